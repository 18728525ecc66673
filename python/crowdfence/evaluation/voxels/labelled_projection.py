"""One frame on the terrain beside the truth: what a detector says about each voxel, and what is true."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import FrameError
from crowdfence.sources.recording import Frame, Recording
from crowdfence.truth.at_exposure import crowd_ground_of, people_at, true_camera_pose
from crowdfence.truth.crowd_masks import MaskOf, crowd_mask
from crowdfence.truth.recorded_people import require_people
from crowdfence.zones.sorted_keys import are_among, distinct

if TYPE_CHECKING:
    from crowdfence._core import Observation, Terrain

_COLUMN = np.int64(1) << 31
_NEIGHBOURS = np.array([di * _COLUMN + dj for di in (-1, 0, 1) for dj in (-1, 0, 1) if (di, dj) != (0, 0)])


@dataclass(frozen=True, slots=True, eq=False)
class LabelledObservation:
    """Voxels that one frame shows and whose truth is known (arrays of equal length)."""

    voxel_ids: NDArray[np.int64]
    mean: NDArray[np.float64]
    """Mean heatmap value over the pixels that show the voxel."""
    crowd: NDArray[np.bool_]
    near_edge: NDArray[np.bool_]
    """Within one voxel, seen from above, of where crowd begins or ends: there a label is a matter of
    centimetres."""
    distance_m: NDArray[np.float64]
    """From the camera to the voxel's centre, raised by `target_height_m`."""
    tilt_deg: NDArray[np.float64]
    """Angle of that ray below the horizon."""
    gsd_m: NDArray[np.float64]
    """Metres across that ray per image pixel: distance / focal length."""
    excluded: int
    """Voxels in view that are left out because their truth is not known."""


class LabelledProjection:
    """Projects heatmaps of a recording onto its terrain, with the true pose where it is recorded.

    The truth comes from the world where the recording holds everybody's positions: the ground of every crowd
    (`truth_from_positions`) as it stood at the exposure, by the definition of a crowd in the recording's
    manifest (else three people within 2 m). Crowds that are hidden by trees or other people count too.
    Without positions the truth is the frame's own label, projected like the heatmap (`truth="labels"`): it
    knows only what the frame shows, and voxels that an ignored pixel shows are left out.
    """

    def __init__(
        self,
        recording: Recording,
        terrain: Terrain,
        *,
        target_height_m: float,
        max_range_m: float,
        coverage: Literal["rays", "full"] = "full",
        surface: Literal["planes", "voxels"] = "planes",
        truth: Literal["auto", "world", "labels"] = "auto",
        mask_of: MaskOf | None = None,
        ignore_of: MaskOf | None = None,
    ) -> None:
        """`mask_of` and `ignore_of`: bool [H, W] of a frame, crowd (default: recorded regions, or silhouettes
        merged) and pixels that do not count; used for labels only."""
        if truth not in ("auto", "world", "labels"):
            raise ValueError(f'truth must be "auto", "world" or "labels", got {truth!r}')
        knows_people = len(recording.people.stamps_ns) > 0
        if truth == "world":
            require_people(recording, "use its labels as truth")
        self.truth: Literal["world", "labels"] = (
            "world" if truth == "world" or (truth == "auto" and knows_people) else "labels"
        )
        self._recording, self._terrain = recording, terrain
        self._target_height_m, self._max_range_m = target_height_m, max_range_m
        self._coverage: Literal["rays", "full"] = coverage
        self._surface: Literal["planes", "voxels"] = surface
        self._mask_of, self._ignore_of = mask_of or crowd_mask, ignore_of
        self._world: tuple[int, NDArray[np.bool_], NDArray[np.int64]] | None = None

    def observe(self, frame: Frame, heatmap: NDArray[Any]) -> LabelledObservation:
        """What the heatmap [h, w] of a frame says about the voxels in view.

        FrameError when the frame's truth or pose is missing or damaged, or the heatmap does not fit.
        ValueError when people of a crowd stand on no voxel: the terrain is then of another place.
        """
        seen = self._project(frame, heatmap)
        if self.truth == "world":
            crowd_on_terrain, edge_columns = self._crowd_ground(frame)
            known: NDArray[np.bool_] = np.ones(len(seen.voxel_ids), np.bool_)
            crowd = crowd_on_terrain[seen.voxel_ids]
        else:
            crowd, known = self._labels(frame)
            edge_columns = _edge_columns(self._columns(seen.voxel_ids[crowd]))
        ids = seen.voxel_ids[known]
        ray = self._terrain.voxel_centers(ids) - true_camera_pose(frame)[:3, 3]
        ray[:, 2] += self._target_height_m
        distance_m = np.linalg.norm(ray, axis=1)
        down = -ray[:, 2] / np.maximum(distance_m, np.finfo(np.float64).tiny)
        return LabelledObservation(
            ids,
            seen.mean[known],
            crowd[known],
            are_among(self._columns(ids), edge_columns),
            distance_m,
            np.degrees(np.arcsin(np.clip(down, -1.0, 1.0))),
            distance_m / np.sqrt(frame.camera.fx * frame.camera.fy),
            int(np.count_nonzero(~known)),
        )

    def _project(self, frame: Frame, heatmap: NDArray[Any]) -> Observation:
        from crowdfence._core import View, project

        pose = true_camera_pose(frame)
        try:
            view = View(frame.drone, frame.stamp_ns, frame.camera, pose, heatmap)
        except ValueError as error:
            raise FrameError(frame.drone, frame.stamp_ns, str(error)) from error
        return project(
            view,
            self._terrain,
            max_range_m=self._max_range_m,
            target_height_m=self._target_height_m,
            coverage=self._coverage,
            surface=self._surface,
        )

    def _crowd_ground(self, frame: Frame) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Crowd voxels [V] of the terrain at the exposure, and the columns at their edges."""
        people = people_at(frame, self._recording)
        # Drones that expose together share one instant of the world.
        if self._world is None or self._world[0] != people.stamp_ns:
            crowd = crowd_ground_of(people, self._recording, self._terrain)
            edges = _edge_columns(self._columns(np.flatnonzero(crowd)))
            self._world = (people.stamp_ns, crowd, edges)
        return self._world[1:]

    def _labels(self, frame: Frame) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether each voxel in view is crowd by the frame's label, and whether the label counts there."""
        mask = np.asarray(self._mask_of(frame))
        crowd = self._project(frame, _as_heatmap(mask)).mean >= 0.5
        if self._ignore_of is None:
            return crowd, np.ones(len(crowd), np.bool_)
        return crowd, self._project(frame, _as_heatmap(np.asarray(self._ignore_of(frame)))).mean == 0.0

    def _columns(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """One number per voxel for the column (i, j) that it is in."""
        i, j, _ = self._terrain.voxel_indices(ids).T
        return np.asarray(i * _COLUMN + j)


def _as_heatmap(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return (mask != 0).astype(np.uint8) * np.uint8(255)


def _edge_columns(crowd_columns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Columns with and without crowd that have a neighbour of the other kind among their eight."""
    crowd = distinct(crowd_columns)
    around = crowd[:, None] + _NEIGHBOURS
    outside = ~are_among(around, crowd)
    return np.concatenate([crowd[outside.any(axis=1)], distinct(around[outside])])
