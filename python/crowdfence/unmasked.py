"""Masked arrays where every value counts: numpy takes what stands below a mask for a value without a word."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def require_unmasked(values: ArrayLike, name: str) -> None:
    """ValueError for masked elements of `numpy.ma`."""
    if np.ma.is_masked(values):
        raise ValueError(f"{name} are masked; leave out what nobody knows")
