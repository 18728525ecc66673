"""OctoMap files (.bt occupancy, .ot full tree) -> Terrain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from crowdfence._core import Terrain
from crowdfence.georeference import Georeference
from crowdfence.maps.map_error import MapError
from crowdfence.maps.map_reading import MapReading
from crowdfence.octomap_frame import LONGEST_HEADER, marked, moved_back, read_frame

_STAMPS_OF_PYOCTOMAP = b"\n#PYOC_TIME_V1\n"
"""What pyoctomap writes behind the nodes of an OcTreeStamped in a .bt, before a zip of its stamps. Other
readers of OctoMap stop at the last node; that more bytes follow is an error here, for one that is wrong."""


def open_octomap(
    path: Path,
    *,
    voxel_size_m: float | None = None,
    georeference: Georeference | None = None,
    origin: Sequence[float] | None = None,
) -> MapReading:
    """Occupied leaves of an OctoMap, whose coordinates are local ENU metres; `origin` is added to them.

    The file decides the voxel size; another `voxel_size_m` is refused, since resampled voxels have gaps.
    A file of ours says in a comment where it lies (`octomap_frame`); `origin` overrides its origin, and an
    anchor other than `georeference` is refused. Other files know no place on Earth: `georeference` is taken
    as given and `origin` is zero unless given.
    """
    data = path.read_bytes().partition(_STAMPS_OF_PYOCTOMAP)[0]
    frame = read_frame(data)
    known = frame if origin is None else None
    place = (known.origin_m if known else (0.0, 0.0, 0.0)) if origin is None else origin
    terrain = Terrain.from_octomap(data, origin=place)
    if frame is not None:
        terrain = marked(terrain, frame)
    if known is not None:
        terrain = moved_back(terrain, known)
    if voxel_size_m is not None and not math.isclose(voxel_size_m, terrain.voxel_size_m, rel_tol=1e-6):
        raise MapError(
            path,
            f"has voxels of {terrain.voxel_size_m:g} m, but voxel_size_m is {voxel_size_m:g}; an OctoMap is "
            "not resampled, so leave voxel_size_m out",
        )
    terrain.georeference = _anchor(path, georeference, None if frame is None else frame.georeference)
    return MapReading(terrain, voxel_size_why="as in the file, which cannot be resampled")


def stated_anchor(path: Path) -> Georeference | None:
    """The anchor in the header of an OctoMap of ours."""
    with path.open("rb") as file:
        frame = read_frame(file.read(LONGEST_HEADER))
    return None if frame is None else frame.georeference


def _anchor(path: Path, wanted: Georeference | None, written: Georeference | None) -> Georeference | None:
    if wanted is None or written is None or wanted == written:
        return wanted or written
    offset_m = wanted.local_from_geodetic(written.latitude_deg, written.longitude_deg, written.height_m)
    raise MapError(
        path,
        f"is anchored {abs(offset_m).max():.3g} m away from the recording's local frame; make it again for "
        "that frame, or pass the map that it was made from",
    )
