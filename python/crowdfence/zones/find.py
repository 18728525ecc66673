"""A crowd map at one stamp -> its zones, at the cost of what was seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdColumns, CrowdMap, Terrain
from crowdfence.zones.least_area import least_columns, of_those_kept
from crowdfence.zones.outline import outlines
from crowdfence.zones.regions import Runs, largest_first, reach_columns
from crowdfence.zones.zone import Zone, ZoneSet
from crowdfence.zones.zone_id import zone_id

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon


def find_zones(
    crowd_map: CrowdMap, stamp_ns: int, *, threshold: float | None = None, min_area_m2: float = 0.0
) -> ZoneSet:
    """Regions of the terrain's columns that hold crowd, at a stamp not before the newest instant.

    threshold    in (0, 1]: a voxel at or above it is crowd; None = the method's `default_threshold`
    min_area_m2  >= 0: smaller regions are left out and counted in the result

    Columns that touch at an edge or a corner belong to the same region, and those within 2 m of each other,
    from middle to middle: such a zone may have several parts. A column that was never seen is in no zone: a
    zone says where crowd is believed to be, its absence does not say that ground is clear (see
    `CrowdMap.state`). This is one look at a map; a `ZoneEngine` follows zones over time.

    Raises StampError for an earlier stamp, ValueError for a parameter out of bounds and for more zones than
    there are ids.
    """
    if threshold is None:
        threshold = crowd_map.default_threshold()
    crowd = crowd_map.crowd_columns(stamp_ns, threshold=threshold)
    if not 0.0 <= min_area_m2 < np.inf:
        raise ValueError(f"min_area_m2 must be finite and not negative, got {min_area_m2}")
    runs = Runs.of(crowd.indices)
    voxel_size_m = crowd_map.terrain.voxel_size_m
    all_regions = largest_first(runs, reach_columns(voxel_size_m))
    size = np.bincount(np.repeat(all_regions, runs.length))
    kept = size >= least_columns(min_area_m2, voxel_size_m)
    region = of_those_kept(all_regions, kept)
    polygons = outlines(runs[region >= 0], region[region >= 0], crowd_map.terrain)
    return ZoneSet(
        zones=tuple(zones_of_regions(crowd_map, crowd, np.repeat(region, runs.length), polygons)),
        threshold=threshold,
        min_area_m2=min_area_m2,
        dropped_count=int(np.count_nonzero(~kept)),
        dropped_area_m2=float(size[~kept].sum() * voxel_size_m**2),
    )


def zones_of_regions(
    crowd_map: CrowdMap,
    crowd: CrowdColumns,
    column_region: NDArray[np.int64],
    polygons: Sequence[Polygon | MultiPolygon],
) -> Iterator[Zone]:
    """What the map says about each region, one zone per polygon; `column_region` [C] is the region of each
    column, others than those of the polygons are left out. Ids count from 1."""
    count = len(polygons)
    if count == 0:
        return
    zone_id(count)
    terrain = crowd_map.terrain
    columns, first = by_region(column_region, count)
    voxels, first_voxel = by_region(np.repeat(column_region, crowd.crowd_count), count)
    lower_m = _height_m(np.minimum.reduceat(crowd.bottom_index[columns], first), terrain)
    upper_m = _height_m(np.maximum.reduceat(crowd.top_index[columns], first) + 1, terrain)
    last_seen_ns = crowd.last_seen_ns[columns]
    newest_ns = np.maximum.reduceat(last_seen_ns, first)
    oldest_ns = np.minimum.reduceat(last_seen_ns, first)
    probability = np.split(crowd.probability[columns], first[1:])
    crowd_ids = np.split(crowd.voxel_ids[voxels], first_voxel[1:])
    for number, polygon in enumerate(polygons):
        yield Zone(
            id=zone_id(number + 1),
            polygon=polygon,
            cell_count=len(probability[number]),
            area_m2=len(probability[number]) * terrain.voxel_size_m**2,
            probability_max=float(probability[number].max()),
            probability_mean=float(probability[number].mean()),
            lower_m=float(lower_m[number]),
            upper_m=float(upper_m[number]),
            last_seen_ns=int(newest_ns[number]),
            oldest_look_ns=int(oldest_ns[number]),
            seen_by=tuple(crowd_map.seen_by(crowd_ids[number])),
        )


def by_region(region: NDArray[np.int64], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Positions in `region` of the numbers 0 to `count` - 1, one region after the other and sorted within
    each; where each begins [count]. Other numbers are left out."""
    kept = np.flatnonzero((region >= 0) & (region < count))
    size = np.bincount(region[kept], minlength=count)
    order = kept[np.argsort(region[kept], kind="stable")]
    return order, np.cumsum(size) - size


def _height_m(index: NDArray[np.int64], terrain: Terrain) -> NDArray[np.float64]:
    """Local height of the lower face of the voxels with grid index k = `index`."""
    return terrain.origin[2] + index.astype(np.float64) * terrain.voxel_size_m
