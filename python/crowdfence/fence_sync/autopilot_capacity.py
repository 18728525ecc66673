"""How much fence an autopilot holds.

PX4 (v1.12): 64 entries of storage, one of which is a header; measured: 60 corners are taken, 64 are not.
ArduPilot (AC_Fence/AC_PolyFence_loader.cpp): bytes of storage, 4 of a head, 2 and 8 a corner of a polygon,
13 of a circle, 1 of an end; corners of all polygons are counted in 8 bits. How many bytes a board has is not
said by the vehicle: Copter has 48 to 560, and what does not fit is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from crowdfence.fence_sync.fence_item import POLYGONS, FenceShape, items_of
from crowdfence.fence_sync.messages import Autopilot

PX4_ITEMS = 63
ARDUPILOT_BYTES = 560
"""Of a Copter on a board with 16 kB of storage: 70 points of 8 bytes."""
_HEAD_BYTES = 5  # with the end mark
_POLYGON_BYTES, _CORNER_BYTES, _SINGLE_BYTES = 2, 8, 13
_MOST_CORNERS = 255


class Capacity(Protocol):
    """A bound on a list of shapes."""

    def holds(self, shapes: Sequence[FenceShape]) -> bool: ...

    def free_items(self, kept: Sequence[FenceShape]) -> int:
        """At most so many items fit beside what is kept; fewer may."""

    def after_refusal(self, shapes: Sequence[FenceShape]) -> Capacity:
        """A smaller one, because these were too many."""


@dataclass(frozen=True, slots=True)
class ItemCapacity:
    """So many items."""

    items: int

    def holds(self, shapes: Sequence[FenceShape]) -> bool:
        return len(items_of(shapes)) <= self.items

    def free_items(self, kept: Sequence[FenceShape]) -> int:
        return self.items - len(items_of(kept))

    def after_refusal(self, shapes: Sequence[FenceShape]) -> ItemCapacity:
        refused = len(items_of(shapes))
        return ItemCapacity(min(refused - 1, max(refused * 3 // 4, 1)))

    def __str__(self) -> str:
        return f"{self.items} items"


@dataclass(frozen=True, slots=True)
class StorageCapacity:
    """So many bytes."""

    bytes: int

    def holds(self, shapes: Sequence[FenceShape]) -> bool:
        corners = sum(len(shape) for shape in shapes if shape[0].command in POLYGONS)
        return corners <= _MOST_CORNERS and _HEAD_BYTES + sum(map(_bytes, shapes)) <= self.bytes

    def free_items(self, kept: Sequence[FenceShape]) -> int:
        corners = sum(len(shape) for shape in kept if shape[0].command in POLYGONS)
        left = self.bytes - _HEAD_BYTES - sum(map(_bytes, kept))
        return min(left // _CORNER_BYTES, _MOST_CORNERS - corners)

    def after_refusal(self, shapes: Sequence[FenceShape]) -> StorageCapacity:
        refused = _HEAD_BYTES + sum(map(_bytes, shapes))
        return StorageCapacity(min(refused - 1, refused * 3 // 4))

    def __str__(self) -> str:
        return f"{self.bytes} bytes"


def _bytes(shape: FenceShape) -> int:
    if shape[0].command in POLYGONS:
        return _POLYGON_BYTES + _CORNER_BYTES * len(shape)
    return _SINGLE_BYTES * len(shape)


def usual_capacity(autopilot: int) -> Capacity:
    """Of an autopilot that has said nothing yet; what it refuses makes it smaller."""
    return StorageCapacity(ARDUPILOT_BYTES) if autopilot == Autopilot.ARDUPILOT else ItemCapacity(PX4_ITEMS)
