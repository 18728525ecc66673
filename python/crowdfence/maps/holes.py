"""Holes of a height raster: the small ones are bridged from their rims, and all are counted.

A hole is a group of pixels without height, touching at edges or corners, with heights all around it. What
reaches the edge of the raster is where the map ends. Dropouts of lidar and photogrammetry (wet asphalt,
glass, shadow) measure a few square metres; water, which must stay a hole, measures more.

Inside a bridged hole every height is the mean of its four neighbours (a discrete harmonic surface): a plane
is continued exactly, and beside a wall the heights stay between the lowest and the highest of the rim. Pixels
with a height are never changed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import beyond
from crowdfence.maps.height_raster import Bridges, HeightRaster

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MAX_HOLE_M2 = 25.0
"""Bridged unless the caller says otherwise: 5 x 5 m."""


@dataclass(frozen=True, slots=True)
class MapHoles:
    """The holes of a height model."""

    max_hole_m2: float
    """Larger ones stay open."""
    bridged: int
    bridged_m2: float
    open: int
    open_m2: float

    def __str__(self) -> str:
        if not (self.bridged or self.open):
            return "none"
        # 5 x 5 m of a projection are 25.02 m2 of ground.
        open_m2 = beyond(self.open_m2, self.max_hole_m2 if self.open else 0.0, ",")
        return (
            f"{self.bridged} bridged ({self.bridged_m2:,.1f} m2), {self.open} left open "
            f"({open_m2} m2), limit {self.max_hole_m2:g} m2"
        )


def bridge_holes(raster: HeightRaster, pixel_m2: float, max_hole_m2: float) -> tuple[Bridges, MapHoles]:
    """Heights for the holes up to `max_hole_m2` large, and what was found."""
    runs = _Runs.of(raster)
    hole = runs.connected()
    count = int(hole.max(initial=-1)) + 1
    area_m2 = np.bincount(hole, runs.stop - runs.start, count) * pixel_m2
    closed = np.bincount(hole, runs.at_edge(raster), count) == 0
    small = closed & (area_m2 <= max_hole_m2 * (1 + 1e-9))
    large = closed & ~small
    holes = MapHoles(
        max_hole_m2,
        int(small.sum()),
        float(area_m2[small].sum()),
        int(large.sum()),
        float(area_m2[large].sum()),
    )
    row, column = runs.pixels(small[hole])
    return Bridges(row, column, _harmonic(raster, row, column)), holes


@dataclass(frozen=True, slots=True, eq=False)
class _Runs:
    """Pixels without height as runs [N] along rows, columns [start, stop), sorted."""

    row: Indices
    start: Indices
    stop: Indices

    @staticmethod
    def of(raster: HeightRaster) -> _Runs:
        rows, bounds = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        for first_row, strip in raster.strips():
            missing = np.isnan(strip)
            if missing.any():
                # A row changes where a run starts and where it stops, in turn.
                row, column = np.nonzero(np.diff(missing, axis=1, prepend=False, append=False))
                rows.append(row[::2] + first_row)
                bounds.append(column)
        bound = np.concatenate(bounds)
        return _Runs(np.concatenate(rows), bound[::2], bound[1::2])

    def connected(self) -> Indices:
        """Number of each run's group [N], from 0; runs of neighbouring rows that touch belong together."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        count = len(self.row)
        width = int(self.stop.max(initial=0)) + 2
        # Runs of the next row that touch this one lie together: stop >= this start, start <= this stop.
        first = np.searchsorted(self.row * width + self.stop, (self.row + 1) * width + self.start)
        last = np.searchsorted(self.row * width + self.start, (self.row + 1) * width + self.stop, "right")
        touching = np.maximum(last - first, 0)
        this = np.repeat(np.arange(count), touching)
        below = np.arange(len(this)) - np.repeat(np.cumsum(touching) - touching, touching) + first[this]
        graph = coo_array((np.ones(len(this), np.int8), (this, below)), shape=(count, count))
        return np.asarray(connected_components(graph, directed=False)[1], np.int64)

    def at_edge(self, raster: HeightRaster) -> NDArray[np.bool_]:
        vertical = (self.row == 0) | (self.row == raster.height - 1)
        return vertical | (self.start == 0) | (self.stop == raster.width)

    def pixels(self, chosen: NDArray[np.bool_]) -> tuple[Indices, Indices]:
        """Row and column of every pixel of some runs."""
        start, length = self.start[chosen], (self.stop - self.start)[chosen]
        inside = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        return np.repeat(self.row[chosen], length), np.repeat(start, length) + inside


def _harmonic(raster: HeightRaster, row: Indices, column: Indices) -> Array:
    """Heights of pixels inside holes: each the mean of its four neighbours."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import spsolve

    count = len(row)
    if count == 0:
        return np.empty(0)
    beside_row = row[:, np.newaxis] + (-1, 1, 0, 0)
    beside_column = column[:, np.newaxis] + (0, 0, -1, 1)
    heights = _heights(raster, beside_row.ravel(), beside_column.ravel()).reshape(count, 4)
    in_hole = np.isnan(heights)
    pixel, key = np.nonzero(in_hole)[0], row * raster.width + column
    neighbour = np.searchsorted(key, (beside_row * raster.width + beside_column)[in_hole])
    everyone = np.arange(count)
    weights = np.concatenate([np.full(count, 4.0), np.full(len(pixel), -1.0)])
    places = np.concatenate([everyone, pixel]), np.concatenate([everyone, neighbour])
    equations = csc_array((weights, places), shape=(count, count))
    return np.atleast_1d(spsolve(equations, np.nansum(heights, axis=1)))


def _heights(raster: HeightRaster, row: Indices, column: Indices) -> Array:
    """Heights of pixels [N], read in strips."""
    heights, order = np.empty(len(row)), np.argsort(row, kind="stable")
    rising = row[order]
    for first_row, strip in raster.strips(int(rising[0]), int(rising[-1]) + 1):
        here = order[slice(*np.searchsorted(rising, [first_row, first_row + len(strip)]))]
        heights[here] = strip[row[here] - first_row, column[here]]
    return heights
