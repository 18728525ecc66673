"""Of boxes that show the same person, keep the strongest (greedy non-maximum suppression)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def strongest_boxes(
    boxes: NDArray[np.floating], scores: NDArray[np.floating], iou_max: float
) -> NDArray[np.intp]:
    """Indices of the boxes [N, 4] (x1, y1, x2, y2) to keep, strongest first.

    A box goes when it overlaps a stronger kept one by more than `iou_max` (intersection over union).
    """
    area = np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0), axis=1)
    waiting = np.argsort(-scores, kind="stable")
    kept = []
    while waiting.size:
        best, waiting = waiting[0], waiting[1:]
        kept.append(best)
        low = np.maximum(boxes[best, :2], boxes[waiting, :2])
        high = np.minimum(boxes[best, 2:], boxes[waiting, 2:])
        shared = np.prod(np.maximum(high - low, 0.0), axis=1)
        union = area[best] + area[waiting] - shared
        waiting = waiting[shared <= iou_max * union]
    return np.array(kept, np.intp)
