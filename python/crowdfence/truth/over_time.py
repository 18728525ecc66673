"""Crowd voxels at each instant of a recording, to score maps against."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.errors import FrameError
from crowdfence.sources.recording import Frame, Instant, Recording
from crowdfence.truth.at_exposure import are_people_recorded, crowd_ground_at, people_at, timed_frame
from crowdfence.truth.crowd_masks import crowd_mask, has_crowd_mask, require_crowd_masks
from crowdfence.truth.projected import ProjectedTruth, TruthMap, project_truth
from crowdfence.truth.recorded_people import require_people


class TruthOverTime(Protocol):
    """Called with the instants of a recording in their order."""

    def at(self, instant: Instant) -> NDArray[np.bool_] | None:
        """Crowd voxels [V]; None where the truth is people's positions and nobody's is recorded then, or no
        frame says when that was. FrameError when the truth of the instant is damaged."""


class TruthAhead:
    """Truth that is worked out by another thread, an instant ahead of whoever asks for it."""

    def __init__(self, truth: TruthOverTime, executor: Executor) -> None:
        """Of an executor with one worker: truths are called with the instants in their order."""
        self._truth, self._executor = truth, executor
        self._begun: deque[Future[NDArray[np.bool_] | None]] = deque()

    def begun(self, instants: Iterable[Instant]) -> Iterator[Instant]:
        """The same instants; with each the truth of the next one is begun."""
        held: Instant | None = None
        for instant in instants:
            self._begun.append(self._executor.submit(self._truth.at, instant))
            if held is not None:
                yield held
            held = instant
        if held is not None:
            yield held

    def next(self) -> NDArray[np.bool_] | None:
        """Crowd voxels [V] or None of the first instant that was not asked for yet, or what its truth
        raised."""
        return self._begun.popleft().result()


class ProjectedLabels:
    """The labels of the drones' own images, projected like their heatmaps; a voxel keeps the label it was
    last seen with. This is the paper's truth: it knows no more than the drones saw, and where labels are
    silhouettes it reaches behind the people as far as their bodies hide the ground."""

    def __init__(
        self,
        recording: Recording,
        terrain: Terrain,
        *,
        max_range_m: float,
        target_height_m: float,
        coverage: Literal["rays", "full"] = "full",
        surface: Literal["planes", "voxels"] = "planes",
        on_damaged: Callable[[FrameError], None] | None = None,
    ) -> None:
        """Labels are projected as `project_truth` says. A frame whose label is damaged counts as one without
        where `on_damaged` is told of it. ValueError when no frame has a label."""
        require_crowd_masks(recording)
        self._terrain = terrain
        self._max_range_m, self._target_height_m = max_range_m, target_height_m
        self._coverage: Literal["rays", "full"] = coverage
        self._surface: Literal["planes", "voxels"] = surface
        self._on_damaged = on_damaged
        self._map = TruthMap(terrain.voxel_count)

    def at(self, instant: Instant) -> NDArray[np.bool_]:
        self._map.update(self.projected(instant))
        return self._map.crowd

    def projected(self, instant: Instant) -> list[ProjectedTruth]:
        """The labels of this instant alone, one per frame that has one."""
        return [
            project_truth(
                mask,
                frame.camera,
                frame.world_from_camera,
                self._terrain,
                max_range_m=self._max_range_m,
                target_height_m=self._target_height_m,
                coverage=self._coverage,
                surface=self._surface,
            )
            for frame in instant.frames
            if has_crowd_mask(frame) and (mask := self._mask(frame)) is not None
        ]

    def _mask(self, frame: Frame) -> NDArray[np.bool_] | None:
        try:
            return crowd_mask(frame)
        except FrameError as error:
            if self._on_damaged is None:
                raise
            self._on_damaged(error)
            return None


class CrowdsOfTheWorld:
    """Where the crowds stand on the map, seen or not, from everybody's recorded positions."""

    def __init__(self, recording: Recording, terrain: Terrain) -> None:
        """ValueError when the recording does not hold them."""
        require_people(recording, "score against its labels (--truth projected)")
        self._recording, self._terrain = recording, terrain

    def at(self, instant: Instant) -> NDArray[np.bool_] | None:
        frame = timed_frame(instant)
        if frame is None or not are_people_recorded(frame, self._recording):
            return None
        return crowd_ground_at(frame, self._recording, self._terrain, "beside")


class LayerOfTheWorld:
    """Where in the world the class of a layer is, seen or not: the recorded ground, without what people take
    away while they stand there."""

    def __init__(self, recording: Recording, terrain: Terrain) -> None:
        """ValueError when the recording does not hold it."""
        ground = recording.layer_grounds.get(recording.layer)
        if ground is None:
            raise ValueError(
                f"{recording.name} does not record where in the world {recording.layer} is; score against "
                "its labels (--truth projected)"
            )
        self._recording, self._ground = recording, ground
        ids = np.arange(terrain.voxel_count, dtype=np.int64)
        places = terrain.voxel_indices(ids)[:, :2] + 0.5
        xy = np.asarray(terrain.origin)[:2] + places * terrain.voxel_size_m
        self._cell_of_voxel = ground.numbers_at(xy)

    def at(self, instant: Instant) -> NDArray[np.bool_] | None:
        cells = self._ground.cells
        if len(self._recording.people.stamps_ns):
            frame = timed_frame(instant)
            if frame is None or not are_people_recorded(frame, self._recording):
                return None
            people = people_at(frame, self._recording)
            cells = self._ground.without(people.position)
        return (self._cell_of_voxel >= 0) & cells.ravel()[self._cell_of_voxel]
