"""Series of a log that come at rates of their own -> rows that hold everything at one time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.sources.film.flight_log import FlightLog
from crowdfence.sources.geographic_track import HeightsAbove
from crowdfence.sources.place_camera import Limits
from crowdfence.sources.rotation import are_unset

_LONGEST_GAP_S = 2.1
"""Positions come once a second at the least; a longer pause stays a gap."""
_TURNS_GAP_S = Limits().max_pose_gap_s
"""A drone turns sooner than it is elsewhere: attitudes are bridged over this, or over a pause that is usual
among them."""
UNSET_BODY = (
    "are level and due north to the last digit, as where nobody tells them: what a "
    "camera saw that hangs on it by --mount, or on a gimbal that counts from its heading, is put anywhere; "
    "--mount north:PITCH,YAW needs none"
)
"""What is told of them, as the end of a sentence that begins with which they are."""


@dataclass(frozen=True, slots=True)
class Turns:
    """Attitudes over time: seconds [N], quaternions [N, 4] (w, x, y, z)."""

    time_s: NDArray[np.float64]
    quaternions: NDArray[np.float64]

    @classmethod
    def of(cls, time_s: ArrayLike, quaternions: ArrayLike) -> Turns | None:
        """Those that are rotations, in order of time; None when there are fewer than two."""
        time, turn = np.asarray(time_s, np.float64), np.asarray(quaternions, np.float64).reshape(-1, 4)
        with np.errstate(all="ignore"):
            length = np.linalg.norm(turn, axis=1)
            usable = np.isfinite(time) & (np.abs(length - 1) < 1e-2)
        _, order = np.unique(time[usable], return_index=True)
        if len(order) < 2:
            return None
        return cls(time[usable][order], turn[usable][order])

    @property
    def usual_step_s(self) -> float:
        return float(np.median(np.diff(self.time_s)))

    def at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """[M, 4] by slerp; NaN outside and in gaps."""
        from scipy.spatial.transform import Rotation, Slerp

        gap_s = min(max(_TURNS_GAP_S, 1.5 * self.usual_step_s), _LONGEST_GAP_S)
        inside = (time_s >= self.time_s[0]) & (time_s <= self.time_s[-1])
        inside &= _close(self.time_s, time_s, gap_s)
        turns = Slerp(self.time_s, Rotation.from_quat(self.quaternions[:, [1, 2, 3, 0]]))
        found = np.full((len(time_s), 4), np.nan)
        if inside.any():
            found[inside] = turns(time_s[inside]).as_quat()[:, [3, 0, 1, 2]]
        return found


def merged(
    position: Mapping[str, ArrayLike],
    heights: Mapping[HeightsAbove, str],
    body: Turns | None,
    camera: Turns | None,
    *,
    start_ns: int | None,
    take_off: tuple[float, float] | None,
    remarks: Sequence[str],
) -> FlightLog:
    """A log timed by itself, with a row for every attitude; `position` has columns time_s, latitude,
    longitude and those that `heights` names. ValueError when there is no position or no attitude."""
    said = list(remarks)
    if body is not None and are_unset(body.quaternions):
        said.append(f"all {len(body.quaternions)} attitudes of the drone {UNSET_BODY}")
    columns = {name: np.asarray(values, np.float64) for name, values in position.items()}
    usable = np.isfinite(np.stack(list(columns.values()))).all(axis=0)
    usable &= (columns["latitude"] != 0) | (columns["longitude"] != 0)
    on_earth = (np.abs(columns["latitude"]) <= 90) & (np.abs(columns["longitude"]) <= 180)
    if nowhere := int(np.count_nonzero(usable & ~on_earth)):
        said.append(f"{nowhere} of {len(usable)} positions are nowhere on Earth and left out")
    usable &= on_earth
    _, order = np.unique(columns["time_s"][usable], return_index=True)
    if len(order) < 2:
        raise ValueError("it holds no positions on Earth")
    columns = {name: values[usable][order] for name, values in columns.items()}
    attitudes = camera or body
    rows = columns["time_s"] if attitudes is None else attitudes.time_s
    at = columns["time_s"]
    known = (rows >= at[0]) & (rows <= at[-1]) & _close(at, rows, _LONGEST_GAP_S)
    rows = rows[known]
    if not len(rows):
        raise ValueError("its positions and attitudes are of different times")
    columns["longitude"] = np.unwrap(columns["longitude"], period=360.0)  # over the date line too
    sampled = {name: np.interp(rows, at, values) for name, values in columns.items()}
    longitude = sampled["longitude"]
    longitude[np.abs(longitude) > 180.0] -= 360.0 * np.sign(longitude[np.abs(longitude) > 180.0])
    return FlightLog(
        time_s=rows,
        start_ns=start_ns,
        latitude_deg=sampled["latitude"],
        longitude_deg=sampled["longitude"],
        heights_m={above: sampled[name] for above, name in heights.items()},
        camera_ned=None if camera is None else camera.at(rows),
        body_ned=None if body is None else body.at(rows),
        timed_by_film=False,
        take_off=take_off,
        remarks=said,
    )


def headings(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """The turns about "down" alone [N, 4] that attitudes in north-east-down contain."""
    w, x, y, z = quaternions.T
    half = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) / 2
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1)


def _close(at: NDArray[np.float64], time_s: NDArray[np.float64], gap_s: float) -> NDArray[np.bool_]:
    """Where the two neighbours in `at` are no further apart than `gap_s`."""
    after = np.clip(np.searchsorted(at, time_s), 1, len(at) - 1)
    return np.asarray(at[after] - at[after - 1] <= gap_s)
