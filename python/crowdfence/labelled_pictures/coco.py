"""COCO annotations: a folder of pictures with a JSON file, read and written.

    {"images": [{"id": 1, "file_name": "a.jpg", "width": 640, "height": 480}],
     "annotations": [{"image_id": 1, "category_id": 1, "segmentation": [[x, y, ...]]}],
     "categories": [{"id": 1, "name": "crowd"}]}

Annotations are outlines or masks (`segmentation`), boxes (`bbox`: x, y, width, height, turned clockwise by
the degrees of `attributes.rotation`, as of CVAT) or points (`keypoints`: x, y, visibility, of which the first
visible one counts). A group of people marked with `iscrowd` is a crowd; such masks are counted
(`painted_groups`), as CVAT exports every mask so. Of people and crowds marked with `ignore`, as converters of
other data sets do, nothing is said.
Our own key `gsd_m` of an image states its metres per pixel.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from crowdfence.atomic_file import atomic_path
from crowdfence.detector.contract.metadata_values import CROWD_NAMES, PEOPLE_NAMES
from crowdfence.errors import quoted
from crowdfence.labelled_pictures.annotated_picture import (
    AnnotatedPicture,
    AnnotationError,
    Polygon,
    Role,
    people_at_points,
    people_in_boxes,
    rectangle,
    turned,
)
from crowdfence.labelled_pictures.run_lengths import mask_outlines

ANNOTATIONS = "annotations.json"
"""Name of the file that imports write."""
MOST_BYTES = 2_000_000_000
_LARGEST_SIDE = 65_535
_IGNORED_NAMES = frozenset({"ignore", "ignored", "ignored regions", "ignored region"})


def annotation_file(folder: Path) -> Path | None:
    """The COCO file of a folder of pictures: `annotations.json`, else the only JSON file beside or above the
    pictures that holds images and annotations; None for any other folder."""
    if not folder.is_dir():
        return None
    if (folder / ANNOTATIONS).is_file():
        return folder / ANNOTATIONS
    found = [path for path in sorted(folder.glob("*.json")) if _is_coco(path)]
    return found[0] if len(found) == 1 else None


def read_coco(path: Path, roles: Mapping[str, Role] | None = None) -> list[AnnotatedPicture]:
    """The pictures of a COCO file. `roles` says what further class names mean; those of people, crowds and
    ignored regions are known; marks of all others mean nothing, and are `left_out`.

    OSError when it cannot be read; AnnotationError names the file, the place and the value.
    """
    if path.stat().st_size > MOST_BYTES:
        raise AnnotationError(f"{path}: larger than {MOST_BYTES:,} bytes")
    try:
        document = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise AnnotationError(f"{path} is not JSON: {error}") from None
    try:
        return _pictures(document, path.parent, roles or {})
    except AnnotationError as error:
        raise AnnotationError(f"{path}: {error}") from None


def write_coco(pictures: Sequence[AnnotatedPicture], path: Path) -> None:
    """Write what `read_coco` reads; the pictures must lie below the folder of `path`."""
    images, annotations = [], []
    for number, picture in enumerate(pictures, start=1):
        name = picture.path.relative_to(path.parent).as_posix()
        image = {"id": number, "file_name": name, "width": picture.width, "height": picture.height}
        images.append(image if picture.gsd_m is None else {**image, "gsd_m": picture.gsd_m})
        for x, y, width, height in picture.people.tolist():
            box = {"bbox": [x - width / 2.0, y - height, width, height]}
            point = {"keypoints": [x, y, 2], "num_keypoints": 1}
            annotations.append({"image_id": number, "category_id": 1, **(box if height else point)})
        for category, polygons in ((2, picture.crowds), (3, picture.ignored)):
            for polygon in polygons:
                outline = {"segmentation": [polygon.ravel().tolist()]}
                annotations.append({"image_id": number, "category_id": category, **outline})
    for number, annotation in enumerate(annotations, start=1):
        annotation["id"] = number
    categories = [{"id": 1, "name": "person"}, {"id": 2, "name": "crowd"}, {"id": 3, "name": "ignored"}]
    document = {"images": images, "annotations": annotations, "categories": categories}
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(document))


def _is_coco(path: Path) -> bool:
    """Whether a JSON file begins like one of ours or COCO's, and is one."""
    try:
        document = json.loads(path.read_bytes()) if path.stat().st_size <= MOST_BYTES else None
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(document, dict) and {"images", "annotations"} <= document.keys()


