"""What becomes a zone, and how: the rules that a zone engine keeps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from crowdfence.plain_values import make_plain
from crowdfence.zones.altitude_band import DEFAULT_BAND, AltitudeBand
from crowdfence.zones.safety_distance import MOST_M

Restriction = Literal["prohibited", "no_sustained_flight"]
"""No flight at all, or (14 CFR 107.110, 107.115) none that stays above."""

CONTINUES_WITHIN_M = 5.0
"""A zone that shares no ground with one of the instant before continues it from this near: people walk
1.5 m/s, instants lie up to some seconds apart."""
_LOWEST_M, _HIGHEST_M = -1000.0, 100_000.0
"""Above ground: in the shaft of a mine, and where space begins. No drone is beyond, where a zone closes
nothing."""
_THINNEST_M = 1.0


@dataclass(frozen=True, slots=True)
class ZoneRules:
    """ValueError for a value out of bounds."""

    threshold: float
    """Ground becomes crowd at this probability, in (0, 1]."""
    off_threshold: float
    """Ground stays crowd down to this one, in (0, `threshold`]."""
    opening_looks: int = 1
    """Where a method forgets towards "not known", so many looks in a row must find ground below
    `off_threshold` before it is opened; >= 1. `benchmarks/evidence/opening.py` measures what 2 bring."""
    min_area_m2: float = 0.0
    """Smaller regions (`regions`) do not become zones, and zones end when they are smaller than half of it;
    >= 0."""
    max_hole_m2: float = 0.0
    """Ground enclosed by crowd is closed too up to this area; inf for all of it."""
    buffer_m: float = 0.0
    """Distance around the crowd that is closed too; >= 0, at most 100 km. `safety_distance` has formulas."""
    simplify_m: float = 0.0
    """How far an outline with fewer corners may reach beyond; >= 0."""
    max_vertices: int | None = None
    """Most corners of a zone, >= 3; where it takes more ground to keep this, it takes it."""
    close_unseen: bool = False
    """Ground that is not known to be empty is closed too: never seen, hidden, stale, looked at and not
    cleared, missing inside the map, and crowd in regions below `min_area_m2`."""
    stale_after_s: float = 30.0
    """For `close_unseen`: how long a look says that ground is empty."""
    band: AltitudeBand = DEFAULT_BAND
    """From which height to which; above ground."""
    restriction: Restriction = "prohibited"

    @property
    def closes_more_than_crowd(self) -> bool:
        """Whether a zone may hold ground beside its columns of crowd."""
        grows = self.buffer_m > 0.0 or self.simplify_m > 0.0 or self.max_hole_m2 > 0.0
        return grows or self.max_vertices is not None

    def __post_init__(self) -> None:
        make_plain(self)
        if not 0.0 < self.threshold <= 1.0:
            raise ValueError(f"threshold is {self.threshold:g}; it must be in (0, 1]")
        if not self.off_threshold > 0.0:
            raise ValueError(
                f"off_threshold is {self.off_threshold:g}; it must be above 0, below which no probability "
                "falls: no zone would ever end"
            )
        if self.off_threshold > self.threshold:
            raise ValueError(
                f"off_threshold is {self.off_threshold:g}; it must be at most the threshold, "
                f"{self.threshold:g}"
            )
        if self.opening_looks < 1:
            raise ValueError(f"opening_looks is {self.opening_looks}; it must be at least 1")
        for name in ("min_area_m2", "buffer_m", "simplify_m", "stale_after_s"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name):g}; it must be finite and >= 0")
        if self.buffer_m > MOST_M:
            raise ValueError(f"buffer_m is {self.buffer_m:g}; it must be at most {MOST_M:g} m")
        if not self.max_hole_m2 >= 0.0:
            raise ValueError(f"max_hole_m2 is {self.max_hole_m2:g}; it must be >= 0")
        if self.max_vertices is not None and self.max_vertices < 3:
            raise ValueError(f"max_vertices is {self.max_vertices}; it must be at least 3")
        if self.band.datum != "AGL":
            raise ValueError(f"the band of a rule is above ground, not {self.band.datum}")
        lower_m, upper_m = self.band.lower_m, self.band.upper_m
        if upper_m - lower_m < _THINNEST_M or lower_m < _LOWEST_M or upper_m > _HIGHEST_M:
            raise ValueError(
                f"zones from {lower_m:g} to {upper_m:g} m above ground; they must be at least "
                f"{_THINNEST_M:g} m high and lie within {_LOWEST_M:g} and {_HIGHEST_M:g} m"
            )
        if self.restriction not in ("prohibited", "no_sustained_flight"):
            raise ValueError(
                f"restriction {self.restriction!r} is neither prohibited nor no_sustained_flight"
            )
