"""What the network is to mark in an image, cell by cell.

Two answers are offered. `silhouettes` is the paper's: the people of a crowd as they appear, merged and
filled; projected onto bare terrain they smear away from the camera. `ground` is the ground on which the crowd
stands, as it appears from the drone: it projects to where it belongs, but hides behind the people.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.evaluation.world_truth import truth_from_positions
from crowdfence.sources.recording import Frame, FrameError, Recording

Target = Literal["ground", "silhouettes"]
TARGETS: tuple[Target, ...] = get_args(Target)

STRIDE = 4
"""Image pixels per label cell along each axis, as the network's output."""

MAX_RANGE_M = 300.0
"""Ground farther away is not labelled."""

_HIDDEN_FROM = 0.9
_HIDDEN_SLACK_M = 1.0
_PEOPLE_GAP_S = 0.5


class CellLabels(NamedTuple):
    """Labels of one image for one target."""

    crowd: NDArray[np.uint8]
    """[h, w] share of the cell that is crowd, times 255."""
    known: NDArray[np.bool_]
    """[h, w] False where the truth cannot be told from the image: such cells teach nothing."""


@dataclass(frozen=True, slots=True)
class CrowdRule:
    """When people are a crowd, see `crowds_of`."""

    min_people: int = 3
    radius_m: float = 2.0

    @classmethod
    def of(cls, recording: Recording) -> CrowdRule:
        """The rule that a simulated mission was made with; the default for other recordings."""
        scenario = recording.manifest.get("simulation", {}).get("scenario", {})
        return cls(**scenario.get("crowd_definition", {}))


def cell_labels(
    target: Target, frame: Frame, recording: Recording, terrain: Terrain | None, rule: CrowdRule
) -> CellLabels:
    """Labels [h, w] of a frame at `STRIDE`. FrameError when its truth cannot be read, ValueError when
    `ground` is wanted without a terrain."""
    if target == "silhouettes":
        return _silhouette_cells(frame)
    if target == "ground":
        if terrain is None:
            raise ValueError(f"{recording.name} comes without a map, which the target 'ground' needs")
        return _ground_cells(frame, recording, terrain, rule)
    raise ValueError(f"target is {target!r}; it must be one of {', '.join(TARGETS)}")


def _silhouette_cells(frame: Frame) -> CellLabels:
    regions = frame.regions() > 0
    rows, columns = regions.shape[0] // STRIDE, regions.shape[1] // STRIDE
    blocks = regions[: rows * STRIDE, : columns * STRIDE].reshape(rows, STRIDE, columns, STRIDE)
    return CellLabels(
        np.rint(blocks.mean(axis=(1, 3)) * 255.0).astype(np.uint8), np.ones((rows, columns), np.bool_)
    )


def _ground_cells(frame: Frame, recording: Recording, terrain: Terrain, rule: CrowdRule) -> CellLabels:
    """A cell is crowd when the ray through its centre, with all people and things taken away, meets ground
    that a crowd stands on. What trees, cars or tents hide is unknown where it is crowd."""
    people = recording.people_truth(frame.exposure_ns(), max_gap_s=_PEOPLE_GAP_S)
    if people is None:
        raise FrameError(frame.drone, frame.stamp_ns, "the recording does not say where the people are")
    crowd_voxels = truth_from_positions(
        people.position, terrain, rule.radius_m, rule.min_people, off_terrain="ignore"
    )
    rows, columns = frame.camera.height // STRIDE, frame.camera.width // STRIDE
    world_from_camera = frame.true_pose().world_from_camera()
    rays = frame.camera.unproject(cell_centres(rows, columns))
    directions = rays @ world_from_camera[:3, :3].T
    origins = np.broadcast_to(world_from_camera[:3, 3], directions.shape)
    ids, distance_m = terrain.raycast(origins, directions, MAX_RANGE_M)
    crowd = ((ids >= 0) & crowd_voxels[ids]).reshape(rows, columns)
    hidden = _hidden(frame, (distance_m * rays[:, 2]).reshape(rows, columns))
    return CellLabels(crowd.astype(np.uint8) * np.uint8(255), ~(crowd & hidden))


def cell_centres(rows: int, columns: int) -> NDArray[np.float64]:
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