def _pictures(document: object, folder: Path, roles: Mapping[str, Role]) -> list[AnnotatedPicture]:
    if not isinstance(document, dict):
        raise AnnotationError(f"must hold an object, got {quoted(document)}")
    names: dict[Any, Any] = {}
    for place, row in _rows(document, "categories"):
        category = _key(row.get("id"), place, "id")
        if category in names:
            raise AnnotationError(
                f"{place}.id {quoted(category)} occurs twice: nobody knows which class is meant"
            )
        names[category] = row.get("name")
    role_of = dict(_roles(_rows(document, "categories"), roles))
    marks: dict[Any, list[tuple[str, Mapping[str, Any], Role]]] = {}
    left_out: dict[Any, list[str]] = {}
    groups: Counter[Any] = Counter()
    for place, row in _rows(document, "annotations"):
        key = _key(row.get("image_id"), place, "image_id")
        category = _key(row.get("category_id"), place, "category_id")
        if category not in names:
            raise AnnotationError(f"{place}.category_id is {quoted(category)}, which is no category")
        role = role_of.get(category)
        is_group, is_ignored = (_flag(row.get(name), f"{place}.{name}") for name in ("iscrowd", "ignore"))
        if role == "person" and is_group:
            role = "crowd"
            groups[key] += isinstance(row.get("segmentation"), dict) and not is_ignored
        if role is not None and is_ignored:
            role = "ignore"
        if role is None:
            left_out.setdefault(key, []).append(names[category])
        else:
            marks.setdefault(key, []).append((place, row, role))
    pictures = []
    seen: set[Any] = set()
    files: set[Path] = set()
    for place, row in _rows(document, "images"):
        key = _key(row.get("id"), place, "id")
        if key in seen:
            raise AnnotationError(f"{place}.id {quoted(key)} occurs twice")
        seen.add(key)
        picture = _picture(place, row, folder, marks.pop(key, []))
        unmeant = tuple(left_out.get(key, ()))
        pictures.append(replace(picture, left_out=unmeant, painted_groups=groups[key]))
        if pictures[-1].path in files:
            name = quoted(row["file_name"])
            raise AnnotationError(
                f"{place}.file_name {name} occurs twice: what is marked there is in two parts"
            )
        files.add(pictures[-1].path)
    if marks:
        place, *_ = next(iter(marks.values()))[0]
        raise AnnotationError(f"{place}.image_id is {quoted(next(iter(marks)))}, which is no image")
    if not pictures:
        raise AnnotationError("holds no image")
    return pictures


def _picture(
    place: str,
    row: Mapping[str, Any],
    folder: Path,
    marks: Sequence[tuple[str, Mapping[str, Any], Role]],
) -> AnnotatedPicture:
    name = row.get("file_name")
    if not isinstance(name, str) or not name or Path(name).is_absolute() or ".." in Path(name).parts:
        raise AnnotationError(f"{place}.file_name is {quoted(name)}; allowed: a path below {folder}")
    width, height = (_side(row.get(side), f"{place}.{side}") for side in ("width", "height"))
    gsd_m = row.get("gsd_m")
    if gsd_m is not None and (not _is_number(gsd_m) or gsd_m <= 0.0):
        raise AnnotationError(f"{place}.gsd_m is {quoted(gsd_m)}; allowed: metres above 0")
    people: list[list[float]] = []
    polygons: dict[str, list[Polygon]] = {"crowd": [], "ignore": []}
    for where, mark, role in marks:
        if role == "person":
            people.append(_person(mark, where, width, height))
            continue
        # Ground in the hole of what is ignored, such as all around a field, was labelled as any other.
        outlines = _outlines(mark, where, width, height, filled=role == "crowd")
        if role == "crowd" and not any(map(_has_area, outlines)):
            raise AnnotationError(f"{where} is a crowd without area: its corners lie in one line")
        polygons[role] += outlines
    return AnnotatedPicture(
        folder / name,
        width,
        height,
        np.array(people, np.float64).reshape(-1, 4),
        tuple(polygons["crowd"]),
        tuple(polygons["ignore"]),
        None if gsd_m is None else float(gsd_m),
    )


def _person(mark: Mapping[str, Any], where: str, width: int, height: int) -> list[float]:
    """x, y of the feet, width, height."""
    box = _box(mark, where)
    has_size = box is not None and max(box[2:]) > 0.0
    if not has_size and mark.get("keypoints"):
        points = np.array(_numbers(mark["keypoints"], f"{where}.keypoints", None))
        if len(points) % 3 == 0 and (points[2::3] > 0.0).any():
            first = int(np.flatnonzero(points[2::3] > 0.0)[0])
            return [float(value) for value in people_at_points(points[3 * first : 3 * first + 2])[0]]
    if box is not None and _turn_deg(mark) == 0.0 and (has_size or not mark.get("segmentation")):
        return [float(value) for value in people_in_boxes(np.array(box))[0]]
    corners = np.concatenate(_outlines(mark, where, width, height))
    low, high = corners.min(axis=0), corners.max(axis=0)
    return [float(value) for value in people_in_boxes(np.concatenate([low, high - low]))[0]]


