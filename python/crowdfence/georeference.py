"""Local metres <-> WGS84 and any coordinate reference system (CRS) that PROJ knows.

The local frame is the true topocentric frame of its anchor (EPSG method 9837): x east, y north and z up are
straight lines in the tangent plane, so the ground falls away from z = 0 by about d^2 / (2 * 6371 km) at
distance d: 8 cm at 1 km, 8 m at 10 km. No map projection is mistaken for it.

Axis order is fixed here, whatever the authority of a CRS prefers: latitude before longitude in the geodetic
calls, easting (or longitude) before northing (or latitude) in the projected calls.

Heights. A CRS that has no vertical axis says nothing about heights, so they are taken as metres above the
WGS84 ellipsoid, as satellite receivers report them. Heights of a compound CRS (above a geoid) are converted
with PROJ's geoid grid; where the grid is not installed the conversion is refused, because the quiet
fallback of calling both heights equal is wrong by up to 100 m.

Datums that PROJ does not know are refused or taken as WGS84, see `crowdfence.datum`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.datum import uncovered_heights, wgs84_from
from crowdfence.plain_values import make_plain
from crowdfence.unmasked import require_unmasked

if TYPE_CHECKING:
    from pyproj import CRS, Transformer

# Below the deepest trench and above any aircraft: wider values are a unit mistake (feet, millimetres).
LOWEST_HEIGHT_M = -12_000.0
HIGHEST_HEIGHT_M = 100_000.0

MAX_LATITUDE_DEG = 89.0
"""Where outlines, circles and ways in degrees end: longitude loses its meaning at the poles."""


@dataclass(frozen=True, slots=True)
class Georeference:
    """WGS84 anchor of a local east-north-up frame: the point that has local coordinates (0, 0, 0).

    `latitude_deg` in [-90, 90], `longitude_deg` in [-180, 180], `height_m` above the WGS84 ellipsoid (not
    above sea level) in [-12000, 100000]. ValueError names the value that lies outside.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float
    of_map: bool = field(default=False, repr=False, compare=False, kw_only=True)
    """Whether the reader of a map chose it, in the middle of the map: no poses count from there unless
    somebody says so."""

    def __post_init__(self) -> None:
        make_plain(self)
        _require_within("latitude_deg", self.latitude_deg, -90.0, 90.0)
        _require_within("longitude_deg", self.longitude_deg, -180.0, 180.0)
        _require_within("height_m", self.height_m, LOWEST_HEIGHT_M, HIGHEST_HEIGHT_M)

    @classmethod
    def from_projected(cls, crs: CRS | str | int, x: float, y: float, height: float) -> Georeference:
        """Anchor at a point of `crs` (anything pyproj accepts, such as "EPSG:32632" or a WKT).

        `x` is the easting or longitude, `y` the northing or latitude, both in the CRS's own units; `height`
        is in metres above the WGS84 ellipsoid unless the CRS has a vertical axis, which then says what it is.
        """
        longitude, latitude, height_m = _geodetic_from_projected(crs, x, y, height)
        return cls(latitude.item(), longitude.item(), height_m.item())

    def local_from_geodetic(
        self, latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike
    ) -> NDArray[np.float64]:
        """WGS84 degrees and ellipsoidal heights, each [N] or a scalar -> local ENU metres [N, 3].

        ValueError names the first entry that is not finite or has a latitude outside [-90, 90].
        """
        geodetic = (longitude_deg, latitude_deg, height_m)
        return np.stack(_transform(_topocentric(self), geodetic, "WGS84 -> local"), axis=-1)

    def geodetic_from_local(
        self, points: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Local ENU metres [N, 3] -> (latitude_deg [N], longitude_deg [N], ellipsoidal height_m [N])."""
        longitude, latitude, height_m = self._geodetic(points)
        return latitude, longitude, height_m

    def local_from_projected(
        self, crs: CRS | str | int, x: ArrayLike, y: ArrayLike, z: ArrayLike
    ) -> NDArray[np.float64]:
        """Coordinates of `crs`, each [N] or a scalar -> local ENU metres [N, 3].

        Meaning of x, y and z as in `from_projected`. ValueError names the first entry that is not finite or
        has no place on Earth in this CRS.
        """
        geodetic = _geodetic_from_projected(crs, x, y, z)
        return np.stack(_transform(_topocentric(self), geodetic, "WGS84 -> local"), axis=-1)

    def projected_from_local(self, crs: CRS | str | int, points: ArrayLike) -> NDArray[np.float64]:
        """Inverse of `local_from_projected`: local ENU metres [N, 3] -> coordinates (x, y, z) [N, 3]."""
        known = _as_crs(crs)
        geodetic = self._geodetic(points)
        return np.stack(_through(known, geodetic, f"WGS84 -> {known.name}", True), axis=-1)

    def _geodetic(self, points: ArrayLike) -> tuple[NDArray[np.float64], ...]:
        """(longitude_deg, latitude_deg, ellipsoidal height), each [N], of local points [N, 3]."""
        return _transform(_topocentric(self), _columns(points), "local -> WGS84", True)


def longitude_latitude(
    places: NDArray[np.float64], height_m: float, georeference: Georeference
) -> NDArray[np.float64]:
    """Degrees [N, 2] of places [N, 2], local metres, at one local height."""
    at_height = np.column_stack([places, np.full(len(places), height_m)])
    latitude, longitude, _ = georeference.geodetic_from_local(at_height)
    return np.column_stack([longitude, latitude])


def geoid_height_m(latitude_deg: float, longitude_deg: float) -> float:
    """How high mean sea level (EGM96) lies above the ellipsoid at a place. ValueError where PROJ has no grid
    of it."""
    return Georeference.from_projected("EPSG:4326+5773", longitude_deg, latitude_deg, 0.0).height_m


def on_earth(latitude_deg: float, longitude_deg: float) -> bool:
    """Whether they are a latitude and a longitude; NaN is neither."""
    return abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0


def _require_within(name: str, value: float, lowest: float, highest: float) -> None:
    if not (math.isfinite(value) and lowest <= value <= highest):
        raise ValueError(f"georeference: {name} is {value}, must lie in [{lowest:g}, {highest:g}]")


def _columns(points: ArrayLike) -> tuple[NDArray[np.float64], ...]:
    require_unmasked(points, "points")
    array = np.atleast_2d(np.asarray(points, dtype=np.float64))
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"points must have shape [N, 3], not {list(np.shape(points))}")
    return array[:, 0], array[:, 1], array[:, 2]


def _geodetic_from_projected(
    crs: CRS | str | int, x: ArrayLike, y: ArrayLike, z: ArrayLike
) -> tuple[NDArray[np.float64], ...]:
    """(longitude_deg, latitude_deg, ellipsoidal height), each [N]."""
    known = _as_crs(crs)
    return _through(known, (x, y, z), f"{known.name} -> WGS84")


def _through(
    crs: CRS, coordinates: tuple[Any, ...], what: str, inverse: bool = False
) -> tuple[NDArray[np.float64], ...]:
    """`_transform` from a CRS to WGS84; ValueError says so where only a vertical grid has no such place."""
    transformer = wgs84_from(crs)
    try:
        return _transform(transformer, coordinates, what, inverse)
    except ValueError:
        if not crs.is_compound:
            raise
    flat = _transform(wgs84_from(crs.sub_crs_list[0]), coordinates, what, inverse)
    x, y, z = np.broadcast_arrays(*map(np.atleast_1d, coordinates))
    heights = transformer.transform(x, y, z, direction="INVERSE" if inverse else "FORWARD")[2]
    first = int(np.argmax(~np.isfinite(heights)))
    longitude, latitude = (x, y) if inverse else flat[:2]
    raise ValueError(uncovered_heights(crs, transformer, (float(latitude[first]), float(longitude[first]))))


def _as_crs(crs: CRS | str | int) -> CRS:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return CRS.from_user_input(crs)
    except CRSError as error:
        raise ValueError(f"not a coordinate reference system that PROJ knows: {crs!r}") from error


@lru_cache(maxsize=64)
def _topocentric(anchor: Georeference) -> Transformer:
    """(longitude_deg, latitude_deg, ellipsoidal height) -> local ENU, through Earth-centred coordinates."""
    from pyproj import Transformer

    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={float(anchor.latitude_deg)!r} "
        f"+lon_0={float(anchor.longitude_deg)!r} +h_0={float(anchor.height_m)!r}"
    )


def _transform(
    transformer: Transformer, coordinates: tuple[Any, ...], what: str, inverse: bool = False
) -> tuple[NDArray[np.float64], ...]:
    """Three arrays through PROJ; ValueError for the first entry that is not finite before or after."""
    for values in coordinates:
        require_unmasked(values, "coordinates")
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(values, np.float64)) for values in coordinates))
    if arrays[0].ndim != 1:
        raise ValueError(f"coordinates must be scalars or [N], not of shape {list(arrays[0].shape)}")
    x, y, z = arrays
    transformed = transformer.transform(x, y, z, direction="INVERSE" if inverse else "FORWARD")
    result = tuple(np.asarray(values) for values in transformed)
    bad = ~(np.isfinite(arrays).all(axis=0) & np.isfinite(result).all(axis=0))
    if bad.any():
        first = int(np.argmax(bad))
        entry = tuple(float(values[first]) for values in arrays)
        raise ValueError(f"{what}: entry {first}, {entry} (x, y, z), is not finite or outside the valid area")
    return result
