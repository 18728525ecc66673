"""When a film began on the clock of a log, from how both turn.

A camera that turns shifts its whole picture: by -w_y f a second to the right and w_x f down, for an angular
velocity w in its own axes. The shifts between neighbouring frames (phase correlation) are held against the
log's angular velocity at every offset. That works where the camera turns in a way that does not repeat: a
hover, a straight line or a steady orbit say nothing, and are refused.
"""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from crowdfence._core import Camera
from crowdfence.sources.film.picture_reader import FilmPictures
from crowdfence.sources.pose_track import PoseTrack

_STEP_S = 0.1
_LONGEST_S = 60.0
_FEWEST = 50
"""Pairs of frames: 5 s."""
_WIDTH = 128
_LAG_S = 0.02
_LOWEST_AGREEMENT = 0.7
_LEAD = 0.15
"""By how much the best offset must agree better than any more than a second away."""
_SLOWEST_RAD_S = np.radians(1.0)


@dataclass(frozen=True, slots=True)
class ClockEstimate:
    """When the film began, in seconds on the log's clock."""

    offset_s: float
    error_s: float
    """Half of what two halves of the film differ by, and a step of the search."""
    agreement: float
    """Correlation of the turning rates, 1 = equal."""


def estimate_clock_offset(film: FilmPictures, camera: Camera, track: PoseTrack) -> ClockEstimate:
    """`track` is the camera's, stamped from the log's beginning. ValueError says why it cannot be told."""
    pairs = _pairs(film.times_s)
    if len(pairs) < _FEWEST:
        raise ValueError(
            f"its motion cannot tell: {len(pairs)} pairs of frames {_STEP_S:g} s apart, {_FEWEST} are needed"
        )
    seen = _seen_rates(film, pairs, camera)
    at = np.array([(film.times_s[a] + film.times_s[b]) / 2 for a, b in pairs])
    log_s, turned = _logged_rates(track)
    lags = np.arange(log_s[0] - at[0], log_s[-1] - at[-1], _LAG_S)
    if not len(lags):
        raise ValueError("its motion cannot tell: the log is shorter than the film")
    agreement = _agreement(lags, at, seen, log_s, turned)
    best = int(np.argmax(agreement))
    _require_clear(lags, agreement, best, at, log_s, turned)
    near = np.abs(lags - lags[best]) <= 1.0
    halves = [
        lags[near][np.argmax(_agreement(lags[near], at[part], seen[part], log_s, turned))]
        for part in (slice(0, len(at) // 2), slice(len(at) // 2, None))
    ]
    error_s = abs(float(halves[0] - halves[1])) / 2 + _LAG_S
    return ClockEstimate(float(lags[best]), error_s, float(agreement[best]))


def _pairs(times_s: list[float]) -> list[tuple[int, int]]:
    """Neighbouring frames about a tenth of a second apart."""
    pairs, last = [], 0
    for number, time_s in enumerate(times_s):
        if time_s > times_s[0] + _LONGEST_S:
            break
        if time_s - times_s[last] >= _STEP_S - 0.02:
            if time_s - times_s[last] <= 2 * _STEP_S:
                pairs.append((last, number))
            last = number
    return pairs


def _seen_rates(film: FilmPictures, pairs: list[tuple[int, int]], camera: Camera) -> NDArray[np.float64]:
    """Radians a second that the picture moves right and down, [N, 2]; NaN where a frame is damaged."""
    rates = np.full((len(pairs), 2), np.nan)
    known: dict[int, NDArray[np.float64] | None] = {}
    for row, (first, second) in enumerate(pairs):
        for number in (first, second):
            if number not in known:
                known[number] = _small(film, number)
        a, b = known[first], known[second]
        known = {second: b}
        if a is not None and b is not None:
            apart_s = film.times_s[second] - film.times_s[first]
            focal_px = camera.fx * a.shape[1] / camera.width
            rates[row] = np.array(_shift(a, b)) / focal_px / apart_s
    return rates


def _small(film: FilmPictures, number: int) -> NDArray[np.float64] | None:
    try:
        picture = Image.open(io.BytesIO(film.ppm(number))).convert("L")
    except ValueError:
        return None
    height = max(8, round(picture.height * _WIDTH / picture.width))
    grey = np.asarray(picture.resize((_WIDTH, height), Image.Resampling.BOX), np.float64)
    window = np.outer(np.hanning(height), np.hanning(_WIDTH))
    return np.asarray((grey - grey.mean()) * window)


def _shift(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[float, float]:
    """Pixels by which the content of `b` lies right of and below that of `a`."""
    product = np.fft.rfft2(b) * np.conj(np.fft.rfft2(a))
    surface = np.fft.irfft2(product / (np.abs(product) + 1e-9), s=a.shape)
    row, column = np.unravel_index(int(np.argmax(surface)), surface.shape)
    return (
        _peak(surface[row, :], int(column)),
        _peak(surface[:, column], int(row)),
    )


def _peak(values: NDArray[np.float64], at: int) -> float:
    """Where the parabola through the highest value and its neighbours is highest; wraps around."""
    count = len(values)
    left, middle, right = values[at - 1], values[at], values[(at + 1) % count]
    bend = left - 2 * middle + right
    place = at + (0.0 if bend == 0 else float(0.5 * (left - right) / bend))
    return place - count if place > count / 2 else place


def _logged_rates(track: PoseTrack) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times [M] and how a distant point in the middle moves right and down, radians a second [M, 2]."""
    from scipy.spatial.transform import Rotation, Slerp

    stamps_s = track.stamps_ns / 1e9
    if len(track) < 2 or stamps_s[-1] - stamps_s[0] < 3 * _STEP_S:
        raise ValueError("its motion cannot tell: the log is too short")
    turns = Slerp(stamps_s, Rotation.from_quat(track.quaternions[:, [1, 2, 3, 0]]))
    at = np.arange(stamps_s[0] + _STEP_S / 2, stamps_s[-1] - _STEP_S / 2, _LAG_S)
    turned = (turns(at - _STEP_S / 2).inv() * turns(at + _STEP_S / 2)).as_rotvec() / _STEP_S
    return at, np.stack([-turned[:, 1], turned[:, 0]], axis=1)


def _agreement(
    lags: NDArray[np.float64],
    at: NDArray[np.float64],
    seen: NDArray[np.float64],
    log_s: NDArray[np.float64],
    turned: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Correlation of both rates together at each lag."""
    usable = np.isfinite(seen).all(axis=1)
    a = seen[usable] - seen[usable].mean(axis=0)
    found = np.zeros(len(lags))
    for number, lag in enumerate(lags):
        b = np.stack([np.interp(at[usable] + lag, log_s, turned[:, axis]) for axis in (0, 1)], axis=1)
        b -= b.mean(axis=0)
        found[number] = np.sum(a * b) / (np.sqrt(np.sum(a * a) * np.sum(b * b)) + 1e-12)
    return found


def _require_clear(
    lags: NDArray[np.float64],
    agreement: NDArray[np.float64],
    best: int,
    at: NDArray[np.float64],
    log_s: NDArray[np.float64],
    turned: NDArray[np.float64],
) -> None:
    during = (log_s >= at[0] + lags[best]) & (log_s <= at[-1] + lags[best])
    turning = float(np.sqrt(np.mean(np.var(turned[during], axis=0)))) if during.any() else 0.0
    if turning < _SLOWEST_RAD_S:
        raise ValueError(f"its motion cannot tell: the camera turns by {np.degrees(turning):.1f} deg/s only")
    if agreement[best] < _LOWEST_AGREEMENT:
        raise ValueError(
            f"its motion cannot tell: the best offset agrees by {agreement[best]:.2f} with the log "
            f"({_LOWEST_AGREEMENT:g} is needed)"
        )
    others = agreement[np.abs(lags - lags[best]) > 1.0]
    if others.size and others.max() > agreement[best] - _LEAD:
        raise ValueError(
            "its motion cannot tell: offsets more than a second apart agree alike "
            f"({agreement[best]:.2f} and {others.max():.2f})"
        )