def _outlines(
    mark: Mapping[str, Any], where: str, width: int, height: int, *, filled: bool = True
) -> list[Polygon]:
    """Polygons of a mark, at least one; its box where it has none."""
    outline = mark.get("segmentation")
    if isinstance(outline, list) and outline:
        polygons = [_numbers(one, f"{where}.segmentation", None) for one in outline]
        for one in polygons:
            if len(one) < 6 or len(one) % 2:
                raise AnnotationError(
                    f"{where}.segmentation has {len(one)} numbers; allowed: x, y of 3 corners and more"
                )
        return [np.array(one, np.float64).reshape(-1, 2) for one in polygons]
    if outline and isinstance(outline, dict):
        if not (parts := mask_outlines(outline, width, height, where, filled=filled)):
            raise AnnotationError(f"{where}.segmentation is a mask without a pixel")
        return parts
    if (box := _box(mark, where)) is not None:
        return [turned(rectangle(*box), _turn_deg(mark))]
    raise AnnotationError(f"{where} has no outline (segmentation), no box (bbox) and no point (keypoints)")


def _has_area(polygon: Polygon) -> bool:
    return bool(np.linalg.matrix_rank(polygon[1:] - polygon[0]) == 2)


def _box(mark: Mapping[str, Any], where: str) -> list[float] | None:
    """x, y, width, height; None where there is none. Four zeros are none: so does COCO Annotator fill the
    place of one beside points and outlines, and everybody would stand in the corner of the picture."""
    if not mark.get("bbox"):
        return None
    box = _numbers(mark["bbox"], f"{where}.bbox", 4)
    if box[2] < 0.0 or box[3] < 0.0:
        raise AnnotationError(f"{where}.bbox is {quoted(box)}; allowed: width and height of at least 0")
    return box if any(box) else None


def _turn_deg(mark: Mapping[str, Any]) -> float:
    """By how much the box is turned about its middle, clockwise, as CVAT states it; 0 for outlines, which
    are as they are."""
    attributes = mark.get("attributes")
    turn: Any = attributes.get("rotation") if isinstance(attributes, dict) else None
    return float(turn) if _is_number(turn) and not mark.get("segmentation") else 0.0


def _roles(
    rows: Iterator[tuple[str, Mapping[str, Any]]], given: Mapping[str, Role]
) -> Iterator[tuple[Any, Role]]:
    named = {name.strip().lower(): role for name, role in given.items()}
    known: dict[str, Role] = {
        **dict.fromkeys(PEOPLE_NAMES, "person"),
        **dict.fromkeys(CROWD_NAMES, "crowd"),
        **dict.fromkeys(_IGNORED_NAMES, "ignore"),
        **named,
    }
    names = []
    for place, row in rows:
        name = row.get("name")
        if not isinstance(name, str):
            raise AnnotationError(f"{place}.name is {quoted(name)}; allowed: text")
        names.append(name.strip().lower())
        if names[-1] in known:
            yield _key(row.get("id"), place, "id"), known[names[-1]]
    if missing := [name for name in named if name not in names]:
        raise AnnotationError(f"no class is named {quoted(missing[0])}; it has {quoted(', '.join(names))}")
    if not any(name in known for name in names):
        raise AnnotationError(
            f"no class is of people or crowds; it has {quoted(', '.join(names))}: say what they mean (data "
            "import coco --class NAME=person)"
        )


def _rows(document: Mapping[str, Any], name: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    rows = document.get(name)
    if not isinstance(rows, list):
        raise AnnotationError(f"{name} is {quoted(rows)}; allowed: a list")
    for number, row in enumerate(rows):
        if not isinstance(row, dict):
            raise AnnotationError(f"{name}[{number}] is {quoted(row)}; allowed: an object")
        yield f"{name}[{number}]", row


def _key(value: object, place: str, name: str) -> int | str:
    if isinstance(value, bool) or not isinstance(value, (int, str)):
        raise AnnotationError(f"{place}.{name} is {quoted(value)}; allowed: a whole number or text")
    return value


def _flag(value: object, where: str) -> bool:
    """Of what is neither, as of "1", nobody knows whether a group of people is one person."""
    if value is not None and value not in (0, 1):  # true and false are 1 and 0
        raise AnnotationError(f"{where} is {quoted(value)}; allowed: 0 or 1")
    return value == 1


def _side(value: object, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= _LARGEST_SIDE:
        raise AnnotationError(f"{where} is {quoted(value)}; allowed: pixels from 1 to {_LARGEST_SIDE}")
    return value


def _numbers(value: object, where: str, count: int | None) -> list[float]:
    if not isinstance(value, list) or not all(_is_number(one) for one in value):
        raise AnnotationError(f"{where} is {quoted(value)}; allowed: a list of finite numbers")
    if count is not None and len(value) != count:
        raise AnnotationError(f"{where} has {len(value)} numbers; allowed: {count}")
    return [float(one) for one in value]


def _is_number(value: object) -> bool:
    """Whether it is one, and finite as a float: whole numbers of JSON have no end."""
    return (
        isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
    )
