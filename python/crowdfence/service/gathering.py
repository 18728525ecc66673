"""Arrivals on their way into instants: what waits for the views of other drones, and for how long."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from crowdfence.service.arrivals import Arrival
from crowdfence.sources.synchronize import InstantGrouper


class Gathering:
    """Not safe for several threads, apart from `is_due`, `end_ns` and `drones`."""

    def __init__(self, *, tolerance_ns: int, max_delay_ns: int) -> None:
        self.patience_ns = tolerance_ns + max_delay_ns
        """Once it is so much later than a stamp, every instant that follows is later than that stamp."""
        self._grouper = InstantGrouper[Arrival](tolerance_ns, max_delay_ns)
        self._newest_ns = 0
        self._waiting: dict[int, Arrival] = {}
        """By their place in the journal."""

    def push(self, arrival: Arrival) -> tuple[list[list[Arrival]], list[Arrival]]:
        """The instants that it completes, and what came too late for its own."""
        self._waiting[arrival.seq] = arrival
        grouped = self._grouper.push(arrival)
        self._newest_ns = max(self._newest_ns, arrival.stamp_ns)
        return [list(group) for group in grouped.instants], list(grouped.late)

    def advance(self, stamp_ns: int) -> list[list[Arrival]]:
        """The instants that are complete once it is this late."""
        self._newest_ns = max(self._newest_ns, stamp_ns)
        return [list(group) for group in self._grouper.advance(stamp_ns).instants]

    def took(self, group: Sequence[Arrival]) -> None:
        """They wait no more."""
        for arrival in group:
            del self._waiting[arrival.seq]

    @property
    def drones(self) -> set[str]:
        """Whose views wait."""
        return {one.drone for one in list(self._waiting.values())}

    @property
    def waits_until_ns(self) -> int:
        """The newest stamp of what waits; 0 for nothing."""
        return max((one.stamp_ns for one in list(self._waiting.values())), default=0)

    @property
    def end_ns(self) -> int:
        """Once it is so late, nothing waits."""
        return self.waits_until_ns + self.patience_ns + 1

    def is_due(self, now_ns: int) -> bool:
        """Whether something has waited longer than views may come late."""
        oldest_ns = min((one.stamp_ns for one in list(self._waiting.values())), default=None)
        return oldest_ns is not None and now_ns - oldest_ns > self.patience_ns

    def first_waiting(self, default: int) -> int:
        """The first place in the journal that is still needed."""
        return min(self._waiting, default=default)

    def to_json(self) -> dict[str, Any]:
        near = [seq for seq, arrival in sorted(self._waiting.items()) if arrival.near]
        return {"grouper_ns": self._newest_ns, "waiting": sorted(self._waiting), "near": near}

    def restore(
        self, told: dict[str, Any], waiting: Sequence[Arrival]
    ) -> tuple[list[list[Arrival]], list[Arrival]]:
        """`waiting` are the arrivals that `to_json` told of, in the order of arrival. As they lay nothing of
        them was complete; where less delay is allowed now, what `push` gives is returned."""
        instants, too_late = [], []
        for arrival in waiting:
            complete, late = self.push(arrival)
            instants += complete
            too_late += late
        if told["grouper_ns"]:
            instants += self.advance(told["grouper_ns"])
        return instants, too_late
