"""Zones as the exclusion fence of a QGroundControl plan, alone or put into a plan that exists.

A fence of an autopilot is short (63 corners and circles on PX4), has no holes, no heights and no times: zones
are fitted into it without uncovering anything (`zones.capacity`), and stand until another fence is sent. What
the plan held before stays, its other fence items too, and they count.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from crowdfence.errors import quoted
from crowdfence.exports.geographic_circle import geographic_circle
from crowdfence.exports.ground_of_shapes import GroundOfShapes
from crowdfence.exports.zone_formats.zone_export import SOFTWARE, ZoneExport
from crowdfence.georeference import Georeference, geoid_height_m
from crowdfence.zones.capacity import Circle, Fence, fitted

PLAN_VERSION = 1
MISSION_VERSION = 2
FENCE_VERSION = 2
_ITEM_VERSION = 1
_DECIMALS = 8


def qgc_plan(export: ZoneExport, plan: dict[str, Any] | None = None) -> str:
    """The plan as text; `plan` is one that exists. ValueError for a plan of a version that is not known and
    for a fence that is full."""
    result = _empty_plan(export) if plan is None else _checked(plan)
    fence = result["geoFence"]
    ours = fence_of(export, None if plan is None else result)
    ground = GroundOfShapes(export.zones)
    fence["polygons"] += [_polygon(one, export, ground) for one in ours.polygons]
    fence["circles"] += [_circle(one, export, ground) for one in ours.circles]
    return json.dumps(result, ensure_ascii=False, allow_nan=False, indent=4) + "\n"


def fence_of(export: ZoneExport, plan: dict[str, Any] | None = None) -> Fence:
    """What is put into the fence beside what a plan holds. ValueError where there is no room."""
    if not export.zones:
        return Fence((), (), 0.0, 0.0)
    there: dict[str, Any] = {"polygons": [], "circles": []} if plan is None else _checked(plan)["geoFence"]
    # QGroundControl sends the point to return to as one more item of the same list.
    taken = sum(len(one["polygon"]) for one in there["polygons"]) + len(there["circles"])
    taken += "breachReturn" in there
    return fitted([zone.polygon for zone in export.zones], export.max_items - taken)


def _checked(plan: dict[str, Any]) -> dict[str, Any]:
    """A copy with a fence of the known version."""
    result: dict[str, Any] = json.loads(json.dumps(plan))
    if result.get("fileType") != "Plan" or not isinstance(result.get("mission"), dict):
        raise ValueError("the plan is not one of QGroundControl: it has no fileType Plan or no mission")
    for name, found, known in (
        ("the plan", result.get("version"), PLAN_VERSION),
        ("its mission", result["mission"].get("version"), MISSION_VERSION),
    ):
        if found != known:
            raise ValueError(f"{name} is of version {found!r}; only {known} is known")
    fence = result.setdefault("geoFence", {})
    if not isinstance(fence, dict):
        raise ValueError(f"its geoFence is {quoted(fence)}; it must be an object")
    if fence.get("version", FENCE_VERSION) != FENCE_VERSION:
        if fence.get("polygon") or fence.get("polygons") or fence.get("circles"):
            raise ValueError(f"its fence is of version {fence['version']!r}; only {FENCE_VERSION} is known")
        fence = result["geoFence"] = {}  # the old form, empty
    fence["version"] = FENCE_VERSION
    fence.setdefault("polygons", [])
    fence.setdefault("circles", [])
    for name in ("polygons", "circles"):
        if not isinstance(fence[name], list) or not all(isinstance(one, dict) for one in fence[name]):
            raise ValueError(
                f"the {name} of its geoFence are {quoted(fence[name])}; they must be a list of objects"
            )
    for one in fence["polygons"]:
        if not isinstance(one.get("polygon"), list):
            raise ValueError(f"a polygon of its geoFence has no corners: {quoted(one)}")
    return result


def _empty_plan(export: ZoneExport) -> dict[str, Any]:
    return {
        "fileType": "Plan",
        "groundStation": SOFTWARE,
        "version": PLAN_VERSION,
        "geoFence": {"version": FENCE_VERSION, "polygons": [], "circles": []},
        "rallyPoints": {"version": 2, "points": []},
        "mission": {
            "version": MISSION_VERSION,
            "firmwareType": 12,
            "vehicleType": 2,
            "globalPlanAltitudeMode": 1,
            "cruiseSpeed": 15,
            "hoverSpeed": 5,
            "items": [],
            "plannedHomePosition": _home(export.georeference),
        },
    }


def _home(anchor: Georeference) -> list[float | None]:
    """Its height counts from the sea. Where nobody knows how high that lies it is left open, which
    QGroundControl takes for unknown; it puts a home onto its own terrain."""
    try:
        sea_m = geoid_height_m(anchor.latitude_deg, anchor.longitude_deg)
    except ValueError:
        return [anchor.latitude_deg, anchor.longitude_deg, None]
    return [anchor.latitude_deg, anchor.longitude_deg, anchor.height_m - sea_m]


def _polygon(polygon: Any, export: ZoneExport, ground: GroundOfShapes) -> dict[str, Any]:
    outline = export.outline(ground.as_zone(polygon), max_edge_m=None, decimals=_DECIMALS)
    if outline.geom_type != "Polygon":
        raise ValueError("a fence across the antimeridian cannot be written as a plan")
    ring = np.asarray(outline.exterior.coords)[:-1]
    return {
        "inclusion": False,
        "polygon": [[latitude, longitude] for longitude, latitude in ring.tolist()],
        "version": _ITEM_VERSION,
    }


def _circle(circle: Circle, export: ZoneExport, ground: GroundOfShapes) -> dict[str, Any]:
    longitude, latitude, radius_m = geographic_circle(
        circle, export.georeference, *ground.between_m(circle.outline()), _DECIMALS
    )
    return {
        "circle": {"center": [latitude, longitude], "radius": radius_m},
        "inclusion": False,
        "version": _ITEM_VERSION,
    }
