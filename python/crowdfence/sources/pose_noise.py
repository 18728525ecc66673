"""Errors of poses that change from row to row: how large they are, and pose tracks without most of them.

A drone's way and its camera's turning are smooth; what rows of telemetry are off each by itself is not. A
cubic smoothing spline is what is left: the most likely motion of a body whose acceleration is white noise,
seen with normal errors (Wahba, Spline Models for Observational Data, 1990, 1.4). Errors that last, such as
those of a compass or of a filter in the autopilot, are smooth too and stay: `crowdfence align` tells the
constant ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.placed_again import placed_again
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.recording import Recording
from crowdfence.sources.rotation import multiply, normalise

SPEED_CHANGE_M2_S3 = 3.0
"""Spectral density of a drone's acceleration: its speed changes by some 1.7 m/s within a second."""
TURN_CHANGE_DEG2_S3 = 100.0
"""The same of its camera's turning: by some 10 deg/s within a second."""

WORTH_SAYING_M, WORTH_SAYING_DEG = 0.3, 0.3
"""Noise from which a recording whose poses are taken as they are says so: at 35 m 0.3 degrees are 0.2 m
across the line of sight, and twice that on the ground 30 degrees below the horizon."""

_CLOSE_ROWS_S = 0.25
"""Three rows within so short a time lie on a line but for their errors: at 5 m/s2 within 4 cm."""
_FEWEST_ROWS = 20
"""Of those, before they say how large the errors are."""
_SPLINE_ROWS = 5
"""A cubic smoothing spline needs so many."""
_MEDIAN_OF_NORMAL = 0.6745
"""Median of |x|, x standard normal."""

_MOST_M, _MOST_DEG = 100.0, 45.0
"""Rows that are off by more show no flight, and smoothed by so much they are a straight line."""

GivenNoise = Literal["estimate"] | tuple[float, float]
"""What a caller knows of the noise: nothing, or metres and degrees."""


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """Standard deviations, per axis, of what each row of a pose track is off by itself. ValueError for values
    that are not finite or negative."""

    position_m: float
    attitude_deg: float

    def __post_init__(self) -> None:
        for value in (self.position_m, self.attitude_deg):
            if not (np.isfinite(value) and value >= 0.0):
                raise ValueError(
                    "the noise of poses is metres and degrees, finite and not negative, got "
                    f"{self.position_m}, {self.attitude_deg}"
                )


def noise_of(track: PoseTrack) -> PoseNoise | None:
    """How far rows are off the line between their neighbours, as the median of each axis tells it; None where
    too few rows are close enough together to say. Of noise that lasts over several rows it sees a part."""
    seconds = (track.stamps_ns - track.stamps_ns[:1]) / 1e9
    whole = seconds[2:] - seconds[:-2]
    close = whole < _CLOSE_ROWS_S
    if np.count_nonzero(close) < _FEWEST_ROWS:
        return None
    part = ((seconds[1:-1] - seconds[:-2]) / whole)[:, None]
    attitudes = _continuous(track.quaternions)
    # Seen from a row's own attitude, the last three parts of a small turn are half its angles in radians.
    turned = multiply(attitudes[1:-1] * [1.0, -1.0, -1.0, -1.0], _off_the_line(attitudes, part))[:, 1:]
    scale = np.sqrt(1.0 + part**2 + (1.0 - part) ** 2)
    moved = _off_the_line(track.positions, part)
    return PoseNoise(
        _spread((moved / scale)[close]), float(np.degrees(2.0 * _spread((turned / scale)[close])))
    )


def _spread(errors: NDArray[np.float64]) -> float:
    """Standard deviation an axis of normal errors [N, 3], whatever a few of them are. Heights or headings may
    tremble alone, which the median over all axes takes for none: root of the mean square of the axes."""
    of_axes = np.median(np.abs(errors), axis=0) / _MEDIAN_OF_NORMAL
    return float(np.sqrt(np.mean(of_axes**2)))


def steadied(track: PoseTrack, noise: PoseNoise) -> PoseTrack:
    """The track without most of such noise, at the same stamps; one of fewer than five rows as it is."""
    if len(track) < _SPLINE_ROWS:
        return track
    seconds = (track.stamps_ns - track.stamps_ns[0]) / 1e9
    positions = _smoothed(seconds, track.positions, noise.position_m**2 / SPEED_CHANGE_M2_S3)
    # A quaternion's parts are half the angle: its noise and what drives it alike.
    attitudes = _smoothed(
        seconds, _continuous(track.quaternions), noise.attitude_deg**2 / TURN_CHANGE_DEG2_S3
    )
    return PoseTrack(track.stamps_ns, positions, normalise(attitudes))


def steadied_as(track: PoseTrack, given: GivenNoise | None) -> PoseTrack:
    """The same by what a caller knows; None: as it is."""
    noise = None if given is None else _taken(track, given)
    return track if noise is None else steadied(track, noise)


