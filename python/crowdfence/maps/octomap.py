"""OctoMap files (.bt occupancy, .ot full tree) -> Terrain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from crowdfence._core import Terrain
from crowdfence.georeference import Georeference
from crowdfence.maps.map_error import MapError


def open_octomap(
    path: Path,
    *,
    voxel_size_m: float | None = None,
    georeference: Georeference | None = None,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
) -> Terrain:
    """Occupied leaves of an OctoMap, whose coordinates are local ENU metres; `origin` is added to them.

    The file decides the voxel size; another `voxel_size_m` is refused, since resampled voxels have gaps.
    An OctoMap knows no place on Earth, so `georeference` is taken as given.
    """
    terrain = Terrain.from_octomap(path.read_bytes(), origin=origin)
    if voxel_size_m is not None and not math.isclose(voxel_size_m, terrain.voxel_size_m, rel_tol=1e-6):
        raise MapError(
            path,
            f"has voxels of {terrain.voxel_size_m:g} m, but voxel_size_m is {voxel_size_m:g}; an OctoMap is "
            "not resampled, so leave voxel_size_m out",
        )
    terrain.georeference = georeference
    return terrain
