"""A map of landing ground at one stamp -> the sites where a drone could land.

Everything is rounded against landing: a column counts when its own top was found fit by looks that are not
stale, whatever lies below it; when the known map was measured there, is level and has no step; and when no
closed zone touches it. What no drone of the fleet has in room for itself is left out. A site is what looks
and map speak for, no promise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap, Terrain
from crowdfence.landing_area import column_surface_m, slope_deg
from crowdfence.zones.outline import outlines
from crowdfence.zones.regions import Runs, largest_first
from crowdfence.zones.sorted_keys import are_among
from crowdfence.zones.tracker import column_keys
from crowdfence.zones.zone import Zone, closed_of

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

MAX_SLOPE_DEG = 10.0
"""Of the map, over a square of `SLOPE_WINDOW_M`, of 5 x 5 columns at least: over fewer, a step of bare voxels
on level ground reads as steeper."""
SLOPE_WINDOW_M = 2.5
STEP_VOXELS = 0.5
"""Ground beside a column that is higher or lower by more, as of a post or a ditch, is no site. A single voxel
among bare ones, which may be rounding, stands out by less."""
FIT_FROM = 0.5
"""The least threshold of ground that is fit, where nobody gives one: more likely than not."""
PAD_M = 2.0
"""Radius of the free disc that a drone needs."""
STALE_AFTER_S = 30.0


@dataclass(frozen=True, slots=True)
class LandingSite:
    """One connected region of ground on which a drone could land, in local metres."""

    id: str
    """L1, L2, ... from the one with the most room; S1 is a static zone."""
    polygon: Polygon | MultiPolygon
    area_m2: float
    centre: tuple[float, float, float]
    """Local x, y and height of the middle of the largest disc inside."""
    radius_m: float
    """Of that disc."""
    probability_min: float
    """Of its columns."""
    probability_mean: float
    slope_deg: float
    """Steepest place of the map in it."""
    last_seen_ns: int
    oldest_look_ns: int
    """Last look at the column that has gone unseen for longest."""
    seen_by: tuple[str, ...]
    """Drones that ever saw it."""


@dataclass(frozen=True, slots=True)
class _Columns:
    """Columns that count, arrays [C]: grid indices, probability, newest look, slope and height of the top."""

    indices: NDArray[np.int64]
    probability: NDArray[np.float64]
    last_seen_ns: NDArray[np.int64]
    slope_deg: NDArray[np.float64]
    height_m: NDArray[np.float64]
    voxel_ids: NDArray[np.int64]


def find_sites(
    landing_map: CrowdMap,
    stamp_ns: int,
    *,
    threshold: float | None = None,
    min_area_m2: float = 0.0,
    closed: Sequence[Zone] = (),
    stale_after_s: float = STALE_AFTER_S,
) -> tuple[LandingSite, ...]:
    """Landing sites on a map of the layer `landing-site`, at a stamp not before its newest instant.

    threshold    in (0, 1]: a voxel at or above it is fit; None = the method's `default_threshold`, at least
                 `FIT_FROM`
    min_area_m2  smaller sites are left out
    closed       zones, of a `ZoneSet` all that it closes; no site touches one, whatever their altitude band

    Sites end where a disc of `PAD_M` no longer fits, and no two of them share a corner. Raises StampError
    for an earlier stamp, ValueError for a parameter out of bounds and for a method that gives no sites
    (`require_takes_back`).
    """
    require_takes_back(landing_map.method.name)
    if not 0.0 <= min_area_m2 < np.inf:
        raise ValueError(f"min_area_m2 must be finite and not negative, got {min_area_m2}")
    if threshold is None:
        threshold = max(FIT_FROM, landing_map.default_threshold())
    columns = _fit(landing_map, stamp_ns, threshold, stale_after_s)
    columns = _some(columns, ~_touched(columns.indices, closed_of(closed), landing_map.terrain))
    room_m, inside = _room_m(columns.indices, landing_map.terrain.voxel_size_m)
    columns, room_m = _some(columns, inside), room_m[inside]
    return tuple(_sites(landing_map, columns, room_m, min_area_m2))


def require_takes_back(method: str) -> None:
    """ValueError for a method whose map keeps what it once found, whatever looks say later: ground that
    people walked onto would stay a site, as seen just now."""
    if method == "or":
        raise ValueError(
            "the method or never takes back ground that it once found fit, whoever stands there since: it "
            "gives no landing sites; use evidence"
        )


def _fit(landing_map: CrowdMap, stamp_ns: int, threshold: float, stale_after_s: float) -> _Columns:
    """Columns whose top was found fit by a look that is not stale, on level map that somebody measured."""
    terrain = landing_map.terrain
    found = landing_map.crowd_columns(stamp_ns, threshold=threshold)
    top_ids = terrain.voxel_ids(np.column_stack([found.indices, found.top_index]))
    # Of the top alone: what a drone saw below it lately makes it neither newer nor fitter.
    last_seen_ns = landing_map.last_seen_ns(top_ids)
    fits = np.isin(top_ids, found.voxel_ids) & (stamp_ns - last_seen_ns <= stale_after_s * 1e9)
    indices, top_ids = found.indices[fits], top_ids[fits]
    slope, height = _slope_and_height(terrain, indices)
    probability = landing_map.probability(stamp_ns, top_ids)
    columns = _Columns(indices, probability, last_seen_ns[fits], slope, height, top_ids)
    # What the reader of the map bridged may be a tank or a pit.
    measured = ~are_among(column_keys(indices), column_keys(terrain.unmeasured))
    return _some(columns, measured & (slope <= MAX_SLOPE_DEG))


def _slope_and_height(
    terrain: Terrain, indices: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of the map at columns [C]; a slope that cannot be told is infinite, and so is one beside a step."""
    height_m = column_surface_m(terrain)
    cells = max(5, 2 * round(SLOPE_WINDOW_M / terrain.voxel_size_m / 2) + 1)
    slope = slope_deg(height_m, terrain.voxel_size_m, window_cells=cells)
    # A plane through a square does not see the post in its middle: its slope there is 0.
    slope[_step_m(height_m) > STEP_VOXELS * terrain.voxel_size_m] = np.inf
    lowest = np.rint((terrain.bounds[0] - np.asarray(terrain.origin)) / terrain.voxel_size_m)
    i, j = (indices - lowest[:2].astype(np.int64)).T
    at = np.nan_to_num(slope[i, j].astype(np.float64), nan=np.inf)
    return at, terrain.bounds[0, 2] + height_m[i, j].astype(np.float64)


