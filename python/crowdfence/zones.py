"""Crowd map -> no-fly polygons on the ground plane.

The first simple form: cells at or above a threshold, grouped into connected regions, outlined exactly.
Nothing is simplified, smoothed or buffered here, so a zone covers its crowd cells and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap
from crowdfence.surface_grid import SurfaceGrid

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

MAX_ID_LENGTH = 7
"""Longest identifier that ED-318 and ED-269 accept."""


@dataclass(frozen=True, slots=True)
class Zone:
    """One connected region of crowd, in local metres."""

    id: str
    """At most 7 characters, unique within one call of `find_zones` only."""
    polygon: Polygon | MultiPolygon
    """Outline in the local plane (x east, y north). A region whose cells touch only at corners is a
    MultiPolygon; ground enclosed by crowd, but below the threshold, is a hole."""
    cell_count: int
    area_m2: float
    probability_max: float
    probability_mean: float
    lower_m: float
    """Local height of the underside of the lowest terrain voxel in the zone's columns."""
    upper_m: float
    """Local height of the top of the highest terrain voxel in the zone's columns."""
    last_seen_ns: int | None
    """Newest look at any of its cells; None when the grid holds no stamps."""
    oldest_look_ns: int | None
    """Last look at the cell that has gone unseen for longest."""
    seen_by: tuple[str, ...] = ()
    """Drones that saw it, where the caller knows."""


@dataclass(frozen=True, slots=True)
class ZoneSet(Sequence[Zone]):
    """The zones of one call, largest first, and what was left out of them."""

    zones: tuple[Zone, ...]
    threshold: float
    min_area_m2: float
    dropped_count: int
    """Regions smaller than `min_area_m2`: crowd that no zone covers."""
    dropped_area_m2: float

    @overload
    def __getitem__(self, index: int) -> Zone: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Zone, ...]: ...
    def __getitem__(self, index: int | slice) -> Zone | tuple[Zone, ...]:
        return self.zones[index]

    def __len__(self) -> int:
        return len(self.zones)

    def __iter__(self) -> Iterator[Zone]:
        return iter(self.zones)

    @property
    def area_m2(self) -> float:
        return sum(zone.area_m2 for zone in self.zones)


def find_zones(crowd_map: CrowdMap, stamp_ns: int, *, threshold: float, min_area_m2: float = 0.0) -> ZoneSet:
    grid = SurfaceGrid.from_crowd_map(crowd_map, stamp_ns, threshold=threshold, margin_m=60.0)
    return zones_of_grid(grid, threshold, min_area_m2=min_area_m2)


def zones_of_grid(grid: SurfaceGrid, threshold: float, *, min_area_m2: float = 0.0) -> ZoneSet:
    """Connected regions of columns whose probability is at or above `threshold`.

    Columns that touch at an edge or a corner belong to the same region. A column that was never seen holds
    no probability and is in no zone: a zone says where crowd is believed to be, its absence does not say
    that ground is clear (see `SurfaceGrid.state`). Regions smaller than `min_area_m2` are left out and
    counted in the result.

    Raises ValueError when threshold is not in (0, 1] or min_area_m2 is negative.
    """
    if not 0.0 < threshold <= 1.0:
        raise ValueError(f"threshold must be above 0 and at most 1, got {threshold}")
    if not 0.0 <= min_area_m2 < np.inf:
        raise ValueError(f"min_area_m2 must be finite and not negative, got {min_area_m2}")
    regions = sorted(_connected_regions(np.argwhere(grid.probability >= threshold)), key=_largest_first)
    kept = [region for region in regions if len(region) * grid.cell_area_m2 >= min_area_m2]
    dropped = regions[len(kept) :]
    return ZoneSet(
        zones=tuple(_zone(number, cells, grid) for number, cells in enumerate(kept, start=1)),
        threshold=threshold,
        min_area_m2=min_area_m2,
        dropped_count=len(dropped),
        dropped_area_m2=sum(len(region) for region in dropped) * grid.cell_area_m2,
    )


def count_regions(columns: NDArray[np.int64], *, min_columns: int = 1) -> int:
    """How many zones the distinct crowd columns (i, j) [N, 2] form, without outlining them."""
    return sum(len(region) >= min_columns for region in _connected_regions(columns))


