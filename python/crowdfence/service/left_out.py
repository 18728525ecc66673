"""Drones whose looks do not count, because an operator says that they see nothing.

A covered lens shows an empty field with full weight, and so does a detector that fails at dusk: what such a
drone alone has in view opens. Left out, it is a drone that does not look: what is closed below it stays
closed, and what it cleared is known no longer than other ground that nobody looks at. Its views are still
journaled and shown, so that somebody notices when it sees again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal

from crowdfence.service.operator_zones import RefusedAction

DroneVerb = Literal["leave_out", "take_in"]


@dataclass(frozen=True, slots=True)
class DroneAction:
    """What somebody did about a drone, when and why; it can be done again from the journal."""

    action: DroneVerb
    drone: str
    stamp_ns: int
    user: str
    role: str
    reason: str


class LeftOut:
    """Actions in order; the same actions give the same result."""

    def __init__(self) -> None:
        self._by: dict[str, DroneAction] = {}

    def __contains__(self, drone: str) -> bool:
        return drone in self._by

    def __iter__(self) -> Iterator[DroneAction]:
        """By whom and why each is left out."""
        return iter(list(self._by.values()))

    def by(self, drone: str) -> DroneAction | None:
        """None where its looks count."""
        return self._by.get(drone)

    def check(self, action: DroneAction) -> None:
        """RefusedAction for what `do` would not do."""
        is_left_out = action.drone in self._by
        if action.action == "leave_out" and is_left_out:
            raise RefusedAction(f"{action.drone} is left out already")
        if action.action == "take_in" and not is_left_out:
            raise RefusedAction(f"{action.drone} is not left out")

    def do(self, action: DroneAction) -> None:
        """Do what was checked."""
        self.check(action)
        if action.action == "leave_out":
            self._by[action.drone] = action
        else:
            del self._by[action.drone]

    def to_json(self) -> list[dict[str, Any]]:
        """For a snapshot."""
        return [asdict(action) for action in self]

    def restore(self, told: list[dict[str, Any]]) -> None:
        """What `to_json` told."""
        self._by = {one["drone"]: DroneAction(**one) for one in told}
