"""What an autopilot's fence is made of: items of the MAVLink mission protocol, and the shapes that they form.

Numbers are those of MAV_CMD. A polygon is as many items as it has corners, each of which says how many there
are; a circle is one. There are no heights, no times and no holes.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

RETURN_POINT = 5000
POLYGON_INCLUSION = 5001
POLYGON_EXCLUSION = 5002
CIRCLE_INCLUSION = 5003
CIRCLE_EXCLUSION = 5004
POLYGONS = (POLYGON_INCLUSION, POLYGON_EXCLUSION)
CIRCLES = (CIRCLE_INCLUSION, CIRCLE_EXCLUSION)

POSITION_TOLERANCE_E7 = 1
"""Some autopilots keep degrees in floating point."""
RADIUS_TOLERANCE_M = 1e-3
"""Older ArduPilot keeps a radius this close to a whole number as that."""


@dataclass(frozen=True, slots=True)
class FenceItem:
    """One item as it travels; what a fence does not use is kept, so that items of others stay."""

    command: int
    param1: float
    """Corners of the polygon, or radius of the circle in metres."""
    latitude_e7: int
    """1e-7 degrees."""
    longitude_e7: int
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    z: float = 0.0
    frame: int = 0
    """MAV_FRAME_GLOBAL, which PX4 and ArduPilot both take."""

    def is_same(self, other: FenceItem) -> bool:
        """Whether both close the same, within what autopilots lose when they store it."""
        return (
            self.command == other.command
            and _are_near(self.param1, other.param1)
            and abs(self.latitude_e7 - other.latitude_e7) <= POSITION_TOLERANCE_E7
            and abs(self.longitude_e7 - other.longitude_e7) <= POSITION_TOLERANCE_E7
        )


def _are_near(first: float, second: float) -> bool:
    """What is no number is near to itself: others may have written it, and it is to be kept."""
    return str(first) == str(second) or abs(first - second) <= RADIUS_TOLERANCE_M


FenceShape = tuple[FenceItem, ...]
"""The corners of a polygon, or one item by itself."""


def shapes_of(items: Sequence[FenceItem]) -> list[FenceShape]:
    """Items put together to shapes. A polygon that ends early is what there is of it."""
    shapes, start = [], 0
    while start < len(items):
        first = items[start]
        size = max(1, _corners(first))
        end = start + 1
        while end < min(start + size, len(items)) and _goes_on(first, items[end]):
            end += 1
        shapes.append(tuple(items[start:end]))
        start = end
    return shapes


def _corners(item: FenceItem) -> int:
    """That it says its polygon has; none where that is no number, 1 of what is no polygon."""
    if item.command not in POLYGONS:
        return 1
    return round(item.param1) if math.isfinite(item.param1) else 0


def _goes_on(first: FenceItem, item: FenceItem) -> bool:
    return (item.command, item.param1) == (first.command, first.param1)


def missing_corners(shape: FenceShape) -> int:
    """Of a polygon that ends early; other than 0, too, where its number of corners is none."""
    return _corners(shape[0]) - len(shape)


def is_circle(shape: FenceShape) -> bool:
    """Circles stand behind everything else in a list: newer PX4 (geofence.cpp) takes every corner of a
    polygon behind a circle for the first one of another polygon, which reaches into the next shape."""
    return shape[0].command in CIRCLES


def items_of(shapes: Iterable[FenceShape]) -> list[FenceItem]:
    return [item for shape in shapes for item in shape]


def are_same(first: Sequence[FenceItem], second: Sequence[FenceItem]) -> bool:
    """Item by item."""
    return len(first) == len(second) and all(a.is_same(b) for a, b in zip(first, second, strict=True))


def parted(
    there: Iterable[FenceShape], known: Iterable[FenceShape]
) -> tuple[list[FenceShape], list[FenceShape], list[FenceShape]]:
    """Shapes that are there and known, there and not known, known and no longer there; each known one counts
    for one that is there. Known shapes are as they were read back, so they are found again exactly."""
    left = Counter(key_of(shape) for shape in known)
    by_key = {key_of(shape): shape for shape in known}
    found, others = [], []
    for shape in there:
        key = key_of(shape)
        if left[key] > 0:
            left[key] -= 1
            found.append(shape)
        else:
            others.append(shape)
    missing = [by_key[key] for key in left.elements()]
    return found, others, missing


def key_of(shape: FenceShape) -> tuple[tuple[int, str, int, int], ...]:
    """What tells shapes apart; of numbers the text, because what is no number is not equal to itself."""
    return tuple((item.command, str(item.param1), item.latitude_e7, item.longitude_e7) for item in shape)
