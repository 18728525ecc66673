"""The zones of a moment as a file, in the formats of `crowdfence export`."""

from __future__ import annotations

from typing import Any, NamedTuple

from crowdfence.exports.geojson import zones_geojson
from crowdfence.exports.zone_formats import ZONE_FORMATS, ZoneExport
from crowdfence.service.mission import Mission
from crowdfence.service.operator_zones import passable
from crowdfence.service.timeline import Moment

_MEDIA = {"kml": ("kml", "application/vnd.google-earth.kml+xml"), "csv": ("csv", "text/csv")}
_MEDIA["multidrone"] = _MEDIA["kml"]
FORMATS = ("geojson", *ZONE_FORMATS)


class NotPossible(ValueError):
    """Asked for rightly, but this mission cannot give it."""


class Download(NamedTuple):
    """A file."""

    name: str
    media_type: str
    body: bytes


def download(mission: Mission, moment: Moment, kind: str, **how: Any) -> Download:
    """`how` is that of `ZoneExport`. ValueError for a format that there is not, NotPossible."""
    if kind not in FORMATS:
        raise ValueError(f"format {kind!r} is none of {', '.join(FORMATS)}")
    zones = passable(moment.zones, moment.marks)
    if kind == "geojson":
        description = mission.description(moment.stamp_ns, None)
        text = zones_geojson(zones, description, mission.georeference)
        return Download("zones.geojson", "application/geo+json", text.encode())
    if mission.georeference is None:
        raise NotPossible("the mission has no place on Earth; only geojson holds local metres")
    export = ZoneExport(
        zones=zones.closed,
        stamp_ns=moment.stamp_ns,
        georeference=mission.georeference,
        mission=mission.name,
        method=mission.loop.crowd_map.method.name,
        threshold=zones.threshold,
        **how,
    )
    suffix, media_type = _MEDIA.get(kind, ("json", "application/json"))
    if kind == "qgc":
        suffix = "plan"
    return Download(f"zones-{kind}.{suffix}", media_type, ZONE_FORMATS[kind](export).encode())
