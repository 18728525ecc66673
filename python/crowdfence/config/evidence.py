"""Method `evidence` with its parameters, or with what they are taken from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import exp, log, sqrt
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from crowdfence._core import Evidence, LikelihoodRatio, Terrain
from crowdfence.plain_values import make_plain

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract

DEFAULT_PRIOR = 0.015
"""Share of the ground met by pixels that crowds stand on, in the shipped detector's calibration missions."""
DEFAULT_FOCAL_PX = 376.0
"""Of the cameras of those missions."""
FURTHEST_LOG_ODDS = 12.0
"""So far from the prior log odds end, whatever was seen (`MOST_EVIDENCE` of the core)."""

_MEAN_BORDERS = (0.005, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98)
_LOG_RATIO = (-4.1, -0.9, 0.5, 1.3, 1.9, 2.4, 2.9, 3.3, 3.8, 4.1, 4.5, 5.0, 5.7, 6.5, 8.2)
"""ln P(m | crowd) / P(m | no crowd) of the shipped detector over all distances and tilts: what a detector
is taken for that states nothing. Of the voxels that rays of pixels met: over all in view, far ground, which
is most of it, would make every look as vague as one from afar."""
_MOST_EXPONENT = 700.0
"""No float holds exp of more than 709."""
_MOST = f"{FURTHEST_LOG_ODDS:g}"
_NO_FURTHER = "no number of looks goes further from the prior"


@dataclass(frozen=True, slots=True)
class EvidenceConfig:
    """Method `evidence`. The defaults are those of `benchmarks/evidence/tune.py`; what it measured stands in
    `benchmarks/evidence/README.md`. The core checks the values when it takes them."""

    name: ClassVar[Literal["evidence"]] = "evidence"
    b_threshold: ClassVar[float] = 0.5
    """Pixels above this show crowd, where crowd that meets no ground is counted. It decides nothing else."""
    likelihood: LikelihoodRatio | None = None
    """How strongly a look speaks for crowd; None: what the detector's calibration measured, or the shipped
    one's."""
    prior: float | None = None
    """P(A = 1) where nobody has looked, inside (0, 1); None: the share in the detector's calibration, or
    0.015."""
    focal_px: float | None = None
    """Focal length of the calibration's cameras; None: the detector's. It stands in for that of views that do
    not say theirs, and a look of a finer camera weighs as one of theirs, or as 1.5 times as fine where it
    shows crowd: poses are off in degrees, however fine the picture. It says what such a look says, unless the
    likelihood knows finer cameras."""
    memory_s: float = 5.0
    """After so many seconds a look weighs 1 / e of what it did."""
    sharp_gsd_m: float = 0.15
    """Metres per pixel up to which a look has its full weight; a coarser one has as much less as it has
    fewer pixels on the same ground."""
    doubt: float = 0.2
    """Sharp looks that the prior stands against."""
    agreement: float = 0.1
    """How far drones know something of their own: 0 = more of them only average, 1 = they add up."""
    zone_log_odds: float = 1.1
    """Ground is crowd from this far above the prior, in log odds, at most 12, unless a threshold is given."""
    clear_log_odds: float = 2.5
    """Ground is empty from this far below the prior, in (0, 12]; between the two it is looked at and not
    cleared."""
    from_below: Literal["for", "against"] | None = None
    """Which looks from below the top of a place count: those that speak for the class, as none that shows
    there clears nothing, or those against it. None: against a layer that opens ground, else for."""

    def __post_init__(self) -> None:
        make_plain(self)

    @property
    def rates_given(self) -> bool:
        """Whether the detector's own calibration is overruled."""
        return self.likelihood is not None

    def with_detector(self, contract: Contract | None) -> EvidenceConfig:
        """The same with likelihood, prior and focal length: the given ones, else those of the contract,
        else the shipped detector's. ValueError when the contract states a table that cannot be used."""
        rates = {} if contract is None else contract.rates or {}
        stated = None if contract is None or "likelihood_ratio" not in rates else _stated(contract)
        return replace(
            self,
            likelihood=self.likelihood or stated or _shipped_over_all(),
            prior=_share_of_crowd(rates) if self.prior is None else self.prior,
            focal_px=calibration_focal_px(contract) if self.focal_px is None else self.focal_px,
        )

    def with_terrain(self, terrain: Terrain) -> tuple[EvidenceConfig, tuple[str, ...]]:
        """The same: nothing is left to the terrain."""
        return self, ()

    def fusion_method(self, terrain: Terrain, drones: int) -> Evidence:
        """The method. What is left to the detector has its default; call `with_detector` before where
        there is one. ValueError for values out of bounds."""
        complete = self.with_detector(None)
        assert complete.likelihood and complete.prior is not None and complete.focal_px is not None
        threshold = above(complete.prior, zone_log_odds=self.zone_log_odds)
        cleared = below(complete.prior, clear_log_odds=self.clear_log_odds)
        if not -self.clear_log_odds < self.zone_log_odds:
            raise ValueError(
                f"zone_log_odds is {self.zone_log_odds:g}; it must be above {-self.clear_log_odds:g}, from "
                "which on ground is empty (clear_log_odds)"
            )
        return Evidence(
            complete.likelihood,
            prior=complete.prior,
            memory_s=self.memory_s,
            sharp_gsd_m=self.sharp_gsd_m,
            doubt=self.doubt,
            agreement=self.agreement,
            threshold=threshold,
            cleared=cleared,
            focal_px=complete.focal_px,
            from_below=self.from_below or "for",
        )


