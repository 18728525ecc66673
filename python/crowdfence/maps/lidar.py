"""Lidar point clouds (.las, .laz, .copc.laz) -> Terrain."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.errors import one_line
from crowdfence.georeference import Georeference
from crowdfence.maps.geo_keys import las_crs, las_directory, vertical_unit
from crowdfence.maps.ground_surface import triangulate, unmeasured
from crowdfence.maps.height_raster import HIGHEST_PLAUSIBLE_M, LOWEST_PLAUSIBLE_M
from crowdfence.maps.las_header import check_las_header
from crowdfence.maps.lone_low_points import LonePoints
from crowdfence.maps.map_error import MapError
from crowdfence.maps.map_reading import MapReading
from crowdfence.maps.point_cells import Gathered, VoxelKeys, cells, lowest, means, summed
from crowdfence.maps.point_cover import PointCover
from crowdfence.maps.source_frame import (
    MAX_DISTANCE_M,
    HeightRules,
    HeightUnit,
    SourceFrame,
    chosen_crs,
    source_frame,
)
from crowdfence.maps.voxel_size import FINEST_M, chosen_voxel_size, round_voxel_size_m

if TYPE_CHECKING:
    from pyproj import CRS

Surface = Literal["ground", "all"]
# Points [N, 3] in local metres and which of them are ground [N].
Chunks = Iterator[tuple[NDArray[np.float64], NDArray[np.bool_]]]

# Classes of ASPRS LAS 1.4 R15, tables 9 and 17.
GROUND = (2, 8, 11, 20)
"""Ground, its key points in older files, the surface of roads, and ground beside breaklines."""
NOISE = (7, 18)
BRIDGE_DECK = 17

MAX_COLUMNS = 20_000_000
MAX_VOXELS = 100_000_000
# Triangulating takes about 10 seconds for a million points.
MAX_GROUND_COLUMNS = 5_000_000

_WKT = 2112
"""Number of the record that holds the reference system as text."""

_MOST_IN_HOLES = 0.25
"""Of the columns with points; rivers, lakes and halls take up less."""

_CHUNK_POINTS = 1_000_000
_LARGEST_COORDINATE = 1e9


def open_lidar(
    path: Path,
    *,
    voxel_size_m: float | None = None,
    georeference: Georeference | None = None,
    surface: Surface | None = None,
    max_hole_m: float = 50.0,
    crs: str | int | CRS | None = None,
    height_unit: HeightUnit = "auto",
    height_offset_m: float | None = None,
    assume_local: bool = False,
) -> MapReading:
    """Lidar points -> voxel surface in the local frame.

    - `surface="ground"`: the points of ground (classes 2, 8, 11 and 20), averaged per voxel column and joined
      by triangles, so that no ray falls through between two points. `surface="all"`: every voxel that holds a
      point (roofs, canopies with air below) on top of that ground; without such points the lowest one of a
      column is its ground. None: "ground" where the file has such points, else "all". Points marked as noise
      (classes 7 and 18) or withheld are left out.
    - `max_hole_m`: wider gaps stay holes. In narrower ones, where points are far apart for the file, the
      ground is `unmeasured`.
    - `crs`, `height_unit`, `height_offset_m`, `assume_local`: as in `maps.geotiff.open_geotiff`.

    Without `voxel_size_m` it follows the mean distance of neighbouring points on the ground that they cover
    (`maps.point_cover`), rounded up to 1, 2 or 5 times a power of ten, and is at least 0.25 m; where it is
    above a metre it is 0.5 m, or as fine as ten million columns allow. Without `georeference` the anchor is
    the middle of the file at its lowest height, rounded down to whole metres.

    MapError for a file without reference system, without usable points, with fewer points than its header
    says or at heights that no land has, more than 200 km from the anchor, too large for the voxel size, or
    damaged.
    """
    if surface not in (None, "ground", "all"):
        raise MapError(path, f"surface is {surface!r}, must be 'ground' or 'all'")
    if max_hole_m is not None and not (math.isfinite(max_hole_m) and max_hole_m > 0):
        raise MapError(path, f"max_hole_m is {max_hole_m}, must be finite and > 0")
    with _reader(path) as reader:
        low, high = _bounds(path, reader.header)
        in_file = _crs(path, reader.header) if crs is None else None
        known_crs = chosen_crs(in_file, crs, assume_local=assume_local)
        rules = HeightRules(height_unit, height_offset_m)
        metres_per_height = rules.metres_per_height(known_crs, _height_label(path, reader.header))
        frame = _frame(known_crs, georeference, rules, metres_per_height, low, high)
        corners = frame.local_from_source(*np.stack([low, high], axis=-1))
        area_m2, points = _box_m2(corners), int(reader.header.point_count)
        if voxel_size_m is None and round_voxel_size_m(math.sqrt(area_m2 / points)) > FINEST_M:
            area_m2, points = _covered(path, frame, low, high)
        distance_m = round_voxel_size_m(math.sqrt(area_m2 / points))
        told = f"its points, up to {distance_m:g} m apart on average"
        voxels = chosen_voxel_size(voxel_size_m, distance_m, told, area_m2)
        middle = corners.mean(axis=0)
        keys = VoxelKeys(voxels.size_m, near=middle)
        kinds: Counter[int] = Counter()
        chunks = _chunks(path, reader, frame, kinds)
        survey = _Survey.of(chunks, keys, middle, only_ground=surface == "ground")
    terrain = survey.terrain(path, surface, max_hole_m)
    terrain.georeference = frame.georeference
    doubts = frame.doubts
    if surface != "all" and len(survey.ground):
        doubts = (*doubts, *_of_bridges(kinds[BRIDGE_DECK]), *_of_holes(survey, terrain))
    doubts = (*doubts, *_of_low_points(survey, surface))
    return MapReading(terrain, voxel_size_why=voxels.why, doubts=doubts)


def _of_bridges(points: int) -> Iterator[str]:
    if points:
        yield (
            f"{points:,} points of bridge decks (class 17) are no ground and not in the map: who stands on a "
            "bridge is put on what lies below, beside where they stand; pass surface='all' to have them"
        )


def _of_low_points(survey: _Survey, surface: Surface | None) -> Iterator[str]:
    only_ground = surface != "all" and len(survey.ground) > 0
    points, below_m = survey.lone.below(only_ground=only_ground)
    if points:
        told = "1 point lies" if points == 1 else f"{points:,} points lie"
        yield (
            f"{told} up to {below_m:.0f} m below all around and not marked as noise (class 7): where that is "
            "no ground there are pits in the map, in which crowds are put in wrong places; mark such points "
            "or leave them out of the file"
        )


def _of_holes(survey: _Survey, terrain: Terrain) -> Iterator[str]:
    """Of a cloud that was classified in part."""
    size_m = survey.keys.voxel_size_m
    with_point = np.floor(survey.lowest[:, :2] / size_m).astype(np.int64)
    ground = terrain.columns()[:, :2].astype(np.int64)
    key, ground_key = ((columns[:, 0] << 32) + columns[:, 1] for columns in (with_point, ground))
    in_hole = ~np.isin(key, ground_key)
    if in_hole.sum() > _MOST_IN_HOLES * len(in_hole):
        yield (
            f"{in_hole.mean():.0%} of the area that holds points, {in_hole.sum() * size_m**2:,.0f} m2, is a "
            "hole in the map, because no points of ground (classes 2, 8, 11, 20) lie there: unless that is "
            "water, crowds there are lost; pass surface='all' to have it"
        )


def _box_m2(corners: NDArray[np.float64]) -> float:
    """Area in plan of the box between two `corners` [2, 3], local metres."""
    return float(np.abs(corners[1, :2] - corners[0, :2]).prod())


def _covered(
    path: Path, frame: SourceFrame, low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[float, int]:
    """Ground that the usable points cover, m2, and their number. Their plan is read for it, which takes a
    fraction of the time of the rest: the header's bounds are as wide as a single stray point is far."""
    from laspy import DecompressionSelection as Fields

    x, y, _ = middle = (low + high) / 2
    steps = (high - low)[:2] / 1000
    around = frame.local_from_source(
        np.array([x, x + steps[0], x]), np.array([y, y, y + steps[1]]), np.full(3, middle[2])
    )
    sides_m = np.linalg.norm((around[1:] - around[0])[:, :2], axis=1)
    cover = PointCover(np.divide(sides_m, steps, out=np.ones(2), where=steps > 0), near=low[:2])
    with _reader(path, Fields.XY_RETURNS_CHANNEL | Fields.CLASSIFICATION | Fields.FLAGS) as reader:
        for chunk in _read(path, reader):
            with _damage(path):
                usable = _usable(chunk)
                cover.add(np.asarray(chunk.x, np.float64)[usable], np.asarray(chunk.y, np.float64)[usable])
    if cover.points == 0:
        return 0.0, 1
    plan = np.stack([cover.low, cover.high])
    corners = frame.local_from_source(plan[:, 0], plan[:, 1], np.array([low[2], high[2]]))
    return cover.area_m2(_box_m2(corners)), cover.points


