"""What is read back of a fence and is not what was sent: whose doing that is."""

from __future__ import annotations

from collections.abc import Sequence

from crowdfence.exports.geographic_outline import DEGREE_M
from crowdfence.fence_sync.fence_error import FenceError
from crowdfence.fence_sync.fence_item import FenceItem, are_same

_ROUNDED_E7 = 200
"""float32 loses up to 76 of longitudes beyond 128 degrees."""


class Rewritten(FenceError):
    """Somebody else wrote the fence after it was read: it is to be read again first."""


class Rounded(FenceError):
    """The vehicle took the list, and keeps other places than those that were sent."""

    def __init__(self, wanted: Sequence[FenceItem], held: tuple[FenceItem, ...]) -> None:
        pairs = list(zip(wanted, held, strict=True))
        off_m = max(DEGREE_M * max(_apart_e7(*pair)) / 1e7 for pair in pairs)
        super().__init__(
            f"the vehicle took the fence and keeps its corners elsewhere, up to {off_m:.2g} m from where "
            "they were sent, so zones may not be covered: its firmware loses digits of a degree; use one "
            "that keeps 7 (MISSION_ITEM_INT)"
        )
        self.held = held


def require_same(before: Sequence[FenceItem], now: Sequence[FenceItem]) -> None:
    """Rewritten where what is there now is not what was read before."""
    if not are_same(before, now):
        raise Rewritten(
            f"somebody else writes the fence all the time: of {len(before)} items that were read {len(now)} "
            "were there a little later, or others; nothing was sent. Find out who, then send again"
        )


def are_rounded(held: Sequence[FenceItem], wanted: Sequence[FenceItem]) -> bool:
    """Whether it is the list that was sent, each place a little off."""
    return len(held) == len(wanted) and all(
        (one.command, one.param1) == (other.command, other.param1)
        and max(_apart_e7(one, other)) <= _ROUNDED_E7
        for one, other in zip(held, wanted, strict=True)
    )


def _apart_e7(one: FenceItem, other: FenceItem) -> tuple[int, int]:
    return abs(one.latitude_e7 - other.latitude_e7), abs(one.longitude_e7 - other.longitude_e7)


def are_of_neither(held: Sequence[FenceItem], known: Sequence[FenceItem]) -> bool:
    """Whether items are there that were neither there before nor sent."""
    return any(not any(item.is_same(one) for one in known) for item in held)


def differs(wanted: Sequence[FenceItem], held: Sequence[FenceItem]) -> FenceError:
    """In words, where nobody knows whose doing it is."""
    same = sum(a.is_same(b) for a, b in zip(wanted, held, strict=False))
    return FenceError(
        f"the fence read back is not the one that was sent: {len(held)} items instead of {len(wanted)}, "
        f"{same} of them equal; did another ground station write meanwhile? Look with "
        "`crowdfence fence pull`, then send again"
    )
