"""Heatmaps in the wrong units: what was meant as sure of crowd is read as next to nothing.

Two mistakes are common, and each leaves its own levels. A segmentation network's mask of 0 and 1 saved with
8 bits, where a heatmap is value / 255, holds nothing but 0 and 1/255. Values of 0 to 255 saved with 16 bits,
where a heatmap is value / 65535, hold nothing above 255/65535, in steps of 1/65535. Both are valid heatmaps
of a flight without any crowd, so that only a whole recording can be doubted: where not one value of a drone
is larger, and where the largest are not scattered but lie together, as people do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import View

_LEAST_SHARE = 0.001
"""Of the cells of one heatmap that lie together; a speck says nothing."""
_LARGEST = 1 / 255
"""255/65535 is less."""
_ROUNDING = 1e-6


@dataclass(slots=True)
class _Levels:
    """What the heatmaps of one drone have held so far."""

    looked_at: int = 0
    mask_of_one: bool = True
    """All of them hold 0 and 1/255 alone."""
    eight_of_sixteen_bits: bool = True
    """All of them hold multiples of 1/65535 up to 255 alone."""
    together: float = 0.0
    """The largest share of a heatmap that is connected and at least half of what such units can show."""


class HeatmapUnits:
    """Looks at the heatmaps of a run as they pass."""

    def __init__(self) -> None:
        self._drones: dict[str, _Levels] = {}

    def look(self, view: View) -> None:
        levels = self._drones.setdefault(view.drone, _Levels())
        levels.looked_at += 1
        if not (levels.mask_of_one or levels.eight_of_sixteen_bits):
            return
        heatmap = view.heatmap
        if heatmap.max() > _LARGEST * (1 + _ROUNDING):
            levels.mask_of_one = levels.eight_of_sixteen_bits = False
            return
        marked = heatmap[heatmap > 0]
        levels.mask_of_one &= bool(np.all(np.abs(marked * 255 - 1) < _ROUNDING))
        steps = marked * 65535.0
        levels.eight_of_sixteen_bits &= bool(
            np.all(np.abs(steps - np.round(steps)) < 1e-3) and np.all(steps < 255.5)
        )
        if levels.mask_of_one or levels.eight_of_sixteen_bits:
            levels.together = max(levels.together, _largest_connected_share(heatmap >= 128 / 65535))

    @property
    def warnings(self) -> list[str]:
        """One sentence for each drone whose heatmaps look like that, all of them."""
        warnings = (self.warning(drone) for drone in sorted(self._drones))
        return [warning for warning in warnings if warning is not None]

    def warning(self, drone: str) -> str | None:
        """The sentence for one drone; None where its heatmaps are not doubted."""
        levels = self._drones.get(drone, _Levels())
        doubted = levels.mask_of_one or levels.eight_of_sixteen_bits
        return _warning(drone, levels) if doubted and levels.together >= _LEAST_SHARE else None


def _warning(drone: str, levels: _Levels) -> str:
    what, remedy = (
        ("look like masks of 0 and 1 (no 8-bit level is above 1)", "multiply them by 255")
        if levels.mask_of_one
        else ("look like 0 to 255 saved with 16 bits (no level is above 255)", "multiply them by 257")
    )
    return (
        f"{drone}: its {levels.looked_at} heatmaps {what}, so that its crowds are read as probabilities of "
        f"0.4 % at most and ground under them as free: {remedy}"
    )


def _largest_connected_share(marked: NDArray[np.bool_]) -> float:
    """Of all cells; neighbours share a side."""
    if not marked.any():
        return 0.0
    from scipy.ndimage import label

    numbers, _ = label(marked)
    return float(np.bincount(numbers.ravel())[1:].max() / marked.size)
