"""A zone as a file of somebody else gives it, and what becomes of it in the local frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import count
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.georeference import MAX_LATITUDE_DEG, Georeference
from crowdfence.great_circle import great_circle_m
from crowdfence.legible import legible
from crowdfence.zones import MAX_ID_LENGTH, AltitudeBand, Zone
from crowdfence.zones.altitude_band import LOWEST_GROUND_M
from crowdfence.zones.given_ground import SMALLEST_EARTH_RADIUS_M
from crowdfence.zones.rules import Restriction
from crowdfence.zones.zone_id import zone_id

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

_METRES_PER = {None: 1.0, "m": 1.0, "M": 1.0, "ft": 0.3048, "FT": 0.3048}
"""By the unit's name; a file that gives none means metres."""
NO_CEILING_M = 99_999.0
"""What the formats write for "unlimited"."""
_MAX_EDGE_DEG = 1e-3
"""Longer edges are straight in longitude and latitude only: between such corners they bow by 0.3 mm."""
_CIRCLE_CORNERS = 64
_MAX_RADIUS_M = 2e6
_HIGHER_GROUND = 1.001
"""A circle on the ellipsoid is so much wider 6 km above it."""
MAX_LONGITUDE_DEG = 540.0
"""Files that go on beyond the antimeridian write 181; what is farther round is no longitude."""
_FAR_DEG = 20.0
"""No mission comes to a zone so far away."""
_IS_FAR = f"lies more than {_FAR_DEG:g} degrees away"
_MAX_REACH_DEG = 60.0
"""The local plane holds what is nearer than a quarter of the Earth's circumference."""
_NEAR_DEG = 1.0
_NEAR_M = 100_000.0
"""A file of zones for a mission has one so near, a national file many."""
_OURS = "ZUO"
"""Ids of crowds, of unseen ground and of what operators close begin so."""


@dataclass(frozen=True, slots=True)
class GivenPolygon:
    rings: Sequence[NDArray[np.float64]]
    """Corners (longitude, latitude) [C, 2] of the outline, then of its holes."""

    @property
    def places(self) -> NDArray[np.float64]:
        """Of its outline, which may be empty."""
        return self.rings[0] if self.rings else np.empty((0, 2))


@dataclass(frozen=True, slots=True)
class GivenCircle:
    places: NDArray[np.float64]
    """Longitude and latitude of its centre [1, 2]."""
    radius_m: float


@dataclass(frozen=True, slots=True)
class GivenZone:
    """Areas in longitude and latitude with the band of heights that all of them have."""

    name: str
    parts: Sequence[GivenPolygon | GivenCircle]
    band: AltitudeBand
    restriction: Restriction = "prohibited"
    title: str = ""
    """What people call it, where the name is a code."""

    def __post_init__(self) -> None:
        """Names of others as everybody can read them."""
        object.__setattr__(self, "name", legible(self.name))
        object.__setattr__(self, "title", legible(self.title))

    @property
    def places(self) -> NDArray[np.float64]:
        """Longitude and latitude [C, 2] of all corners and centres."""
        return np.vstack([np.empty((0, 2)), *(part.places for part in self.parts)])


def in_one(drawn: Iterable[GivenZone]) -> Iterator[GivenZone]:
    """What a file gives as one zone, by its bands of heights: one, where all of it has the same."""
    by_band: dict[AltitudeBand, list[GivenZone]] = {}
    for one in drawn:
        by_band.setdefault(one.band, []).append(one)
    for together in by_band.values():
        yield replace(together[0], parts=[part for one in together for part in one.parts])


@dataclass(frozen=True, slots=True)
class StaticZones:
    """What a file gives."""

    zones: tuple[Zone, ...]
    left_out: tuple[str, ...]
    """What is in the file and closes nothing, and why."""


def local_zones(
    given: Iterable[GivenZone], georeference: Georeference, taken: set[str], left_out: list[str]
) -> list[Zone]:
    """The zones in local metres. A name that is too long for an id, taken or like one of ours is replaced by
    a number; `taken` receives the ids, `left_out` what has no part or is too far away, and that all of it is
    where exchanged coordinates would be near. ValueError for an outline that is empty, crosses itself in the
    area of the mission, is not finite or reaches round the Earth."""
    import shapely

    zones = []
    numbers = count(1)
    exchanged = 0
    for one in given:
        if not one.parts:
            left_out.append(f"{one.name}: no polygon, closes no ground")
        exchanged += _would_be_near_exchanged(one, georeference)
        outlines = [_outline(one.name, part, georeference) for part in one.parts]
        left_out += dict.fromkeys(f"{one.name}: {why}" for why in outlines if isinstance(why, str))
        kept = [outline for outline in outlines if not isinstance(outline, str)]
        if not kept:
            continue
        polygon = kept[0] if len(kept) == 1 else shapely.union_all(kept)
        id = _free_id(one.name, taken, numbers)
        taken.add(id)
        called = one.title or one.name
        name = None if called in ("", id) else called
        zones.append(
            Zone.of_no_look(
                id, polygon, "static", "given", restriction=one.restriction, band=one.band, name=name
            )
        )
    if exchanged and not any(_is_near(zone) for zone in zones):
        left_out.append(
            f"no zone is within {_NEAR_DEG:g} degree, and {exchanged} would be if latitude and longitude "
            "were exchanged; longitude comes first"
        )
    return zones


