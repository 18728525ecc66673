"""What a gimbal reports of itself -> attitudes in north-east-down.

Its yaw counts from north or from the drone's heading. Flags say which, by the text of MAVLink's
GIMBAL_DEVICE_ATTITUDE_STATUS (also PX4's gimbal_device_attitude_status):

    YAW_IN_VEHICLE_FRAME           from the heading, locked or not
    YAW_IN_EARTH_FRAME             from north, locked or not
    neither, as gimbals had it before these two existed: from north with YAW_LOCK, else from the heading
    both                           not allowed: nobody can say what such a yaw means
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.sources.film.merged_rows import Turns, headings
from crowdfence.sources.rotation import are_unset, multiply

# GIMBAL_DEVICE_FLAGS
_YAW_LOCK = 16
_YAW_IN_VEHICLE_FRAME = 32
_YAW_IN_EARTH_FRAME = 64
_BOTH_FRAMES = _YAW_IN_VEHICLE_FRAME | _YAW_IN_EARTH_FRAME

_OFTEN_S = 0.25
"""Attitudes that come no more seldom tell how a drone turns."""


def one_gimbal(rows: Mapping[tuple[int, int], int], where: str, remarks: list[str]) -> tuple[int, int]:
    """Of several gimbals the first of those that tell about as often as any: between two of them no camera
    looks. `rows`: how many there are by (number of what tells them, device), of which at least one; `where`:
    what that is."""
    often = max(rows.values()) / 2
    gimbals = sorted(rows, key=lambda gimbal: (rows[gimbal] < often, gimbal))
    taken, *others = (f"{where} {number}, device {device}" for number, device in gimbals)
    if others:
        remarks.append(f"attitudes of several gimbals are told: {taken} is taken, not {'; '.join(others)}")
    return gimbals[0]


def count_from_north(flags: ArrayLike) -> NDArray[np.bool_]:
    """Which rows of flags [N] say that yaw does not count from the drone's heading."""
    told = np.asarray(flags, np.int64)
    of_vehicle, of_earth = (told & _YAW_IN_VEHICLE_FRAME) > 0, (told & _YAW_IN_EARTH_FRAME) > 0
    return np.asarray(of_earth | (~of_vehicle & ((told & _YAW_LOCK) > 0)))


def gimbal_turns(
    time_s: ArrayLike, quaternions: ArrayLike, flags: ArrayLike, body: Turns | None, remarks: list[str]
) -> Turns | None:
    """The camera's attitude from a gimbal's rows: seconds [N], quaternions [N, 4] (w, x, y, z), flags [N].
    None when fewer than two can be used: a yaw from the heading needs the attitude of the drone, `body`, and
    none is known where all are level and straight ahead."""
    time = np.asarray(time_s, np.float64)
    turns = np.asarray(quaternions, np.float64).reshape(-1, 4)
    if are_unset(turns):
        remarks.append(
            f"all {len(turns)} rows of the gimbal are level and straight ahead to the last digit, as of one "
            "that does not know where it points: they are not used"
        )
        return None
    told = np.asarray(flags, np.int64)
    from_north = count_from_north(told)
    contradictory = (told & _BOTH_FRAMES) == _BOTH_FRAMES
    if contradictory.any():
        remarks.append(
            f"{contradictory.sum()} of {len(told)} rows of the gimbal are left out: by their flags "
            f"({told[contradictory][0]}) yaw counts from the drone's heading and from north"
        )
    if not from_north.all():
        if body is not None and body.usual_step_s > _OFTEN_S:
            # A straight line over a step t is a t^2 / 8 off at an acceleration a.
            remarks.append(
                "attitudes of the drone, from whose heading the gimbal's yaw counts, come every "
                f"{body.usual_step_s:.1f} s: where it begins or ends a turn, by 60 deg/s2, the camera looks "
                f"up to {60 * body.usual_step_s**2 / 8:.0f} degrees elsewhere"
            )
        turned = np.full_like(turns, np.nan) if body is None else multiply(headings(body.at(time)), turns)
        turns = np.where(from_north[:, None], turns, turned)
    return Turns.of(time, np.where(contradictory[:, None], np.nan, turns))
