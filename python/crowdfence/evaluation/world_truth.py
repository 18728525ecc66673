"""Ground truth on the terrain from the positions of all people: what a simulator or a survey knows.

Unlike projected truth it depends on no camera: hidden and unseen people count, and a crowd that left is gone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.evaluation.morphology import MAX_PADDED_CELLS, close_with_disc

if TYPE_CHECKING:
    from crowdfence._core import Terrain

BODY_RADIUS_M = 0.5
"""Ground that one standing person takes up."""

MAX_NEIGHBOURS = 50_000_000
_PIXELS_PER_BODY_RADIUS = 2


def truth_from_positions(
    positions_enu: ArrayLike,
    terrain: Terrain,
    radius_m: float = 2.0,
    min_people: int = 3,
    *,
    body_radius_m: float = BODY_RADIUS_M,
    off_terrain: Literal["refuse", "ignore"] = "refuse",
) -> NDArray[np.bool_]:
    """Crowd voxels [V] of one instant from feet positions [N, 3] (local ENU metres).

    A crowd is a cluster of people as `crowds_of` finds it. Its ground is the union of discs of
    `body_radius_m` around its people, closed with a disc of `radius_m`: with the gaps between them that a
    disc of that radius cannot enter. A column of voxels belongs to it when its centre lies on that ground or
    one of the people stands in it; then all of its voxels do whose centre is at most `radius_m` plus one
    voxel above or below the feet of the nearest person. A crowd on a bridge leaves the road below alone.

    The paper does not say when people are a crowd; three within 2 m is our choice.

    Raises ValueError for positions that are not finite numbers [N, 3], and when a person in a crowd stands
    in a column without such a voxel (usually a wrong frame: NED for ENU, or a missing offset);
    `off_terrain="ignore"` leaves out the ground that the map does not cover.
    """
    feet = np.asarray(positions_enu, np.float64)
    if off_terrain not in ("refuse", "ignore"):
        raise ValueError(f'off_terrain must be "refuse" or "ignore", got {off_terrain!r}')
    if not (np.isfinite(body_radius_m) and body_radius_m > 0.0):
        raise ValueError(f"body_radius_m must be positive and finite, got {body_radius_m}")
    crowd_of_person = crowds_of(feet, radius_m, min_people)
    reach_m = radius_m + terrain.voxel_size_m
    truth = np.zeros(terrain.voxel_count, np.bool_)
    for crowd in range(crowd_of_person.max(initial=-1) + 1):
        people = feet[crowd_of_person == crowd]
        if off_terrain == "refuse":
            _require_ground(people, terrain, reach_m)
        columns, height_m = _crowd_columns(people, terrain, radius_m, body_radius_m)
        ids = _voxels_near(columns, height_m, terrain, reach_m)
        truth[ids[ids >= 0]] = True
    return truth


def crowds_of(positions_enu: ArrayLike, radius_m: float, min_people: int) -> NDArray[np.int64]:
    """Crowd number per person [N], -1 for people in none; distances are horizontal.

    A person with at least `min_people` people within `radius_m`, the person included, is the core of a crowd.
    Cores within `radius_m` of each other share a crowd, and everyone within `radius_m` of a core belongs to
    the crowd of the nearest. These are the clusters of DBSCAN (Ester et al., 1996) with eps = `radius_m`.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    feet = np.asarray(positions_enu, np.float64)
    if feet.ndim != 2 or feet.shape[1] != 3 or not np.isfinite(feet).all():
        raise ValueError(f"positions must be finite metres [N, 3], got shape {list(feet.shape)} or NaN in it")
    if not (np.isfinite(radius_m) and radius_m > 0.0):
        raise ValueError(f"radius_m must be positive and finite, got {radius_m}")
    if min_people < 1:
        raise ValueError(f"min_people must be at least 1, got {min_people}")
    crowd_of_person = np.full(len(feet), -1, np.int64)
    if len(feet) == 0:
        return crowd_of_person
    tree = cKDTree(feet[:, :2])
    neighbours = tree.query_ball_point(feet[:, :2], radius_m, return_length=True)
    if neighbours.sum() > MAX_NEIGHBOURS:
        raise ValueError(
            f"{len(feet)} people have {neighbours.mean():.0f} others within {radius_m} m on average; "
            "check the unit of the positions or use a smaller radius_m"
        )
    dense = np.flatnonzero(neighbours >= min_people)
    if dense.size == 0:
        return crowd_of_person
    dense_tree = cKDTree(feet[dense, :2])
    pairs = dense_tree.query_pairs(radius_m, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), np.bool_), (pairs[:, 0], pairs[:, 1])), shape=(dense.size,) * 2)
    _, crowd_of_dense = connected_components(links, directed=False)
    distance_m, nearest = dense_tree.query(feet[:, :2])
    return np.where(distance_m <= radius_m, crowd_of_dense[nearest], -1).astype(np.int64)