def _would_be_near_exchanged(given: GivenZone, georeference: Georeference) -> bool:
    """Whether a corner would lie near the anchor if its latitude were its longitude."""
    away_deg = np.abs(given.places - (georeference.latitude_deg, georeference.longitude_deg))
    return bool((away_deg < _NEAR_DEG).all(axis=1).any())


def _is_near(zone: Zone) -> bool:
    import shapely

    return bool(zone.polygon.distance(shapely.Point(0.0, 0.0)) < _NEAR_M)


def _free_id(name: str, taken: set[str], numbers: Iterator[int]) -> str:
    """Its name where that can be an id, else the next number that is free."""
    if 0 < len(name) <= MAX_ID_LENGTH and name not in taken and name[0] not in _OURS and name.isprintable():
        return name
    return next(free for free in (zone_id(number, "S") for number in numbers) if free not in taken)


@contextmanager
def naming(name: str) -> Iterator[None]:
    """What a zone lacks, or has wrong, is a ValueError with its name: a national file has thousands."""
    try:
        yield
    except (LookupError, TypeError, AttributeError, ValueError, OverflowError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        has_name = what.startswith(f"zone {name!r}")
        raise ValueError(what if has_name else f"zone {name!r}: {what}") from error


def ring_of(corners: Sequence[Sequence[float | str]]) -> NDArray[np.float64]:
    """Longitude and latitude [C, 2] of corners that may have a height too; ValueError for any other."""
    if len({len(corner[:2]) for corner in corners}) > 1:
        raise ValueError("a corner is no longitude and latitude")
    ring = np.array([corner[:2] for corner in corners], dtype=np.float64)
    if len(ring) and (ring.ndim != 2 or ring.shape[1] != 2):
        raise ValueError("a corner is no longitude and latitude")
    return ring.reshape(-1, 2)


def _closed(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """With its first corner at the end too, which some programs leave out."""
    return ring if len(ring) == 0 or (ring[0] == ring[-1]).all() else np.vstack([ring, ring[:1]])


def _outline(
    name: str, part: GivenPolygon | GivenCircle, georeference: Georeference
) -> Polygon | MultiPolygon | str:
    """Or why it is left out."""
    if isinstance(part, GivenCircle):
        return _around_circle(name, part, georeference)
    return _polygon(name, part.rings, georeference)


def _polygon(
    name: str, given: Sequence[NDArray[np.float64]], georeference: Georeference
) -> Polygon | MultiPolygon | str:
    import shapely

    rings = [_closed(ring) for ring in given]
    if not rings or any(len(ring) < 4 or not np.isfinite(ring).all() for ring in rings):
        raise ValueError(f"zone {name!r} has no outline of at least three corners")
    _check_places(name, rings[0])
    outline = _beside(rings[0], georeference.longitude_deg)
    middle_deg = float(outline[:, 0].min() + outline[:, 0].max()) / 2.0
    unwrapped = [outline, *(_beside(ring, middle_deg) for ring in rings[1:])]
    shape = shapely.Polygon(unwrapped[0], unwrapped[1:])
    anchor = np.array([georeference.longitude_deg, georeference.latitude_deg])
    if not shape.is_valid or shape.is_empty:
        why = shapely.is_valid_reason(shape)
        # Nobody knows what ground it means, but within which it lies, whichever way round the Earth.
        nearest = [anchor.clip(ring.min(axis=0), ring.max(axis=0)) for ring in (outline, rings[0])]
        if min(_away_deg(place, georeference) for place in nearest) > _NEAR_DEG:
            return f"{why}, and it lies more than {_NEAR_DEG:g} degree away"
        raise ValueError(
            f"zone {name!r}: {why}; mend its outline where it was drawn, or take it out of the file"
        )
    if shape.distance(shapely.Point(anchor)) > _FAR_DEG:
        return _IS_FAR
    if abs(unwrapped[0] - anchor).max() > _MAX_REACH_DEG:
        raise ValueError(f"zone {name!r} reaches {_MAX_REACH_DEG:g} degrees away: no local plane holds it")
    dense = shapely.segmentize(shape, _MAX_EDGE_DEG)
    local = shapely.transform(dense, lambda corners: _local(corners, georeference))
    # Rings that touch between their corners may cross by what an edge bows.
    return local if local.is_valid else shapely.make_valid(local, method="structure", keep_collapsed=False)


def _around_circle(name: str, circle: GivenCircle, georeference: Georeference) -> Polygon | str:
    """Not in it."""
    import shapely

    centre = circle.places
    if not (0.0 < circle.radius_m < _MAX_RADIUS_M and np.isfinite(centre).all()):
        raise ValueError(f"zone {name!r} is a circle of {circle.radius_m:g} m")
    _check_places(name, centre)
    if _away_deg(centre[0], georeference) - np.rad2deg(circle.radius_m / SMALLEST_EARTH_RADIUS_M) > _FAR_DEG:
        return _IS_FAR
    middle = _local(centre, georeference)[0]
    angle = 2 * np.pi * np.arange(_CIRCLE_CORNERS) / _CIRCLE_CORNERS
    reach_m = _HIGHER_GROUND * circle.radius_m / np.cos(np.pi / _CIRCLE_CORNERS)
    return shapely.Polygon(middle + reach_m * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def _away_deg(place: NDArray[np.float64], georeference: Georeference) -> float:
    """Of the Earth's circumference from the anchor to a longitude and latitude."""
    anchor = georeference.longitude_deg, georeference.latitude_deg
    return float(np.rad2deg(great_circle_m(anchor, place[:1], place[1:], sphere_m=1.0)[0]))


def _check_places(name: str, corners: NDArray[np.float64]) -> None:
    longitude_deg, latitude_deg = abs(corners).max(axis=0)
    if latitude_deg > MAX_LONGITUDE_DEG:
        raise ValueError(
            f"zone {name!r} has a corner at {corners[0, 0]:.10g}, {corners[0, 1]:.10g}: no degrees, as in a "
            "file of metres; write it in longitude and latitude (WGS 84)"
        )
    if latitude_deg > MAX_LATITUDE_DEG:
        raise ValueError(f"zone {name!r} reaches beyond {MAX_LATITUDE_DEG:g} degrees of latitude")
    if longitude_deg > MAX_LONGITUDE_DEG:
        raise ValueError(f"zone {name!r} has a longitude of {longitude_deg:g} degrees")


def _beside(ring: NDArray[np.float64], around_deg: float) -> NDArray[np.float64]:
    """On one branch of longitude, that which lies nearest to `around_deg`, so that no ring jumps across the
    antimeridian: between two corners it goes the short way round."""
    longitude = ring[:, 0]
    steps = (np.diff(longitude) + 180.0) % 360.0 - 180.0
    turns = np.append(0.0, np.round((np.cumsum(steps) - (longitude[1:] - longitude[0])) / 360.0))
    onward = longitude + 360.0 * turns
    middle_deg = (onward.min() + onward.max()) / 2.0
    return np.column_stack([onward + 360.0 * np.round((around_deg - middle_deg) / 360.0), ring[:, 1]])


def _local(corners: NDArray[np.float64], georeference: Georeference) -> NDArray[np.float64]:
    height_m = np.full(len(corners), georeference.height_m)
    return georeference.local_from_geodetic(corners[:, 1], corners[:, 0], height_m)[:, :2]


def metres(value: float | str | None, unit: str | None) -> float | None:
    """A limit in metres from text or a number in "m", "M", "ft", "FT"; None where there is none. ValueError
    for any other unit."""
    if value is None:
        return None
    if unit not in _METRES_PER:
        raise ValueError(f"a length in {unit!r}; what is read is {', '.join(map(repr, _METRES_PER))}")
    return float(value) * _METRES_PER[unit]


def band_of(
    name: str,
    limits: tuple[float | str | None, float | str | None],
    unit: str | None,
    datums: tuple[str, str],
) -> AltitudeBand:
    """Of a zone's lower and upper limit, see `metres` and `band_between`. ValueError that names the zone."""
    try:
        return band_between(metres(limits[0], unit), metres(limits[1], unit), *datums)
    except ValueError as error:
        raise ValueError(f"zone {name!r}: {error}") from error


def band_between(
    lower_m: float | None, upper_m: float | None, lower_datum: str, upper_datum: str
) -> AltitudeBand:
    """Of two limits; where one is missing it is closed from the ground, or without end. Above two different
    data it is both: what lies between them cannot be told here."""
    if lower_datum != upper_datum or lower_datum not in ("AGL", "AMSL", "WGS84"):
        return AltitudeBand(0.0, NO_CEILING_M, "AGL")
    if lower_m is None:
        lower_m = 0.0 if lower_datum == "AGL" else LOWEST_GROUND_M
    upper_m = NO_CEILING_M if upper_m is None else upper_m
    return AltitudeBand(lower_m, upper_m, lower_datum)  # type: ignore[arg-type]
