"""Statistics of frames: what share of the pixels is what, who is seen, and how the views overlap."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.simulation.recording.footprint_overlap import OverlapStatistics, footprint_cells
from crowdfence.simulation.scenarios.scenario import Scenario
from crowdfence.simulation.scene_class import SceneClass
from crowdfence.sources.recorded_truth import RecordedPeople

MOST_FOOTPRINTS = 600
"""Footprints are kept for this many frames, evenly spread: some 50 MB."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameSummary:
    """What the statistics need of one frame."""

    class_pixels: NDArray[np.int64]
    """Pixels of every `SceneClass`."""
    visible: int
    """People of whom at least one pixel shows."""
    hidden: int
    """People in front of the camera whom something hides."""
    footprint: NDArray[np.int64] | None
    """Ground cells that the frame shows."""

    @staticmethod
    def of(
        segmentation: NDArray[np.integer],
        depth_m: NDArray[np.floating],
        people: RecordedPeople,
        camera: Camera,
        world_from_camera: NDArray[np.float64] | None,
    ) -> FrameSummary:
        """`depth_m` [H, W] with NaN for unknown; the footprint is left out without a pose."""
        seen = np.zeros(0, np.uint32) if people.pixels is None else people.pixels
        footprint = None
        if world_from_camera is not None:
            footprint = footprint_cells(depth_m, camera, world_from_camera)
        return FrameSummary(
            np.bincount(np.asarray(segmentation).ravel(), minlength=len(SceneClass)),
            int(np.count_nonzero(seen)),
            int(np.count_nonzero(seen == 0)),
            footprint,
        )


@dataclass(slots=True)
class MissionStatistics:
    """Collects the summaries of a mission; memory does not grow with its length."""

    scenario: Scenario
    class_pixels: NDArray[np.int64] = field(init=False)
    frames: NDArray[np.int64] = field(init=False)
    visible: NDArray[np.int64] = field(init=False)
    hidden: NDArray[np.int64] = field(init=False)
    footprints: dict[int, dict[int, NDArray[np.int64]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        drones = self.scenario.drones
        self.class_pixels = np.zeros((drones, len(SceneClass)), np.int64)
        self.frames, self.visible, self.hidden = (np.zeros(drones, np.int64) for _ in range(3))

    def wants_footprint(self, frame: int) -> bool:
        """Whether the overlap is measured at this frame number."""
        every = max(1, math.ceil(self.scenario.frames * self.scenario.drones / MOST_FOOTPRINTS))
        return frame % every == 0

    def add(self, drone: int, frame: int, summary: FrameSummary) -> None:
        self.class_pixels[drone] += summary.class_pixels
        self.frames[drone] += 1
        self.visible[drone] += summary.visible
        self.hidden[drone] += summary.hidden
        if summary.footprint is not None:
            self.footprints.setdefault(frame, {})[drone] = summary.footprint

    def manifest(self) -> dict[str, Any]:
        """Ready for JSON."""
        overlap = OverlapStatistics(self.scenario.drones)
        for frame in sorted(self.footprints):
            overlap.add(frame / self.scenario.fps, self.footprints[frame])
        drones = {
            name: {
                "frames": int(self.frames[drone]),
                "class_share": _shares(self.class_pixels[drone]),
                "people_visible_per_frame": _per(self.visible[drone], self.frames[drone]),
                "people_hidden_per_frame": _per(self.hidden[drone], self.frames[drone]),
            }
            for drone, name in enumerate(self.scenario.drone_names)
        }
        return {
            "frames": int(self.frames.sum()),
            "class_share": _shares(self.class_pixels.sum(axis=0)),
            "drones": drones,
            "overlap": overlap.manifest(),
        }


def _shares(class_pixels: NDArray[np.int64]) -> dict[str, float] | None:
    total = int(class_pixels.sum())
    if total == 0:
        return None
    return {kind.name.lower(): int(class_pixels[kind]) / total for kind in SceneClass}


def _per(count: int, frames: int) -> float | None:
    return float(count) / int(frames) if frames else None
