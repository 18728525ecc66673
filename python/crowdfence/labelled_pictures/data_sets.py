"""Data sets of people seen by drones, as they come from their makers -> annotated pictures.

visdrone    VisDrone-DET: images/*.jpg and annotations/*.txt; x, y, width, height, score, class, truncation,
            occlusion, of which class 0 is ignored and 1 and 2 are people, who are ignored too where the score
            is 0
dronecrowd  DroneCrowd: images/imgSSSFFF.jpg and ground_truth/GT_imgSSSFFF.mat with the heads as image_info
upcount     UP-COUNT: images/**/NAME__ALTITUDE.jpg and labels/**/NAME__ALTITUDE.txt with the heads, x y a line
coco        any folder with a COCO file

Whoever imports one has its licence; none comes with crowdfence.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import one_line, quoted
from crowdfence.labelled_pictures.annotated_picture import (
    AnnotatedPicture,
    AnnotationError,
    Role,
    people_at_points,
    people_in_boxes,
    rectangle,
)
from crowdfence.labelled_pictures.coco import ANNOTATIONS, annotation_file, read_coco
from crowdfence.sources.pictures.decoding import UPRIGHT, orientation, turned_fault

_MOST_LINES = 100_000
_SUFFIXES = (".jpg", ".jpeg", ".png")
_IMAGES = "images"
_LABELS = {
    "visdrone": ("annotations", ".txt", ""),
    "dronecrowd": ("ground_truth", ".mat", "GT_"),
    "upcount": ("labels", ".txt", ""),
}
"""Folder of the labels, how their names end, and what they begin with."""
_VISDRONE_IGNORED, _VISDRONE_PEOPLE = 0, (1, 2)


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """What the files of a data set do not say."""

    gsd_m: float | None = None
    """Metres per pixel of every picture."""
    hfov_deg: float | None = None
    """Horizontal field of view, for data that state the altitude: metres per pixel straight down."""
    every: int = 1
    """Only every n-th picture."""
    roles: Mapping[str, Role] | None = None
    """What further class names of a COCO file mean."""


def read_data_set(kind: str, folder: Path, options: ImportOptions) -> Iterator[AnnotatedPicture]:
    """The pictures of a data set, one after the other. AnnotationError in one line for files that are none of
    its kind, FileNotFoundError where nothing of it is found."""
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder} is no folder")
    for picture in KINDS[kind](folder, options):
        yield picture if options.gsd_m is None else replace(picture, gsd_m=options.gsd_m)


def labels_without_picture(kind: str, folder: Path) -> list[Path]:
    """Files of labels of which no picture is there: nothing of them is imported. Of a COCO file, that is an
    error."""
    if kind not in _LABELS:
        return []
    place, suffix, prefix = _LABELS[kind]
    pictured = {_labels_of(image, folder, kind) for image in _pictures(folder)}
    found = sorted((folder / place).rglob(f"{prefix}*{suffix}"))
    return [path for path in found if path not in pictured and not path.name.startswith(".")]


def stored_turned(pictures: Sequence[AnnotatedPicture]) -> list[Path]:
    """Those that ask to be turned (EXIF Orientation): nothing is measured on them, as their marks may mean
    the stored picture or the one that is shown."""
    return [picture.path for picture in pictures if _orientation(picture.path) != UPRIGHT]


def _visdrone(folder: Path, options: ImportOptions) -> Iterator[AnnotatedPicture]:
    for image, labels in _pairs(folder, "visdrone", options.every):
        rows = _table(labels, 8, separator=",")
        if (turned := rows[(rows[:, 2:4] < 0.0).any(axis=1)]).size:
            # Written as COCO, it would be refused by whoever opens the import.
            width, height = turned[0, 2:4]
            raise AnnotationError(f"{labels}: a box of {width:g} x {height:g} pixels; allowed: at least 0")
        score, kind = rows[:, 4], rows[:, 5]
        are_people = np.isin(kind, _VISDRONE_PEOPLE)
        people = rows[are_people & (score != 0)]
        ignored = rows[(kind == _VISDRONE_IGNORED) | (are_people & (score == 0))]
        yield AnnotatedPicture(
            image,
            *_size(image),
            people_in_boxes(people[:, :4]),
            ignored=tuple(rectangle(*row[:4].tolist()) for row in ignored),
        )


def _dronecrowd(folder: Path, options: ImportOptions) -> Iterator[AnnotatedPicture]:
    for image, labels in _pairs(folder, "dronecrowd", options.every):
        yield AnnotatedPicture(image, *_size(image), people_at_points(_heads(labels)))


def _upcount(folder: Path, options: ImportOptions) -> Iterator[AnnotatedPicture]:
    for image, labels in _pairs(folder, "upcount", options.every):
        width, height = _size(image)
        heads = _table(labels, 2)
        gsd_m = None if options.hfov_deg is None else _straight_down(image, options.hfov_deg, width)
        yield AnnotatedPicture(image, width, height, people_at_points(heads), gsd_m=gsd_m)


def _coco(folder: Path, options: ImportOptions) -> Iterator[AnnotatedPicture]:
    file = annotation_file(folder)
    if file is None:
        raise FileNotFoundError(
            f"{folder} holds no JSON file, or several, with images and annotations: it takes one "
            f"{ANNOTATIONS} there, which names pictures below {folder}"
        )
    for picture in read_coco(file, options.roles)[:: options.every]:
        marked = (picture.width, picture.height)
        if picture.path.is_file() and (size := _size(picture.path)) != marked:
            if size[::-1] == marked and (told := _orientation(picture.path)) != UPRIGHT:
                raise AnnotationError(f"{picture.path} {turned_fault(told)}")
            raise AnnotationError(
                f"{picture.path} has {size[0]} x {size[1]} pixels, its marks are of {marked[0]} x {marked[1]}"
                ": they would lie beside what they mark"
            )
        yield picture


KINDS: dict[str, Callable[[Path, ImportOptions], Iterator[AnnotatedPicture]]] = {
    "visdrone": _visdrone,
    "dronecrowd": _dronecrowd,
    "upcount": _upcount,
    "coco": _coco,
}


def _pictures(folder: Path) -> list[Path]:
    # Cameras write .JPG; a picture that is passed over is one without its crowd.
    return sorted(path for path in (folder / _IMAGES).rglob("*") if path.suffix.lower() in _SUFFIXES)


def _labels_of(image: Path, folder: Path, kind: str) -> Path:
    """They lie the same way below another folder."""
    place, suffix, prefix = _LABELS[kind]
    labels = (folder / place / image.relative_to(folder / _IMAGES)).with_suffix(suffix)
    return labels.with_name(f"{prefix}{labels.name}")


def _pairs(folder: Path, kind: str, every: int) -> Iterator[tuple[Path, Path]]:
    """Pictures with their files of labels."""
    found = _pictures(folder)
    if not found:
        raise FileNotFoundError(f"{folder / _IMAGES} holds no picture ({', '.join(_SUFFIXES)})")
    of_labels: dict[Path, Path] = {}
    for image in found:
        other = of_labels.setdefault(_labels_of(image, folder, kind), image)
        if other is not image:
            raise AnnotationError(f"{image} and {other.name} have the same labels: keep one of them")
    for image in found[::every]:
        labels = _labels_of(image, folder, kind)
        if not labels.is_file():
            raise FileNotFoundError(f"{labels}: no labels of {image.name}")
        yield image, labels


def _size(image: Path) -> tuple[int, int]:
    """Width and height of a picture, from its header."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(image) as picture:
            return picture.size
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError) as error:
        raise AnnotationError(f"{image} cannot be read as a picture: {error}") from None