def stated_crs(path: Path) -> CRS | None:
    """The reference system in the file's header."""
    with _reader(path) as reader:
        return _crs(path, reader.header)


@dataclass(frozen=True, slots=True)
class _Survey:
    """What is kept of a cloud: mean ground point and lowest point per column, mean point per voxel, and
    which points lie apart."""

    keys: VoxelKeys
    ground: NDArray[np.float64]
    lowest: NDArray[np.float64]
    voxel_points: NDArray[np.float64]
    lone: LonePoints

    @staticmethod
    def of(chunks: Chunks, keys: VoxelKeys, near: NDArray[np.float64], *, only_ground: bool) -> _Survey:
        ground = Gathered(summed, "columns with ground", MAX_COLUMNS)
        low = Gathered(lowest, "columns", MAX_COLUMNS)
        voxels = Gathered(summed, "voxels", MAX_VOXELS)
        lone = LonePoints(keys.voxel_size_m, near)
        for points, is_ground in chunks:
            ground_points = points[is_ground]
            ground.add(cells(keys.columns_of(ground_points), ground_points))
            other = points[:0] if only_ground else points
            low.add(cells(keys.columns_of(other), other))
            voxels.add(cells(keys.of(other), other))
            lone.add(points, is_ground)
        return _Survey(
            keys, means(ground.rows()), means(low.rows()), _voxel_points(voxels.rows(), keys), lone
        )

    def terrain(self, path: Path, surface: Surface | None, max_hole_m: float) -> Terrain:
        if surface == "ground" and len(self.ground) == 0:
            raise MapError(path, "has no point of ground (classes 2, 8, 11, 20); pass surface='all'")
        vertices = self.ground if len(self.ground) else self.lowest
        if len(vertices) == 0:
            raise MapError(path, "has no usable point: all are noise or withheld")
        size_m = self.keys.voxel_size_m
        if len(vertices) > MAX_GROUND_COLUMNS:
            fitting_m = size_m * math.sqrt(len(vertices) / MAX_GROUND_COLUMNS)
            raise MapError(
                path,
                f"{len(vertices)} columns of {size_m:g} m hold ground, the bound is {MAX_GROUND_COLUMNS}; "
                f"pass a voxel_size_m above {fitting_m:.3g}",
            )
        terrain = self._surface(path, surface, vertices, max_hole_m)
        with_point = self.voxel_points if surface == "all" or not len(self.ground) else self.ground
        measured = np.floor(with_point[:, :2] / self.keys.voxel_size_m).astype(np.int64)
        columns = unmeasured(terrain.columns()[:, :2], np.unique(measured, axis=0))
        return terrain.with_unmeasured(columns) if len(columns) else terrain

    def _surface(
        self, path: Path, surface: Surface | None, vertices: NDArray[np.float64], max_hole_m: float
    ) -> Terrain:
        size_m = self.keys.voxel_size_m
        triangles = triangulate(vertices, max_hole_m)
        ground = Terrain.from_triangles(vertices, triangles, size_m) if len(triangles) else None
        if surface == "all" or len(self.ground) == 0:
            return self._with_all_points(ground)
        if ground is None:
            raise MapError(
                path,
                f"its ground points, in {len(vertices)} columns of {size_m:g} m, lie on one line or further "
                f"apart than max_hole_m = {max_hole_m:g}: they make no surface; pass a smaller voxel_size_m "
                "or a larger max_hole_m",
            )
        return ground

    def _with_all_points(self, ground: Terrain | None) -> Terrain:
        points = Terrain.from_points(self.voxel_points, self.keys.voxel_size_m)
        return points if ground is None else ground.joined(points)


