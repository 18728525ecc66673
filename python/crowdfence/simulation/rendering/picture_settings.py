"""How a simulated camera takes pictures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PictureSettings:
    """Settings that touch colours only: labels and depth are those of the middle of the exposure."""

    noise_sigma: float = 0.007
    """Standard deviation of the sensor's noise at mid grey, of full scale 1."""
    motion_blur: bool = True
    """Blur along the motion of the camera when a pose one exposure later is given."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.noise_sigma <= 0.5:
            raise ValueError(f"noise_sigma must be 0 to 0.5, got {self.noise_sigma}")
