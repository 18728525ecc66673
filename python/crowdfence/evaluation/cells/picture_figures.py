"""Picture by picture: how much of each crowd a detector marks, and how much of pictures without one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.evaluation.cells.scores import THRESHOLD

NOTABLE_SHARE = 0.01
"""A picture without a crowd of which more is marked has a false alarm that somebody would act on."""


class PictureFigures:
    """Collects pictures one at a time; every picture counts the same, however large it or its crowd is."""

    def __init__(self) -> None:
        self._recall: list[float] = []
        self._marked: list[float] = []

    def add(
        self, heatmap: NDArray[np.floating[Any]], crowd: NDArray[np.bool_], known: NDArray[np.bool_]
    ) -> None:
        """A heatmap, its crowd cells, and cells whose truth is known, [h, w] each."""
        called = heatmap > THRESHOLD
        if (crowd & known).any():
            self._recall.append(float(called[crowd & known].mean()))
        elif known.any():
            self._marked.append(float(called[known].mean()))

    def to_json(self) -> dict[str, Any]:
        """Ready for JSON; unknown is null."""
        marked = np.array(self._marked)
        return {
            "pictures_with_crowd": len(self._recall),
            "mean_recall": float(np.mean(self._recall)) if self._recall else None,
            "pictures_without_crowd": len(self._marked),
            "mean_share_marked": float(marked.mean()) if self._marked else None,
            "share_with_more_than_one_percent": float((marked > NOTABLE_SHARE).mean())
            if self._marked
            else None,
        }
