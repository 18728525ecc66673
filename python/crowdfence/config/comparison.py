"""The methods that `evidence` is compared with, on the same engine; none of them is safe to fly by."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal, TypeVar

from crowdfence._core import LikelihoodRatio, LinearPool, LogOdds, LogPool, MovingAverage, Rates, Terrain
from crowdfence.config.evidence import EvidenceConfig, above
from crowdfence.config.rates import with_rates
from crowdfence.plain_values import make_plain

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract


_EVIDENCE = EvidenceConfig()
"""What reads the same calibration has the same defaults, so that the fusion alone differs."""
ConfigT = TypeVar("ConfigT", bound="_Config")


@dataclass(frozen=True, slots=True)
class _Config:
    """What all have in common."""

    def __post_init__(self) -> None:
        make_plain(self)

    def with_terrain(self: ConfigT, terrain: Terrain) -> tuple[ConfigT, tuple[str, ...]]:
        """The same: nothing is left to the terrain."""
        return self, ()


RatesT = TypeVar("RatesT", bound="_OfRates")


@dataclass(frozen=True, slots=True)
class _OfRates(_Config):
    """Of methods that ask whether a view calls a voxel crowd, and how often detectors are right then."""

    true_positive_rate: float | None = None
    """P(B = 1 | A = 1) of the detector, inside (0, 1); None: what the detector states, or 0.9."""
    false_positive_rate: float | None = None
    """P(B = 1 | A = 0), inside (0, 1) and below the other; None: what the detector states, or 0.02."""

    @property
    def rates_given(self) -> bool:
        """Whether the detector's own rates are overruled."""
        return self.true_positive_rate is not None and self.false_positive_rate is not None

    def with_detector(self: RatesT, contract: Contract | None) -> RatesT:
        """The same with rates: the given ones, else those of the contract, else the defaults. ValueError
        when the contract states a rate that cannot be used."""
        true_positive, false_positive = with_rates(
            self.true_positive_rate, self.false_positive_rate, contract
        )
        return replace(self, true_positive_rate=true_positive, false_positive_rate=false_positive)


CalibrationT = TypeVar("CalibrationT", bound="_OfCalibration")


@dataclass(frozen=True, slots=True)
class _OfCalibration(_Config):
    """Of methods that weigh a heatmap value by what the detector's calibration says of it."""

    b_threshold: ClassVar[float] = 0.5
    """As of `evidence`."""

    likelihood: LikelihoodRatio | None = None
    """How strongly a look speaks for crowd; None: as `evidence` has it."""
    prior: float | None = None
    """P(A = 1) where nobody has looked, inside (0, 1); None: as `evidence` has it."""
    focal_px: float | None = None
    """Focal length of the calibration's cameras; None: the detector's."""

    @property
    def rates_given(self) -> bool:
        """Whether the detector's own calibration is overruled."""
        return self.likelihood is not None

    def with_detector(self: CalibrationT, contract: Contract | None) -> CalibrationT:
        """The same with likelihood, prior and focal length, as `EvidenceConfig.with_detector`."""
        filled = EvidenceConfig(self.likelihood, self.prior, self.focal_px).with_detector(contract)
        return replace(self, likelihood=filled.likelihood, prior=filled.prior, focal_px=filled.focal_px)


@dataclass(frozen=True, slots=True)
class LinearPoolConfig(_OfRates):
    """Method `linear-pool`: the paper's equations with the drones that see a place alone, weights that sum
    to 1, and forgetting towards the prior. The core checks the values when it takes them."""

    name: ClassVar[Literal["linear-pool"]] = "linear-pool"

    prior: float | None = None
    """P(A = 1), inside (0, 1); None: the share in the detector's calibration, as `evidence` has it."""
    b_threshold: float = 0.5
    """A view calls a voxel crowd when its mean heatmap value is above this."""
    alpha: float = 0.1
    """Weight of the newest instant, in (0, 1]."""
    decay: float = 0.0005
    """lambda per second, >= 0."""

    def with_detector(self, contract: Contract | None) -> LinearPoolConfig:
        """The same with rates, and the prior of `EvidenceConfig.with_detector`."""
        prior = EvidenceConfig(prior=self.prior).with_detector(contract).prior
        return replace(_OfRates.with_detector(self, contract), prior=prior)

    def fusion_method(self, terrain: Terrain, drones: int) -> LinearPool:
        """The method. What is left to the detector has its default. ValueError for values out of bounds."""
        complete = self.with_detector(None)
        assert complete.true_positive_rate is not None and complete.false_positive_rate is not None
        assert complete.prior is not None
        return LinearPool(
            Rates(complete.true_positive_rate, complete.false_positive_rate),
            complete.prior,
            alpha=self.alpha,
            decay=self.decay,
            b_threshold=self.b_threshold,
        )


