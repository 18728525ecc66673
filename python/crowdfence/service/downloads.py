"""The zones of a moment as a file, in the formats of `crowdfence export`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from crowdfence.exports.geojson import zones_geojson
from crowdfence.exports.zone_formats import ZONE_FORMATS, ZoneExport
from crowdfence.service.mission import Mission
from crowdfence.service.operator_zones import passable
from crowdfence.service.timeline import Moment
from crowdfence.service.zone_json import Marks
from crowdfence.zones import ZoneSet

_MEDIA = {"kml": ("kml", "application/vnd.google-earth.kml+xml"), "csv": ("csv", "text/csv")}
_MEDIA["multidrone"] = _MEDIA["kml"]
FORMATS = ("geojson", *ZONE_FORMATS)
_TIMELESS = ("geojson", "qgc", "multidrone")
"""Whoever reads these goes by what is in them, and looks at no time from which on."""
_ABOVE_GROUND = ("geojson", "kml", "multidrone", "qgc")
"""Their heights are above the ground, or none: whoever asks for others would take these for them."""


class NotPossible(ValueError):
    """Asked for rightly, but this mission cannot give it."""


class Download(NamedTuple):
    """A file."""

    name: str
    media_type: str
    body: bytes


def download(mission: Mission, moment: Moment, kind: str, now_ns: int, **how: Any) -> Download:
    """`how` is that of `ZoneExport`. The newest moment holds now, however long no view has come. ValueError
    for a format that there is not, NotPossible."""
    if kind not in FORMATS:
        raise ValueError(f"format {kind!r} is none of {', '.join(FORMATS)}")
    if kind in _ABOVE_GROUND and how.get("datum", "AGL") != "AGL":
        others = ", ".join(one for one in FORMATS if one not in _ABOVE_GROUND)
        raise ValueError(f"{kind} knows no heights above {how['datum']}; those that do are {others}")
    if kind == "f3548" and how.get("datum") == "AMSL":
        raise ValueError("f3548 has heights above the ellipsoid (WGS84) alone, and none above AMSL")
    is_timeless = kind in _TIMELESS
    holds_ns = now_ns if moment is mission.newest else moment.stamp_ns
    standing = _standing(moment.zones, holds_ns)
    zones, starts_ns = (
        (passable(standing, moment.marks), {}) if is_timeless else _later_too(standing, moment.marks)
    )
    if kind == "geojson":
        span_ns = mission.timeline.span_ns()
        description = mission.description(moment.stamp_ns, None if span_ns is None else span_ns[0])
        text = zones_geojson(zones, description, mission.georeference)
        return Download("zones.geojson", "application/geo+json", text.encode())
    if mission.georeference is None:
        raise NotPossible("the mission has no place on Earth; only geojson holds local metres")
    export = ZoneExport(
        zones=zones.closed,
        stamp_ns=holds_ns,
        georeference=mission.georeference,
        mission=mission.name,
        method=mission.loop.crowd_map.method.name,
        threshold=zones.threshold,
        starts_ns=starts_ns,
        **how,
    )
    suffix, media_type = _MEDIA.get(kind, ("json", "application/json"))
    if kind == "qgc":
        suffix = "plan"
    return Download(f"zones-{kind}.{suffix}", media_type, ZONE_FORMATS[kind](export).encode())


def _standing(zones: ZoneSet, holds_ns: int) -> ZoneSet:
    """Those that still stand at `holds_ns` have not ended before: they name no end that is over."""
    return replace(
        zones,
        zones=tuple(
            zone
            if zone.valid_until_ns is None or zone.valid_until_ns > holds_ns
            else replace(zone, valid_until_ns=None)
            for zone in zones
        ),
    )


def _later_too(zones: ZoneSet, marks: Marks) -> tuple[ZoneSet, dict[str, int]]:
    """With those that drones may pass for a while, and until when: a consumer that asks again in ten minutes
    would have none of them for nine."""
    ends_ns = {
        name: int(mark["dismissed"]["until_ns"]) for name, mark in marks.items() if mark.get("dismissed")
    }
    kept = tuple(
        zone
        for zone in zones
        if zone.id not in ends_ns or zone.valid_until_ns is None or zone.valid_until_ns > ends_ns[zone.id]
    )
    return replace(zones, zones=kept), ends_ns
