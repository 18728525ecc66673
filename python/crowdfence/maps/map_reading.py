"""What comes out of a map file."""

from __future__ import annotations

from dataclasses import dataclass

from crowdfence._core import Terrain
from crowdfence.maps.holes import MapHoles


@dataclass(frozen=True, slots=True, eq=False)
class MapReading:
    """A terrain, and what its reader found on the way."""

    terrain: Terrain
    holes: MapHoles | None = None
    """None for kinds of maps that are no height models."""
    voxel_size_why: str = ""
    """Who chose the size of the voxels, as in "finer than the file's pixels of 2 m"."""
    doubts: tuple[str, ...] = ()
    """What is doubtful about the map, one sentence each."""
