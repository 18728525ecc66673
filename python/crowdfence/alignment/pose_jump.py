"""A drone whose poses jump during the flight, as after a GNSS fix of another kind or a reset of its heading.

No constant offset is right then, but one in the middle fits half of it everywhere. What the pictures say each
pose is off besides tells the two apart: around 0 all the time, or around one value before and another after.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence.alignment.offset_fit import JITTER, OF_FRAME, QUANTITIES, UNITS
from crowdfence.iso_time import iso_utc

SURE = 5.0
"""Standard deviations from which a step is no chance: of all places that it may be at it is at the best."""
LEAST = np.array([0.35, 0.35, 0.35, 0.5, 0.5, 0.5])
"""Steps that matter, in degrees and metres: what an offset may be unsure by and still be told."""
_FEWEST = 3
"""Pictures on either side, by which one that is off alone makes no step."""
_OF_NORMAL = _OF_MEDIANS = float(np.sqrt(np.pi / 2))
"""Standard deviation over the mean of |x|, and standard error of a median over that of the mean, of a normal
distribution."""


@dataclass(frozen=True, slots=True)
class PoseJump:
    """Where the poses of a drone change for good."""

    before_ns: int
    """Stamp of the last picture before."""
    after_ns: int
    """Stamp of the first picture after."""
    by: dict[str, float]
    """What changes by how much, in the units of `offset_fit`; somewhat less than it does."""
    sigmas: float
    """How sure, in standard deviations."""

    def __str__(self) -> str:
        units = dict(zip(QUANTITIES, UNITS, strict=True))
        by = ", ".join(f"{quantity} by {size:+.1f} {units[quantity]}" for quantity, size in self.by.items())
        before, after = (f"{iso_utc(stamp_ns)[:23]}Z" for stamp_ns in (self.before_ns, self.after_ns))
        return (
            f"its poses, or its clock, jump between {before} and {after} ({by}): no constant is right before "
            "and after"
        )


def find_jump(stamps_ns: NDArray[np.int64], jitter: NDArray[np.float64]) -> PoseJump | None:
    """The step that what the poses of a drone's pictures [F] are off each [F, 6] takes, if it is sure and
    matters. A steady drift is none."""
    count = len(jitter)
    if count < 2 * _FEWEST:
        return None
    order = np.argsort(stamps_ns, kind="stable")
    stamps_ns, jitter = stamps_ns[order], jitter[order]
    k = min(range(_FEWEST, count - _FEWEST + 1), key=lambda k: np.abs(_split(jitter, k)[1] / JITTER).sum())
    size, left = _split(jitter, k)
    noise = np.maximum(JITTER, _OF_NORMAL * np.abs(left).mean(axis=0))
    sigmas = np.abs(size) / (_OF_MEDIANS * noise * np.sqrt(1 / k + 1 / (count - k)))
    matters = (np.abs(size) >= LEAST) & (sigmas >= SURE) & ~_drifts(stamps_ns, jitter, left)
    if not matters.any():
        return None
    by = {QUANTITIES[OF_FRAME[q]]: float(size[q]) for q in np.flatnonzero(matters)}
    return PoseJump(int(stamps_ns[k - 1]), int(stamps_ns[k]), by, float(sigmas[matters].max()))


def _split(jitter: NDArray[np.float64], k: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far the medians before and after are apart [6], and what both leave [F, 6]."""
    before, after = np.median(jitter[:k], axis=0), np.median(jitter[k:], axis=0)
    return after - before, np.concatenate([jitter[:k] - before, jitter[k:] - after])


def _drifts(
    stamps_ns: NDArray[np.int64], jitter: NDArray[np.float64], left: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether a straight line leaves less [6] than a step does."""
    seconds = (stamps_ns - stamps_ns[0]) / 1e9
    line = np.polynomial.polynomial.polyfit(seconds, jitter, 1)
    of_line = jitter - np.polynomial.polynomial.polyval(seconds, line).T
    return np.asarray((of_line**2).sum(axis=0) < (left**2).sum(axis=0))
