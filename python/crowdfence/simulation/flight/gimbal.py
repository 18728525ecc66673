"""Attitudes: of the airframe from its flight, of the camera from where it should look.

World axes are east, north, up. Body axes are forward, left, up (REP 103); camera axes right, down, forward.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

GRAVITY_M_S2 = 9.81
CAMERA_IN_BODY_M = np.array([0.12, 0.0, -0.08])
"""Centre of the camera in body axes: ahead of and below the airframe's centre."""

_DRAG_PER_S = 0.12
"""Acceleration that keeps up a speed against the air, per speed."""


def body_attitude(
    heading_rad: float, velocity: NDArray[np.float64], acceleration: NDArray[np.float64]
) -> NDArray[np.float64]:
    """`world_from_body` rotation [3, 3]: a multirotor's thrust points along gravity + drag + acceleration.

    `velocity` and `acceleration` [3] in world axes, metres and seconds.
    """
    up = acceleration + _DRAG_PER_S * velocity + np.array([0.0, 0.0, GRAVITY_M_S2])
    up /= np.linalg.norm(up)
    nose = np.array([np.cos(heading_rad), np.sin(heading_rad), 0.0])
    left = np.cross(up, nose)
    left /= np.linalg.norm(left)
    return np.stack([np.cross(left, up), left, up], axis=-1)


def camera_attitude(azimuth_rad: float, tilt_rad: float) -> NDArray[np.float64]:
    """`world_from_camera` rotation [3, 3] of a camera without roll that looks `tilt_rad` below the horizon.

    `azimuth_rad` counter-clockwise from east. Straight down (tilt of 90 degrees) the azimuth is where the
    upper edge of the image points.
    """
    east, north = np.cos(azimuth_rad), np.sin(azimuth_rad)
    forward = np.array([np.cos(tilt_rad) * east, np.cos(tilt_rad) * north, -np.sin(tilt_rad)])
    right = np.array([north, -east, 0.0])
    return np.stack([right, np.cross(forward, right), forward], axis=-1)


def rigid(rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> NDArray[np.float64]:
    """[4, 4] transform from a rotation [3, 3] and a translation [3]."""
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, translation
    return transform