def _orientation(image: Path) -> int:
    """EXIF Orientation of a picture that can be opened."""
    from PIL import Image

    with Image.open(image) as picture:
        return orientation(picture)


def _table(path: Path, columns: int, *, separator: str | None = None) -> NDArray[np.float64]:
    """Rows [N, columns] of finite numbers; empty lines and a separator at the end are no harm. Lines of more
    are of another kind of data, whose columns mean something else."""
    rows = []
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise AnnotationError(f"{path} is no text of numbers") from None
    if len(lines) > _MOST_LINES:
        raise AnnotationError(f"{path} has {len(lines):,} lines; allowed: {_MOST_LINES:,}")
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        words = line.split(separator)
        if not words[-1].strip():
            words.pop()
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != columns or not all(map(math.isfinite, values)):
            raise AnnotationError(f"{path}, line {number}: {quoted(line)}; allowed: {columns} finite numbers")
        rows.append(values)
    return np.array(rows, np.float64).reshape(-1, columns)


def _heads(path: Path) -> NDArray[np.float64]:
    """Points [N, 2] of a file of DroneCrowd: image_info is the points, or holds them three levels down."""
    from scipy.io import loadmat

    try:
        info: Any = loadmat(path)["image_info"]
        while isinstance(info, np.ndarray) and info.dtype == object and info.size:
            info = info.flat[0]
        if isinstance(info, np.void) or (isinstance(info, np.ndarray) and info.dtype.names):
            info = np.asarray(info).flat[0][0]
        while isinstance(info, np.ndarray) and info.dtype == object and info.size:
            info = info.flat[0]
        points = np.asarray(info, np.float64)
    except Exception as error:  # what loadmat raises for damaged files has no base class
        raise AnnotationError(f"{path} is no MATLAB file with image_info: {one_line(error)}") from None
    if points.size == 0:
        return np.empty((0, 2))
    # Of heads that lie the other way, one a column, all but two would be lost; some give each a number.
    if points.ndim != 2 or points.shape[1] not in (2, 3) or not np.isfinite(points[:, :2]).all():
        raise AnnotationError(f"{path}: image_info has shape {list(points.shape)}; allowed: finite [N, 2]")
    return points[:, :2]


def _straight_down(image: Path, hfov_deg: float, width: int) -> float:
    """Metres per pixel of a picture taken straight down from the altitude at the end of its name."""
    written = image.stem.rpartition("__")[2]
    try:
        altitude_m = float(written)
    except ValueError:
        altitude_m = math.nan
    if not (math.isfinite(altitude_m) and altitude_m > 0.0):
        raise AnnotationError(f"{image.name} does not end in the altitude in metres, as NAME__35.2.jpg does")
    return 2.0 * altitude_m * math.tan(math.radians(hfov_deg) / 2.0) / width
