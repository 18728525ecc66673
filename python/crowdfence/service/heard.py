"""What was heard of every drone."""

from __future__ import annotations

from collections import Counter

from crowdfence.service.latency import Latency
from crowdfence.service.view_lag import ViewLag

UNKNOWN = "(unknown)"
"""Stands for the drone of views that nobody read, or of one that never had a view accepted."""


class Heard:
    """Views by drone since the start, and what became of them. Counted by several threads."""

    def __init__(self) -> None:
        self.accepted: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.late: Counter[str] = Counter()
        self.left_out: Counter[str] = Counter()
        """Of drones that an operator left out."""
        self.last_view_ns: dict[str, int] = {}
        """Newest stamp of each drone that was accepted, also before a restart."""
        self.came_ns: dict[str, int] = {}
        """When the last view of each drone was accepted since the start, by the clock of the service."""
        self.lag: dict[str, ViewLag] = {}
        """From the stamps of each drone to when its views came, where a clock on the wall tells that."""
        self.accepted_s: float | None = None
        """When the last view was accepted since the start, by a steady clock."""
        self.acknowledging = Latency()
        """From the last byte of a view to its acknowledgement."""
        self.publishing = Latency()
        """From the acknowledgement to the zones that follow from it."""

    def view(self, drone: str, stamp_ns: int) -> None:
        """One that was accepted."""
        self.last_view_ns[drone] = max(stamp_ns, self.last_view_ns.get(drone, 0))

    def lag_s(self, drone: str) -> float | None:
        """How long after its stamp the quickest view of a drone came of late, s; None where nobody knows."""
        lag = self.lag.get(drone)
        return None if lag is None else lag.least_s
