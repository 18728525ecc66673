"""What every exported file says about the map that it was made from."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class MapDescription:
    """Where the numbers in a file come from, so that the file explains itself without its folder."""

    stamp_ns: int
    """Instant at which the map was read."""
    threshold: float
    """Probability at or above which ground counts as crowd."""
    method: str
    """Name of the fusion method, for example "paper"."""
    parameters: Mapping[str, str | int | float | bool] = field(default_factory=dict)
    """Settings of the method, named with their units."""
    first_stamp_ns: int | None = None
    """First instant that was integrated."""
    drones: tuple[str, ...] = ()
    mission: str = ""
    """Name of the recording."""
    layer: str = "crowd"
    """Class whose probability the map holds."""

    def __post_init__(self) -> None:
        if not 0.0 < self.threshold <= 1.0:
            raise ValueError(f"threshold must be above 0 and at most 1, got {self.threshold}")
        if not self.method:
            raise ValueError("method must not be empty")
        if self.first_stamp_ns is not None and self.first_stamp_ns > self.stamp_ns:
            raise ValueError(f"first_stamp_ns {self.first_stamp_ns} is after stamp_ns {self.stamp_ns}")
