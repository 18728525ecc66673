"""Crowd regions of one image from the silhouettes of its people."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.truth.morphology import close_with_disc


def crowd_regions(
    silhouettes: ArrayLike,
    *,
    closing_px: float | None = None,
    closing_m: float | None = None,
    depth_m: ArrayLike | None = None,
    focal_px: float | None = None,
    min_pixels: int = 1,
) -> NDArray[np.bool_]:
    """Ground truth of one image as in the paper: "merging silhouettes and filling the gaps".

    `silhouettes` [H, W]: bool, all pixels that show people of a crowd; or integers, 0 for none and any other
    value for one crowd each. Silhouettes are closed with a disc, holes are filled, and connected regions
    of fewer than `min_pixels` pixels are left out. Crowds with different values are closed one by one and
    never grow together; a mask with one value per person has to be reduced to `people != 0` first.

    The radius of the disc is `closing_px` pixels everywhere, or `closing_m` metres at the depth of the
    silhouettes: then `depth_m` (one number or [H, W], distance along the optical axis; infinite joins
    nothing) and `focal_px` are needed. Returns bool [H, W].

    Raises ValueError for arrays of another kind or shape, a radius given twice or not at all, and a depth
    that is not positive at a pixel that shows people.
    """
    labels = np.asarray(silhouettes)
    if labels.ndim != 2 or labels.dtype.kind not in "bui":
        raise ValueError(
            f"silhouettes must be bool or integer [H, W], got {labels.dtype} {list(labels.shape)}"
        )
    radius_px = _closing_radius_px(labels != 0, closing_px, closing_m, depth_m, focal_px)
    regions = np.zeros(labels.shape, np.bool_)
    for crowd in np.unique(labels[labels != 0]):
        regions |= _region_of(labels == crowd, radius_px)
    return _without_small(regions, min_pixels)


def _closing_radius_px(
    shown: NDArray[np.bool_],
    closing_px: float | None,
    closing_m: float | None,
    depth_m: ArrayLike | None,
    focal_px: float | None,
) -> NDArray[np.float64]:
    """Radius per pixel [H, W]; 0 where nobody is shown."""
    if (closing_px is None) == (closing_m is None):
        raise ValueError("give the closing radius once: closing_px, or closing_m with depth_m and focal_px")
    if closing_px is not None:
        return np.where(shown, _at_least_zero("closing_px", closing_px), 0.0)
    assert closing_m is not None
    if depth_m is None or focal_px is None:
        raise ValueError("closing_m needs depth_m and focal_px to become pixels")
    if not (np.isfinite(focal_px) and focal_px > 0.0):
        raise ValueError(f"focal_px must be positive and finite, got {focal_px}")
    given = np.asarray(depth_m, np.float64)
    if given.ndim != 0 and given.shape != shown.shape:
        raise ValueError(f"depth_m must be one number or {list(shown.shape)}, got {list(given.shape)}")
    depth = np.broadcast_to(given, shown.shape)
    wrong = shown & ~(depth > 0.0)  # also true for NaN
    if wrong.any():
        row, column = (int(index) for index in np.argwhere(wrong)[0])
        raise ValueError(
            f"depth {depth[row, column]} m at row {row}, column {column}, which shows people, is not positive"
        )
    return _at_least_zero("closing_m", closing_m) * focal_px / np.where(shown, depth, np.inf)


def _at_least_zero(name: str, value: float) -> float:
    if not (np.isfinite(value) and value >= 0.0):
        raise ValueError(f"{name} must be a finite length of at least 0, got {value}")
    return value


def _region_of(crowd: NDArray[np.bool_], radius_px: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Closed and filled, computed on the crowd's bounding box only: nothing outside it can be filled."""
    from scipy.ndimage import binary_fill_holes

    rows, columns = np.flatnonzero(crowd.any(axis=1)), np.flatnonzero(crowd.any(axis=0))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    region = np.zeros_like(crowd)
    region[box] = binary_fill_holes(close_with_disc(crowd[box], radius_px[box]))
    return region


def _without_small(regions: NDArray[np.bool_], min_pixels: int) -> NDArray[np.bool_]:
    from scipy.ndimage import generate_binary_structure, label

    if min_pixels <= 1:
        return regions
    label_of_pixel, count = label(regions, structure=generate_binary_structure(2, 2))
    pixels = np.bincount(label_of_pixel.ravel(), minlength=count + 1)
    kept = pixels >= min_pixels
    kept[0] = False
    return np.asarray(kept[label_of_pixel])
