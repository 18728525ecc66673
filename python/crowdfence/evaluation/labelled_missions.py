"""Labelled missions as a measurement goes over them: several times, one frame and one map in memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.errors import FrameError
from crowdfence.evaluation.beside_map import nobody_on_map_warning
from crowdfence.labelled_pictures.coco import ANNOTATIONS
from crowdfence.labelled_pictures.picture_recording import is_labelled_pictures, open_labelled_pictures
from crowdfence.sources import open_recording
from crowdfence.sources.photographs.reader import photographs
from crowdfence.sources.recording import Frame, Recording, RefusedFrame
from crowdfence.truth.crowd_masks import MaskOf
from crowdfence.truth.frame_labels import TARGET_HEIGHT_M, Target, label_functions

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector

BLOCK_S = 10.0
"""A single mission is resampled in blocks of this length."""
FEWEST_UNITS = 5
"""Of fewer missions, or blocks, the intervals are too narrow: of two they are the two values, between which
the truth lies half of the time."""


@dataclass(frozen=True, slots=True)
class MeasurementPlan:
    """What is measured, and how."""

    target: Target = "silhouettes"
    """What the heatmap should mark."""
    target_height_m: float = TARGET_HEIGHT_M["silhouettes"]
    """Height above ground at which it is projected."""
    max_range_m: float = 300.0
    coverage: Literal["rays", "full"] = "full"
    surface: Literal["planes", "voxels"] = "planes"
    b_threshold: float = 0.5
    truth: Literal["auto", "world", "labels"] = "auto"
    """Truth of the voxels, see `LabelledProjection`."""
    every: int = 1
    """Look at every n-th frame of each drone only."""
    terrain_options: Mapping[str, Any] = field(default_factory=dict)
    """How the maps are opened, see `pipeline.open_terrain`."""

    def __post_init__(self) -> None:
        if self.every < 1:
            raise ValueError(f"every is {self.every}; it must be at least 1")


@dataclass(frozen=True, slots=True, eq=False)
class LabelledMission:
    """A recording with its labels."""

    name: str
    """Different for every mission of a calibration."""
    recording: Recording
    terrain: Terrain | None
    mask_of: MaskOf
    ignore_of: MaskOf | None
    is_pictures: bool = False
    """Annotated pictures, which have neither poses nor a map."""
    gsd_of: Callable[[Frame], float | None] | None = None
    """Metres per pixel of annotated pictures; None where no annotation states them."""

    def heatmap(self, detector: Detector, frame: Frame, max_range_m: float) -> NDArray[Any]:
        """What a detector gives on this mission: every part at the size that pose and map ask for, or the
        annotations of a picture; a picture of unknown scale at all sizes. FrameError when it fails."""
        from crowdfence.pipeline import heatmap_source

        if detector.needs_gsd and self.terrain is None and self.gsd_of is None:
            raise ValueError(
                f"{detector.contract.name} needs metres per pixel, and {self.name} comes without a map that "
                "tells them: take missions with maps, or pictures whose annotations state gsd_m (a model of "
                "boxes does without where its rule states person_height_m)"
            )
        return heatmap_source(detector, self.terrain, max_range_m, gsd_of=self.gsd_of).heatmap_of(frame)

    def ignored(self, frame: Frame) -> NDArray[np.bool_] | None:
        return None if self.ignore_of is None else self.ignore_of(frame)


class LabelledMissions:
    """The missions named by `paths`, opened anew by every pass."""

    def __init__(self, paths: list[Path], plan: MeasurementPlan, on_frame: Callable[[], None]) -> None:
        if not paths:
            raise ValueError("no data: name at least one labelled mission")
        resolved = [path.resolve() for path in paths]
        if twice := [path for path in paths if resolved.count(path.resolve()) > 1]:
            raise ValueError(f"{twice[0]} is given twice; its frames would count double")
        self.paths, self.plan, self._on_frame = paths, plan, on_frame
        self.refused: dict[str, None] = {}
        """What was not used and why, in order, each once."""
        self.doubts: dict[str, None] = {}
        """What is doubtful about the recordings and the maps that were opened, in order, each once."""
        self._name_of: dict[tuple[bytes, ...], str] = {}
        """Of the missions that were opened, by some of their pictures."""
        self._first_of: dict[bytes, str] = {}
        """Of annotated pictures that were opened, by each of them."""
        self._first_with: dict[str, str] = {}
        """The first mission of each kind of truth of voxels."""

    def opened(self, *, with_maps: bool) -> Iterator[LabelledMission]:
        """One mission after the other; maps are opened if wanted here or needed for the labels. ValueError
        where a map lies beside all cameras of its mission, and for a mission that is there twice."""
        for path, name in zip(self.paths, mission_names(self.paths), strict=True):
            if is_labelled_pictures(path):
                pictures = open_labelled_pictures(path)
                self._require_new(name, pictures.recording)
                self._require_new_pictures(name, pictures.recording)
                self.doubts |= {f"{name}: {warning}": None for warning in pictures.recording.warnings}
                yield LabelledMission(
                    name, pictures.recording, None, pictures.crowd, pictures.ignored, True, pictures.gsd_m
                )
                continue
            recording = _recorded(path)
            self._require_new(name, recording)
            self.doubts |= {f"{name}: {warning}": None for warning in recording.warnings}
            self.refused |= {f"{name}: {frame}": None for frame in recording.refused}
            with_map = with_maps or self.plan.target == "ground"
            terrain = self._terrain(name, recording) if with_map else None
            with _or_annotated(path):
                labels = label_functions(self.plan.target, recording, terrain)
            yield LabelledMission(name, recording, terrain, *labels)

    def _require_new(self, name: str, recording: Recording) -> None:
        """ValueError where another mission has the pictures of this one, as a copy has, or a conversion:
        what is held out would be what was fitted on."""
        pictures = _some_pictures(recording)
        other = self._name_of.setdefault(pictures, name) if pictures else name
        if other != name:
            raise ValueError(
                f"{name} holds the pictures of {other}: they would count double, and vouch for themselves; "
                "leave one out"
            )

    def _require_new_pictures(self, name: str, recording: Recording) -> None:
        """The same of folders of pictures, of which people put some into several."""
        if name in self._first_of.values():
            return  # by the pass before
        for frame in recording.frames:
            try:
                other = self._first_of.setdefault(sha256(frame.encoded_image()).digest(), name)
            except FrameError:
                continue
            if other != name:
                raise ValueError(
                    f"{name} holds a picture of {other}, {frame.drone}: it would count double, and vouch for "
                    "itself; leave one out"
                )

    def _terrain(self, name: str, recording: Recording) -> Terrain | None:
        from crowdfence.pipeline import check_overlap, read_map

        if recording.terrain is None:
            return None
        ground = read_map(recording, **self.plan.terrain_options)
        try:
            check_overlap(recording, ground.terrain, self.plan.max_range_m)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
        beside = nobody_on_map_warning(recording, ground.terrain)
        doubts = [*ground.doubts, *([] if beside is None else [beside])]
        self.doubts |= {f"{name}: {doubt}": None for doubt in doubts}
        return ground.terrain

    def judged_by(self, mission: LabelledMission, truth: Literal["world", "labels"]) -> None:
        """A mission's voxels have this truth. Labels reach behind people where these are outlined: a doubt
        where others have another."""
        self._first_with.setdefault(truth, mission.name)
        if len(self._first_with) > 1:
            world, labels = self._first_with["world"], self._first_with["labels"]
            self.doubts[
                f"two truths of voxels in one table: where people stood in {world}, the labels of pictures "
                f"in {labels}, which records no people; calibrate --truth labels takes one"
            ] = None

    def over_frames(self, mission: LabelledMission, use: Callable[[Frame], None]) -> int:
        """Call `use` for every n-th frame of each drone and return how many could be used. A frame for which
        it raises FrameError is refused. ValueError when none could be used."""
        used = 0
        first_refusal: str | None = None
        for frame in _looked_at(mission.recording, self.plan.every, is_pictures=mission.is_pictures):
            try:
                use(frame)
                used += 1
            except FrameError as error:
                refusal = str(RefusedFrame(frame.drone, frame.stamp_ns, error.reason))
                first_refusal = first_refusal or refusal
                self.refused[f"{mission.name}: {refusal}"] = None
            self._on_frame()
        if used == 0:
            raise ValueError(f"no frame of {mission.name} can be used: {first_refusal or 'it holds none'}")
        return used

    def unit(self, mission: LabelledMission, frame: Frame) -> str:
        """What intervals resample together with this frame: its mission, or its block of the only one."""
        if len(self.paths) > 1:
            return mission.name
        elapsed_s = (frame.stamp_ns - mission.recording.frames[0].stamp_ns) / 1e9
        return f"{mission.name}, block {int(elapsed_s / BLOCK_S)}"

    def interval_warnings(self, units: int) -> Iterator[str]:
        """What intervals over so many missions, or blocks of the only one, do not cover."""
        one = len(self.paths) == 1
        if one:
            yield (
                f"one mission only: intervals come from blocks of {BLOCK_S:g} s and do not cover other places"
            )
        if 1 < units < FEWEST_UNITS:
            yield (
                f"{units} {'blocks' if one else 'missions'} only: intervals over fewer than {FEWEST_UNITS} "
                "are too narrow, the truth lies outside of them more often than 1 time in 20"
            )

    def some_image(self) -> NDArray[np.uint8]:
        """A picture of the first mission."""
        for frame in open_labelled(self.paths[0]).frames:
            try:
                return frame.image()
            except FrameError:
                continue
        raise ValueError(f"{self.paths[0]} holds no picture that can be read")


def _some_pictures(recording: Recording) -> tuple[bytes, ...]:
    """What the first picture, the middle one and the last are known by; nothing where one cannot be read.
    Whatever a flight is stored as, its pictures are the bytes that were recorded."""
    frames = recording.frames
    try:
        some = [frames[at].encoded_image() for at in (0, len(frames) // 2, -1)] if frames else []
    except FrameError:
        return ()
    return tuple(sha256(picture).digest() for picture in some)


def mission_names(paths: Sequence[Path]) -> list[str]:
    """How missions are told apart: by the names of their files, where those differ."""
    stems = [path.stem for path in paths]
    return [stem if stems.count(stem) == 1 else str(path) for path, stem in zip(paths, stems, strict=True)]


def open_labelled(path: Path) -> Recording:
    """A recording, or a folder of annotated pictures as one."""
    return open_labelled_pictures(path).recording if is_labelled_pictures(path) else _recorded(path)


def _recorded(path: Path) -> Recording:
    """ValueError, OSError."""
    with _or_annotated(path):
        return open_recording(path)


@contextmanager
def _or_annotated(path: Path) -> Iterator[None]:
    """Of a folder of pictures that is no labelled recording, annotations may be what was forgotten."""
    try:
        yield
    except ValueError as error:
        if not (path.is_dir() and (photographs(path) or any(path.glob("*.png")))):
            raise
        raise ValueError(f"{error}; nor does the folder hold {ANNOTATIONS} in COCO form") from error


def frames_looked_at(paths: Sequence[Path], every: int) -> int:
    """How many frames of labelled missions a plan looks at."""
    return sum(
        len(_looked_at(open_labelled(path), every, is_pictures=is_labelled_pictures(path))) for path in paths
    )


def _looked_at(recording: Recording, every: int, *, is_pictures: bool) -> list[Frame]:
    """Every n-th frame of each drone, by stamp: of drones that expose together every n-th of all may be
    those of one drone, which flies at one height. Annotated pictures are a drone each: every n-th of them."""
    number: Counter[str] = Counter()
    kept = []
    for frame in recording.frames:
        track = "" if is_pictures else frame.drone
        if number[track] % every == 0:
            kept.append(frame)
        number[track] += 1
    return kept
