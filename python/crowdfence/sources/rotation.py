"""Unit quaternions (w, x, y, z) and what pose tracks need of them.

A quaternion q stands for the rotation v -> R(q) v. `multiply(a, b)` turns by b first: R(a) R(b).
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Quaternion = tuple[float, float, float, float]
_UNSET = (1.0, 0.0, 0.0, 0.0)
UNSET_OF_ROS = (
    "0, 0, 0, 1 to the last digit, with which messages begin and no drone hangs: where nobody tells the "
    "attitude, what was seen is put anywhere; name one who knows it"
)
"""What is told of attitudes in messages of ROS that nobody set, as the end of a sentence."""


def multiply(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Hamilton product of quaternions [..., 4] (w, x, y, z); the leading axes broadcast."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a, dtype=np.float64), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b, dtype=np.float64), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def normalise(q: ArrayLike) -> NDArray[np.float64]:
    """Quaternions [..., 4] scaled to length one. The caller has made sure that none is zero."""
    q = np.asarray(q, dtype=np.float64)
    return q / np.sqrt(np.sum(q * q, axis=-1, keepdims=True))


def rotation_matrix(q: ArrayLike) -> NDArray[np.float64]:
    """R(q) [..., 3, 3] of unit quaternions [..., 4]."""
    w, x, y, z = np.moveaxis(np.asarray(q, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def are_unset(quaternions: NDArray[np.float64]) -> bool:
    """Whether all of these, [N, 4] (w, x, y, z), are what a message begins with where nobody sets it: level,
    straight ahead, to the last digit, as no drone and no gimbal ever hangs. False of none."""
    return bool(len(quaternions) > 0 and (quaternions == _UNSET).all())


def are_degrees(yaw: ArrayLike, pitch: ArrayLike, roll: ArrayLike) -> NDArray[np.bool_]:
    """Whether angles, whichever way they are counted, can be degrees: in tenths of them, say, they reach
    further. Angles that are not known (NaN) can."""
    found = np.ones(np.broadcast_shapes(np.shape(yaw), np.shape(pitch), np.shape(roll)), np.bool_)
    for angle, least in ((yaw, -360.0), (pitch, -180.0), (roll, -180.0)):
        found &= ~((np.asarray(angle) < least) | (np.asarray(angle) > 360.0))
    return found


def from_yaw_pitch_roll_deg(yaw: float, pitch: float, roll: float) -> NDArray[np.float64]:
    """Aerospace angles in degrees: turn by yaw about z, then pitch about the new y, roll about the new x."""
    half = [math.radians(angle) / 2 for angle in (yaw, pitch, roll)]
    about_z = (math.cos(half[0]), 0.0, 0.0, math.sin(half[0]))
    about_y = (math.cos(half[1]), 0.0, math.sin(half[1]), 0.0)
    about_x = (math.cos(half[2]), math.sin(half[2]), 0.0, 0.0)
    return multiply(multiply(about_z, about_y), about_x)


def slerp(a: NDArray[np.float64], b: NDArray[np.float64], fraction: float) -> NDArray[np.float64]:
    """The unit quaternion a `fraction` of the way from a to b along the shorter great circle (Shoemake 1985).

    The angle comes from atan2 of the chord and the sum because acos loses half the digits for the small
    angles between two neighbouring telemetry rows.
    """
    if float(np.dot(a, b)) < 0.0:
        b = -b
    angle = 2.0 * math.atan2(float(np.linalg.norm(b - a)), float(np.linalg.norm(b + a)))
    if angle < 1e-9:
        return normalise(a + fraction * (b - a))
    sine = math.sin(angle)
    return normalise(
        (math.sin((1.0 - fraction) * angle) / sine) * a + (math.sin(fraction * angle) / sine) * b
    )
