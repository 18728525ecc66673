"""Wildtrack and MultiviewX: cameras that stand still around people whose places are annotated -> recording.

Every camera counts as a drone that hovers. Heatmaps are made from the boxes of the annotations; a detector
sees the pictures where they are there. Who stood where is the recording's truth. Nothing says when the
pictures were taken: stamps begin at `BEGIN_NS` and run as fast as the numbers of the frames.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import get_args

import numpy as np
from PIL import Image

from crowdfence.sources.multi_camera.annotations import Annotated, annotation_files, read_annotations
from crowdfence.sources.multi_camera.box_heatmap import Boxes, box_heatmap
from crowdfence.sources.multi_camera.calibration import FixedCamera, read_cameras
from crowdfence.sources.multi_camera.flat_ground import flat_ground
from crowdfence.sources.multi_camera.layout import PICTURES, Layout, layout_of
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.recorded_truth import FrameTruth, PeopleLog, RecordedPeople
from crowdfence.sources.recording import Frame, PixelSources, Recording

BEGIN_NS = 1_500_000_000_000_000_000
USUAL_SIZE = (1920, 1080)
"""Of the pictures, where there are none to say."""
_SUFFIXES = (".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG")


@dataclass(frozen=True, slots=True)
class MultiCameraOptions:
    """What the recording does not say about itself."""

    boxes: Boxes = "contact"
    """What heatmaps show: the ground that people stand on, or the whole boxes."""

    def __post_init__(self) -> None:
        if self.boxes not in get_args(Boxes):
            raise ValueError(f"boxes is {self.boxes!r}; it must be {' or '.join(get_args(Boxes))}")


def read_multi_camera(folder: Path, options: MultiCameraOptions) -> Recording:
    """Open the folder of a data set. ValueError when its calibrations or annotations cannot be used."""
    layout = layout_of(folder)
    if layout is None:
        raise ValueError(f"{folder} has the layout of neither Wildtrack nor MultiviewX")
    files = annotation_files(folder)
    cameras = read_cameras(folder, layout, _picture_size(folder))
    # Frames and the log of people ask for the same annotations one after the other.
    annotated = lru_cache(maxsize=4)(lambda number: read_annotations(files[number], layout, len(cameras)))
    numbers = {_stamp_ns(layout, number): number for number in files}
    frames = [
        _frame(folder, fixed, at, number, stamp_ns, annotated, options.boxes)
        for stamp_ns, number in numbers.items()
        for at, fixed in enumerate(cameras)
    ]
    warnings = [f"{layout.name} does not say when pictures were taken: stamps are made up"]
    missing = [frame for frame in frames if frame.pixels.image is None]
    if 0 < len(missing) < len(frames):
        first = f"{missing[0].drone} of number {numbers[missing[0].stamp_ns]}"
        warnings.append(f"{len(missing)} of {len(frames)} pictures are not there, the first {first}")
    return Recording(
        name=folder.resolve().name,
        drones=tuple(fixed.name for fixed in cameras),
        frames=tuple(frames),
        georeference=None,
        terrain=flat_ground(layout),
        refused=(),
        warnings=tuple(warnings),
        manifest={"kind": layout.name, "path": str(folder), "boxes": options.boxes},
        pose_tracks={fixed.name: _hovering(fixed, list(numbers)) for fixed in cameras},
        people=PeopleLog(list(numbers), lambda stamp_ns: _people(stamp_ns, annotated(numbers[stamp_ns]))),
    )


def _frame(
    folder: Path,
    fixed: FixedCamera,
    at: int,
    number: int,
    stamp_ns: int,
    annotated: Callable[[int], Annotated],
    boxes: Boxes,
) -> Frame:
    picture = _picture(folder, fixed.name, number)
    pixels = PixelSources(
        image=None if picture is None else picture.read_bytes,
        heatmap=lambda: box_heatmap(fixed, annotated(number).boxes[at], boxes),
    )
    truth = FrameTruth(exposure_ns=partial(int, stamp_ns))
    return Frame(fixed.name, stamp_ns, fixed.camera, fixed.world_from_camera, pixels, truth)


def _people(stamp_ns: int, annotated: Annotated) -> RecordedPeople:
    """Who belongs to which crowd is not annotated: that follows from the places."""
    crowd = np.zeros(len(annotated.person), np.uint32)
    return RecordedPeople(stamp_ns, annotated.position, annotated.person, crowd)


def _hovering(fixed: FixedCamera, stamps_ns: list[int]) -> PoseTrack:
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(fixed.world_from_camera[:3, :3]).as_quat()
    count = len(stamps_ns)
    return PoseTrack(
        np.array(stamps_ns, np.int64),
        np.tile(fixed.world_from_camera[:3, 3], (count, 1)),
        np.tile([w, x, y, z], (count, 1)),
    )


def _stamp_ns(layout: Layout, number: int) -> int:
    return BEGIN_NS + round(number / layout.frames_per_s * 1e9)


def _picture_size(folder: Path) -> tuple[int, int]:
    """(width, height) of the first picture; all have one size."""
    first = next((path for path in sorted((folder / PICTURES).glob("*/*")) if path.suffix in _SUFFIXES), None)
    if first is None:
        return USUAL_SIZE
    with Image.open(first) as picture:
        return picture.size


def _picture(folder: Path, camera: str, number: int) -> Path | None:
    """Wildtrack writes eight digits, MultiviewX four."""
    names = (f"{number:0{digits}}{suffix}" for digits in (8, 4, 5, 6) for suffix in _SUFFIXES)
    return next((path for name in names if (path := folder / PICTURES / camera / name).is_file()), None)