@dataclass(frozen=True, slots=True)
class LogPoolConfig(_OfCalibration):
    """Method `log-pool`: the mean of the drones' log likelihood ratios, blended as in equation 3."""

    name: ClassVar[Literal["log-pool"]] = "log-pool"

    alpha: float = 0.1
    """Weight of the newest instant, in (0, 1]."""
    decay: float = 0.0005
    """lambda per second, >= 0."""
    zone_log_odds: float = _EVIDENCE.zone_log_odds
    """Ground is crowd from this far above the prior, in log odds, at most 12, unless a threshold is given."""

    def fusion_method(self, terrain: Terrain, drones: int) -> LogPool:
        """The method. What is left to the detector has its default. ValueError for values out of bounds."""
        complete = self.with_detector(None)
        assert complete.likelihood and complete.prior is not None and complete.focal_px is not None
        return LogPool(
            complete.likelihood,
            prior=complete.prior,
            alpha=self.alpha,
            decay=self.decay,
            threshold=above(complete.prior, zone_log_odds=self.zone_log_odds),
            focal_px=complete.focal_px,
        )


@dataclass(frozen=True, slots=True)
class LogOddsConfig(_OfRates):
    """Method `log-odds`: every look adds to the log odds, between two clamps, as in OctoMap, whose prior and
    clamps are the defaults."""

    name: ClassVar[Literal["log-odds"]] = "log-odds"

    prior: float | None = None
    """P(A = 1), inside (0, 1); None: 0.5."""
    b_threshold: float = 0.5
    """A view calls a voxel crowd when its mean heatmap value is above this."""
    clamp_low: float = -2.0
    """Lowest log odds, below 0."""
    clamp_high: float = 3.5
    """Highest log odds, above 0."""

    def fusion_method(self, terrain: Terrain, drones: int) -> LogOdds:
        """The method. What is left to the detector has its default. ValueError for values out of bounds."""
        complete = self.with_detector(None)
        assert complete.true_positive_rate is not None and complete.false_positive_rate is not None
        return LogOdds(
            Rates(complete.true_positive_rate, complete.false_positive_rate),
            0.5 if self.prior is None else self.prior,
            b_threshold=self.b_threshold,
            clamp_low=self.clamp_low,
            clamp_high=self.clamp_high,
        )


@dataclass(frozen=True, slots=True)
class MovingAverageConfig(_OfCalibration):
    """Method `moving-average`: the mean of the calibrated scores of all looks, which fade with their age."""

    name: ClassVar[Literal["moving-average"]] = "moving-average"

    memory_s: float = _EVIDENCE.memory_s
    """After so many seconds a look weighs 1 / e of what it did."""
    zone_log_odds: float = _EVIDENCE.zone_log_odds
    """Ground is crowd from this far above the prior, in log odds, at most 12, unless a threshold is given."""

    def fusion_method(self, terrain: Terrain, drones: int) -> MovingAverage:
        """The method. What is left to the detector has its default. ValueError for values out of bounds."""
        complete = self.with_detector(None)
        assert complete.likelihood and complete.prior is not None and complete.focal_px is not None
        return MovingAverage(
            complete.likelihood,
            prior=complete.prior,
            memory_s=self.memory_s,
            threshold=above(complete.prior, zone_log_odds=self.zone_log_odds),
            focal_px=complete.focal_px,
        )
