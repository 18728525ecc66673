"""How what the views say is fused: a fusion method with its parameters, or with what they are taken from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal

from crowdfence._core import Or, Paper, Rates, Terrain
from crowdfence.config.comparison import (
    LinearPoolConfig,
    LogOddsConfig,
    LogPoolConfig,
    MovingAverageConfig,
)
from crowdfence.config.evidence import EvidenceConfig
from crowdfence.config.rates import with_rates
from crowdfence.plain_values import make_plain

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract

UNDECIDED_PRIOR = 0.5
"""Prior on a map that is fit for landing everywhere or nowhere: as likely crowd as not."""


@dataclass(frozen=True, slots=True)
class PaperConfig:
    """Method `paper`; the defaults follow the paper. The core checks the values when it takes them."""

    name: ClassVar[Literal["paper"]] = "paper"

    true_positive_rate: float | None = None
    """P(B = 1 | A = 1) of the detector, inside (0, 1); None: what the detector states, or 0.9."""
    false_positive_rate: float | None = None
    """P(B = 1 | A = 0), inside (0, 1) and below the other; None: what the detector states, or 0.02."""
    prior: float | None = None
    """P(A = 1), inside (0, 1); None: the share of the terrain that is suitable for landing, or 0.5 where
    that is all of it or nothing."""
    b_threshold: float = 0.5
    """A view calls a voxel crowd when its mean heatmap value is above this."""
    fleet_size: int | None = None
    """N of equation 1; None: the drones of the recording."""
    unseen: Literal["fleet", "visible"] = "fleet"
    """What drones that do not see a voxel say: m = 0 with full weight as printed, or nothing."""
    normalise: bool = False
    """Divide the weights of equation 2 by their sum."""
    alpha: float = 0.1
    """Weight of the newest instant in equation 3, in (0, 1]; 1 is the paper's Policy 1."""
    decay: float = 0.0005
    """lambda of equation 3, >= 0, per `decay_unit`."""
    decay_unit: Literal["second", "frame"] = "second"
    """What lambda counts: seconds, or instants."""
    initial: Literal["zero", "prior", "first"] = "zero"
    """P~ before the first look; "first" takes the first look whole."""

    def __post_init__(self) -> None:
        make_plain(self)

    @property
    def rates_given(self) -> bool:
        """Whether the detector's own rates are overruled."""
        return self.true_positive_rate is not None and self.false_positive_rate is not None

    def with_detector(self, contract: Contract | None) -> PaperConfig:
        """The same with rates: the given ones, else those of the contract, else the defaults.

        ValueError when the contract states a rate that equation 1 cannot use.
        """
        true_positive, false_positive = with_rates(
            self.true_positive_rate, self.false_positive_rate, contract
        )
        return replace(self, true_positive_rate=true_positive, false_positive_rate=false_positive)

    def with_terrain(self, terrain: Terrain) -> tuple[PaperConfig, tuple[str, ...]]:
        """The same with a prior, and what is doubtful about it: the given one, else the share of the terrain
        that is suitable for landing, else `UNDECIDED_PRIOR`."""
        if self.prior is not None:
            return self, ()
        prior, doubts = _landing_prior(terrain)
        return replace(self, prior=prior), doubts

    def fusion_method(self, terrain: Terrain, drones: int) -> Paper:
        """The method for a fleet of `drones`. What is left to the detector has its default; call
        `with_detector` before where there is one. ValueError for values out of bounds."""
        complete = self.with_detector(None).with_terrain(terrain)[0]
        assert complete.true_positive_rate is not None and complete.false_positive_rate is not None
        assert complete.prior is not None
        return Paper(
            Rates(complete.true_positive_rate, complete.false_positive_rate),
            complete.prior,
            alpha=self.alpha,
            decay=self.decay,
            fleet_size=drones if self.fleet_size is None else self.fleet_size,
            b_threshold=self.b_threshold,
            unseen=self.unseen,
            normalise=self.normalise,
            initial=self.initial,
            decay_unit=self.decay_unit,
        )


@dataclass(frozen=True, slots=True)
class OrConfig:
    """Baseline `or`."""

    name: ClassVar[Literal["or"]] = "or"

    b_threshold: float = 0.5
    """A view calls a voxel crowd when its mean heatmap value is above this."""

    def __post_init__(self) -> None:
        make_plain(self)

    @property
    def rates_given(self) -> bool:
        """`or` needs no rates."""
        return True

    def with_detector(self, contract: Contract | None) -> OrConfig:
        """The same: nothing is left to a detector."""
        return self

    def with_terrain(self, terrain: Terrain) -> tuple[OrConfig, tuple[str, ...]]:
        """The same: nothing is left to the terrain."""
        return self, ()

    def fusion_method(self, terrain: Terrain, drones: int) -> Or:
        """The method. ValueError for a threshold out of bounds."""
        return Or(b_threshold=self.b_threshold)


ComparisonConfig = LinearPoolConfig | LogPoolConfig | LogOddsConfig | MovingAverageConfig
MethodConfig = EvidenceConfig | PaperConfig | OrConfig | ComparisonConfig


def _landing_prior(terrain: Terrain) -> tuple[float, tuple[str, ...]]:
    from crowdfence.landing_area import landing_prior

    try:
        return landing_prior(terrain), ()
    except ValueError as error:
        doubt = f"prior {UNDECIDED_PRIOR:g}, because the map gives none (set it with --prior): {error}"
        return UNDECIDED_PRIOR, (doubt,)
