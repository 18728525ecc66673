"""The fence that a vehicle holds, as GeoJSON (RFC 7946)."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from crowdfence.fence_sync.fence_item import (
    CIRCLE_EXCLUSION,
    CIRCLE_INCLUSION,
    CIRCLES,
    POLYGON_EXCLUSION,
    POLYGON_INCLUSION,
    POLYGONS,
    RETURN_POINT,
    FenceShape,
)

_KINDS = {
    RETURN_POINT: "return point",
    POLYGON_INCLUSION: "inclusion",
    POLYGON_EXCLUSION: "exclusion",
    CIRCLE_INCLUSION: "inclusion",
    CIRCLE_EXCLUSION: "exclusion",
}


def fence_geojson(shapes: Sequence[FenceShape], ours: Sequence[FenceShape], vehicle: str) -> str:
    """One Feature a shape: polygons; circles as points with `radius_m`; what is neither as a point."""
    features = [_feature(shape, shape in ours) for shape in shapes]
    head = {"type": "FeatureCollection", "vehicle": vehicle}
    lines = ",\n".join(json.dumps(feature, allow_nan=False) for feature in features)
    return f'{json.dumps(head)[:-1]}, "features": [\n{lines}\n]}}\n'


def _feature(shape: FenceShape, is_ours: bool) -> dict[str, Any]:
    first = shape[0]
    corners = [[item.longitude_e7 / 1e7, item.latitude_e7 / 1e7] for item in shape]
    properties: dict[str, Any] = {
        "fence": _KINDS.get(first.command, "not known"),
        "command": first.command,
        "drawn_by": "crowdfence" if is_ours else "others",
    }
    if first.command in CIRCLES:
        properties["radius_m"] = first.param1 if math.isfinite(first.param1) else None
    if first.command in POLYGONS and len(shape) >= 3:
        geometry: dict[str, Any] = {"type": "Polygon", "coordinates": [_counter_clockwise(corners)]}
    else:
        geometry = {"type": "Point", "coordinates": corners[0]}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _counter_clockwise(corners: list[list[float]]) -> list[list[float]]:
    closed = [*corners, corners[0]]
    double_area = sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(closed))
    return closed if double_area >= 0.0 else closed[::-1]
