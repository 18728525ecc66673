"""Which correction of a detector's logits holds on missions that it was not fitted on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.calibration.correction import (
    FITS,
    LogitMap,
    negative_log_likelihood,
    sigmoid,
)
from crowdfence.calibration.logit_counts import COUNT_CROWD, COUNT_EMPTY, mean_logits
from crowdfence.evaluation.cells.scores import Quality, quality
from crowdfence.evaluation.cells.value_histogram import BINS as VALUE_BINS
from crowdfence.evaluation.cells.value_histogram import CROWD, EMPTY, SQUARED_ERROR, VALUE_SUM, bin_of_values


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """One kind of correction."""

    fitted: LogitMap
    """Fitted on all missions."""
    held_out_nll: NDArray[np.float64]
    """[missions] mean negative log-likelihood per cell of each mission under the map that was fitted on the
    others; NaN where nothing can be judged."""
    held_out: Quality | None
    """Scores of the same probabilities; None where nothing can be judged."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """All corrections that were tried, and the one to use."""

    chosen: LogitMap
    candidates: dict[str, Candidate]
    before: Quality
    """Scores of the probabilities as they come from the model."""
    missions: int
    cells: int

    @property
    def after(self) -> Quality | None:
        """Scores of the chosen correction on missions that it was not fitted on."""
        return self.candidates[self.chosen.method].held_out

    def to_json(self) -> dict[str, Any]:
        """The "calibration" of a detector's contract, without the temperature."""
        after = self.after
        nll = {name: float(one.held_out_nll.mean()) for name, one in self.candidates.items()}
        return {
            "method": self.chosen.method,
            "in_graph": self.chosen.to_json(),
            "missions": self.missions,
            "cells": self.cells,
            "error_before": _error(self.before.calibration_error.value),
            "error_before_above_0.05": _error(self.before.calibration_error_above.value),
            "error": None if after is None else _error(after.calibration_error.value),
            "error_above_0.05": None if after is None else _error(after.calibration_error_above.value),
            "held_out_nll": {name: _error(value) for name, value in nll.items()},
        }


def calibrate(counts: Mapping[str, NDArray[np.float64]], *, lines_only: bool = False) -> Calibration:
    """Choose a correction from the cells of each mission (`logit_counts`, name -> [3, BINS]).

    Every candidate is fitted on all missions but one and judged on that one, for each mission. From the
    simplest on (none, temperature, scale and bias, curve), a candidate replaces the best so far when its
    negative log-likelihood is smaller by more than the standard error of that difference over the missions.
    With crowd in fewer than two missions nothing can be judged: then the temperature is taken. `lines_only`
    leaves the curve out. A mission of which no cell counts says nothing and is none of them.

    Use missions that the model was not trained on. ValueError when no cell, or only crowd, or none is there.
    """
    missions = [one for one in counts.values() if one[[COUNT_EMPTY, COUNT_CROWD]].any()]
    total = np.sum(missions, axis=0) if missions else np.zeros((3, 1))
    crowd, empty = total[COUNT_CROWD].sum(), total[COUNT_EMPTY].sum()
    if crowd == 0 or empty == 0:
        missing = "crowd" if crowd == 0 else "crowd-free"
        raise ValueError(
            f"no {missing} cells among {int(crowd + empty)}: calibration needs labelled frames that show some"
        )
    can_judge = sum(bool(one[COUNT_CROWD].any()) for one in missions) > 1
    names = [name for name in FITS if not (lines_only and name == "curve")]
    candidates = {name: _candidate(name, missions, total, can_judge) for name in names}
    before = quality(np.stack([_value_histogram(one, FITS["none"](one)) for one in missions]))
    chosen = _choice(candidates) if can_judge else candidates["temperature"].fitted
    return Calibration(chosen, candidates, before, len(missions), int(crowd + empty))


def _candidate(
    name: str, missions: list[NDArray[np.float64]], total: NDArray[np.float64], can_judge: bool
) -> Candidate:
    fit = FITS[name]
    if not can_judge:
        return Candidate(fit(total), np.full(len(missions), np.nan), None)
    fitted_on_others = [fit(total - mission) for mission in missions]
    pairs = list(zip(missions, fitted_on_others, strict=True))
    return Candidate(
        fit(total),
        np.array([negative_log_likelihood(mission, others) for mission, others in pairs]),
        quality(np.stack([_value_histogram(mission, others) for mission, others in pairs])),
    )


def _choice(candidates: Mapping[str, Candidate]) -> LogitMap:
    best, *others = candidates.values()
    for other in others:
        gain = best.held_out_nll - other.held_out_nll
        if gain.mean() > gain.std(ddof=1) / np.sqrt(len(gain)):
            best = other
    return best.fitted


def _value_histogram(counts: NDArray[np.float64], logit_map: LogitMap) -> NDArray[np.float64]:
    """Value histogram [4, VALUE_BINS] of the corrected probabilities of counts [3, BINS]."""
    value = sigmoid(logit_map(mean_logits(counts)))
    crowd, empty = counts[COUNT_CROWD], counts[COUNT_EMPTY]
    bin_of = bin_of_values(value)
    weights = {
        EMPTY: empty,
        CROWD: crowd,
        VALUE_SUM: value * (crowd + empty),
        SQUARED_ERROR: crowd * (1.0 - value) ** 2 + empty * value**2,
    }
    return np.stack([np.bincount(bin_of, weights[row], minlength=VALUE_BINS) for row in sorted(weights)])


def _error(value: float) -> float | None:
    return None if value != value else round(value, 6)
