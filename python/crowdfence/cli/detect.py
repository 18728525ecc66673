"""`crowdfence detect`: pictures, a video or a recording -> heatmaps."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.atomic_file import replaceable_file, writable_folder
from crowdfence.cli import console, options, source_options
from crowdfence.cli.detector_choice import tell_choice
from crowdfence.cli.option_sets import FlightOptions, MapOptions, SourceOptions, map_options, takes
from crowdfence.cli.refusals import refusal_lines
from crowdfence.cli.unused_options import refuse_unused
from crowdfence.cli.wording import counted, in_options
from crowdfence.detector.shipped import PHOTOGRAPH_MODEL

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector
    from crowdfence.sources.recording import Recording

MOST_REASONS_SHOWN = 12

_OF_RECORDINGS = (MapOptions, SourceOptions, FlightOptions)


@takes(*_OF_RECORDINGS, before="force")
def detect(
    context: typer.Context,
    source: Annotated[
        Path, typer.Argument(help="Video, picture, folder of pictures, or recording (every drone of it).")
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Folder for the heatmaps; for a recording, and for a film or photographs that know where "
            "they were taken, a mission file (.mcap).",
        ),
    ],
    models: Annotated[
        list[str] | None,
        typer.Option(
            "--detector",
            metavar="MODEL",
            help="ONNX model, several to combine them. Default, of those that come with crowdfence: "
            "crowdnet-s for recordings whose pictures look like those that it was tested on, else "
            "crowdnet-s-wide.",
        ),
    ] = None,
    called_model: Annotated[list[str] | None, typer.Option("--model", hidden=True)] = None,
    contract: options.ContractPath = None,
    threads: Annotated[int, typer.Option("--threads", min=1, max=1024, help="Threads of the model.")] = 1,
    device: options.DeviceOption = options.DeviceChoice.cpu,
    every: Annotated[
        int,
        typer.Option("--every", min=1, help="Only every N-th frame (of each drone); the rest is left out."),
    ] = 1,
    video: Annotated[
        bool | None,
        typer.Option(
            "--video/--no-video", help="Overlay video. Default: for pictures and videos, not for recordings."
        ),
    ] = None,
    gsd_m: Annotated[
        float | None,
        typer.Option(
            "--gsd-m",
            "--gsd",
            min=1e-6,
            max=1e3,
            help="Metres per pixel of the pictures, where known; not for recordings.",
        ),
    ] = None,
    enlarge: options.EnlargeOption = options.EnlargeChoice.always,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Write the heatmaps that a detector makes of pictures, and a video that shows them over the pictures."""
    from crowdfence.pipeline import named_detector, suitable_model
    from crowdfence.sources import is_flight, is_recording

    with_poses = is_recording(source) or (output.suffix == ".mcap" and is_flight(source))
    named = [*(models or []), *(called_model or [])]
    named_by_options = partial(
        named_detector, contract=contract, threads=threads, device=device.value, enlarge=enlarge.value
    )
    if not with_poses:
        for unused in _OF_RECORDINGS:
            refuse_unused(context, unused.__annotations__, "for pictures without poses")
        with writable_folder(output):
            names = named or [PHOTOGRAPH_MODEL]
            detector = named_by_options(names)
            if detector.needs_gsd and gsd_m is None:
                raise ValueError(
                    f"{detector.contract.name} needs metres per pixel, which pictures without poses do not "
                    "tell: give them with --gsd-m"
                )
            _detect_pictures(source, detector, output, every, video is not False, gsd_m, force, as_json)
        return
    if gsd_m is not None:
        raise ValueError("--gsd-m: a recording knows its metres per pixel from poses and map")
    if output.suffix.lower() != ".mcap" and not output.is_dir():
        raise ValueError(f"{output}: for a recording the output is a mission file, whose name ends in .mcap")
    if output.is_dir():
        raise ValueError(
            f"{output} is a folder; for a recording the output is a mission file: give a name.mcap"
        )
    with replaceable_file(output, force=force, reads=[source]):
        recording = source_options.open_source(source, context.params)
        names = named or [suitable_model(recording)]
        detector = named_by_options(names)
        if not named:
            tell_choice(detector)
        _detect_recording(recording, detector, context.params, output, every, bool(video), force, as_json)


