"""Refusals of impossible scenario parameters, by name."""

from __future__ import annotations

import math
from collections.abc import Sequence

LONGEST_S = 1e9
"""Thirty years; stamps in nanoseconds hold a few hundred."""


class ScenarioError(ValueError):
    """A scenario that cannot be simulated; the message names the parameter, its value and its bound."""


def require_within(name: str, value: float, low: float, high: float) -> None:
    """`low` <= `value` <= `high`, and finite."""
    if not (math.isfinite(value) and low <= value <= high):
        raise ScenarioError(f"{name} must be between {low:g} and {high:g}, got {value:g}")


def require_positive(name: str, value: float, high: float) -> None:
    """0 < `value` <= `high`, and finite."""
    if not (math.isfinite(value) and 0.0 < value <= high):
        raise ScenarioError(f"{name} must be above 0 and at most {high:g}, got {value:g}")


def require_one_of(name: str, value: str, choices: Sequence[str]) -> None:
    if value not in choices:
        raise ScenarioError(f"{name} must be one of {', '.join(choices)}; got {value!r}")


def require_range(name: str, bounds: tuple[float, float], low: float, high: float) -> None:
    """An ascending pair inside [`low`, `high`]."""
    if len(bounds) != 2:
        raise ScenarioError(f"{name} must be two numbers [lowest, highest], got {list(bounds)}")
    for value in bounds:
        require_within(name, value, low, high)
    if bounds[0] > bounds[1]:
        raise ScenarioError(f"{name} must rise from lowest to highest, got {list(bounds)}")


def require_windows(name: str, windows: Sequence[tuple[float, float]]) -> None:
    """Spans of time [start, end] in seconds, in order and apart from each other, none after `LONGEST_S`."""
    before = 0.0
    for start, end in windows:
        if not before <= start < end <= LONGEST_S:
            raise ScenarioError(
                f"{name} must be spans [start, end] in rising order that do not touch, up to {LONGEST_S:g} "
                f"s, got [{start}, {end}] after {before:g} s"
            )
        before = end
