"""What each knob of a method is worth: the method beside itself with one of them turned."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from crowdfence.config import (
    EvidenceConfig,
    LinearPoolConfig,
    LogOddsConfig,
    LogPoolConfig,
    MethodConfig,
    MovingAverageConfig,
    OrConfig,
    PaperConfig,
)

if TYPE_CHECKING:
    from crowdfence.evaluation.replay import Score

_PRIORS = (0.005, 0.015, 0.05, 0.2)
_ALPHAS = (0.02, 0.05, 0.1, 0.3, 1.0)
_DECAYS = (0.0, 0.0005, 0.005, 0.05)
_MEMORIES_S = (1.0, 2.5, 5.0, 10.0, 20.0)
_B_THRESHOLDS = (0.1, 0.3, 0.5, 0.7, 0.9)

KNOBS: Mapping[type, Mapping[str, Sequence[Any]]] = {
    EvidenceConfig: {
        "memory_s": _MEMORIES_S,
        "sharp_gsd_m": (0.05, 0.1, 0.15, 0.3),
        "doubt": (0.05, 0.1, 0.2, 0.5, 1.5),
        "agreement": (0.0, 0.25, 0.5, 1.0),
    },
    PaperConfig: {
        "prior": _PRIORS,
        "b_threshold": _B_THRESHOLDS,
        "alpha": _ALPHAS,
        "decay": _DECAYS,
        "unseen": ("fleet", "visible"),
        "normalise": (False, True),
        "initial": ("zero", "prior", "first"),
    },
    OrConfig: {},
    LinearPoolConfig: {
        "prior": _PRIORS,
        "b_threshold": _B_THRESHOLDS,
        "alpha": _ALPHAS,
        "decay": _DECAYS,
    },
    LogPoolConfig: {"alpha": _ALPHAS, "decay": _DECAYS},
    LogOddsConfig: {
        "prior": (0.015, 0.05, 0.2, 0.5),
        "b_threshold": _B_THRESHOLDS,
        "clamp_low": (-6.0, -4.0, -2.0, -1.0),
        "clamp_high": (1.0, 2.0, 3.5, 6.0),
    },
    MovingAverageConfig: {"prior": _PRIORS, "memory_s": _MEMORIES_S},
}
"""The values that are tried. Thresholds are swept for every one of them, and the `b_threshold` of `or` in
the same way: both cost nothing more."""


class Turn(NamedTuple):
    """A method with one knob turned."""

    knob: str
    value: Any
    method: MethodConfig


def turns(method: MethodConfig) -> Iterator[Turn]:
    """Every value of every knob but the one that it has."""
    for knob, values in KNOBS[type(method)].items():
        for value in values:
            if getattr(method, knob) != value:
                yield Turn(knob, value, replace(method, **{knob: value}))


class Turned(NamedTuple):
    """What a knob is worth."""

    knob: str
    values: list[tuple[Any, float]]
    """Each value that was tried, the method's own included, with the mean IoU at its best threshold."""

    @property
    def best(self) -> tuple[Any, float]:
        """The value with the largest mean IoU, on this very recording."""
        return max(self.values, key=lambda one: -1.0 if one[1] != one[1] else one[1])


def turned(own: Score, swept: Sequence[tuple[Turn, Score]]) -> list[Turned]:
    """Knob by knob, from the method's turns and their scores; values in the order in which they are tried."""
    result = []
    for knob, tried in KNOBS[type(own.config.method)].items():
        here = getattr(own.config.method, knob)
        found = {one.value: score.sweep.best()[1].mean for one, score in swept if one.knob == knob}
        found[here] = own.sweep.best()[1].mean
        order = [value for value in tried if value in found]
        order += [value for value in found if value not in tried]
        result.append(Turned(knob, [(value, found[value]) for value in order]))
    return result
