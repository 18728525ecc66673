"""Which voxels a map is given where nobody says: sizes that people would choose themselves, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass

BOUNDS_M = (0.001, 100.0)
"""What may be asked for: below, the size of a grain of sand; above, crowds are nowhere."""
SMALLEST_M = 0.05
AS_THE_FILE_M = 1.0
"""Files of this resolution or finer decide themselves, down to `FINEST_M`."""
FINEST_M = 0.25
"""Half of what a person takes up in a loose crowd. Finer files are read so coarsely: every voxel in view is
paid for at every look, and a photogrammetric model of 5 cm has twenty-five of them on the same ground."""
PEOPLE_M = 0.5
"""Coarser files are read so finely, if that is not too much: the room of a person in a loose crowd, and what
the shipped detector was measured with."""
MOST_COLUMNS = 10_000_000
"""1.6 km x 1.6 km at 0.5 m, read in some seconds."""
COARSE_M = 2.0
"""A crowd of ten people stands on about one voxel of this size."""


@dataclass(frozen=True, slots=True)
class VoxelSize:
    """The size of a map's voxels, and who chose it."""

    size_m: float
    why: str
    """As in "0.5 m, ...": after a comma."""


def require_voxel_size(size_m: float | None) -> None:
    """ValueError for a size that was asked for and makes no map."""
    low_m, high_m = BOUNDS_M
    if size_m is not None and not low_m <= size_m <= high_m:
        raise ValueError(f"voxel_size_m is {size_m:g}; it must be in [{low_m:g}, {high_m:g}], metres")


def chosen_voxel_size(given_m: float | None, file_m: float, told: str, area_m2: float) -> VoxelSize:
    """`given_m` where somebody said so; else the resolution `file_m` of the file, `told` in words. Coarser
    where that is finer than `FINEST_M`; finer where it is coarser than `AS_THE_FILE_M` and the map's area
    allows: the surface between heights, points and corners is interpolated, and people are small."""
    if given_m is not None:
        return VoxelSize(given_m, "as asked for")
    if file_m < FINEST_M:
        return VoxelSize(FINEST_M, f"coarser than {told}, because every one costs and people are larger")
    if file_m <= AS_THE_FILE_M:
        return VoxelSize(file_m, f"as {told}")
    affordable_m = round_voxel_size_m(max(PEOPLE_M, math.sqrt(area_m2 / MOST_COLUMNS)))
    if affordable_m >= file_m:
        return VoxelSize(file_m, f"as {told}; finer ones would be too many for so large a map")
    return VoxelSize(affordable_m, f"finer than {told}, because people are; heights are interpolated")


def coarse_voxels_warning(size_m: float) -> str | None:
    """What voxels too large for people do to zones; None for smaller ones."""
    if size_m <= COARSE_M:
        return None
    return (
        f"voxels of {size_m:g} m are coarse for people: a small crowd does not fill one and may be missed, "
        "and zones come in steps of that size (give a finer map, or --voxel-size-m where the map's format "
        "allows it)"
    )


def round_voxel_size_m(wanted_m: float) -> float:
    """The next of ... 0.1, 0.2, 0.5, 1, 2, 5 ... metres that is not below `wanted_m`; at least 5 cm."""
    wanted_m = max(wanted_m, SMALLEST_M)
    power = 10.0 ** math.floor(math.log10(wanted_m))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= wanted_m * (1 - 1e-9))
