"""How a camera hangs on its drone, where nothing recorded it: what the pilot says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.rotation import from_yaw_pitch_roll_deg, multiply, rotation_matrix

MountKind = Literal["body", "level", "north"]

_WORTH_SAYING_DEG = 2.0
_MOST_DEG = {"pitch": 90, "yaw": 360, "roll": 180}


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Where the camera looks.

    body    turned against the drone, fixed to it: it banks with the drone
    level   on a stabilised gimbal that follows the drone's heading: pitch and roll against the horizon
    north   yaw against true north, pitch and roll against the horizon: the same in the whole flight

    Degrees; pitch -90 is straight down, yaw is clockwise from above, roll is right side down. ValueError for
    an angle beyond its bounds: pitch 90, yaw 360, roll 180, either way.
    """

    kind: MountKind
    pitch_deg: float
    yaw_deg: float = 0.0
    roll_deg: float = 0.0

    def __post_init__(self) -> None:
        for name, most_deg in _MOST_DEG.items():
            angle_deg = getattr(self, f"{name}_deg")
            if not abs(angle_deg) <= most_deg:
                raise ValueError(
                    f"the {name} of a mount is {angle_deg:g}; it must be in [-{most_deg}, {most_deg}] degrees"
                )

    @classmethod
    def parse(cls, text: str) -> CameraMount:
        """From KIND:PITCH[,YAW[,ROLL]], such as level:-60."""
        kind, _, angles = text.partition(":")
        try:
            values = [float(angle) for angle in angles.split(",")]
        except ValueError:
            values = []
        if kind not in get_args(MountKind) or not 1 <= len(values) <= 3:
            raise ValueError(
                f"mount {text!r} must be body|level|north:PITCH[,YAW[,ROLL]] in degrees, such as level:-60"
            )
        return cls(cast(MountKind, kind), *values)

    @property
    def needs_body(self) -> bool:
        """Whether the drone's own attitude must be known."""
        return self.kind != "north"

    def camera_quaternions_ned(self, body_quaternions_ned: NDArray[np.float64]) -> NDArray[np.float64]:
        """Body attitudes [N, 4] -> camera attitudes [N, 4], both forward-right-down in north-east-down."""
        turn = from_yaw_pitch_roll_deg(self.yaw_deg, self.pitch_deg, self.roll_deg)
        if self.kind == "body":
            return multiply(body_quaternions_ned, turn)
        if self.kind == "north":
            return np.broadcast_to(turn, body_quaternions_ned.shape).copy()
        forward = rotation_matrix(body_quaternions_ned)[..., 0]
        heading = np.arctan2(forward[..., 1], forward[..., 0]) / 2
        zero = np.zeros_like(heading)
        return multiply(np.stack([np.cos(heading), zero, zero, np.sin(heading)], axis=-1), turn)


def overruled(mount: CameraMount, told_ned: NDArray[np.float64], used_ned: NDArray[np.float64]) -> str:
    """What to tell where attitudes [N, 4] of the camera are recorded and those of a mount are used; empty
    where they say the same, or none is recorded (NaN)."""
    both = np.isfinite(told_ned).all(axis=1) & np.isfinite(used_ned).all(axis=1)
    if not both.any():
        return ""
    alike = np.abs(np.sum(told_ned[both] * used_ned[both], axis=1))
    apart_deg = float(np.degrees(2.0 * np.median(np.arccos(np.clip(alike, 0.0, 1.0)))))
    if apart_deg < _WORTH_SAYING_DEG:
        return ""
    return (
        f"where its camera looked is recorded, and --mount is used instead, of kind {mount.kind}, "
        f"{apart_deg:.0f} degrees from that: leave it out where the record is right"
    )