def without_noise(recording: Recording, given: GivenNoise) -> Recording:
    """The recording with steady poses; where they were not told, `Recording.warnings` says how large the
    errors were found. The manifest tells by what each drone's poses were smoothed.

    ValueError where `given` is stated and the poses of a drone were smoothed before (`convert` keeps it in
    the file): the noise is no longer in them, and smoothing would round off what was flown.
    """
    tracks: dict[str, PoseTrack] = {}
    before = smoothed_by(recording.manifest)
    smoothed: dict[str, dict[str, float]] = {}
    warnings = list(recording.warnings)
    for drone, track in recording.tracks().items():
        if drone in before:
            said = f"smoothed before by {_told(before[drone])}"
            if given != "estimate":
                raise ValueError(
                    f"the poses of {drone} in {recording.name} were {said}: leave --pose-noise out"
                )
            warnings.append(f"poses of {drone}: {said}; left as they are")
            continue
        noise = _taken(track, given)
        if noise is not None:
            tracks[drone] = steadied(track, noise)
            smoothed[drone] = asdict(noise)
        if given == "estimate":
            warnings.append(f"poses of {drone}: {_found(noise)}")
    earlier = {drone: asdict(noise) for drone, noise in before.items()}
    manifest = {**recording.manifest, "pose_noise": {**earlier, **smoothed}}
    steady = placed_again(recording, tracks, "smoothing")
    return replace(steady, warnings=tuple(warnings), manifest=manifest)


def smoothed_by(manifest: Mapping[str, Any]) -> dict[str, PoseNoise]:
    """By what the poses of each drone were smoothed before, of a file that may say anything."""
    told = manifest.get("pose_noise")
    found = {}
    for drone, noise in told.items() if isinstance(told, Mapping) else ():
        try:
            found[str(drone)] = PoseNoise(float(noise["position_m"]), float(noise["attitude_deg"]))
        except (KeyError, TypeError, ValueError):
            continue
    return found


def with_doubts(recording: Recording) -> Recording:
    """The recording as it is; `Recording.warnings` names the drones whose rows are off by much each by
    itself."""
    found = {drone: noise_of(track) for drone, track in recording.tracks().items()}
    doubts = [
        f"poses of {drone}: each off by itself by {noise.position_m:.2g} m and {noise.attitude_deg:.2g} deg, "
        "which --pose-noise estimate would smooth"
        for drone, noise in found.items()
        if noise and (noise.position_m >= WORTH_SAYING_M or noise.attitude_deg >= WORTH_SAYING_DEG)
    ]
    return replace(recording, warnings=(*recording.warnings, *doubts))


def given_noise(text: str) -> GivenNoise:
    """Of "estimate", or metres and degrees such as "0.5,0.5". ValueError for anything else."""
    if text == "estimate":
        return "estimate"
    try:
        position_m, attitude_deg = map(float, text.split(","))
    except ValueError:
        raise ValueError(
            f"the noise of poses is 'estimate', or metres and degrees such as 0.5,0.5, got {text!r}"
        ) from None
    _stated(position_m, attitude_deg)
    return position_m, attitude_deg


def _taken(track: PoseTrack, given: GivenNoise) -> PoseNoise | None:
    return noise_of(track) if given == "estimate" else _stated(*given)


def _stated(position_m: float, attitude_deg: float) -> PoseNoise:
    if position_m > _MOST_M or attitude_deg > _MOST_DEG:
        raise ValueError(
            f"the noise of poses is at most {_MOST_M:g} m and {_MOST_DEG:g} degrees, got {position_m:g}, "
            f"{attitude_deg:g}"
        )
    return PoseNoise(position_m, attitude_deg)


def _told(noise: PoseNoise) -> str:
    return f"{noise.position_m:.2g} m and {noise.attitude_deg:.2g} deg"


def _found(noise: PoseNoise | None) -> str:
    if noise is None:
        return f"rows are too far apart to tell their noise (3 within {_CLOSE_ROWS_S:g} s); left as they are"
    return f"each off by itself by {_told(noise)}; smoothed"


def _off_the_line(rows: NDArray[np.float64], part: NDArray[np.float64]) -> NDArray[np.float64]:
    """[N - 2, ...] of rows [N, ...], `part` [N - 2, 1] of the way between their neighbours."""
    return rows[1:-1] - (1.0 - part) * rows[:-2] - part * rows[2:]


def _continuous(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same attitudes [N, 4], of length one, each with the sign that is nearer to the row before."""
    attitudes = normalise(quaternions)
    against = np.sum(attitudes[1:] * attitudes[:-1], axis=1) < 0.0
    attitudes[1:] *= np.where(np.cumsum(against) % 2, -1.0, 1.0)[:, None]
    return attitudes


def _smoothed(
    seconds: NDArray[np.float64], rows: NDArray[np.float64], stiffness: float
) -> NDArray[np.float64]:
    """Rows [N, K] on the spline; `stiffness` is the variance of their noise over the density of what drives
    the motion, s^3."""
    from scipy.interpolate import make_smoothing_spline

    if stiffness == 0.0:
        return rows
    columns = [make_smoothing_spline(seconds, column, lam=stiffness)(seconds) for column in rows.T]
    return np.stack(columns, axis=1)
