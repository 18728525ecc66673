"""What a map file becomes as a terrain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.georeference import Georeference
from crowdfence.inspection.map_file import Facts, map_file_facts, map_file_kind
from crowdfence.maps import MapHoles, MapReading, read_map
from crowdfence.maps.voxel_size import coarse_voxels_warning

if TYPE_CHECKING:
    from crowdfence.inspection.options import InspectionOptions

_PLACES_PER_BLOCK = 1 << 20  # 24 MB of indices at a time, however large the map is

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class TerrainReport:
    """Size and place of a terrain in its local frame (east, north, up)."""

    voxels: int
    voxel_size_m: float
    low_m: Point
    """Lowest corner of the occupied voxels, local metres."""
    high_m: Point
    extent_m: Point
    unmeasured_m2: float
    """Ground whose surface nobody measured, as far as the map says: bridged holes, gaps of a point cloud. No
    landing site lies there."""
    unmeasured_share: float
    """Of all ground of the map."""
    georeference: Georeference | None
    fingerprint: str
    """Checksum that a crowd map names its terrain by, 16 hexadecimal digits."""

    @staticmethod
    def of(terrain: Terrain, columns: int | None = None) -> TerrainReport:
        """`columns` of the terrain, where they were counted already."""
        low, high = terrain.bounds
        unmeasured = len(terrain.unmeasured)
        return TerrainReport(
            voxels=terrain.voxel_count,
            voxel_size_m=terrain.voxel_size_m,
            low_m=_point(low),
            high_m=_point(high),
            extent_m=_point(high - low),
            unmeasured_m2=unmeasured * terrain.voxel_size_m**2,
            unmeasured_share=unmeasured / (columns or count_columns(terrain).columns) if unmeasured else 0.0,
            georeference=terrain.georeference,
            fingerprint=f"{terrain.fingerprint:016x}",
        )


@dataclass(frozen=True, slots=True)
class ColumnReport:
    """The terrain seen from above."""

    columns: int
    """Columns that hold a voxel."""
    overhangs: int
    """Columns with air between two voxels: roofs, crowns, bridges."""
    overhang_share: float


@dataclass(frozen=True, slots=True)
class MapReport:
    """A map file: what it says about itself and the terrain that it becomes."""

    path: str
    kind: str
    bytes: int
    file: Facts
    """What the file's own header says, by name with the unit."""
    terrain: TerrainReport
    tree_bytes: int
    tree_bytes_per_voxel: float
    columns: ColumnReport
    landing_prior: float | None
    """Share of the columns that is suitable for landing, the paper's prior; None when it was not taken."""
    no_landing_prior: str | None
    """Why there is none."""
    holes: MapHoles | None
    """None for a map that is no height model."""
    voxel_size_why: str
    """Who chose the size of the voxels."""
    warnings: list[str]


def inspect_map(path: Path, options: InspectionOptions, tell: Callable[[str], None]) -> MapReport:
    """MapError (a ValueError) for a file that cannot become a terrain."""
    tell(f"reading {path.name}")
    reading = read_map_file(path, options)
    terrain = reading.terrain
    tell("counting columns")
    columns = count_columns(terrain)
    coarse = coarse_voxels_warning(terrain.voxel_size_m)
    prior, reason = (None, "left out") if options.quick else _landing_prior(terrain, tell)
    return MapReport(
        path=str(path),
        kind=map_file_kind(path),
        bytes=path.stat().st_size,
        file=map_file_facts(path),
        terrain=TerrainReport.of(terrain, columns.columns),
        tree_bytes=terrain.tree_bytes,
        tree_bytes_per_voxel=terrain.tree_bytes / terrain.voxel_count,
        columns=columns,
        landing_prior=prior,
        no_landing_prior=reason,
        holes=reading.holes,
        voxel_size_why=reading.voxel_size_why,
        warnings=[*reading.doubts, *([] if coarse is None else [coarse])],
    )


def read_map_file(path: Path, options: InspectionOptions) -> MapReading:
    """ValueError for an option that this kind of map does not have."""
    try:
        return read_map(path, **options.terrain_options)
    except TypeError as error:
        raise ValueError(str(error)) from error


def count_columns(terrain: Terrain) -> ColumnReport:
    """Columns and overhangs: a column with several standing places has air between voxels."""
    places = terrain.standing_places()  # sorted by column
    columns = overhangs = 0
    last, last_is_overhang = np.full(2, np.iinfo(np.int64).min), True
    for start in range(0, len(places), _PLACES_PER_BLOCK):
        column = terrain.voxel_indices(places[start : start + _PLACES_PER_BLOCK])[:, :2]
        is_further = (np.diff(column, axis=0, prepend=[last]) == 0).all(axis=1)
        # The second place makes an overhang of its column, a third one changes nothing.
        is_second = is_further & ~np.concatenate([[last_is_overhang], is_further[:-1]])
        columns += int(np.count_nonzero(~is_further))
        overhangs += int(np.count_nonzero(is_second))
        last, last_is_overhang = column[-1], bool(is_further[-1])
    return ColumnReport(columns, overhangs, overhangs / columns)


def _landing_prior(terrain: Terrain, tell: Callable[[str], None]) -> tuple[float | None, str | None]:
    """(prior, None), or (None, why there is none)."""
    from crowdfence.landing_area import landing_prior

    tell("taking the landing prior")
    try:
        return landing_prior(terrain), None
    except ValueError as error:
        return None, str(error)


def _point(values: NDArray[np.float64]) -> Point:
    return float(values[0]), float(values[1]), float(values[2])