def _step_m(height_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """From each column [X, Y] up or down to the eight around it, the highest step; holes are none."""
    from scipy.ndimage import maximum_filter, minimum_filter

    hole = np.isnan(height_m)
    above = maximum_filter(np.where(hole, -np.inf, height_m), size=3) - height_m
    below = height_m - minimum_filter(np.where(hole, np.inf, height_m), size=3)
    return np.asarray(np.maximum(above, below))


def _touched(indices: NDArray[np.int64], closed: Sequence[Zone], terrain: Terrain) -> NDArray[np.bool_]:
    """Columns [C] of which a closed zone holds a part."""
    import shapely

    if not closed or not len(indices):
        return np.zeros(len(indices), np.bool_)
    size_m = terrain.voxel_size_m
    low = np.asarray(terrain.origin)[:2] + indices * size_m
    cells = shapely.box(low[:, 0], low[:, 1], low[:, 0] + size_m, low[:, 1] + size_m)
    everything = shapely.union_all([zone.polygon for zone in closed])
    shapely.prepare(everything)
    return np.asarray(shapely.intersects(everything, cells))


def _room_m(indices: NDArray[np.int64], size_m: float) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """How far the middle of each column [C] is from the edge of what counts, at least, and whether the column
    touches a disc of `PAD_M` that holds nothing else."""
    from scipy.ndimage import distance_transform_edt

    if not len(indices):
        return np.zeros(0), np.zeros(0, np.bool_)
    corner = indices.min(axis=0) - 1
    counts = np.zeros(indices.max(axis=0) - corner + 2, np.bool_)
    at = tuple((indices - corner).T)
    counts[at] = True
    # From the middle to the middle of the nearest other column: its corner is half a diagonal nearer.
    half_m = size_m * np.sqrt(0.5)
    room_m = distance_transform_edt(counts) * size_m - half_m
    roomy = room_m >= PAD_M
    if not roomy.any():
        return room_m[at], np.zeros(len(indices), np.bool_)
    return room_m[at], (distance_transform_edt(~roomy) * size_m < PAD_M + half_m)[at]


def _some(columns: _Columns, kept: NDArray[np.bool_]) -> _Columns:
    return _Columns(
        columns.indices[kept],
        columns.probability[kept],
        columns.last_seen_ns[kept],
        columns.slope_deg[kept],
        columns.height_m[kept],
        columns.voxel_ids[kept],
    )


def _sites(
    landing_map: CrowdMap, columns: _Columns, room_m: NDArray[np.float64], min_area_m2: float
) -> Iterator[LandingSite]:
    """One site per region that is large enough, the one with the most room first."""
    terrain = landing_map.terrain
    runs = Runs.of(columns.indices)
    if not len(runs):
        return
    region_of_run = largest_first(runs)
    region = np.repeat(region_of_run, runs.length)
    polygons = outlines(runs, region_of_run, terrain)
    members = np.split(np.argsort(region, kind="stable"), np.cumsum(np.bincount(region))[:-1])
    size_m = terrain.voxel_size_m
    large = [
        (members[number], polygon)
        for number, polygon in enumerate(polygons)
        if len(members[number]) * size_m**2 >= min_area_m2
    ]
    large.sort(key=lambda one: -float(room_m[one[0]].max()))
    for number, (some, polygon) in enumerate(large, start=1):
        middle = some[np.argmax(room_m[some])]
        x, y = np.asarray(terrain.origin)[:2] + (columns.indices[middle] + 0.5) * size_m
        yield LandingSite(
            id=f"L{number}",
            polygon=polygon,
            area_m2=len(some) * size_m**2,
            centre=(float(x), float(y), float(columns.height_m[middle])),
            radius_m=float(room_m[middle]),
            probability_min=float(columns.probability[some].min()),
            probability_mean=float(columns.probability[some].mean()),
            slope_deg=float(columns.slope_deg[some].max()),
            last_seen_ns=int(columns.last_seen_ns[some].max()),
            oldest_look_ns=int(columns.last_seen_ns[some].min()),
            seen_by=tuple(landing_map.seen_by(np.sort(columns.voxel_ids[some]))),
        )
