"""A whole flight whose heatmaps show nobody at all: over empty ground, or made by what does not see.

Topics that were never written to, a node that publishes its buffer before the first picture and a mask of the
wrong class leave exact zeros; the ground below them is called empty with full weight.
"""

from __future__ import annotations

import numpy as np

from crowdfence._core import View
from crowdfence.detector.same_answer import LEAST_MASKS


class NobodyShown:
    """Looks at the views of a flight as they pass. Heatmaps that a model makes are `SameAnswer`'s."""

    def __init__(self) -> None:
        self._looked_at, self._anybody = 0, False

    def look(self, view: View) -> None:
        self._looked_at += 1
        self._anybody = self._anybody or bool(np.any(view.heatmap > 0.0))

    @property
    def warnings(self) -> list[str]:
        """One sentence where there are enough heatmaps, of which not one cell is above 0."""
        if self._anybody or self._looked_at < LEAST_MASKS:
            return []
        return [
            f"all {self._looked_at} heatmaps are 0 everywhere: nobody is in any of them, or what made them "
            "does not see, and the ground below them is called empty for nothing; look at one of a crowd"
        ]
