"""Attitudes written the other way round: the rotation that turns the world into the camera, as some renderers
and programs of photogrammetry tell it, where ours turns the camera into the world.

Both are rotations, so that nothing is refused, and zones lie beside their crowds. But a camera that hangs
level comes out leaning to the side, by its heading; the other way round it hangs level all the time.
"""

from __future__ import annotations

import numpy as np

from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.rotation import normalise, rotation_matrix

_LEVEL_DEG = 3.0
"""A camera on a gimbal leans no further to the side, but for one pose in twenty."""
_LEANS_DEG = 20.0
"""It must lean so far at some time: one that is fixed to a drone leans with it, less."""
_CHANGES_DEG = 10.0
"""And so much more than at another: a leaning that stays may be how the camera is mounted."""


def reversal_doubt(track: PoseTrack) -> str | None:
    """What is doubtful about the attitudes, as the end of a sentence that begins with whose they are; None
    for those of a camera that hangs level, or that leans either way."""
    if len(track) == 0:
        return None
    turns = rotation_matrix(normalise(track.quaternions))
    # The height of the camera's x axis; of the inverse, which is the transpose, it is the other corner.
    lean_deg, lean_of_inverse_deg = (
        np.degrees(np.arcsin(np.clip(axis, -1.0, 1.0))) for axis in (turns[:, 2, 0], turns[:, 0, 2])
    )
    leans = np.abs(lean_deg).max() >= _LEANS_DEG and np.ptp(lean_deg) >= _CHANGES_DEG
    if not leans or np.quantile(np.abs(lean_of_inverse_deg), 0.95) > _LEVEL_DEG:
        return None
    return (
        f"by its attitudes the camera leans to the side by {lean_deg.min():.0f} to {lean_deg.max():.0f} "
        "degrees, and the other way round it would hang level all the time: do they turn world axes into "
        "camera axes? Then zones are beside their crowds: give the inverse, which turns camera axes into "
        "world axes"
    )
