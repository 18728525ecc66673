"""From pixels, rays or labels to the cells that they make up."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def block_means(values: NDArray[Any], side: int) -> NDArray[np.float32]:
    """Means [..., H / side, W / side] of the cells of `side` x `side` values [..., H, W]. ValueError when the
    cells are not whole."""
    *many, height, width = values.shape
    if height % side or width % side:
        raise ValueError(f"an array of {width}x{height} values has no whole cells of {side}x{side}")
    blocks = values.reshape(*many, height // side, side, width // side, side)
    return np.asarray(blocks.mean(axis=(-3, -1), dtype=np.float32))
