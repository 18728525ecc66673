"""Closing with a disc, exactly and for any radius."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

MAX_PADDED_CELLS = 1 << 26
"""Largest array that is worked on, margins included: about 2 GB."""


def close_with_disc(mask: NDArray[np.bool_], radius_cells: ArrayLike) -> NDArray[np.bool_]:
    """Morphological closing of a bool [H, W] mask: fills every gap that a disc outside the mask cannot enter.

    `radius_cells` is one radius in cells or one per cell [H, W]; a cell outside the mask takes the radius of
    the mask's nearest cell, so that silhouettes at different depths are closed by discs of different size.
    The outside of the array counts as empty: nothing grows along the border. The result contains the mask.

    Raises ValueError for a radius that is negative, not finite, or too large to compute with.
    """
    from scipy.ndimage import distance_transform_edt

    if mask.ndim != 2 or mask.dtype != np.bool_:
        raise ValueError(f"mask must be bool [H, W], got {mask.dtype} {list(mask.shape)}")
    if not mask.any():
        return mask.copy()
    radius = np.broadcast_to(np.asarray(radius_cells, np.float64), mask.shape)
    used = radius[mask]
    if not (np.isfinite(used).all() and used.min() >= 0.0):
        raise ValueError(
            f"closing radius must be finite and at least 0, got {used.min():g} to {used.max():g}"
        )
    # A disc that just misses the array may be centred a radius outside it.
    margin = int(np.ceil(used.max())) + 1
    if (mask.shape[0] + 2 * margin) * (mask.shape[1] + 2 * margin) > MAX_PADDED_CELLS:
        raise ValueError(
            f"closing {list(mask.shape)} cells with a disc of radius {used.max():g} needs more than "
            f"{MAX_PADDED_CELLS} cells of memory; use a smaller radius"
        )
    padded, padded_radius = np.pad(mask, margin), np.pad(radius, margin)
    to_mask, nearest = distance_transform_edt(~padded, return_indices=True)
    local_radius = padded_radius[tuple(nearest)]
    disc_centres = to_mask > local_radius  # here a disc fits without touching the mask
    reachable = distance_transform_edt(~disc_centres) <= local_radius
    closed = padded | ~reachable
    return np.asarray(closed[margin:-margin, margin:-margin])
