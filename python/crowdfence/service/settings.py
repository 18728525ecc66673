"""What the service is told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

ClockKind = Literal["system", "views"]

_MOST = {
    "max_delay_ms": 3_600_000.0,
    "silent_after_s": 3600.0,
    "pose_stale_s": 3600.0,
    "keep_s": 10 * 365 * 86400.0,
}
"""An alarm that comes after an hour is none, and stamps end in the year 2262."""


@dataclass(frozen=True, slots=True)
class ServiceSettings:
    """Complete by default. ValueError for a value out of bounds."""

    clock: ClockKind = "system"
    """What live views are compared with: the machine's clock, or the newest view (simulations)."""
    max_delay_ms: float = 500.0
    """A view that comes later than this after newer ones, or after its stamp, is late: it is taken in by
    itself, with its age."""
    max_age_s: float = 60.0
    """A view that is older is refused."""
    max_ahead_s: float = 2.0
    """A view that is further ahead of the clock is refused: its drone has a wrong clock."""
    waiting_per_drone: int = 16
    """Views of one drone that are accepted and not in the map yet; more are told to come again (429)."""
    turn_within_s: float = 2.0
    """While views wait longer until they are taken into the map, each drone has room for one."""
    views_per_s: float = 30.0
    """Of one drone, on average."""
    silent_after_s: float = 5.0
    """No view from a drone for longer is an alarm."""
    quiet_s: float = 5.0
    """With the clock of the views: once no view came for so long, by a clock on the wall, those that wait for
    others become instants."""
    pose_wait_s: float = 1.0
    """A view without a pose waits so long for the telemetry around its stamp."""
    pose_stale_s: float = 2.0
    """No telemetry of a drone that should have it for longer is an alarm."""
    near_m: float = 30.0
    """A drone this near a zone is a warning."""
    dismissed_for_s: float = 60.0
    """How long drones may pass through crowd that an operator dismissed."""
    snapshot_every: int = 200
    """Journaled records from one snapshot to the next."""
    keep_s: float = 24 * 3600.0
    """History, pictures and journaled views older than this are removed."""
    keep_media_mb: float = 512.0
    """Pictures with heatmaps, maps, and zones of the past: of each what is beyond this is removed, the oldest
    first."""
    max_body_mb: float = 16.0
    """Largest request."""
    requests_per_s: float = 100.0
    """Of one user or address, on average, without the views that it gives."""
    given_per_s: float = 1000.0
    """Views and observations of one user or address, on average: a bridge gives those of a whole fleet."""

    def __post_init__(self) -> None:
        for name in ("max_delay_ms", "max_age_s", "max_ahead_s", "pose_wait_s", "near_m", "dismissed_for_s"):
            if not 0.0 <= getattr(self, name) < float("inf"):
                raise ValueError(f"{name} is {getattr(self, name):g}; it must be finite and >= 0")
        for name in (
            "views_per_s",
            "silent_after_s",
            "quiet_s",
            "turn_within_s",
            "pose_stale_s",
            "keep_s",
            "keep_media_mb",
            "max_body_mb",
            "requests_per_s",
            "given_per_s",
        ):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ValueError(f"{name} is {getattr(self, name):g}; it must be finite and above 0")
        for name, most in _MOST.items():
            if getattr(self, name) > most:
                raise ValueError(f"{name} is {getattr(self, name):g}; it must be at most {most:g}")
        for name in ("waiting_per_drone", "snapshot_every"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be at least 1")
        if self.clock not in ("system", "views"):
            raise ValueError(f"clock {self.clock!r} is neither system nor views")