def _voxel_points(rows: NDArray[Any], keys: VoxelKeys) -> NDArray[np.float64]:
    """Mean point [N, 3] of every voxel, which rounding must not carry out of it."""
    centres, reach_m = keys.centres(rows["key"]), 0.499_999 * keys.voxel_size_m
    return np.clip(means(rows), centres - reach_m, centres + reach_m)


@contextmanager
def _reader(path: Path, fields: Any = None) -> Iterator[Any]:
    """`fields`: those that are needed, where not all."""
    only = {} if fields is None else {"decompression_selection": fields}
    try:
        import laspy
    except ImportError as error:
        raise MapError(path, "reading lidar needs laspy: pip install 'crowdfence[lidar]'") from error
    with _damage(path):
        check_las_header(path)
        reader = laspy.open(path, laz_backend=laspy.LazBackend.Lazrs, **only)
    with reader:
        if reader.header.point_count == 0:
            raise MapError(path, "holds no points")
        yield reader


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Whatever laspy and its decompressor stumble over becomes a MapError, panics of the latter included."""
    try:
        yield
    except (MapError, KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:
        raise MapError(
            path,
            f"not a readable lidar file ({type(error).__name__}: {one_line(error)}): truncated or damaged",
        ) from error


def _bounds(path: Path, header: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low, high = np.asarray(header.mins, np.float64), np.asarray(header.maxs, np.float64)
    # No reference system has larger coordinates, in any unit; NaN satisfies nothing.
    if not ((np.abs([low, high]) < _LARGEST_COORDINATE).all() and (low <= high).all()):
        raise MapError(path, f"its header gives the bounds {low.tolist()} to {high.tolist()}: it is damaged")
    return low, high


def _crs(path: Path, header: Any) -> CRS | None:
    """By the file's WKT, else by its GeoTIFF keys."""
    from pyproj.exceptions import CRSError

    records = _records(header)
    with _damage(path):
        try:
            texts = [
                one.parse_crs() for one in records if one.record_id == _WKT and hasattr(one, "parse_crs")
            ]
            crs = next((crs for crs in reversed(texts) if crs is not None), None) or las_crs(records)
        except CRSError as error:
            raise MapError(path, "its coordinate reference system is damaged; pass crs") from error
    return None if crs is None or crs.is_engineering else crs  # "local" systems have no place on Earth


