"""A way round zones as GeoJSON (RFC 7946); without a georeference in local metres, as `geojson` has zones.

A vehicle flies straight over the ground, a reader of GeoJSON draws straight in degrees: 85 cm apart on 5 km
at 60 degrees of latitude, which may lie in a zone. Long legs get corners between, so that both are the same.
A way that passes zones after their end holds at its times alone: these stand beside its corners.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.georeference import MAX_LATITUDE_DEG, Georeference, longitude_latitude
from crowdfence.iso_time import iso_utc

DECIMALS = 8
"""A millimetre."""
_MOST_OFF_M = 0.01
"""Between the two lines: a fifth of what a way keeps from zones."""
_DEGREE_M = 111_320.0

_Line = list[tuple[list[float], int | None]]
"""Corners, and when each is passed."""


def route_geojson(
    waypoints: ArrayLike,
    stamps_ns: ArrayLike | None,
    georeference: Georeference | None,
    height_m: float,
    properties: Mapping[str, Any],
) -> str:
    """One Feature of a way over `waypoints` [N, 2] (local metres) at a local height, passed at `stamps_ns`
    [N]: `times` in its properties then has one for each corner. ValueError within one degree of a pole."""
    places = np.asarray(waypoints, dtype=np.float64)
    stamps = None if stamps_ns is None else np.asarray(stamps_ns, dtype=np.int64)
    if georeference is None:
        lines, head = [_line(places.round(3), stamps)], {"crs": None}
    else:
        places, stamps = _with_corners_between(places, stamps, georeference, height_m)
        degrees = longitude_latitude(places, height_m, georeference)
        highest_deg = degrees[np.abs(degrees[:, 1]).argmax(), 1]
        if abs(highest_deg) > MAX_LATITUDE_DEG:
            raise ValueError(
                f"the way reaches latitude {highest_deg:.4f}; ways are written up to {MAX_LATITUDE_DEG:g} "
                "degrees, because longitude loses its meaning at the poles"
            )
        lines, head = _cut_at_antimeridian(_line(degrees.round(DECIMALS), stamps)), {}
    corners = [[corner for corner, _ in line] for line in lines]
    geometry: dict[str, Any] = {"type": "LineString", "coordinates": corners[0]}
    told = dict(properties)
    if len(lines) > 1:
        geometry = {"type": "MultiLineString", "coordinates": corners}
    if stamps is not None:
        times = [[None if stamp_ns is None else iso_utc(stamp_ns) for _, stamp_ns in line] for line in lines]
        told["times"] = times if len(lines) > 1 else times[0]
    return json.dumps({"type": "Feature", **head, "geometry": geometry, "properties": told}) + "\n"


def _line(corners: NDArray[np.float64], stamps_ns: NDArray[np.int64] | None) -> _Line:
    stamps: list[Any] = [None] * len(corners) if stamps_ns is None else stamps_ns.tolist()
    return list(zip(corners.tolist(), stamps, strict=True))


def _with_corners_between(
    places: NDArray[np.float64],
    stamps_ns: NDArray[np.int64] | None,
    georeference: Georeference,
    height_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.int64] | None]:
    """Places [N, 2] and when they are passed [N], with as many between as straight lines in degrees need."""
    ends = longitude_latitude(places, height_m, georeference)
    middles = longitude_latitude((places[:-1] + places[1:]) / 2, height_m, georeference)
    to_ends = [_turned(side - middles) for side in (ends[:-1], ends[1:])]
    off = (to_ends[0] + to_ends[1]) / 2 * _DEGREE_M
    off_m = np.hypot(off[:, 0] * np.cos(np.deg2rad(middles[:, 1])), off[:, 1])
    # Half as long a leg bows a quarter as far.
    pieces = np.maximum(np.ceil(np.sqrt(off_m / _MOST_OFF_M)), 1.0).astype(np.int64)
    leg = np.repeat(np.arange(len(pieces)), pieces)
    piece = np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = piece / pieces[leg]
    between = places[leg] + share[:, None] * (places[leg + 1] - places[leg])
    placed = np.vstack([between, places[-1:]])
    if stamps_ns is None:
        return placed, None
    after_ns = (share * (stamps_ns[leg + 1] - stamps_ns[leg])).astype(np.int64)
    return placed, np.append(stamps_ns[leg] + after_ns, stamps_ns[-1])


def _turned(degrees: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differences [N, 2] of longitude and latitude, the short way round."""
    return np.column_stack([(degrees[:, 0] + 180.0) % 360.0 - 180.0, degrees[:, 1]])


def _cut_at_antimeridian(line: _Line) -> list[_Line]:
    """RFC 7946, 3.1.9: a line that crosses it is cut there, and does not go round the Earth."""
    lines = [line[:1]]
    for ((west, south), before_ns), ((east, north), after_ns) in pairwise(line):
        if abs(east - west) > 180.0:
            edge = math.copysign(180.0, west)
            beyond = east + 2.0 * edge
            share = (edge - west) / (beyond - west) if beyond != west else 0.0
            latitude = round(south + share * (north - south), DECIMALS)
            at_ns = None
            if before_ns is not None and after_ns is not None:
                at_ns = before_ns + round(share * (after_ns - before_ns))
            lines[-1].append(([edge, latitude], at_ns))
            lines.append([([-edge, latitude], at_ns)])
        lines[-1].append(([east, north], after_ns))
    return lines