def _crowd_columns(
    people: NDArray[np.float64], terrain: Terrain, radius_m: float, body_radius_m: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Columns [C, 2] (grid indices i, j) of one crowd's ground and feet height [C] of the nearest person."""
    from scipy.spatial import cKDTree

    size_m, origin = terrain.voxel_size_m, np.asarray(terrain.origin)[:2]
    tree = cKDTree(people[:, :2])
    # The ground is drawn on a grid fine enough to show single bodies, whatever the voxels.
    pixel_m = min(body_radius_m, size_m) / _PIXELS_PER_BODY_RADIUS
    south_west = people[:, :2].min(axis=0) - body_radius_m - pixel_m
    shape = np.ceil((people[:, :2].max(axis=0) + body_radius_m + pixel_m - south_west) / pixel_m)
    if shape.prod() > MAX_PADDED_CELLS:
        raise ValueError(
            f"one crowd spans {shape[0] * pixel_m:.0f} x {shape[1] * pixel_m:.0f} m, too much to draw: "
            "check the unit of the positions or use a smaller radius_m"
        )
    centre_x, centre_y = (south_west[axis] + (np.arange(int(shape[axis])) + 0.5) * pixel_m for axis in (0, 1))
    grid = np.stack(np.meshgrid(centre_x, centre_y, indexing="ij"), axis=-1)
    bodies = tree.query(grid, distance_upper_bound=body_radius_m)[0] <= body_radius_m
    ground = close_with_disc(bodies, radius_m / pixel_m)

    lowest = np.floor((south_west - origin) / size_m).astype(np.int64)
    highest = np.floor((people[:, :2].max(axis=0) + body_radius_m - origin) / size_m).astype(np.int64)
    candidates = np.stack(
        np.meshgrid(*(np.arange(lowest[axis], highest[axis] + 1) for axis in (0, 1)), indexing="ij"), axis=-1
    ).reshape(-1, 2)
    centres = origin + (candidates + 0.5) * size_m
    pixel = np.floor((centres - south_west) / pixel_m).astype(np.int64)
    inside = ((pixel >= 0) & (pixel < shape)).all(axis=1)
    on_ground = np.zeros(len(candidates), np.bool_)
    on_ground[inside] = ground[tuple(pixel[inside].T)]
    stood_in = np.floor((people[:, :2] - origin) / size_m).astype(np.int64)
    columns = np.unique(np.concatenate([candidates[on_ground], stood_in]), axis=0)
    _, nearest = tree.query(origin + (columns + 0.5) * size_m)
    return columns, people[nearest, 2]


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
    size_m, origin = terrain.voxel_size_m, np.asarray(terrain.origin)[:2]
    columns = np.floor((people[:, :2] - origin) / size_m).astype(np.int64)
    floating = (_voxels_near(columns, people[:, 2], terrain, reach_m) < 0).all(axis=1)
    if floating.any():
        where = ", ".join(f"{metres:.2f}" for metres in people[floating][0])
        raise ValueError(
            f"{np.count_nonzero(floating)} of {len(people)} people of a crowd stand on no voxel of the "
            f'terrain, the first at ({where}) m: check frame and offset, or pass off_terrain="ignore"'
        )