def _connected_regions(cells: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Cells (i, j) [N, 2] of each region, sorted by i then j.

    Works on the list of cells, not on a raster, so that it costs what is crowd and not what lies between.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if len(cells) == 0:
        return []
    cells = cells[np.lexsort((cells[:, 1], cells[:, 0]))]
    first, second = _touching_pairs(cells)
    links = coo_array((np.ones(len(first), dtype=np.bool_), (first, second)), shape=(len(cells), len(cells)))
    _, label = connected_components(links, directed=False)
    order = np.argsort(label, kind="stable")
    return np.split(cells[order], np.cumsum(np.bincount(label))[:-1])


def _touching_pairs(cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Positions in `cells` (sorted by i then j) of every two that share an edge or a corner."""
    low = cells.min(axis=0)
    # Two columns of padding: a step of one from either end of a row must not land in the next row.
    stride = cells[:, 1].max() - low[1] + 3
    key = (cells[:, 0] - low[0]) * stride + cells[:, 1] - low[1]
    pairs = []
    for step in (1, stride - 1, stride, stride + 1):
        place = np.searchsorted(key, key + step).clip(max=len(key) - 1)
        touching = np.flatnonzero(key[place] == key + step)
        pairs.append(np.stack([touching, place[touching]]))
    first, second = np.concatenate(pairs, axis=1)
    return first, second


def _largest_first(cells: NDArray[np.int64]) -> tuple[int, int, int]:
    return (-len(cells), int(cells[0, 0]), int(cells[0, 1]))


def _zone(number: int, cells: NDArray[np.int64], grid: SurfaceGrid) -> Zone:
    zone_id = f"Z{number}"
    if len(zone_id) > MAX_ID_LENGTH:
        raise ValueError(f"more than {number - 1} zones; raise min_area_m2 or the threshold")
    i, j = cells.T
    probability = grid.probability[i, j]
    looks_ns = grid.last_seen_ns[i, j]
    looks_ns = looks_ns[looks_ns >= 0]
    return Zone(
        id=zone_id,
        polygon=outline(cells, grid),
        cell_count=len(cells),
        area_m2=len(cells) * grid.cell_area_m2,
        probability_max=float(probability.max()),
        probability_mean=float(probability.mean()),
        lower_m=float(grid.height_m(grid.bottom_index[i, j].min())),
        upper_m=float(grid.height_m(int(grid.top_index[i, j].max()) + 1)),
        last_seen_ns=int(looks_ns.max()) if looks_ns.size else None,
        oldest_look_ns=int(looks_ns.min()) if looks_ns.size else None,
    )


def outline(cells: NDArray[np.int64], grid: SurfaceGrid) -> Polygon | MultiPolygon:
    """Exact union of the cells (i, j) [N, 2], N >= 1, as a valid polygon without collinear vertices."""
    import shapely

    east_m, north_m = grid.east_edges_m, grid.north_edges_m
    column, south, north = _runs(cells)
    boxes = shapely.box(east_m[column], north_m[south], east_m[column + 1], north_m[north])
    # normalize starts every ring at its lowest corner; from there simplify(0) removes exactly the vertices
    # that lie on a straight edge, because the edges are axis-parallel and share bit-identical coordinates.
    union = shapely.simplify(shapely.normalize(shapely.union_all(boxes)), 0.0)
    if not isinstance(union, shapely.Polygon | shapely.MultiPolygon):
        raise ValueError(f"the outline of {len(cells)} cells is a {union.geom_type}, not a polygon")
    return union


def _runs(cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Unbroken runs of cells from south to north: column i [R], first cell j [R], one past the last cell [R].

    Few boxes instead of one per cell keep the union fast on regions of many thousand cells.
    """
    ordered = cells[np.lexsort((cells[:, 1], cells[:, 0]))]
    breaks = (np.diff(ordered[:, 0]) != 0) | (np.diff(ordered[:, 1]) != 1)
    first = np.concatenate(([0], np.flatnonzero(breaks) + 1))
    last = np.concatenate((first[1:] - 1, [len(ordered) - 1]))
    return ordered[first, 0], ordered[first, 1], ordered[last, 1] + 1
