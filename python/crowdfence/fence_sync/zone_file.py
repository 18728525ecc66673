"""Zones of a run's folder, its zone history or a GeoJSON file, and whether they were written anew."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.fence_sync.fence_error import FenceError
from crowdfence.fence_sync.placed_zones import PlacedZones, ground_heights
from crowdfence.georeference import Georeference
from crowdfence.result_folder import HISTORY, open_history, stamp_of
from crowdfence.static_zones import StaticZoneError
from crowdfence.static_zones.given_zone import local_zones
from crowdfence.static_zones.plain_geojson import geojson_zones
from crowdfence.static_zones.uas_zones import is_ed269, is_ed318
from crowdfence.zones import MAX_ID_LENGTH

_GEOJSON = (".geojson", ".json")
MOST_APART_M = 50_000.0
"""From the anchor: beyond, a plane is no map."""


class ZoneFile:
    """A place where zones are written."""

    def __init__(self, path: str | os.PathLike[str], at: str = "last") -> None:
        """`at` is the instant of a history; GeoJSON has one only."""
        self._path, self._at = Path(path), at
        self._mark: tuple[int, ...] | None = None
        self._anchor: Georeference | None = None

    @property
    def is_of_one_instant(self) -> bool:
        """Not a history: GeoJSON."""
        return self._file.suffix.lower() in _GEOJSON

    def read(self) -> PlacedZones:
        """What is there now. OSError, or ValueError that names the file."""
        self._mark = self._stat()
        try:
            return self._read()
        except OSError:
            self._mark = None  # what could not be read may be readable later, and be the same file
            raise

    def has_changed(self) -> bool:
        """Whether it was written since it was read. A file that is away while it is replaced has not."""
        return (mark := self._stat()) is not None and mark != self._mark

    def _read(self) -> PlacedZones:
        if self.is_of_one_instant:
            placed = placed_geojson(self._file.read_bytes(), str(self._file), self._anchor)
            self._anchor = placed.georeference
            return placed
        history = open_history(self._path)
        if history.georeference is None:
            raise FenceError(f"{self._path}: the run has no place on Earth, so its zones cannot be sent")
        zones = history.at(stamp_of(self._at, history)).closed
        return PlacedZones(zones, history.georeference, history.stamps_ns[0])

    @property
    def _file(self) -> Path:
        return self._path / HISTORY if self._path.is_dir() else self._path

    def _stat(self) -> tuple[int, ...] | None:
        try:
            state = self._file.stat()
        except OSError:
            return None
        return state.st_mtime_ns, state.st_ino, state.st_size


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
            low_m, high_m = ground_heights(zone.polygon)
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
