"""Looks in a row that all say the same: how many, and for how long, before it is told."""

from __future__ import annotations

from dataclasses import dataclass

LEAST_LOOKS = 5
"""On 14 rendered missions drones that see saw nobody where others showed crowd at most three times."""
LEAST_S = 3.0
"""From the first of them to the last: the false alarm of a drone stands for 2 s."""


@dataclass(frozen=True, slots=True)
class LooksInARow:
    looks: int
    first_ns: int
    last_ns: int

    @staticmethod
    def begun(stamp_ns: int) -> LooksInARow:
        """Without a look so far."""
        return LooksInARow(0, stamp_ns, stamp_ns)

    def and_at(self, stamp_ns: int) -> LooksInARow:
        """With one look more."""
        return LooksInARow(self.looks + 1, min(stamp_ns, self.first_ns), max(stamp_ns, self.last_ns))

    @property
    def seconds(self) -> float:
        return (self.last_ns - self.first_ns) / 1e9

    @property
    def are_many(self) -> bool:
        return self.looks >= LEAST_LOOKS and self.last_ns - self.first_ns >= LEAST_S * 1e9
