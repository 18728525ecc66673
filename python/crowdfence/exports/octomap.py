"""The map as OctoMap files, for octovis, RViz and everything else that reads them.

Two files, because the plain format can only say "occupied": a binary tree (`.bt`) with the terrain, and a
ColorOcTree (`.ot`) whose voxels carry the colour of their state and probability (`colors.py`). OctoMap has no
place for a stamp, a threshold or a georeference; those are in the other exports.
"""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from crowdfence.exports.atomic import write_bytes
from crowdfence.exports.colors import voxel_colors

if TYPE_CHECKING:
    from crowdfence._core import Terrain


def write_terrain_octomap(path: str | PathLike[str], terrain: Terrain) -> None:
    """Every voxel of the terrain as an occupied leaf of a binary tree (`.bt`).

    Raises ValueError when the terrain does not fit into an OctoMap, OSError when the file cannot be written.
    """
    from crowdfence import _core

    write_bytes(path, _core.write_octomap_binary(terrain, _every_id(terrain)))


def write_colored_octomap(
    path: str | PathLike[str],
    terrain: Terrain,
    probability: ArrayLike,
    state: ArrayLike,
    threshold: float,
) -> None:
    """Every voxel of the terrain as a coloured leaf of a ColorOcTree (`.ot`).

    probability [V] and state [V] (`VoxelState`) as `CrowdMap` returns them. Unseen voxels are written too, in
    the grey of their state: leaving them out would make them look like free space.
    Raises ValueError when the arrays do not have one entry per voxel or the terrain does not fit into an
    OctoMap, OSError when the file cannot be written.
    """
    from crowdfence import _core

    probabilities, states = np.asarray(probability, dtype=np.float64), np.asarray(state, dtype=np.uint8)
    for name, array in (("probability", probabilities), ("state", states)):
        if array.shape != (terrain.voxel_count,):
            raise ValueError(f"{name} must have shape [{terrain.voxel_count}], got {list(array.shape)}")
    colors = voxel_colors(probabilities, states, threshold)
    write_bytes(path, _core.write_octomap_color(terrain, _every_id(terrain), colors, probabilities))


def _every_id(terrain: Terrain) -> np.ndarray:
    return np.arange(terrain.voxel_count, dtype=np.int64)
