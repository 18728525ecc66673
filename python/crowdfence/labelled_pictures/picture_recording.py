"""A folder of annotated pictures as the frames that a detector is trained, calibrated and judged on.

They have no poses and no map: cameras and stamps are placeholders, 10 s apart, so that every picture is
resampled on its own. Nothing but labelled measurements may open such a folder.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.errors import FrameError
from crowdfence.labelled_pictures.annotated_picture import AnnotatedPicture, left_out_classes, painted_groups
from crowdfence.labelled_pictures.coco import annotation_file, read_coco
from crowdfence.labelled_pictures.crowd_labels import PictureLabels, picture_labels
from crowdfence.sources.recording import Frame, PixelSources, Recording

PICTURES = "labelled pictures"
"""Under this key the manifest names the file of annotations."""
_IMPORT = "if some are people, `crowdfence data import coco --class NAME=person, crowd or ignore` says so"
_APART_NS = 10_000_000_000


class LabelledPictures(NamedTuple):
    """A recording of pictures, and the labels of its frames [H, W]; they raise FrameError where the
    annotations of a picture cannot be used."""

    recording: Recording
    crowd: Callable[[Frame], NDArray[np.bool_]]
    ignored: Callable[[Frame], NDArray[np.bool_]]
    gsd_m: Callable[[Frame], float | None] | None
    """Metres per pixel of the picture of a frame, as its annotations state them; None: no picture has any."""


def is_labelled_pictures(path: Path) -> bool:
    return annotation_file(path) is not None


def open_labelled_pictures(folder: Path) -> LabelledPictures:
    """AnnotationError or OSError when the annotations cannot be read, or there are none."""
    file = annotation_file(folder)
    if file is None:
        raise FileNotFoundError(f"{folder} holds no pictures with COCO annotations")
    pictures = read_coco(file)
    of_stamp = {number * _APART_NS: picture for number, picture in enumerate(pictures)}
    labels = _Labels(of_stamp)
    frames = tuple(_frame(folder, stamp_ns, picture, labels) for stamp_ns, picture in of_stamp.items())
    drones = tuple(dict.fromkeys(frame.drone for frame in frames))
    _, left_out = left_out_classes(pictures)
    # Where people or crowds have such a class, what shows them would pass for empty ground without a word.
    meaningless = f"{left_out}, so where they are nobody is; {_IMPORT}" if left_out else ""
    warnings = tuple(filter(None, (meaningless, painted_groups(pictures))))
    recording = Recording(folder.name, drones, frames, None, None, (), warnings, {PICTURES: str(file)}, {})
    states_gsd = any(picture.gsd_m is not None for picture in pictures)
    return LabelledPictures(recording, labels.crowd, labels.ignored, labels.gsd_m if states_gsd else None)


class _Labels:
    """Labels of a picture, kept for the one that was asked for last."""

    def __init__(self, pictures: dict[int, AnnotatedPicture]) -> None:
        self._pictures = pictures
        self._last: tuple[int, PictureLabels] | None = None

    def crowd(self, frame: Frame) -> NDArray[np.bool_]:
        return self.of(frame.drone, frame.stamp_ns).crowd

    def ignored(self, frame: Frame) -> NDArray[np.bool_]:
        return self.of(frame.drone, frame.stamp_ns).ignored

    def gsd_m(self, frame: Frame) -> float | None:
        return self._pictures[frame.stamp_ns].gsd_m

    def of(self, drone: str, stamp_ns: int) -> PictureLabels:
        if self._last is None or self._last[0] != stamp_ns:
            try:
                self._last = stamp_ns, picture_labels(self._pictures[stamp_ns])
            except ValueError as error:
                raise FrameError(drone, stamp_ns, str(error)) from error
        return self._last[1]


def _frame(folder: Path, stamp_ns: int, picture: AnnotatedPicture, labels: _Labels) -> Frame:
    camera = Camera.pinhole(
        picture.width, picture.height, picture.width, picture.width, picture.width / 2, picture.height / 2
    )
    name = picture.path.relative_to(folder).as_posix()
    pixels = PixelSources(image=picture.path.read_bytes, regions=partial(_regions, labels, name, stamp_ns))
    return Frame(name, stamp_ns, camera, np.eye(4), pixels)


def _regions(labels: _Labels, drone: str, stamp_ns: int) -> NDArray[np.uint8]:
    return labels.of(drone, stamp_ns).crowd.astype(np.uint8)
