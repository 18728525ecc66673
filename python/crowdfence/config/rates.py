"""The detector's rates, for the methods that only ask whether a view calls a voxel crowd."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract

DEFAULT_TRUE_POSITIVE_RATE = 0.9
DEFAULT_FALSE_POSITIVE_RATE = 0.02
"""What a run uses where neither its configuration nor its detector says anything."""


def with_rates(
    true_positive: float | None, false_positive: float | None, contract: Contract | None
) -> tuple[float, float]:
    """The given rates, else those of the contract, else the defaults. ValueError when the contract states
    one that Bayes' rule cannot use."""
    if true_positive is None:
        true_positive = _stated(contract, "true_positive", DEFAULT_TRUE_POSITIVE_RATE)
    if false_positive is None:
        false_positive = _stated(contract, "false_positive", DEFAULT_FALSE_POSITIVE_RATE)
    return true_positive, false_positive


def _stated(
    contract: Contract | None, name: Literal["true_positive", "false_positive"], default: float
) -> float:
    estimate = None if contract is None else (contract.rates or {}).get(name)
    if estimate is None:
        return default
    rate = float(estimate["rate"])
    if not 0.0 < rate < 1.0:
        raise ValueError(
            f"the detector states a {name}_rate of {rate:g}; equation 1 needs one strictly between 0 and 1: "
            "give your own (--tpr, --fpr)"
        )
    return rate
