"""What happened to a fence, and what its autopilot will not do with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

EventKind = Literal[
    "written",
    "unchanged",
    "cleared",
    "kept_others",
    "changed_by_others",
    "over_coverage",
    "no_heights",
    "capacity_learned",
    "vehicle_inside",
    "home_inside",
    "position_unknown",
    "home_unknown",
    "way_home_closed",
    "not_enforced",
    "acts_inside",
    "autopilot_unknown",
    "several_vehicles",
    "refused_by_text",
    "zone_without_ground",
    "zones_unreadable",
    "zones_stale",
    "zones_ended",
    "another_mission",
    "failed",
    "link_lost",
    "link_back",
]


@dataclass(frozen=True, slots=True)
class FenceEvent:
    """One line of what happened."""

    kind: EventKind
    text: str
    alarm: bool = False
    """Somebody has to do something: the fence does not do what it seems to."""
    details: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        level = "alarm" if self.alarm else "notice"
        return {"event": self.kind, "level": level, "text": self.text, **self.details}