def _height_label(path: Path, header: Any) -> str | None:
    with _damage(path):
        return vertical_unit(las_directory(_records(header)))


def _records(header: Any) -> list[Any]:
    return [*header.vlrs, *(header.evlrs or ())]


def _frame(
    crs: CRS | None,
    georeference: Georeference | None,
    rules: HeightRules,
    metres_per_height: float,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> SourceFrame:
    x, y = ((low + high) / 2)[:2].tolist()
    lowest = max(float(low[2]), LOWEST_PLAUSIBLE_M / metres_per_height)  # what lies below is noise
    return source_frame(crs, georeference, rules, metres_per_height, centre=(x, y), lowest=lowest)


def _usable(chunk: Any) -> NDArray[np.bool_]:
    """Which points are neither noise nor withheld."""
    return ~(np.isin(np.asarray(chunk.classification), NOISE) | np.asarray(chunk.withheld, bool))


def _read(path: Path, reader: Any) -> Iterator[Any]:
    """All points, some at a time."""
    chunks = reader.chunk_iterator(_CHUNK_POINTS)
    while True:
        with _damage(path):
            chunk = next(chunks, None)
        if chunk is None:
            return
        yield chunk


def _chunks(path: Path, reader: Any, frame: SourceFrame, kinds: Counter[int]) -> Chunks:
    """The usable points, counted by their class into `kinds`."""
    count = 0
    for chunk in _read(path, reader):
        with _damage(path):
            x, y, z = (np.asarray(values, np.float64) for values in (chunk.x, chunk.y, chunk.z))
            kind, usable = np.asarray(chunk.classification), _usable(chunk)
        kinds.update(dict(enumerate(np.bincount(kind[usable]).tolist())))
        height_m = z * frame.metres_per_height
        no_land = usable & ((height_m < LOWEST_PLAUSIBLE_M) | (height_m > HIGHEST_PLAUSIBLE_M))
        if no_land.any():
            first = int(np.argmax(no_land))
            raise MapError(
                path,
                f"point {count + first} has the height {z[first]:.10g}, outside [{LOWEST_PLAUSIBLE_M:g}, "
                f"{HIGHEST_PLAUSIBLE_M:g}] m: mark such points as noise (class 7) or leave them out, or "
                "check height_unit",
            )
        points = frame.local_from_source(x, y, z)
        far = usable & (np.abs(points[:, :2]).max(axis=1) > MAX_DISTANCE_M)
        if frame.crs is not None and far.any():
            first = int(np.argmax(far))
            raise MapError(
                path,
                f"point {count + first} at ({x[first]}, {y[first]}) lies more than "
                f"{MAX_DISTANCE_M / 1000:.0f} km from the anchor: the file is damaged, or has a stray point: "
                f"its header spans x {reader.header.mins[0]:.10g} to {reader.header.maxs[0]:.10g}, y "
                f"{reader.header.mins[1]:.10g} to {reader.header.maxs[1]:.10g}; leave that point out of it",
            )
        count += len(points)
        yield points[usable], np.isin(kind, GROUND)[usable]
    if count != reader.header.point_count:
        raise MapError(
            path,
            f"its header promises {reader.header.point_count} points, but there are {count}: it is truncated "
            "or damaged",
        )
