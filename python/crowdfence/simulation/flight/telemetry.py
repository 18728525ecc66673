"""Poses as a drone logs them: at their own rate, on the drone's clock, with noise, beside the true ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crowdfence.simulation.flight.flight import Flight
from crowdfence.simulation.flight.gimbal import CAMERA_IN_BODY_M
from crowdfence.simulation.random_streams import Stream, stream
from crowdfence.simulation.scenarios.plans import TroublePlan

BLOCK_ROWS = 512
"""Noise is drawn in blocks of rows, each from its own stream, so that any span of time can be made alone."""


@dataclass(frozen=True, slots=True)
class PoseRows:
    """Positions [N, 3] in local ENU metres and quaternions [N, 4] (w, x, y, z) of N telemetry rows."""

    body_position: NDArray[np.float64]
    body_quaternion: NDArray[np.float64]
    """world_from_body; body axes forward, left, up."""
    gimbal_quaternion: NDArray[np.float64]
    """body_from_camera; camera axes right, down, forward."""
    camera_position: NDArray[np.float64]
    camera_quaternion: NDArray[np.float64]
    """world_from_camera."""


@dataclass(frozen=True, slots=True)
class Telemetry:
    """Rows of one drone, in the order of time."""

    t_s: NDArray[np.float64]
    """True time [N] since the start of the mission."""
    stamps_ns: NDArray[np.int64]
    """The same on the drone's clock."""
    true: PoseRows
    noisy: PoseRows
    """What the drone believes: true with its bias and noise."""


@dataclass(frozen=True, slots=True)
class PoseBias:
    """Constant errors of one drone: metres [3], and rotation vectors [3] in radians."""

    position_m: NDArray[np.float64]
    attitude_rad: NDArray[np.float64]
    """In body axes."""
    gimbal_rad: NDArray[np.float64]
    """In camera axes."""

    @staticmethod
    def drawn(trouble: TroublePlan, seed: int, drone: int) -> PoseBias:
        normal = stream(seed, Stream.TELEMETRY, drone).normal(size=(3, 3))
        return PoseBias(
            trouble.position_bias_m * normal[0],
            np.radians(trouble.attitude_bias_deg) * normal[1],
            np.radians(trouble.gimbal_bias_deg) * normal[2],
        )


def row_numbers(
    trouble: TroublePlan, seed: int, drone: int, from_s: float, to_s: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Numbers and noise [N, 9] of the rows with true time in [`from_s`, `to_s`) that were not lost.

    Row n is due n / telemetry_hz after the start of the mission; n is negative before it.
    """
    first, last = (int(np.ceil(time * trouble.telemetry_hz - 1e-9)) for time in (from_s, to_s))
    numbers = np.arange(first, max(first, last))
    noise = [np.zeros((0, 9))]
    kept = [np.zeros(0, np.int64)]
    for block in np.unique(numbers // BLOCK_ROWS):
        # Streams take no negative numbers: blocks before the start get the odd ones.
        rng = stream(seed, Stream.TELEMETRY, drone, 2 * abs(int(block)) + int(block < 0))
        drawn, normal = rng.random(BLOCK_ROWS), rng.normal(size=(BLOCK_ROWS, 9))
        mine = numbers[numbers // BLOCK_ROWS == block]
        mine = mine[drawn[mine % BLOCK_ROWS] >= trouble.telemetry_loss]
        kept.append(mine)
        noise.append(normal[mine % BLOCK_ROWS])
    return np.concatenate(kept), np.concatenate(noise)


def true_poses(flight: Flight, drone: int, t_s: NDArray[np.float64]) -> PoseRows:
    """Exact poses of a drone at the times `t_s` [N]."""
    states = [flight.at(drone, float(time)) for time in t_s]
    body = np.array([state.world_from_body for state in states]).reshape(-1, 4, 4)
    camera = np.array([state.world_from_camera for state in states]).reshape(-1, 4, 4)
    gimbal = np.swapaxes(body[:, :3, :3], 1, 2) @ camera[:, :3, :3]
    return PoseRows(
        body[:, :3, 3],
        _quaternions(body[:, :3, :3]),
        _quaternions(gimbal),
        camera[:, :3, 3],
        _quaternions(camera[:, :3, :3]),
    )


def noisy_poses(true: PoseRows, trouble: TroublePlan, bias: PoseBias, noise: NDArray[np.float64]) -> PoseRows:
    """`true` with the drone's `bias` and standard normal `noise` [N, 9] scaled as planned.

    The camera's error is what follows from those of the airframe and of the gimbal.
    """
    position = true.body_position + bias.position_m + trouble.position_noise_m * noise[:, :3]
    body = _turned(true.body_quaternion, bias.attitude_rad, trouble.attitude_noise_deg, noise[:, 3:6])
    gimbal = _turned(true.gimbal_quaternion, bias.gimbal_rad, trouble.gimbal_noise_deg, noise[:, 6:])
    camera = body * gimbal
    return PoseRows(
        position,
        _wxyz(body),
        _wxyz(gimbal),
        position + body.apply(CAMERA_IN_BODY_M),
        _wxyz(camera),
    )


def _turned(
    quaternion: NDArray[np.float64],
    bias_rad: NDArray[np.float64],
    noise_deg: float,
    normal: NDArray[np.float64],
) -> Rotation:
    error = Rotation.from_rotvec(bias_rad + np.radians(noise_deg) * normal)
    return Rotation.from_quat(np.roll(quaternion, -1, axis=-1)) * error


def _quaternions(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    if len(matrices) == 0:
        return np.zeros((0, 4))
    return _wxyz(Rotation.from_matrix(matrices))


def _wxyz(rotations: Rotation) -> NDArray[np.float64]:
    """SciPy's quaternions have the scalar last."""
    return np.roll(rotations.as_quat(), 1, axis=-1)
