"""What a layer of heatmaps starts from where nobody says otherwise: its base rate, and how strongly a look
speaks for its class."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from crowdfence._core import LikelihoodRatio
from crowdfence.config.comparison import LinearPoolConfig, LogPoolConfig, MovingAverageConfig
from crowdfence.config.evidence import EvidenceConfig, above
from crowdfence.config.method import MethodConfig, PaperConfig
from crowdfence.sources.layers import CROWD, LANDING_SITE
from crowdfence.zones.sites import FIT_FROM

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract

PRIORS = {LANDING_SITE: 0.25}
"""Share of the ground in view that is of the class, where it was measured (`benchmarks/layers/calibrate.py`);
of landing sites the mean of missions between .07 (a street) and .68 (a field)."""
UNKNOWN_PRIOR = 0.5

_OPENING = (LANDING_SITE,)
"""Layers whose class opens ground: what is dangerous to overlook is that it is not there."""

_BY_CALIBRATION = (EvidenceConfig, LogPoolConfig, MovingAverageConfig)
"""Methods that weigh looks by what values of the detector are worth, above and below a prior."""

BORDERS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98)
"""Where one bin of the mean value of a voxel ends and the next begins."""
_LOG_RATIOS = {
    LANDING_SITE: (-1.9, -1.3, -1.0, -0.7, -0.4, -0.1, 0.2, 0.4, 0.6, 1.0, 1.5, 2.1, 2.5, 3.2),
}
"""ln P(m | class) / P(m | not) by the mean value m of a voxel, where it was measured: with the simulator's
stand-in for a detector, whose mistakes at places make it less sure than it says."""
_AS_IT_SAYS = (-4.6, -3.3, -2.5, -1.7, -1.1, -0.6, -0.2, 0.2, 0.6, 1.1, 1.7, 2.5, 3.3, 4.6)
"""The logit of the middle of each bin: heatmaps that mean what they say where both are equally likely."""


def with_layer(method: MethodConfig, layer: str, contract: Contract | None = None) -> MethodConfig:
    """The method with what it leaves open filled in for a layer; that of crowds is left to the detector.

    Methods that weigh looks by their calibration take the one of the layer, or values at their word, unless
    the contract of the detector states one. The prior is the share of the layer's class, or 1/2; `paper`
    keeps its own, the share of the terrain that is fit for landing."""
    if layer == CROWD or not isinstance(method, _BY_CALIBRATION):
        return method
    if isinstance(method, EvidenceConfig) and layer in _OPENING and method.from_below is None:
        method = replace(method, from_below="against")
    if contract is not None and "likelihood_ratio" in (contract.rates or {}):
        return method
    return replace(
        method,
        likelihood=method.likelihood or likelihood_of(layer),
        prior=PRIORS.get(layer, UNKNOWN_PRIOR) if method.prior is None else method.prior,
    )


def least_threshold(method: MethodConfig, layer: str, contract: Contract | None = None) -> float | None:
    """The threshold of landing sites where the method's own is low, and rounded towards landing: that of
    `paper` and `linear-pool` is met by what one drone of several is sure of, that of methods which go by a
    calibration lies so far above the prior, which may be small. None for others, and for other layers."""
    own_is_low = isinstance(method, PaperConfig | LinearPoolConfig)
    if layer == LANDING_SITE and isinstance(method, _BY_CALIBRATION):
        prior = method.with_detector(contract).prior
        assert prior is not None
        own_is_low = above(prior, zone_log_odds=method.zone_log_odds) < FIT_FROM
    return FIT_FROM if layer == LANDING_SITE and own_is_low else None


def low_threshold_doubt(method: MethodConfig, threshold: float | None, layer: str) -> str | None:
    """What is doubtful about a threshold that somebody gave for landing sites, of a method with its prior
    filled in; None for others."""
    if layer != LANDING_SITE or threshold is None or not isinstance(method, _BY_CALIBRATION):
        return None
    assert method.prior is not None
    if threshold >= method.prior:
        return None
    return (
        f"the threshold {threshold:g} of landing sites is below the prior {method.prior:g}, where looks say "
        "nothing: ground that they speak against may be a site"
    )


@cache
def likelihood_of(layer: str) -> LikelihoodRatio:
    """How strongly a look speaks for the class of a layer."""
    return LikelihoodRatio([], [], BORDERS, [[_LOG_RATIOS.get(layer, _AS_IT_SAYS)]])
