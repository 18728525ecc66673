"""From which height to which a zone is closed, and above what."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Datum = Literal["AGL", "AMSL", "WGS84"]
"""Above the ground below, above mean sea level (a geoid), above the ellipsoid of WGS 84."""
LOWEST_SEA_M, HIGHEST_SEA_M = -107.0, 86.0
"""The sea lies nowhere lower or higher above the ellipsoid (EGM96)."""
LOWEST_GROUND_M, HIGHEST_GROUND_M = -500.0, 9000.0
"""No ground on Earth is lower or higher, above the sea or the ellipsoid: the shore of the Dead Sea lies at
-440 m, Everest at 8849 m."""


@dataclass(frozen=True, slots=True)
class AltitudeBand:
    """A band of heights in metres; ValueError where it is empty or not finite."""

    lower_m: float
    upper_m: float
    datum: Datum

    def __post_init__(self) -> None:
        if not (math.isfinite(self.lower_m) and math.isfinite(self.upper_m) and self.lower_m < self.upper_m):
            raise ValueError(
                f"band {self.lower_m:g} to {self.upper_m:g} m must be finite, lower before upper"
            )

    def above(self, lowest_ground_m: float, highest_ground_m: float, datum: Datum) -> AltitudeBand:
        """A band above ground as one of another datum, which ground lies between two heights of: it holds the
        band above every place, so it is as much thicker as the ground is uneven."""
        assert self.datum == "AGL"
        return AltitudeBand(lowest_ground_m + self.lower_m, highest_ground_m + self.upper_m, datum)

    def above_ellipsoid(self) -> AltitudeBand:
        """A band above the sea as one above the ellipsoid, wherever on Earth it lies."""
        assert self.datum == "AMSL"
        return AltitudeBand(self.lower_m + LOWEST_SEA_M, self.upper_m + HIGHEST_SEA_M, "WGS84")

    def above_sea(self) -> AltitudeBand:
        """A band above the ellipsoid as one above the sea, wherever on Earth it lies."""
        assert self.datum == "WGS84"
        return AltitudeBand(self.lower_m - HIGHEST_SEA_M, self.upper_m - LOWEST_SEA_M, "AMSL")


DEFAULT_BAND = AltitudeBand(0.0, 120.0, "AGL")
"""From the ground to the ceiling of the EU's open category."""