def above(prior: float, *, zone_log_odds: float) -> float:
    """The probability that lies so far above the prior, or below it where that is negative. ValueError for a
    distance out of bounds; a prior outside (0, 1) is left to the core to refuse."""
    if not -FURTHEST_LOG_ODDS <= zone_log_odds <= FURTHEST_LOG_ODDS:
        raise ValueError(
            f"zone_log_odds is {zone_log_odds:g}; it must be in [-{_MOST}, {_MOST}]: {_NO_FURTHER}"
        )
    return _shifted(prior, zone_log_odds)


def below(prior: float, *, clear_log_odds: float) -> float:
    """The probability that lies so far below the prior; errors as of `above`."""
    if not 0.0 < clear_log_odds <= FURTHEST_LOG_ODDS:
        raise ValueError(f"clear_log_odds is {clear_log_odds:g}; it must be in (0, {_MOST}]: {_NO_FURTHER}")
    return _shifted(prior, -clear_log_odds)


def _shifted(prior: float, log_odds: float) -> float:
    if not 0.0 < prior < 1.0:
        return prior
    against = -(log(prior / (1.0 - prior)) + log_odds)
    return 1.0 / (1.0 + exp(min(against, _MOST_EXPONENT)))


@cache
def _shipped_over_all() -> LikelihoodRatio:
    return LikelihoodRatio([], [], _MEAN_BORDERS, [[_LOG_RATIO]])


def _stated(contract: Contract) -> LikelihoodRatio:
    """The table of a contract, whose distances become metres per pixel of the cameras that it was measured
    with, and beside it that of finer ones, if there is one."""
    assert contract.rates is not None
    focal_px, finer = calibration_focal_px(contract), contract.finer_cameras
    try:
        table = _by_gsd(contract.rates["likelihood_ratio"], focal_px)
        if finer is None:
            return table
        beside = finer.focal_px / focal_px, _by_gsd(finer.likelihood_ratio, finer.focal_px)
        return LikelihoodRatio(table.gsd_m, table.tilt_deg, table.mean, table.log_ratio, beside)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"the detector's likelihood_ratio cannot be used: {error}") from error


def _by_gsd(table: dict[str, Any], focal_px: float) -> LikelihoodRatio:
    inner = {name: np.asarray(table[name], np.float32)[1:-1] for name in ("distance_m", "tilt_deg", "mean")}
    log_ratio = np.asarray(table["log10_ratio"], np.float32) * np.float32(log(10.0))
    return LikelihoodRatio(inner["distance_m"] / focal_px, inner["tilt_deg"], inner["mean"], log_ratio)


def _share_of_crowd(rates: dict[str, Any]) -> float:
    crowd, empty = rates.get("crowd_observations"), rates.get("empty_observations")
    return crowd / (crowd + empty) if crowd and empty else DEFAULT_PRIOR


def calibration_focal_px(contract: Contract | None) -> float:
    """Of the cameras of its calibration: a contract states the ranges of distances and of metres per pixel
    that it was tested in, whose ratio it is."""
    validity = None if contract is None else contract.validity
    if validity is None or validity.distance_m is None or validity.gsd_m is None:
        return DEFAULT_FOCAL_PX
    near_m, far_m = validity.distance_m
    fine_m, coarse_m = validity.gsd_m
    usable = min(near_m, far_m, fine_m, coarse_m) > 0.0
    return sqrt(near_m * far_m / (fine_m * coarse_m)) if usable else DEFAULT_FOCAL_PX
