"""What a crowd map tells the zones about columns of ground at one stamp.

Everything that a zone needs to know of a method stands here: which columns are crowd, until when they stay so
if nobody looks again, and between which bounds their probability lies. A method that does not say is none the
worse: its zones then have no expiry, or no interval.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdColumns, CrowdMap

_LATEST_NS = np.iinfo(np.int64).max // 2
"""Beyond it (the year 2116) an expiry is none, and nothing is forgotten."""
_ROUNDING = 1e-9
"""What the core allows for it where it compares probabilities with a prior, as a share."""
FORGET_TO_PRIOR = ("evidence", "linear-pool", "log-pool")
FOR_GOOD = "or"
"""The method that opens nothing that it called crowd once, whoever looks."""


@dataclass(frozen=True, slots=True, eq=False)
class ColumnBelief:
    """Columns of the terrain that hold crowd or did, sorted by i, then j."""

    columns: CrowdColumns
    valid_until_ns: NDArray[np.int64] | None
    """[C] When each column falls below the threshold if nobody looks at it again, never too early; None where
    the method knows no such time."""
    interval: NDArray[np.float64] | None
    """[C, 2] Bounds of the probability of each column; None where the method has none."""


def column_belief(
    crowd_map: CrowdMap, stamp_ns: int, voxel_ids: NDArray[np.int64], off_threshold: float
) -> ColumnBelief:
    """The columns of voxels [N] that hold crowd or did, at a stamp not before the newest instant."""
    columns = crowd_map.columns_of(voxel_ids, stamp_ns)
    until_ns = _valid_until_ns(crowd_map, columns, stamp_ns, off_threshold)
    return ColumnBelief(columns, until_ns, _interval(crowd_map, columns, stamp_ns))


def forgets_to_unknown(crowd_map: CrowdMap) -> bool:
    """Whether crowd that nobody looks at becomes "not known", the prior, and not "free"."""
    return crowd_map.method.name in FORGET_TO_PRIOR


def require_above_prior(crowd_map: CrowdMap, threshold: float) -> None:
    """ValueError for a threshold that ground reaches by being forgotten, whatever was seen there."""
    prior = float(crowd_map.method.parameters.get("prior", 0.0))
    if forgets_to_unknown(crowd_map) and threshold <= prior * (1.0 + _ROUNDING):
        of_log_odds = crowd_map.method.name != "linear-pool" and threshold == crowd_map.default_threshold()
        given = "zone_log_odds must be above 0: the threshold is" if of_log_odds else "threshold is"
        raise ValueError(
            f"{given} {threshold:g}; it must be above the prior, {prior:g}, which method "
            f"{crowd_map.method.name} forgets towards: ground that was seen empty would become crowd because "
            "nobody looks at it. To close what nobody has looked at for a while, use close_unseen"
        )


def forgotten_ns(
    crowd_map: CrowdMap, columns: CrowdColumns, stamp_ns: int, threshold: float
) -> NDArray[np.int64] | None:
    """[C] When method `evidence` no longer knows crowd on each column, if nobody looks again; None where that
    is beyond the year 2116 for any, or never: at a threshold that is not above the prior; and for the others,
    which forget towards "free" or not at all.

    With e the log odds above the prior and W the looks that are remembered, e (W + doubt) = E D^a of the
    method, and a share f of both is left after memory_s ln(1 / f). The threshold, T above the prior, is met
    at f = T doubt / (e (W + doubt) - T W).
    """
    parameters = crowd_map.method.parameters
    if crowd_map.method.name != "evidence" or not len(columns):
        return None
    prior, doubt, memory_s = (float(parameters[name]) for name in ("prior", "doubt", "memory_s"))
    known = crowd_map.knowledge(columns.voxel_ids, stamp_ns)
    above, least = _log_odds(known.probability) - _log_odds(prior), _log_odds(threshold) - _log_odds(prior)
    if least <= _ROUNDING:
        return None
    looks = np.nan_to_num(known.looks)
    with np.errstate(divide="ignore", invalid="ignore"):
        left = least * doubt / (above * (looks + doubt) - least * looks)
    after_s = np.where(above > least, -memory_s * np.log(np.clip(left, 1e-300, 1.0)), 0.0)
    first = np.cumsum(columns.crowd_count) - columns.crowd_count
    after_s = np.maximum.reduceat(after_s, first)
    if not (after_s <= (_LATEST_NS - stamp_ns) / 1e9).all():
        return None
    return np.asarray(stamp_ns + np.ceil(after_s * 1e9).astype(np.int64))


def _log_odds(probability: NDArray[np.float64] | float) -> NDArray[np.float64]:
    return np.asarray(np.log(probability) - np.log1p(-np.asarray(probability)))


def _interval(crowd_map: CrowdMap, columns: CrowdColumns, stamp_ns: int) -> NDArray[np.float64] | None:
    """[C, 2] The largest bounds of the crowd voxels of each column, as its probability is the largest."""
    if not len(columns):
        return None
    bounds = crowd_map.interval(stamp_ns, columns.voxel_ids)
    if bounds is None:
        return None
    first = np.cumsum(columns.crowd_count) - columns.crowd_count
    return np.maximum.reduceat(bounds, first, axis=0)


def _valid_until_ns(
    crowd_map: CrowdMap, columns: CrowdColumns, stamp_ns: int, threshold: float
) -> NDArray[np.int64] | None:
    """Of equation 3: P exp(-lambda t) is at the threshold after t = ln(P / threshold) / lambda.

    None where nothing decays: method `or`, lambda 0, and lambda per instant, because nobody knows when the
    next instants come.
    """
    parameters = crowd_map.method.parameters
    decay_per_s = parameters.get("decay", 0.0)
    if not decay_per_s or parameters.get("decay_unit") != "second":
        return None
    left_s = np.log(columns.probability / threshold) / float(decay_per_s)
    # Rounded up: a double holds nanoseconds of years no better than this.
    left_ns = np.ceil(left_s * 1e9 * (1.0 + 1e-12)) + 1.0
    if (left_ns > _LATEST_NS - stamp_ns).any():
        return None
    return np.asarray(stamp_ns + left_ns.astype(np.int64))
