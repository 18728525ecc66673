"""Small maps for the tests of zones and exports."""

import numpy as np
from numpy.typing import NDArray

from crowdfence.surface_grid import SurfaceGrid
from crowdfence.voxel_state import VoxelState


def flat_grid(
    probability: NDArray[np.float64],
    cell_size_m: float = 1.0,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    last_seen_ns: NDArray[np.int64] | None = None,
) -> SurfaceGrid:
    """One voxel per column at k = 0; NaN probability = never seen."""
    indices = np.stack([*np.nonzero(np.ones(probability.shape)), np.zeros(probability.size, int)], axis=1)
    state = np.where(np.isnan(probability), VoxelState.NEVER_SEEN, VoxelState.EMPTY)
    stamps = None if last_seen_ns is None else last_seen_ns.ravel()
    return SurfaceGrid.from_voxels(indices, cell_size_m, origin, probability.ravel(), state.ravel(), stamps)
