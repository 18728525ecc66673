"""`crowdfence data`: other people's labelled pictures as data to train, calibrate and evaluate on."""

from __future__ import annotations

import shutil
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from crowdfence.atomic_file import writable_folder
from crowdfence.cli import console, options
from crowdfence.cli.wording import counted

if TYPE_CHECKING:
    from crowdfence.labelled_pictures.annotated_picture import AnnotatedPicture


app = typer.Typer(help="Labelled pictures of others: import them.", no_args_is_help=True)


class DataSet(str, Enum):
    """Kinds of data sets that can be imported."""

    visdrone = "visdrone"
    dronecrowd = "dronecrowd"
    upcount = "upcount"
    coco = "coco"


@app.callback()
def _group() -> None:
    pass


@app.command("import")
def import_data(
    kind: Annotated[DataSet, typer.Argument(help="Which data set it is.")],
    source: Annotated[Path, typer.Argument(help="Its folder, such as that of VisDrone2019-DET-val.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for the pictures and annotations.json.")
    ],
    gsd_m: Annotated[
        float | None,
        typer.Option("--gsd-m", "--gsd", min=1e-6, help="Metres per pixel, for people marked as points."),
    ] = None,
    hfov_deg: Annotated[
        float | None,
        typer.Option(
            "--hfov-deg", min=1.0, max=170.0, help="upcount: metres per pixel from this and the altitude."
        ),
    ] = None,
    every: Annotated[int, typer.Option("--every", min=1, help="Only every N-th picture.")] = 1,
    roles: Annotated[
        list[str] | None,
        typer.Option(
            "--class",
            metavar="NAME=person|crowd|ignore",
            help="What a class of a COCO file means, where its name does not say so; may be repeated.",
        ),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Turn a data set into a folder that `train`, `calibrate` and `model evaluate` take as --data.

    You need the data set and its licence; nothing is downloaded.
    """
    from crowdfence.labelled_pictures.annotated_picture import distinct, left_out_classes, painted_groups
    from crowdfence.labelled_pictures.coco import ANNOTATIONS, write_coco
    from crowdfence.labelled_pictures.crowd_labels import picture_labels
    from crowdfence.labelled_pictures.data_sets import (
        ImportOptions,
        labels_without_picture,
        read_data_set,
        stored_turned,
    )

    if hfov_deg is not None and kind is not DataSet.upcount:
        raise ValueError(f"--hfov-deg is for upcount, whose pictures tell the altitude, not for {kind.value}")
    if hfov_deg is not None and gsd_m is not None:
        raise ValueError("--hfov-deg and --gsd-m both say how many metres a pixel is: give one of them")
    if roles and kind is not DataSet.coco:
        raise ValueError(f"--class is for coco, whose classes have names of their own, not for {kind.value}")
    wanted = ImportOptions(gsd_m, hfov_deg, every, _roles(roles or []))
    if output.exists() and any(output.iterdir() if output.is_dir() else [output]):
        raise FileExistsError(f"{output} exists and is not empty")
    with writable_folder(output):
        with console.working() as tell:
            tell("reading the annotations")
            found = list(read_data_set(kind.value, source, wanted))
            crowds = sum(bool(picture_labels(picture).crowd.any()) for picture in found)
            unpictured = labels_without_picture(kind.value, source)
            if missing := [picture.path for picture in found if not picture.path.is_file()]:
                raise FileNotFoundError(f"{missing[0]}: annotated, but not there")
            turned = stored_turned(found)
        kept: list[AnnotatedPicture] = []
        with console.progress("copying", len(found), "pictures") as advance:
            for picture in found:
                place = output / "images" / picture.path.relative_to(source)
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(picture.path, place)
                kept.append(replace(picture, path=place))
                advance()
        write_coco(kept, output / ANNOTATIONS)
    sizes = {(picture.width, picture.height) for picture in kept}
    people = sum(len(picture.people) for picture in kept)
    again = people - sum(len(distinct(picture.people)) for picture in kept)
    # CVAT exports all pictures of a task, also those that nobody has labelled yet.
    bare = sum(picture.is_bare for picture in kept)
    left_out, left_out_text = left_out_classes(kept)
    facts: dict[str, Any] = {"output": str(output), "pictures": len(kept), "people": people - again}
    if groups := painted_groups(kept):
        console.warn(groups)
    if len(sizes) > 1 and gsd_m is not None:
        smallest, largest = (f"{width} x {height}" for width, height in (min(sizes), max(sizes)))
        console.warn(
            f"pictures have {len(sizes)} sizes, from {smallest} to {largest} pixels, and {gsd_m:g} m a pixel "
            "is taken for all: in those that were shrunk, people seem to stand closer together than they did"
        )
    if turned:
        console.warn(
            f"{counted(len(turned), 'picture')} stored turned (EXIF Orientation), on which nothing is "
            "measured or trained, as their marks may mean the stored picture or the one that is shown: save "
            f"them with their pixels as the marks mean them and Orientation 1; the first: {turned[0]}"
        )
    if unpictured:
        files = counted(len(unpictured), "file")
        console.warn(f"{files} of labels without a picture, left out, the first: {unpictured[0]}")
    if as_json:
        more = {"left_out": left_out, "labels_without_picture": len(unpictured)}
        more["painted_groups"] = sum(picture.painted_groups for picture in kept)
        console.print_json(
            {
                **facts,
                "pictures_with_crowd": crowds,
                "pictures_without_marks": bare,
                **more,
                "stored_turned": len(turned),
                "repeated": again,
            }
        )
        return
    shown = {
        "pictures": f"{len(kept)}, {crowds} of them with a crowd (three people within 2 m)"
        + (f", {bare} without any mark, where nobody is taken to be" if bare else ""),
        "people": f"{people - again}" + (f", {counted(again, 'mark')} again of the same" if again else ""),
    }
    if left_out:
        shown["left out"] = f"{left_out_text}; --class NAME=person, crowd or ignore says what one means"
    console.stdout().print(console.facts(str(output), shown))


def _roles(pairs: list[str]) -> dict[str, Any]:
    from crowdfence.labelled_pictures.annotated_picture import Role

    roles: dict[str, Any] = {}
    for pair in pairs:
        name, equals, role = pair.rpartition("=")
        if not (name and equals) or role not in get_args(Role):
            raise ValueError(f"--class {pair!r} must be NAME=person, NAME=crowd or NAME=ignore")
        same = name.strip().lower()  # as names of classes are compared
        if roles.get(same, role) != role:
            raise ValueError(f"--class says that {name} is {roles[same]} and that it is {role}: give one")
        roles[same] = role
    return roles
