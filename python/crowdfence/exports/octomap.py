"""The map as OctoMap files, for octovis, RViz and everything else that reads them.

Two files, because the plain format can only say "occupied": a binary tree (`.bt`) with the terrain, and a
ColorOcTree (`.ot`) whose voxels carry the colour of their state and probability (`colours.py`).

In both every voxel is occupied, because it is solid ground. The probability of crowd is not written as
occupancy: ground that was seen empty would then read as free space, to fly through. The coloured tree holds
what was seen and nothing else: ground that is not in it is not known, and the terrain is in the other file.

Voxels lie where they are in local metres, within half a voxel. OctoMap has no place for the rest, a stamp or
a threshold: they stand in the header as a comment line, `# crowdfence {JSON}`, which readers skip.
"""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from crowdfence.atomic_file import write_bytes
from crowdfence.exports.colours import STATE_COLOURS, state_colours
from crowdfence.exports.map_description import MapDescription
from crowdfence.iso_time import iso_utc
from crowdfence.octomap_frame import annotated, described, shift_of
from crowdfence.voxel_state import VoxelState

if TYPE_CHECKING:
    from crowdfence._core import Terrain

OCCUPIED = 0.97
"""Occupancy of every voxel: the library's own upper clamp, rounded down."""


def write_terrain_octomap(path: str | PathLike[str], terrain: Terrain) -> None:
    """Every voxel of the terrain as an occupied leaf of a binary tree (`.bt`).

    Raises ValueError when the terrain does not fit into an OctoMap, OSError when the file cannot be written.
    """
    from crowdfence import _core

    every_id = np.arange(terrain.voxel_count, dtype=np.int64)
    data = _core.write_octomap_binary(terrain, every_id, shift_of(terrain))
    write_bytes(path, annotated(data, described(terrain)))


def write_coloured_octomap(
    path: str | PathLike[str],
    terrain: Terrain,
    probability: ArrayLike,
    state: ArrayLike,
    description: MapDescription,
) -> None:
    """Every voxel that was seen as a coloured leaf of a ColorOcTree (`.ot`).

    probability [V] and state [V] (`VoxelState`) as `CrowdMap` returns them. ValueError when the arrays do not
    have one entry per voxel or the terrain does not fit into an OctoMap, OSError when the file cannot be
    written.
    """
    from crowdfence import _core

    probabilities, states = np.asarray(probability, dtype=np.float64), np.asarray(state, dtype=np.uint8)
    for name, array in (("probability", probabilities), ("state", states)):
        if array.shape != (terrain.voxel_count,):
            raise ValueError(f"{name} must have shape [{terrain.voxel_count}], got {list(array.shape)}")
    seen = np.flatnonzero((states != VoxelState.NEVER_SEEN) & (states != VoxelState.OCCLUDED))
    colours = state_colours(probabilities[seen], states[seen], description.threshold)
    data = _core.write_octomap_color(terrain, seen, colours, np.full(len(seen), OCCUPIED), shift_of(terrain))
    write_bytes(path, annotated(data, described(terrain) | _meaning(description)))


def _meaning(description: MapDescription) -> dict[str, Any]:
    return {
        "method": description.method,
        "threshold": description.threshold,
        "stamp_utc": iso_utc(description.stamp_ns),
        "mission": description.mission,
        "layer": description.layer,
        "colors": {state.name: list(colour) for state, colour in STATE_COLOURS.items()},
    }
