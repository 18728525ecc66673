"""One drone's flight, as the picture draws it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class DroneTrack:
    """Positions over time and the last footprint, local metres."""

    drone: str
    positions: NDArray[np.float64]
    """[N, 3] in time order, N >= 1."""
    footprint: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))
    """[M, 2] outline of the ground in its last picture (`ground_footprint`), M = 0 for none."""

    def __post_init__(self) -> None:
        for name, array, width in (("positions", self.positions, 3), ("footprint", self.footprint, 2)):
            if array.ndim != 2 or array.shape[1] != width or not np.isfinite(array).all():
                raise ValueError(f"{name} of {self.drone} must be finite and of shape [N, {width}]")
        if len(self.positions) == 0:
            raise ValueError(f"the track of {self.drone} has no positions")
