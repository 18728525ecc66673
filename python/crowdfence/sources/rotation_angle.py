"""By how much one rotation differs from another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def angle_between_deg(rotation: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Of two rotations [3, 3]; by the chord, not the cosine, which is flat where it matters."""
    chord = np.linalg.norm(rotation - other) / np.sqrt(8.0)
    return float(np.degrees(2.0 * np.arcsin(min(1.0, chord))))
