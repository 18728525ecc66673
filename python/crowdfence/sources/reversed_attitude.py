"""Attitudes written the other way round: the rotation that turns the world into the camera, as some renderers
and programs of photogrammetry tell it, where ours turns the camera into the world.

Both are rotations, so that nothing is refused, and zones lie beside their crowds. But a camera that hangs
level comes out leaning to the side, by its heading; the other way round it hangs level all the time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_LEVEL_DEG = 3.0
"""A camera on a gimbal leans no further to the side, but for one pose in twenty."""
_LEANS_DEG = 20.0
"""It must lean so far at some time: one that is fixed to a drone leans with it, less."""
_CHANGES_DEG = 10.0
"""And so much more than at another: a leaning that stays may be how the camera is mounted."""


def reversal_doubt(world_from_camera: NDArray[np.float64]) -> str | None:
    """What is doubtful about the attitudes of a camera, rotations [N, 3, 3], as the end of a sentence that
    begins with whose they are; None where it hangs level, or leans either way."""
    if len(world_from_camera) == 0 or leans_reversed(world_from_camera):
        return None
    lean_deg = _lean_deg(world_from_camera[:, 2, 0])
    if np.abs(lean_deg).max() < _LEANS_DEG or np.ptp(lean_deg) < _CHANGES_DEG:
        return None
    return (
        f"by its attitudes the camera leans to the side by {lean_deg.min():.0f} to {lean_deg.max():.0f} "
        "degrees, and the other way round it would hang level all the time: do they turn world axes into "
        "camera axes? Then zones are beside their crowds: give the inverse, which turns camera axes into "
        "world axes"
    )


def leans_reversed(world_from_camera: NDArray[np.float64]) -> bool:
    """Whether the inverse of attitudes [N, 3, 3] leans to the side, as that of usual ones does: these are not
    the other way round. What hangs level both ways, as straight down or to the north, says nothing."""
    # The inverse is the transpose.
    return bool(np.quantile(np.abs(_lean_deg(world_from_camera[:, 0, 2])), 0.95) > _LEVEL_DEG)


def _lean_deg(height_of_x_axis: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.degrees(np.arcsin(np.clip(height_of_x_axis, -1.0, 1.0)))
