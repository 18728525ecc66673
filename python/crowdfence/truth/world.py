"""Ground truth on the terrain from the positions of all people: what a simulator or a survey knows.

Unlike projected truth it depends on no camera: hidden and unseen people count, and a crowd that left is gone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.truth.crowd_ground import PERSON_RADIUS_M, CrowdGround, crowd_grounds

if TYPE_CHECKING:
    from crowdfence._core import Terrain

OffTerrain = Literal["refuse", "beside", "ignore"]
_PIXELS_PER_LENGTH = 4


def truth_from_positions(
    positions_enu: ArrayLike,
    terrain: Terrain,
    radius_m: float = 2.0,
    min_people: int = 3,
    *,
    person_radius_m: float = PERSON_RADIUS_M,
    off_terrain: OffTerrain = "refuse",
) -> NDArray[np.bool_]:
    """Crowd voxels [V] of one instant from feet positions [N, 3] (local ENU metres).

    A crowd is a cluster of people as `crowds_of` finds it. Its ground is the union of discs of
    `person_radius_m` around its people, closed with a disc of `radius_m`: with the gaps between them that a
    disc of that radius cannot enter. A column of voxels belongs to it when its centre lies on that ground or
    one of the people stands in it; then all of its voxels do whose centre is at most `radius_m` plus one
    voxel above or below the feet of the nearest person. A crowd on a bridge leaves the road below alone.

    The paper does not say when people are a crowd; three within 2 m is our choice.

    Raises ValueError for positions that are not finite numbers [N, 3], and when a person in a crowd stands
    in a column without such a voxel (usually a wrong frame: NED for ENU, or a missing offset).
    `off_terrain`: "beside" leaves out who stands where the map has no ground at any height
    (`stand_beside`), "ignore" all ground that the map does not cover.
    """
    if off_terrain not in get_args(OffTerrain):
        raise ValueError(f'off_terrain must be "refuse", "beside" or "ignore", got {off_terrain!r}')
    if not (np.isfinite(person_radius_m) and person_radius_m > 0.0):
        raise ValueError(f"person_radius_m must be positive and finite, got {person_radius_m}")
    reach_m = radius_m + terrain.voxel_size_m
    # The ground is drawn finely enough to show single people, whatever the voxels.
    pixel_m = min(person_radius_m, terrain.voxel_size_m) / _PIXELS_PER_LENGTH
    truth = np.zeros(terrain.voxel_count, np.bool_)
    for ground in crowd_grounds(
        positions_enu, radius_m, min_people, pixel_m=pixel_m, person_radius_m=person_radius_m
    ):
        if off_terrain == "refuse":
            _require_ground(ground.feet, terrain, reach_m)
        elif off_terrain == "beside":
            _require_ground(ground.feet[~stand_beside(ground.feet, terrain)], terrain, reach_m)
        ids = _voxels_near(*_crowd_columns(ground, terrain), terrain, reach_m)
        truth[ids[ids >= 0]] = True
    return truth


def stand_beside(positions_enu: NDArray[np.floating[Any]], terrain: Terrain) -> NDArray[np.bool_]:
    """Who of people [N, 3] stands beside the map, or over a hole of it: in a column without a voxel."""
    beside = _float(positions_enu, terrain, terrain.voxel_size_m)
    if beside.any():  # the whole column of those few
        (_, _, lowest), (_, _, highest) = np.asarray(terrain.bounds, np.float64)
        middle = positions_enu[beside] * [1.0, 1.0, 0.0] + [0.0, 0.0, (lowest + highest) / 2]
        beside[beside] = _float(middle, terrain, float(highest - lowest) / 2)
    return beside


def _float(people: NDArray[np.floating[Any]], terrain: Terrain, reach_m: float) -> NDArray[np.bool_]:
    """Whose column [N] has no voxel with its centre within `reach_m` of the feet."""
    height_m = np.asarray(people[:, 2], np.float64)
    ids = _voxels_near(_columns_of(people, terrain), height_m, terrain, reach_m)
    return np.asarray((ids < 0).all(axis=1))


def _columns_of(positions_enu: NDArray[np.floating[Any]], terrain: Terrain) -> NDArray[np.int64]:
    """Columns [N, 2] that people [N, 3] stand in."""
    origin = np.asarray(terrain.origin)[:2]
    return np.floor((positions_enu[:, :2] - origin) / terrain.voxel_size_m).astype(np.int64)


def _crowd_columns(ground: CrowdGround, terrain: Terrain) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Columns [C, 2] (grid indices i, j) of one crowd's ground and feet height [C] of the nearest person."""
    size_m, origin = terrain.voxel_size_m, np.asarray(terrain.origin)[:2]
    lowest, highest = (
        np.floor((corner - origin) / size_m).astype(np.int64) for corner in (ground.low, ground.high)
    )
    candidates = np.stack(
        np.meshgrid(*(np.arange(lowest[axis], highest[axis] + 1) for axis in (0, 1)), indexing="ij"), axis=-1
    ).reshape(-1, 2)
    on_ground = candidates[ground.contains(origin + (candidates + 0.5) * size_m)]
    stood_in = _columns_of(ground.feet, terrain)
    columns = np.unique(np.concatenate([on_ground, stood_in]), axis=0)
    return columns, ground.nearest_feet_m(origin + (columns + 0.5) * size_m)


def _voxels_near(
    columns: NDArray[np.int64], height_m: NDArray[np.float64], terrain: Terrain, reach_m: float
) -> NDArray[np.int64]:
    """Ids [C, K] of the voxels of each column whose centre is within `reach_m` of its height, -1 for none."""
    size_m = terrain.voxel_size_m
    level = (height_m - terrain.origin[2]) / size_m - 0.5  # of a voxel centre at this height
    first = np.ceil(level - reach_m / size_m).astype(np.int64)
    steps = np.arange(int(np.floor(2.0 * reach_m / size_m)) + 1)
    k = first[:, None] + steps
    indices = np.stack([*np.broadcast_arrays(columns[:, :1], columns[:, 1:], k)], axis=-1)
    ids = terrain.voxel_ids(indices.reshape(-1, 3)).reshape(k.shape)
    return np.where(k <= level[:, None] + reach_m / size_m, ids, -1)


def _require_ground(people: NDArray[np.float64], terrain: Terrain, reach_m: float) -> None:
    floating = _float(people, terrain, reach_m)
    if floating.any():
        where = ", ".join(f"{metres:.2f}" for metres in people[floating][0])
        raise ValueError(
            f"{np.count_nonzero(floating)} of {len(people)} people of a crowd stand on no voxel of the "
            f"terrain, the first at ({where}) m: check frame and offset, or take a map that has ground there"
        )
