"""What a log beside a film says, whatever its format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.camera_mount import CameraMount, overruled
from crowdfence.sources.geographic_track import GeographicPoses, HeightsAbove


@dataclass(frozen=True, slots=True)
class FlightLog:
    """Rows over time; values that a row lacks are NaN. Arrays are [N], attitudes [N, 4] (w, x, y, z) with
    axes forward-right-down in north-east-down."""

    time_s: NDArray[np.float64]
    """Since the beginning of the log, or of the film where the log is timed by it."""
    start_ns: int | None
    """Stamp of time 0, by local time taken as UTC where the log is timed by the film; None: the log does not
    say the time of day."""
    latitude_deg: NDArray[np.float64]
    longitude_deg: NDArray[np.float64]
    heights_m: Mapping[HeightsAbove, NDArray[np.float64]]
    camera_ned: NDArray[np.float64] | None
    body_ned: NDArray[np.float64] | None
    timed_by_film: bool
    take_off: tuple[float, float] | None = None
    focal_35mm: NDArray[np.float64] | None = None
    """Focal lengths as on 35 mm film, zoom included [N], millimetres."""
    unusable_attitude: str = ""
    """Why what is logged of the camera's attitude cannot be used."""
    remarks: list[str] = field(default_factory=list)

    def attitudes(self, mount: CameraMount | None) -> NDArray[np.float64]:
        """The camera's attitudes: by the mount where one is given, else as logged.

        ValueError when there are none, because a guessed attitude puts crowds anywhere.
        """
        if mount is not None:
            if mount.needs_body and self.body_ned is None:
                raise ValueError(
                    f"a mount of kind {mount.kind!r} needs the attitude of the drone, which is not logged; "
                    "north:PITCH,YAW says the camera's own"
                )
            level = np.tile([1.0, 0.0, 0.0, 0.0], (len(self.time_s), 1))
            return mount.camera_quaternions_ned(level if self.body_ned is None else self.body_ned)
        if self.camera_ned is None:
            body = "the drone's is there" if self.body_ned is not None else "nor the drone's"
            raise ValueError(
                f"the attitude of the camera is {self.unusable_attitude or 'not logged'} ({body}), and a "
                "guess would put crowds anywhere: say it with --mount, such as level:-60 for a gimbal that "
                "follows the heading, or north:-90,0 for straight down with north on top"
            )
        return self.camera_ned

    def overruled(self, mount: CameraMount | None) -> str:
        """What to tell of recorded attitudes that a mount is used instead of; empty where there are none."""
        if mount is None or self.camera_ned is None:
            return ""
        return overruled(mount, self.camera_ned, self.attitudes(mount))

    def poses(self, mount: CameraMount | None) -> GeographicPoses:
        """The camera over time, stamped from the log's time 0. ValueError as for `attitudes`."""
        return GeographicPoses(
            stamps_ns=[round(float(time_s) * 1e9) for time_s in self.time_s],
            latitude_deg=self.latitude_deg,
            longitude_deg=self.longitude_deg,
            heights_m=self.heights_m,
            attitudes_ned=self.attitudes(mount),
            take_off=self.take_off,
        )
