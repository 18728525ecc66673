"""Voxel sizes that people would choose themselves."""

from __future__ import annotations

import math

SMALLEST_M = 0.05


def round_voxel_size_m(wanted_m: float) -> float:
    """The next of ... 0.1, 0.2, 0.5, 1, 2, 5 ... metres that is not below `wanted_m`; at least 5 cm."""
    wanted_m = max(wanted_m, SMALLEST_M)
    power = 10.0 ** math.floor(math.log10(wanted_m))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= wanted_m * (1 - 1e-9))
