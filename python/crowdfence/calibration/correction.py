"""Logits corrected so that 0.7 means 70 percent: temperature, scale and bias, or any increasing curve."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.calibration.logit_counts import COUNT_CROWD, COUNT_EMPTY, cell_logits, mean_logits
from crowdfence.evaluation.statistics.isotonic import pool_adjacent_violators

MAX_SCALE = 20.0
"""Cells that a threshold separates perfectly would take an infinite scale."""
CURVE_EDGES = np.concatenate([[-np.inf], np.arange(-6.0, 6.5), [np.inf]])
"""Bins of the logit whose shares of crowd the curve joins."""


@dataclass(frozen=True, slots=True)
class LogitMap:
    """An increasing map of logits: straight lines between knots, continued with the slopes at its ends."""

    method: str
    """"none", "temperature", "scale and bias" or "curve"."""
    knots: tuple[tuple[float, float], ...]
    """Logit before, logit after; increasing. One knot with equal slopes is a straight line."""
    slope_below: float
    slope_above: float

    @property
    def is_line(self) -> bool:
        return len(self.knots) == 1 and self.slope_below == self.slope_above

    @property
    def scale(self) -> float:
        """Of a line: after = scale * before + bias. The temperature is 1 / scale."""
        return self.slope_below

    @property
    def bias(self) -> float:
        (before, after), *_ = self.knots
        return after - self.scale * before

    def __call__(self, logits: NDArray[np.float64]) -> NDArray[np.float64]:
        """Logits of any shape -> logits of that shape."""
        before, after = np.array(self.knots).T
        inside = np.interp(logits, before, after)
        below, above = np.minimum(logits - before[0], 0.0), np.maximum(logits - before[-1], 0.0)
        return np.asarray(inside + self.slope_below * below + self.slope_above * above)

    def of_scaled(self, scale: float) -> LogitMap:
        """The map that gives for z what this one gives for `scale` * z."""
        knots = tuple((before / scale, after) for before, after in self.knots)
        return LogitMap(self.method, knots, self.slope_below * scale, self.slope_above * scale)

    def probability(self, heatmap: NDArray[Any]) -> NDArray[np.float32]:
        """Heatmap [h, w] of the uncalibrated model -> heatmap of the calibrated one."""
        return sigmoid(self(cell_logits(heatmap))).astype(np.float32)

    def to_json(self) -> dict[str, Any]:
        """Ready for JSON."""
        if self.is_line:
            return {"scale": self.scale, "bias": self.bias}
        return {
            "knots": [list(knot) for knot in self.knots],
            "slope_below": self.slope_below,
            "slope_above": self.slope_above,
        }


def line(method: str, scale: float, bias: float = 0.0) -> LogitMap:
    """after = scale * before + bias."""
    return LogitMap(method, ((0.0, bias),), scale, scale)


UNCHANGED = line("none", 1.0)


def fit_temperature(counts: NDArray[np.float64]) -> LogitMap:
    """One scale (Guo et al., 2017) that minimises the negative log-likelihood of counts [3, BINS]."""
    scale, _ = _newton(counts, with_bias=False)
    return line("temperature", scale)


def fit_scale_and_bias(counts: NDArray[np.float64]) -> LogitMap:
    """Scale and bias (Platt, 1999)."""
    return line("scale and bias", *_newton(counts, with_bias=True))


def fit_curve(counts: NDArray[np.float64]) -> LogitMap:
    """Isotonic: mean logit and share of crowd of coarse bins, made to increase and joined by lines.

    Every bin counts half a cell of each kind more than it has; the ends go on with slope 1.
    """
    logits = mean_logits(counts)
    coarse = np.digitize(logits, CURVE_EDGES) - 1
    bins = len(CURVE_EDGES) - 1
    crowd = np.bincount(coarse, counts[COUNT_CROWD], minlength=bins)
    empty = np.bincount(coarse, counts[COUNT_EMPTY], minlength=bins)
    logit_sum = np.bincount(coarse, logits * (counts[COUNT_CROWD] + counts[COUNT_EMPTY]), minlength=bins)
    used = crowd + empty > 0.0
    mean = logit_sum[used] / (crowd + empty)[used]
    # Knots keep half a logit apart, so that no line between two of them is steep by accident.
    before = np.clip(mean, CURVE_EDGES[:-1][used] + 0.25, CURVE_EDGES[1:][used] - 0.25)
    pooled_crowd, pooled_empty = pool_adjacent_violators(crowd[used] + 0.5, empty[used] + 0.5)
    after = np.log(pooled_crowd / pooled_empty)
    return LogitMap("curve", tuple(zip(before.tolist(), after.tolist(), strict=True)), 1.0, 1.0)


FITS: Mapping[str, Callable[[NDArray[np.float64]], LogitMap]] = {
    "none": lambda counts: UNCHANGED,
    "temperature": fit_temperature,
    "scale and bias": fit_scale_and_bias,
    "curve": fit_curve,
}
"""From the simplest to the most flexible."""


def negative_log_likelihood(counts: NDArray[np.float64], logit_map: LogitMap) -> float:
    """Mean over the cells of counts [3, BINS] of -log P(truth)."""
    after = logit_map(mean_logits(counts))
    loss = counts[COUNT_CROWD] @ np.logaddexp(0.0, -after) + counts[COUNT_EMPTY] @ np.logaddexp(0.0, after)
    return float(loss / (counts[COUNT_CROWD].sum() + counts[COUNT_EMPTY].sum()))


def sigmoid(logits: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.exp(-np.logaddexp(0.0, -logits)))


def _newton(counts: NDArray[np.float64], *, with_bias: bool) -> tuple[float, float]:
    """Scale and bias of the smallest negative log-likelihood, a convex function, by damped Newton steps."""
    logits = mean_logits(counts)
    crowd, cells = counts[COUNT_CROWD], counts[COUNT_CROWD] + counts[COUNT_EMPTY]
    features = np.stack([logits, np.ones_like(logits)] if with_bias else [logits])
    parameters = np.array([1.0, 0.0])[: len(features)]

    def loss_at(trial: NDArray[np.float64]) -> float:
        after = trial @ features
        return float(crowd @ np.logaddexp(0.0, -after) + (cells - crowd) @ np.logaddexp(0.0, after))

    loss = loss_at(parameters)
    for _ in range(100):
        share = sigmoid(parameters @ features)
        gradient = features @ (cells * share - crowd)
        curvature = (features * (cells * share * (1.0 - share))) @ features.T
        step = np.linalg.solve(curvature + 1e-9 * np.eye(len(features)) * max(cells.sum(), 1.0), gradient)
        size = 1.0
        while size > 1e-6 and not (loss_at(parameters - size * step) <= loss):
            size /= 2.0
        parameters = parameters - size * step
        parameters[0] = np.clip(parameters[0], 1.0 / MAX_SCALE, MAX_SCALE)
        previous, loss = loss, loss_at(parameters)
        if abs(previous - loss) <= 1e-12 * max(loss, 1.0):
            break
    return float(parameters[0]), float(parameters[1]) if with_bias else 0.0
