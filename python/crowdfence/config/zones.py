"""What becomes a no-fly zone, and how long ground counts as known."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Literal

from crowdfence.errors import quoted
from crowdfence.plain_values import make_plain
from crowdfence.zones.altitude_band import DEFAULT_BAND, AltitudeBand
from crowdfence.zones.rules import Restriction, ZoneRules

_ANY_THRESHOLD = 1.0
_LEAST_AREA_M2 = 3.0
"""`benchmarks/evidence/README.md`, "The smallest zone"."""


@dataclass(frozen=True, slots=True)
class ZoneConfig:
    """Checked here and not where it is used: that is after the first frame. ValueError for a value out of
    bounds, TypeError for one of another kind."""

    threshold: float | None = None
    """Probability from which ground is crowd, in (0, 1], and above the prior of a method that forgets towards
    it; None: the method's own."""
    off_threshold: float | None = None
    """Ground stays in its zone down to this probability, in (0, threshold]; None: `threshold`."""
    opening_looks: int = 1
    """So many looks in a row must find ground below `off_threshold` before it leaves its zone, >= 1; methods
    that forget crowd by themselves open it without."""
    min_area_m2: float | None = None
    """Smaller regions do not become zones, and are counted; a zone that is there ends when it is smaller than
    half of it. Finite and >= 0; None: 3, a square metre for each of three people, but 0 where views are
    projected by `rays`: between what they hit nobody measures anything."""
    max_hole_m2: float = 0.0
    """Ground enclosed by crowd is closed too up to this area, >= 0; inf: always."""
    buffer_m: float = 0.0
    """Distance around the crowd that is closed too; from 0 to 100,000 (`safety_distance_m` has formulas)."""
    simplify_m: float = 0.0
    """How far an outline with fewer corners may reach beyond the exact one; finite and >= 0."""
    max_vertices: int | None = None
    """Most corners of a zone, >= 3; None: no limit."""
    lower_m: float = DEFAULT_BAND.lower_m
    """Zones begin here, metres above ground; >= -1000."""
    upper_m: float = DEFAULT_BAND.upper_m
    """Zones end here, metres above ground; at least 1 m above `lower_m`, <= 100000."""
    restriction: Restriction = "prohibited"
    """No flight, or none that stays above."""
    close_unseen: bool = False
    """Close ground that is not known to be empty: never seen, hidden, stale, or looked at and not cleared;
    holes of the map and crowd in regions below `min_area_m2` too."""
    stale_after_s: float = 30.0
    """Empty ground not seen for longer is stale, finite and >= 0: no evidence of absence any more."""

    def __post_init__(self) -> None:
        make_plain(self)
        for field in fields(self):
            _require_kind(field.name, getattr(self, field.name))
        if self.threshold is not None and not 0.0 < self.threshold <= 1.0:
            raise ValueError(f"threshold is {self.threshold:g}; it must be in (0, 1]")
        self.rules(_ANY_THRESHOLD)

    def least_area_m2(self, coverage: Literal["rays", "full"]) -> float:
        """Of a zone, where views are projected with this coverage."""
        if self.min_area_m2 is not None:
            return self.min_area_m2
        return _LEAST_AREA_M2 if coverage == "full" else 0.0

    def rules(self, default_threshold: float, coverage: Literal["rays", "full"] = "full") -> ZoneRules:
        """For a zone engine; `default_threshold` is that of the method, `coverage` that of the projection.
        ValueError where `off_threshold` is above it."""
        threshold = default_threshold if self.threshold is None else self.threshold
        return ZoneRules(
            threshold=threshold,
            off_threshold=threshold if self.off_threshold is None else self.off_threshold,
            opening_looks=self.opening_looks,
            min_area_m2=self.least_area_m2(coverage),
            max_hole_m2=self.max_hole_m2,
            buffer_m=self.buffer_m,
            simplify_m=self.simplify_m,
            max_vertices=self.max_vertices,
            close_unseen=self.close_unseen,
            stale_after_s=self.stale_after_s,
            band=AltitudeBand(self.lower_m, self.upper_m, "AGL"),
            restriction=self.restriction,
        )


def _require_kind(name: str, value: Any) -> None:
    """Configurations are read from files too, where `yes` may be True, and True is 1 as a number."""
    if name == "restriction" or value is None:
        return
    if name == "close_unseen":
        fits, kind = isinstance(value, bool), "True or False"
    elif name in ("opening_looks", "max_vertices"):
        fits, kind = isinstance(value, int) and not isinstance(value, bool), "a whole number"
    else:
        fits, kind = isinstance(value, (int, float)) and not isinstance(value, bool), "a number"
    if not fits:
        raise TypeError(f"{name} of a ZoneConfig is {quoted(value)}; it must be {kind}")
