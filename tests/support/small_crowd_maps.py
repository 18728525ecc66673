"""Crowd maps that hold given probabilities, for the tests of zones and exports."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence import CrowdMap, Observation, Paper, Rates, Terrain

# A single drone whose rates are as good as perfect, and no memory: one look makes P = 2 m - 1 for m >= 0.5.
SURE = Paper(Rates(1 - 1e-15, 1e-15), 0.5, alpha=1.0, decay=0.0, fleet_size=1)


def look(
    crowd_map: CrowdMap, drone: str, stamp_ns: int, voxel_ids: NDArray[np.int64], mean: ArrayLike
) -> None:
    """One drone says what it sees of some voxels: m of equation 1, [N] or one for all."""
    order = np.argsort(voxel_ids)
    observation = Observation(
        crowd_map.terrain,
        drone,
        stamp_ns,
        voxel_ids=voxel_ids[order],
        mean=np.broadcast_to(np.asarray(mean, dtype=float), len(voxel_ids))[order],
        pixel_count=np.ones(len(voxel_ids), dtype=int),
        range_m=np.full(len(voxel_ids), 10.0),
        tilt_deg=np.full(len(voxel_ids), 90.0),
        occluded_ids=[],
    )
    crowd_map.integrate_observations([observation], stamp_ns)


def crowd_map_of(
    indices: ArrayLike,
    probability: ArrayLike,
    last_seen_ns: ArrayLike = 0,
    *,
    voxel_size_m: float = 1.0,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> CrowdMap:
    """A map of the voxels `indices` [V, 3] with these probabilities [V] (to 1e-14, NaN = never seen), each
    looked at once."""
    terrain = Terrain.from_indices(indices, voxel_size_m, origin)
    crowd_map = CrowdMap(terrain, SURE)
    ids, probability = terrain.voxel_ids(indices), np.asarray(probability, dtype=float)
    stamps_ns = np.broadcast_to(last_seen_ns, len(ids))
    seen = ~np.isnan(probability)
    for stamp_ns in np.unique(stamps_ns[seen]):
        now = seen & (stamps_ns == stamp_ns)
        look(crowd_map, "uav1", int(stamp_ns), ids[now], (1.0 + probability[now]) / 2.0)
    return crowd_map


def flat_crowd_map(
    probability: NDArray[np.float64],
    cell_size_m: float = 1.0,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    last_seen_ns: ArrayLike = 0,
) -> CrowdMap:
    """One voxel per column [X, Y] at k = 0, as in `small_grids.flat_grid`; NaN probability = never seen."""
    indices = np.stack([*np.nonzero(np.ones(probability.shape)), np.zeros(probability.size, int)], axis=1)
    stamps_ns = np.broadcast_to(last_seen_ns, probability.shape).ravel()
    return crowd_map_of(indices, probability.ravel(), stamps_ns, voxel_size_m=cell_size_m, origin=origin)
