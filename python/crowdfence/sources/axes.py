"""Axes of other people's frames -> ours.

Autopilots and AirSim: north-east-down, body and camera axes forward-right-down. ROS: east-north-up, body
axes forward-left-up. Ours: east-north-up, camera axes right-down-forward (OpenCV).
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.sources.rotation import multiply

# north, east, down -> east, north, up: half a turn about the horizontal axis half way between north and east.
ENU_FROM_NED = np.array([0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0])
# right, down, forward -> forward, right, down: a third of a turn about the diagonal.
_FORWARD_RIGHT_DOWN_FROM_OPTICAL = np.array([0.5, 0.5, 0.5, 0.5])
# forward, right, down -> forward, left, up: half a turn about forward.
FORWARD_LEFT_UP_FROM_FORWARD_RIGHT_DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def enu_from_ned(ned: NDArray[np.float64]) -> NDArray[np.float64]:
    """(north, east, down) -> (east, north, up)."""
    return np.stack([ned[..., 1], ned[..., 0], -ned[..., 2]], axis=-1)


def optical_quaternions_enu(camera_quaternion_ned: ArrayLike) -> NDArray[np.float64]:
    """Camera axes forward-right-down in NED [N, 4] -> right-down-forward in ENU [N, 4]."""
    return multiply(multiply(ENU_FROM_NED, camera_quaternion_ned), _FORWARD_RIGHT_DOWN_FROM_OPTICAL)


def body_quaternions_ned(body_quaternion_enu: ArrayLike) -> NDArray[np.float64]:
    """Body axes forward-left-up in ENU [N, 4] (REP 103) -> forward-right-down in NED [N, 4]."""
    # Half a turn is its own inverse, up to the sign that a quaternion may have.
    return multiply(multiply(ENU_FROM_NED, body_quaternion_enu), FORWARD_LEFT_UP_FROM_FORWARD_RIGHT_DOWN)
