"""The ground that crowds stand on, as it appears from a drone: cells of the image that are crowd."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.evaluation.labelled_projection import MAX_PEOPLE_GAP_S, crowd_definition, true_camera_pose
from crowdfence.evaluation.world_truth import truth_from_positions
from crowdfence.sources.recording import Frame, FrameError, Recording

STRIDE = 4
"""Image pixels per cell along each axis."""

MAX_RANGE_M = 300.0
"""Ground farther away is not labelled."""

_HIDDEN_FROM = 0.9
_HIDDEN_SLACK_M = 1.0


class GroundCells(NamedTuple):
    """Labels [H // 4, W // 4] of one image."""

    crowd: NDArray[np.bool_]
    known: NDArray[np.bool_]
    """False where a crowd stands but something hides the place: no detector can be asked about that."""


def ground_cells(frame: Frame, recording: Recording, terrain: Terrain) -> GroundCells:
    """A cell is crowd when the ray through its centre, with all people and things taken away, meets a voxel
    that a crowd stands on (`truth_from_positions`). Such a label projects to where it belongs, while
    silhouettes smear over the ground behind the people. What a tree, car or tent hides is unknown where it is
    crowd.

    FrameError when the frame's truth (people, pose, depth, instances) is missing or cannot be read.
    """
    people = recording.people_truth(frame.exposure_ns(), max_gap_s=MAX_PEOPLE_GAP_S)
    if people is None:
        raise FrameError(frame.drone, frame.stamp_ns, "the recording does not say where the people are")
    crowd_voxels = truth_from_positions(
        people.position, terrain, **crowd_definition(recording.manifest), off_terrain="ignore"
    )
    rows, columns = frame.camera.height // STRIDE, frame.camera.width // STRIDE
    world_from_camera = true_camera_pose(frame)
    rays = frame.camera.unproject(_cell_centres(rows, columns))
    directions = rays @ world_from_camera[:3, :3].T
    origins = np.broadcast_to(world_from_camera[:3, 3], directions.shape)
    ids, distance_m = terrain.raycast(origins, directions, MAX_RANGE_M)
    crowd = ((ids >= 0) & crowd_voxels[ids]).reshape(rows, columns)
    hidden = _hidden(frame, (distance_m * rays[:, 2]).reshape(rows, columns))
    return GroundCells(crowd, ~(crowd & hidden))


def _cell_centres(rows: int, columns: int) -> NDArray[np.float64]:
    """Pixel coordinates [rows * columns, 2] of the centres of the cells, row by row."""
    v, u = np.meshgrid((np.arange(rows) + 0.5) * STRIDE, (np.arange(columns) + 0.5) * STRIDE, indexing="ij")
    return np.stack([u.ravel(), v.ravel()], axis=1)


def _hidden(frame: Frame, terrain_depth_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Cells [h, w] at whose centre something that is no person stands well before the terrain."""
    rows, columns = terrain_depth_m.shape
    centre = np.ix_(np.arange(rows) * STRIDE + STRIDE // 2, np.arange(columns) * STRIDE + STRIDE // 2)
    depth_m, person = frame.depth_m()[centre], frame.instances()[centre]
    nearer = depth_m < _HIDDEN_FROM * terrain_depth_m - _HIDDEN_SLACK_M
    return np.asarray(nearer & (person == 0))
