"""Camera poses of an AirSim vehicle in our conventions, one per telemetry row.

AirSim: north-east-down from the vehicle's own start, body and camera axes forward-right-down.
Ours: east-north-up from the world's origin, camera axes right-down-forward.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.sources.airsim.settings import Mount
from crowdfence.sources.axes import enu_from_ned, optical_quaternions_enu
from crowdfence.sources.csv_rows import integer, numbers, read_rows
from crowdfence.sources.rotation import multiply, normalise, rotation_matrix

_POSITION = ("position_x", "position_y", "position_z")
_ATTITUDE = ("q_w", "q_x", "q_y", "q_z")
_GIMBAL = ("gimbal_w", "gimbal_x", "gimbal_y", "gimbal_z")
_CAMERA_POSITION = ("camera_position_x", "camera_position_y", "camera_position_z")
_CAMERA_ATTITUDE = ("camera_q_w", "camera_q_x", "camera_q_y", "camera_q_z")


@dataclass(frozen=True, slots=True)
class CameraRows:
    """Camera poses in ENU at the telemetry's rate, before anything was left out."""

    stamps_ns: list[int]
    positions: NDArray[np.float64]
    quaternions: NDArray[np.float64]
    remarks: list[str]


def camera_positions_enu(
    start_ned: NDArray[np.float64], body_position_ned: ArrayLike, body_quaternion: ArrayLike, mount: Mount
) -> NDArray[np.float64]:
    """start + position + R(q) * mount [N, 3], turned from NED into ENU."""
    turn = rotation_matrix(body_quaternion)
    ned = start_ned + np.asarray(body_position_ned, dtype=np.float64) + turn @ mount.position
    return enu_from_ned(ned)


def compose(
    stamps_ns: list[int],
    body_position_ned: ArrayLike,
    body_quaternion: ArrayLike,
    start_ned: NDArray[np.float64],
    mount: Mount,
    gimbal: ArrayLike | None = None,
) -> CameraRows:
    """Body poses -> camera poses. `gimbal` [N, 4], camera relative to body, replaces the mount's angles."""
    body = _unit(np.asarray(body_quaternion, dtype=np.float64).reshape(-1, 4))
    body_position = np.asarray(body_position_ned, dtype=np.float64).reshape(-1, 3)
    camera_on_body = (
        mount.quaternion if gimbal is None else _unit(np.asarray(gimbal, dtype=np.float64).reshape(-1, 4))
    )
    return CameraRows(
        stamps_ns,
        camera_positions_enu(start_ned, body_position, body, mount),
        optical_quaternions_enu(multiply(body, camera_on_body)),
        [],
    )


def read_telemetry(path: Path, start_ned: NDArray[np.float64], mount: Mount) -> CameraRows:
    """Camera poses of a telemetry log beside the recording, NED from the vehicle's own start. Either

    stamp_ns, position_x/y/z, q_w/x/y/z[, gimbal_w/x/y/z]   body pose, and the camera relative to the body
    stamp_ns, camera_position_x/y/z, camera_q_w/x/y/z       the camera itself, as ImageResponse has it

    Rows that cannot be read are left out and counted in `remarks`. ValueError when a column is missing.
    """
    of_camera = _is_camera_log(path)
    columns = [*_CAMERA_POSITION, *_CAMERA_ATTITUDE] if of_camera else [*_POSITION, *_ATTITUDE]
    stamps_ns: list[int] = []
    values: list[list[float]] = []
    faulty: list[str] = []
    for line, row in read_rows(path, ["stamp_ns", *columns]):
        if isinstance(row, str):
            faulty.append(row)
            continue
        try:
            with_gimbal = not of_camera and all(name in row for name in _GIMBAL)
            value = numbers(row, [*columns, *_GIMBAL] if with_gimbal else columns)
            stamps_ns.append(integer(row, "stamp_ns"))
            values.append(value)
        except ValueError as error:
            faulty.append(f"line {line}: {error}")
    remarks = [f"{path.name}: {len(faulty)} rows cannot be read, first: {faulty[0]}"] if faulty else []
    table = np.array(values, dtype=np.float64).reshape(len(values), -1 if values else 7)
    if of_camera:
        position = enu_from_ned(start_ned + table[:, :3])
        return CameraRows(stamps_ns, position, optical_quaternions_enu(_unit(table[:, 3:7])), remarks)
    gimbal = table[:, 7:11] if table.shape[1] == 11 else None
    rows = compose(stamps_ns, table[:, :3], table[:, 3:7], start_ned, mount, gimbal)
    if gimbal is None:
        remarks.append(f"{path.name} has no gimbal columns: the camera is taken as fixed to the body")
    return CameraRows(rows.stamps_ns, rows.positions, rows.quaternions, remarks)


def _is_camera_log(path: Path) -> bool:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return _CAMERA_POSITION[0] in file.readline(1 << 16)


def _unit(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scaled to length one; what is no rotation (zero, not finite, length off by more than 1 %) becomes NaN,
    which the pose track leaves out and reports."""
    with np.errstate(all="ignore"):
        length = np.sqrt(np.sum(quaternions * quaternions, axis=-1))
        usable = np.abs(length - 1.0) < 1e-2
        return np.where(usable[:, None], normalise(quaternions), np.nan)
