"""Zones as visualization_msgs/MarkerArray.

Every array begins by deleting what the topic showed before, so that it says all by itself: a player may jump
to any instant. Each zone has three to four markers under the name of its kind: its ground, the outline of it,
the band in the air that is closed, and a label.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.exports.colours import STATE_COLOURS
from crowdfence.iso_time import iso_utc
from crowdfence.sources.mission.layout import MAP_FRAME
from crowdfence.sources.mission.ros2_messages import header
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.square_metres import square_metres

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

LINE_LIST, TEXT, TRIANGLE_LIST = 5, 9, 11
ADD, DELETE_ALL = 0, 3

HeightAt = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Local heights [N] of the ground at places [N, 2]."""

_COLOURS = {
    "crowd": STATE_COLOURS[VoxelState.CROWD],
    "unseen": STATE_COLOURS[VoxelState.OCCLUDED],
    "static": (40, 90, 200),
}
_LIFT_M = 0.3
"""Drawn above the ground, so that the terrain does not hide it."""
_TEXT_M = 4.0
_ABOVE = np.array([0.0, 0.0, 2 * _TEXT_M])
_IDENTITY = {"position": {}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}


def zone_markers(zones: ZoneSet, stamp_ns: int, ground: HeightAt | None) -> dict[str, Any]:
    """The message of one instant; `ground` None: zones lie at the top of their own ground."""
    markers = [{"header": header(stamp_ns, MAP_FRAME), "action": DELETE_ALL, "pose": _IDENTITY}]
    for number, zone in enumerate(zones.closed):
        for marker in _markers(zone, ground):
            markers.append({"header": header(stamp_ns, MAP_FRAME), "id": number, "action": ADD} | marker)
    return {"markers": markers}


def _markers(zone: Zone, ground: HeightAt | None) -> Iterator[dict[str, Any]]:
    place = zone.polygon.representative_point()
    middle = np.array([[place.x, place.y]])

    def on_ground(places: NDArray[np.float64]) -> NDArray[np.float64]:
        heights = np.full(len(places), zone.upper_m) if ground is None else ground(places)
        return np.column_stack([places, heights + _LIFT_M])

    edges = _edges(zone.polygon)
    line = {"type": LINE_LIST, "pose": _IDENTITY, "scale": _scale(0.4, 0.0, 0.0)}
    yield {
        "ns": f"{zone.kind} ground",
        "type": TRIANGLE_LIST,
        "pose": _IDENTITY,
        "scale": _scale(1.0, 1.0, 1.0),
        "color": _colour(zone, 0.35),
        "points": points(on_ground(_triangles(zone.polygon))),
    }
    yield line | {
        "ns": f"{zone.kind} outline",
        "color": _colour(zone, 1.0),
        "points": points(on_ground(edges)),
    }
    if (heights := band_heights(zone)) is not None:
        rings = [np.column_stack([edges, np.full(len(edges), height_m)]) for height_m in heights]
        yield line | {
            "ns": f"{zone.kind} band",
            "color": _colour(zone, 0.4),
            "points": points(np.concatenate([*rings, _risers(zone.polygon, heights)])),
        }
    yield {
        "ns": f"{zone.kind} label",
        "type": TEXT,
        "pose": {**_IDENTITY, "position": points(on_ground(middle) + _ABOVE)[0]},
        "scale": _scale(0.0, 0.0, _TEXT_M),
        "color": {"r": 1.0, "g": 1.0, "b": 1.0, "a": 1.0},
        "text": label(zone),
    }


def label(zone: Zone) -> str:
    """What a zone says of itself, in two or three lines."""
    lines = [zone.id if zone.kind == "crowd" else f"{zone.id} ({zone.kind})"]
    if zone.kind == "crowd":
        lines[0] += f"  P {zone.probability_max:.2f}"
        if zone.interval is not None:
            lines[0] += f" ({zone.interval[0]:.2f} to {zone.interval[1]:.2f})"
    reason = "" if zone.reason is None else ", " + zone.reason.replace("_", " ")
    lines.append(f"{square_metres(zone.polygon.area)}{reason}")
    if zone.valid_until_ns is not None:
        lines.append(f"until {iso_utc(zone.valid_until_ns)}")
    return "\n".join(lines)


def band_heights(zone: Zone) -> tuple[float, float] | None:
    """Local heights from which to which it is closed; None where the ground below it is not known."""
    if zone.kind == "static" or zone.band.datum != "AGL" or not zone.ground_is_known:
        return None
    return zone.lower_m + zone.band.lower_m, zone.upper_m + zone.band.upper_m


def points(places: ArrayLike) -> list[dict[str, float]]:
    """geometry_msgs/Point of places [N, 3]."""
    return [{"x": x, "y": y, "z": z} for x, y, z in np.asarray(places, dtype=np.float64).tolist()]


def _edges(outline: Polygon | MultiPolygon) -> NDArray[np.float64]:
    """Both ends of every edge [2 E, 2]."""
    rings = [np.asarray(ring.coords)[:, :2] for ring in _rings(outline)]
    return np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1).reshape(-1, 2) for ring in rings])


def _rings(outline: Polygon | MultiPolygon) -> Iterator[Any]:
    for part in getattr(outline, "geoms", [outline]):
        yield part.exterior
        yield from part.interiors


def _triangles(outline: Polygon | MultiPolygon) -> NDArray[np.float64]:
    """Corners [3 T, 2] of triangles that fill it, and nothing else."""
    import shapely

    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(outline))
    if not len(triangles):
        return np.empty((0, 2))
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)
    return np.asarray(corners[:, :3].reshape(-1, 2))


def _risers(outline: Polygon | MultiPolygon, heights: tuple[float, float]) -> NDArray[np.float64]:
    """Upright lines [2 N, 3] at the corners of a box around each part: a line a corner would be a wall."""
    lines = []
    for part in getattr(outline, "geoms", [outline]):
        ring = np.asarray(part.exterior.coords)[:-1]
        for corner in {int(ring[:, axis].argmin()) for axis in (0, 1)} | {
            int(ring[:, axis].argmax()) for axis in (0, 1)
        }:
            lines += [[*ring[corner, :2], height_m] for height_m in heights]
    return np.array(lines)


def _colour(zone: Zone, opacity: float) -> dict[str, float]:
    red, green, blue = _COLOURS[zone.kind]
    return {"r": red / 255, "g": green / 255, "b": blue / 255, "a": opacity}


def _scale(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}