def _detect_pictures(
    source: Path,
    detector: Detector,
    output: Path,
    every: int,
    video: bool,
    gsd_m: float | None,
    force: bool,
    as_json: bool,
) -> None:
    from crowdfence.exports.heatmap_folder import HEATMAPS
    from crowdfence.heatmap_files import OVERLAY, detect_pictures
    from crowdfence.sources.photographs.tags import is_thermal_picture
    from crowdfence.sources.pictures.files import SUFFIXES, is_picture_file, picture_files, read_pictures
    from crowdfence.sources.pictures.left_out import left_out
    from crowdfence.sources.pictures.thermal import is_named_thermal

    missed = left_out(source, SUFFIXES, except_for=(HEATMAPS, OVERLAY)) if source.is_dir() else []
    with ExitStack() as stack:
        if source.is_dir() or is_picture_file(source):
            files = picture_files(source)
            stream, count = read_pictures(files, every=every), len(files)
            missed += _thermal([file for file in files[::every] if is_thermal_picture(file)])
        else:
            from crowdfence.sources.pictures.video import Video, left_aside, squeezed

            film = stack.enter_context(Video(source))
            missed += _thermal([source] if is_named_thermal(source.stem) else [])
            doubts = squeezed(film.pixel_aspect), left_aside(film.further_films)
            missed += [f"{source} {doubt}" for doubt in doubts if doubt]
            stream, count = film.pictures(every=every), film.frame_count or 0
        advance = stack.enter_context(console.progress("detecting", -(-count // every), "frames"))
        try:
            done = detect_pictures(
                stream,
                detector,
                output,
                video=video,
                gsd_m=gsd_m,
                source=source,
                replace_existing=force,
                on_picture=advance,
            )
        except ValueError as error:
            raise ValueError(f"{source}: {error}") from error
    warnings, skipped = [*done.warnings, *missed], [str(one) for one in done.skipped]
    if as_json:
        report = {"output": str(output), "frames": done.frames, "skipped": skipped}
        report |= {"pictures": done.watch.to_json(), "warnings": warnings}
        console.print_json({**report, "detector": _described(detector)})
        return
    facts = {"frames": f"{counted(done.frames, 'heatmap')}, {len(skipped)} skipped"}
    if done.watch.looked_at:
        facts["unlike tested"] = f"{done.watch.unlike} of {done.watch.looked_at} pictures"
    _report(output, detector, facts, [*warnings, *skipped])


def _thermal(files: Sequence[Path]) -> Iterator[str]:
    """One sentence of pictures of warmth, or of a film, where there are any."""
    from crowdfence.sources.pictures.thermal import THERMAL

    if files:
        first = files[0].name
        which = f"{first} is" if len(files) == 1 else f"{len(files)} pictures, first: {first}, each is"
        yield (
            f"{which} {THERMAL}: they call the ground empty; take the pictures of colours of the same shots, "
            "or give --detector one that was trained on thermal pictures"
        )


def _detect_recording(
    recording: Recording,
    detector: Detector,
    chosen: dict[str, Any],
    output: Path,
    every: int,
    video: bool,
    force: bool,
    as_json: bool,
) -> None:
    from crowdfence.config import ProjectionConfig
    from crowdfence.heatmap_files import detect_recording
    from crowdfence.pipeline import heatmap_source, read_map, review_flight
    from crowdfence.sources.ground_contact import on_ground

    terrain = chosen["terrain"]
    mapped = terrain is not None or recording.terrain is not None
    is_of_ground = detector.uses_gsd or detector.contract.validity is not None
    wanted = detector.needs_gsd or (is_of_ground and mapped)
    found = read_map(recording, terrain, **map_options(chosen)) if wanted else None
    ground = None if found is None else found.terrain
    if ground is not None:
        recording = on_ground(recording, ground)
    max_range_m = ProjectionConfig().max_range_m
    heatmaps = heatmap_source(detector, ground, max_range_m)
    # Whoever fuses heatmaps has only them: what their detector was not tested for is told now or never.
    of_flight = review_flight(heatmaps, recording, ground, max_range_m).warnings
    with console.progress("detecting", -(-len(recording.frames) // every), "frames") as advance:
        done = detect_recording(
            recording,
            heatmaps,
            output,
            video=video,
            every=every,
            replace_existing=force,
            progress=lambda *_: advance(),
        )
    refused = [*map(str, done.conversion.refused), *done.conversion.omitted]
    told = [*refusal_lines(done.conversion.refused), *done.conversion.omitted]
    of_map = () if found is None else found.doubts
    warnings = [*recording.warnings, *of_map, *of_flight, *heatmaps.warnings]
    if ground is None:
        warnings.insert(0, f"no map: no range could be checked against those of {detector.contract.name}")
    if as_json:
        report = {"output": str(output), "frames": done.conversion.frames, "skipped": refused}
        report |= {"pictures": heatmaps.watch.to_json(), "warnings": warnings}
        console.print_json(
            {
                **report,
                "videos": list(map(str, done.videos)),
                "detector": _described(detector),
            }
        )
        return
    facts = {"frames": ", ".join(f"{drone} {count}" for drone, count in done.conversion.frames.items())}
    if done.videos:
        facts["videos"] = ", ".join(path.name for path in done.videos)
    # By itself `run` would look at the pictures, which are still in the mission, once more.
    facts["next"] = f"crowdfence run {shlex.quote(str(output))} --detector recorded ..."
    _report(output, detector, facts, [*warnings, *told])


def _described(detector: Detector) -> dict[str, Any]:
    from crowdfence.pipeline import describe_model

    return describe_model(detector.contract, detector.path, detector.members, detector.device)


def _report(output: Path, detector: Detector, facts: dict[str, str], reasons: list[str]) -> None:
    name, version = detector.contract.name, detector.contract.version
    shown = {"detector": f"{name} {version}" if version else name, **facts}
    console.stdout().print(console.facts(str(output), shown))
    for reason in reasons[:MOST_REASONS_SHOWN]:
        console.warn(in_options(reason))
    if len(reasons) > MOST_REASONS_SHOWN:
        console.warn(f"and {len(reasons) - MOST_REASONS_SHOWN} more; --json lists them all")
