"""Edges of bins as the caller gives them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def increasing_edges(name: str, edges: ArrayLike) -> NDArray[np.float64]:
    """Edges [K + 1] of K bins. ValueError that names them unless they increase."""
    checked = np.asarray(edges, np.float64)
    if checked.ndim != 1 or checked.size < 2 or not (np.diff(checked) > 0.0).all():
        raise ValueError(f"{name} must be two or more increasing numbers, got {checked.tolist()}")
    return checked
