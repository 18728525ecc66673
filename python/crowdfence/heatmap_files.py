"""Pictures or a recording through a detector: heatmaps on disk, and videos for people to look at."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from crowdfence.atomic_file import require_replaceable
from crowdfence.detector.blank_picture import blank_reason
from crowdfence.detector.combination import combination_warnings
from crowdfence.detector.overlay import caption, overlay
from crowdfence.detector.validity import shrunk_warnings, tested_range
from crowdfence.exports.heatmap_folder import HEATMAPS, INDEX, HeatmapFolder
from crowdfence.exports.video import VideoWriter, video_size
from crowdfence.iso_time import iso_utc
from crowdfence.pipeline.detect import HeatmapSource
from crowdfence.pipeline.picture_watch import PictureWatch
from crowdfence.sources.convert import Conversion, convert
from crowdfence.sources.pictures.stream import PictureStream, SkippedPicture, StreamPicture, check_every
from crowdfence.sources.recording import Frame, Pixels, Recording

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract
    from crowdfence.detector.detector import Detector

OVERLAY = "overlay.mp4"
PICTURES_PER_S = 4
"""In the video of pictures that have no time of their own."""
_MOST_REASONS = 3


@dataclass(frozen=True, slots=True)
class DetectedPictures:
    """The outcome for a stream of pictures."""

    frames: int
    """Heatmaps written."""
    skipped: list[SkippedPicture]
    """Pictures without a heatmap: they could not be read, show nothing, or the detector refused
    them."""
    watch: PictureWatch
    """Which of them look unlike everything that the detector was tested on."""
    warnings: tuple[str, ...]
    """What nobody can know about these pictures, one sentence each."""


@dataclass(frozen=True, slots=True)
class DetectedRecording:
    """The outcome for a recording."""

    conversion: Conversion
    videos: list[Path]


def detect_pictures(
    stream: PictureStream,
    detector: Detector,
    folder: Path,
    *,
    video: bool = True,
    gsd_m: float | None = None,
    source: Path | None = None,
    replace_existing: bool = False,
    on_picture: Callable[[], None] = lambda: None,
) -> DetectedPictures:
    """Write a `HeatmapFolder` and, with `video`, `overlay.mp4` beside it; one picture in memory at a time.

    `gsd_m`: metres per pixel, for models that need them. `source`: where the pictures come from.

    ValueError when not a single picture gives a heatmap; nothing is left behind then, and what
    `replace_existing` allows to replace stays. FileExistsError when something of that name is there, and
    even with `replace_existing` when it is the source.
    """
    _require_place(folder, source, replace_existing=replace_existing)
    frames, skipped, watch = 0, list[SkippedPicture](), PictureWatch(detector.contract)
    sizes: set[tuple[int, int]] = set()
    """Widths and heights."""
    with ExitStack() as stack:
        heatmaps = stack.enter_context(HeatmapFolder(folder, replace=replace_existing))
        film = stack.enter_context(VideoWriter(folder / OVERLAY)) if video else None
        for item in stream:
            found = _detected(item, detector, gsd_m)
            if isinstance(found, SkippedPicture):
                skipped.append(found)
            else:
                picture, heatmap = found
                unlike = watch.look(_label(picture), picture.rgb)
                sizes.add((picture.rgb.shape[1], picture.rgb.shape[0]))
                watch.answered(heatmap)
                heatmaps.add(picture.number, picture.name, picture.time_s, heatmap, unlike_tested=unlike)
                if film is not None:
                    time_s = frames / PICTURES_PER_S if picture.time_s is None else picture.time_s
                    note = "  unlike everything tested" if unlike else ""
                    film.write(_looked_at(picture.rgb, heatmap, f"{_label(picture)}{note}"), time_s)
                frames += 1
            on_picture()
        if frames == 0:
            reasons = "; ".join(str(one) for one in skipped[:_MOST_REASONS]) or "it holds no frame"
            raise ValueError(f"no picture could be used: {reasons}")
    if not video:
        (folder / OVERLAY).unlink(missing_ok=True)  # it would show other heatmaps than those beside it
    models = [member.contract for member in detector.members] or [detector.contract]
    warnings = (
        *_unknown_scale(detector, gsd_m),
        *shrunk_warnings(models, sizes, gsd_m),
        *combination_warnings(detector.contract),
        *watch.warnings,
    )
    return DetectedPictures(frames, skipped, watch, warnings)


def detect_recording(
    recording: Recording,
    heatmaps: HeatmapSource,
    path: Path,
    *,
    video: bool = False,
    every: int = 1,
    replace_existing: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> DetectedRecording:
    """Write the recording as a mission file with the heatmaps of a detector, frame for frame; of every drone
    `every`-th frames only. With `video`, an overlay video of each drone appears beside it.

    ValueError when no frame gives a heatmap; nothing is left behind then. FileExistsError when a video of
    that name is there and not to be replaced.
    """
    check_every(every)
    for drone in recording.drones if video else ():
        require_replaceable(_film_path(path, drone), force=replace_existing)
    kept = sorted(
        (frame for drone in recording.drones for frame in recording.frames_of(drone)[::every]),
        key=lambda frame: frame.stamp_ns,
    )
    thinned = replace(recording, frames=tuple(kept))
    maker = heatmaps.to_json()
    source = f"{recording.name}, heatmaps by {maker.get('name', 'a function')} {maker.get('version') or ''}"
    with ExitStack() as stack:
        films = _Films(path, stack) if video else None

        def heatmap_of(frame: Frame) -> Pixels:
            heatmap = heatmaps.heatmap_of(frame)
            if films is not None:
                films.add(frame, heatmap)
            return heatmap

        conversion = convert(
            thinned,
            path,
            heatmap_of=heatmap_of,
            detector=None if heatmaps.contract is None else _stated(heatmaps.contract),
            source=source.strip(),
            progress=progress,
        )
    return DetectedRecording(conversion, [] if films is None else films.paths)


def _stated(contract: Contract) -> dict[str, Any] | None:
    """The contract for whoever fuses the heatmaps; None where it says nothing of them, as that of a
    function."""
    if not (contract.rates or contract.validity or contract.target_height_m is not None):
        return None
    if contract.input.multiple_of % contract.output.stride:
        # Of a combination the stride is the finest, and the input that of its first: no model has both.
        contract = replace(contract, output=replace(contract.output, stride=1))
    return contract.to_json()


def _require_place(folder: Path, source: Path | None, *, replace_existing: bool) -> None:
    written = [folder / name for name in (HEATMAPS, INDEX, OVERLAY)]
    looked_at = [] if source is None else [source.resolve(), *source.resolve().parents]
    for path in written:
        if path.resolve() in looked_at:
            raise FileExistsError(f"{path} is looked at and would be replaced; choose another folder")
        require_replaceable(path, force=replace_existing)


def _unknown_scale(detector: Detector, gsd_m: float | None) -> Iterator[str]:
    """Pictures come without poses, so nobody can tell how far away their ground is."""
    contract = detector.contract
    tested_m = tested_range(contract, "gsd_m")
    if gsd_m is None:
        shown = "" if contract.sizes is None else "; it was shown them at several sizes"
        yield f"pictures without poses: no range could be checked against those of {contract.name}{shown}"
    elif tested_m is not None and not tested_m[0] <= gsd_m <= tested_m[1]:
        yield f"--gsd-m {gsd_m:g}: {contract.name} was tested at {tested_m[0]:g} to {tested_m[1]:g} m"


def _film_path(mission: Path, drone: str) -> Path:
    return mission.with_name(f"{mission.stem}_{re.sub(r'[^A-Za-z0-9._-]', '_', drone)}.mp4")


class _Films:
    """An overlay video per drone."""

    def __init__(self, mission: Path, stack: ExitStack) -> None:
        self._mission, self._stack = mission, stack
        self._films: dict[str, tuple[VideoWriter, int]] = {}

    @property
    def paths(self) -> list[Path]:
        return [film.path for film, _ in self._films.values()]

    def add(self, frame: Frame, heatmap: Pixels) -> None:
        if frame.drone not in self._films:
            writer = VideoWriter(_film_path(self._mission, frame.drone), rate=Fraction(10))
            self._films[frame.drone] = (self._stack.enter_context(writer), frame.stamp_ns)
        film, first_ns = self._films[frame.drone]
        label = f"{frame.drone}  {iso_utc(frame.stamp_ns)[:23]}Z"
        film.write(_looked_at(frame.image(), heatmap, label), (frame.stamp_ns - first_ns) / 1e9)


def _detected(
    item: StreamPicture | SkippedPicture, detector: Detector, gsd_m: float | None
) -> tuple[StreamPicture, NDArray[np.float32]] | SkippedPicture:
    if isinstance(item, SkippedPicture):
        return item
    if reason := blank_reason(item.rgb):
        return SkippedPicture(item.number, item.name, item.time_s, reason)
    try:
        return item, detector(item.rgb, gsd_m=gsd_m)
    except ValueError as error:
        return SkippedPicture(item.number, item.name, item.time_s, str(error))


def _looked_at(rgb: NDArray[np.uint8], heatmap: Pixels, label: str) -> NDArray[np.uint8]:
    """The overlay at the size of the video."""
    width, height = video_size(rgb.shape[1], rgb.shape[0])
    if width < rgb.shape[1] or height < rgb.shape[0]:
        shrunk = Image.fromarray(rgb).resize((width, height), Image.Resampling.BILINEAR, reducing_gap=2.0)
        rgb = np.asarray(shrunk)
    return caption(overlay(rgb, heatmap), label)


def _label(picture: StreamPicture) -> str:
    at = picture.name if picture.time_s is None else f"{picture.time_s:.3f} s"
    return f"frame {picture.number}  {at}"
