"""Zones of a run's folder, its zone history, a GeoJSON file or a live service, and whether they have changed
since."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.fence_sync.fence_error import FenceError
from crowdfence.fence_sync.placed_zones import PlacedZones
from crowdfence.fence_sync.service_zones import ServiceZones
from crowdfence.georeference import Georeference
from crowdfence.result_folder import HISTORY, open_history, stamp_of
from crowdfence.static_zones import StaticZoneError, read_static_zones
from crowdfence.static_zones.given_zone import local_zones
from crowdfence.static_zones.plain_geojson import geojson_zones
from crowdfence.static_zones.uas_zones import is_ed269, is_ed318
from crowdfence.zones import MAX_ID_LENGTH, Zone
from crowdfence.zones.grow import grown

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

_GEOJSON = (".geojson", ".json")
MOST_APART_M = 50_000.0
"""From the anchor: beyond, a plane is no map."""
_LEAST_EARTH_M, _MOST_EARTH_M = 6_335_000.0, 6_400_000.0
"""Radii of curvature."""


class ZoneSource:
    """A place where zones are written, and files of others that stay closed beside them."""

    def __init__(
        self,
        place: str | os.PathLike[str] | ServiceZones,
        at: str = "last",
        static_zones: Sequence[Path] = (),
        margin_m: float = 0.0,
    ) -> None:
        """`at` is the instant of a history; others have one only. `static_zones` are read once.
        `margin_m` is closed around all of them: in it a vehicle halts that acts once it is in its fence."""
        self._place = place if isinstance(place, ServiceZones) else Path(place)
        self._at = at
        self._margin_m = margin_m
        self._wider: dict[int, tuple[Zone, Zone]] = {}
        self._static = list(static_zones)
        self._others: PlacedZones | None = None
        self.left_out: list[str] = []
        """What the files of others hold and closes nothing, and why."""
        self._mark: tuple[int, ...] | None = None
        self._anchor: Georeference | None = None

    def read(self) -> PlacedZones:
        """What is there now, and the zones of others. OSError, or ValueError that names the file."""
        try:
            placed = self._read()
            zones = (*placed.zones, *self._others_beside(placed))
            return replace(placed, zones=self._with_margins(zones) if self._margin_m > 0.0 else zones)
        except OSError:
            self._mark = None  # what could not be read may be readable later, and be the same file
            raise

    def _with_margins(self, zones: Sequence[Zone]) -> tuple[Zone, ...]:
        """Of zones that are those of the last time, as those of others, what was worked out then."""
        # With the zone itself, so that nothing else comes to have its number.
        self._wider = {id(zone): self._wider.get(id(zone)) or (zone, self._wide(zone)) for zone in zones}
        return tuple(self._wider[id(zone)][1] for zone in zones)

    def _wide(self, zone: Zone) -> Zone:
        """With all ground within the margin, at the heights to which it falls away from the local plane."""
        if zone.polygon.is_empty:
            return zone
        wider = grown(zone.polygon, self._margin_m)
        (low_m, high_m), (lower_m, upper_m) = _heights(zone.polygon), _heights(wider)
        return replace(
            zone,
            polygon=wider,
            lower_m=zone.lower_m + lower_m - low_m,
            upper_m=zone.upper_m + upper_m - high_m,
        )

    def _others_beside(self, placed: PlacedZones) -> tuple[Zone, ...]:
        """In the same local frame."""
        if self._others is None or self._others.georeference != placed.georeference:
            taken = {zone.id for zone in placed.zones}
            zones, self.left_out = read_static_zones(self._static, placed.georeference, taken)
            self._others = PlacedZones(zones, placed.georeference)
        return self._others.zones

    def _read(self) -> PlacedZones:
        if isinstance(self._place, ServiceZones):
            return self._place.read()
        self._mark = self._stat(self._place)
        if self.is_of_one_instant:
            file = _file(self._place)
            placed = placed_geojson(file.read_bytes(), str(file), self._anchor)
            self._anchor = placed.georeference
            return placed
        history = open_history(self._place)
        if history.georeference is None:
            raise FenceError(f"{self._place}: the run has no place on Earth, so its zones cannot be sent")
        zones = history.at(stamp_of(self._at, history)).closed
        return PlacedZones(zones, history.georeference, history.stamps_ns[0])

    @property
    def is_of_one_instant(self) -> bool:
        """Not a history: GeoJSON."""
        return isinstance(self._place, ServiceZones) or _file(self._place).suffix.lower() in _GEOJSON

    def has_changed(self) -> bool:
        """Whether it was written since it was read. A file that is away while it is replaced has not; a
        service that does not answer any more has."""
        if isinstance(self._place, ServiceZones):
            return self._place.has_changed()
        return (mark := self._stat(self._place)) is not None and mark != self._mark

    @staticmethod
    def _stat(path: Path) -> tuple[int, ...] | None:
        try:
            state = _file(path).stat()
        except OSError:
            return None
        return state.st_mtime_ns, state.st_ino, state.st_size


def _file(path: Path) -> Path:
    return path / HISTORY if path.is_dir() else path


def placed_geojson(data: bytes, name: str, anchor: Georeference | None = None) -> PlacedZones:
    """The polygons of GeoJSON, in the local frame of an anchor that is near, else in one around their middle.
    StaticZoneError names what is wrong, and `name`."""
    try:
        document = json.loads(data)
        if not isinstance(document, dict):
            raise ValueError("it holds no JSON object with zones")
        for is_other, other in ((is_ed318, "ED-318"), (is_ed269, "ED-269")):
            if is_other(document):
                raise ValueError(f"it is {other}: give it as --static-zones, beside zones of ours")
        left_out: list[str] = []
        given = list(geojson_zones(document, left_out))
        if left_out:
            raise ValueError(left_out[0])
        corners = np.vstack([np.empty((0, 2)), *(one.places for one in given)])
        # Beyond the antimeridian some go on counting.
        wrong = ~(np.isfinite(corners) & (np.abs(corners) <= (360.0, 90.0))).all(axis=1)
        if wrong.any():
            longitude, latitude = corners[wrong][0]
            raise ValueError(f"a corner is no longitude and latitude: {longitude:g}, {latitude:g}")
        anchor = _near(corners, anchor)
        ends = _ends(document.get("features", ()))
        begun_ns = _first_instant(document)
        zones = []
        for one in given:
            (zone,) = local_zones([one], anchor, set(), [])
            low_m, high_m = _heights(zone.polygon)
            zones.append(
                replace(
                    zone,
                    id=one.name[:MAX_ID_LENGTH],
                    valid_until_ns=ends.get(one.name),
                    lower_m=low_m,
                    upper_m=high_m,
                )
            )
    except RecursionError as error:
        raise StaticZoneError(f"{name}: it is nested too deeply") from error
    except (KeyError, TypeError, AttributeError, IndexError, ValueError, OverflowError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise StaticZoneError(f"{name}: {what}") from error
    return PlacedZones(tuple(zones), anchor, begun_ns)


def _first_instant(document: Mapping[str, Any]) -> int | None:
    """As files of ours tell it."""
    told = document.get("crowdfence")
    first_ns = told.get("first_instant_ns") if isinstance(told, dict) else None
    return None if first_ns is None else int(first_ns)


def _ends(features: Sequence[Mapping[str, Any]]) -> dict[str, int | None]:
    """When zones end, by name. Of several with one name, as in files of two missions put together, none ends
    before all of them do."""
    ends: dict[str, int | None] = {}
    for feature in features:
        properties = feature.get("properties") or {}
        name, end = str(feature.get("id") or properties.get("id")), properties.get("valid_until_ns")
        others = ends.get(name, -math.inf)
        ends[name] = None if end is None or others is None else int(max(int(end), others))
    return ends


def _near(corners: NDArray[np.float64], anchor: Georeference | None) -> Georeference:
    """An anchor no farther than `MOST_APART_M` from all corners (longitude, latitude). ValueError where there
    is none."""
    if not len(corners):
        return anchor or Georeference(0.0, 0.0, 0.0)
    for one in filter(None, (anchor, Georeference(*_middle(corners), 0.0))):
        local = one.local_from_geodetic(corners[:, 1], corners[:, 0], 0.0)
        if np.abs(local).max() <= MOST_APART_M:
            return one
    raise ValueError(f"zones lie more than {MOST_APART_M / 500:.0f} km apart; give those of one flight")


def _middle(corners: NDArray[np.float64]) -> tuple[float, float]:
    """Latitude and longitude. Longitudes are taken around the first, which may lie at the antimeridian."""
    first = corners[0, 0]
    east = first + (corners[:, 0] - first + 180.0) % 360.0 - 180.0
    longitude = ((east.min() + east.max()) / 2 + 180.0) % 360.0 - 180.0
    return float((corners[:, 1].min() + corners[:, 1].max()) / 2), float(longitude)


def _heights(outline: Polygon | MultiPolygon) -> tuple[float, float]:
    """Local heights of ground at the anchor's height: it falls away from the local plane."""
    import shapely

    nearest_m = outline.distance(shapely.Point(0.0, 0.0))
    farthest_m = float(np.linalg.norm(shapely.get_coordinates(outline), axis=1).max())
    return -(farthest_m**2) / (2 * _LEAST_EARTH_M), -(nearest_m**2) / (2 * _MOST_EARTH_M)
