"""One typed configuration of a run, complete by default."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Literal

from crowdfence._core import CrowdMap, Or, Paper, Rates, Terrain

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract

FigureName = Literal["true_positive_rate", "false_positive_rate", "target_height_m"]

UNSTATED: dict[FigureName, float] = {
    "true_positive_rate": 0.9,
    "false_positive_rate": 0.02,
    "target_height_m": 0.0,
}
"""What a run uses where neither its configuration nor its detector says anything."""


@dataclass(frozen=True, slots=True)
class RunConfig:
    """How a recording is fused. The defaults follow the paper.

    What the core uses is checked there; what is used after the last frame is checked here, before the first.
    """

    method: Literal["paper", "or"] = "paper"

    true_positive_rate: float | None = None
    """P(B = 1 | A = 1) of the detector, inside (0, 1); None: what the detector states, or 0.9."""
    false_positive_rate: float | None = None
    """P(B = 1 | A = 0), inside (0, 1); None: what the detector states, or 0.02."""
    prior: float | None = None
    """P(A = 1), inside (0, 1); None: the share of the terrain that is suitable for landing."""
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
    decay_per_s: float = 0.0005
    """lambda of equation 3, >= 0, per `decay_unit`."""
    decay_unit: Literal["second", "frame"] = "second"
    initial: Literal["zero", "prior", "first"] = "zero"
    """P~ before the first look; "first" takes the first look whole."""

    max_range_m: float = 300.0
    """Rays end here."""
    target_height_m: float | None = None
    """Height above the ground at which people are marked; None: the detector's own, or 0 (the paper)."""
    coverage: Literal["rays", "full"] = "rays"
    """Voxels hit by pixel rays only, as in the paper, or also those that pixels step over."""

    tolerance_ms: float = 100.0
    """Frames of different drones this close in time form one instant."""

    threshold: float | None = None
    """Probability from which ground is crowd; None: the method's own (`CrowdMap.default_threshold`)."""
    min_area_m2: float = 0.0
    """Smaller regions are dropped from the zones, and counted."""
    stale_after_s: float = 30.0
    """Empty ground not seen for longer is stale: no evidence of absence any more."""

    def __post_init__(self) -> None:
        if self.threshold is not None and not 0.0 < self.threshold <= 1.0:
            raise ValueError(f"threshold is {self.threshold:g}; it must be in (0, 1]")
        for name in ("min_area_m2", "stale_after_s"):
            value = getattr(self, name)
            if not value >= 0.0:
                raise ValueError(f"{name} is {value:g}; it must be >= 0")

    def with_detector(self, contract: Contract | None) -> RunConfig:
        """The same with what is left to the detector filled in: from its contract, else `UNSTATED`.

        ValueError when the contract states a rate that equation 1 cannot use.
        """
        return replace(
            self,
            true_positive_rate=self._chosen("true_positive_rate", contract),
            false_positive_rate=self._chosen("false_positive_rate", contract),
            target_height_m=self._chosen("target_height_m", contract),
        )

    def used(self, name: FigureName) -> float:
        """The value, or the one of `UNSTATED` where it is left to a detector."""
        return self._chosen(name, None)

    def _chosen(self, name: FigureName, contract: Contract | None) -> float:
        given: float | None = getattr(self, name)
        if given is not None:
            return given
        stated = None if contract is None else _stated(contract, name)
        if stated is None:
            return UNSTATED[name]
        if name != "target_height_m" and self.method == "paper" and not 0.0 < stated < 1.0:
            raise ValueError(
                f"the detector states a {name} of {stated:g}; equation 1 needs one strictly between 0 and 1: "
                "give your own (--tpr, --fpr)"
            )
        return stated

    def crowd_map(self, terrain: Terrain, drones: int) -> CrowdMap:
        """An empty crowd map on a terrain for a fleet of `drones`. What is left to the detector is taken from
        `UNSTATED`; call `with_detector` before where there is one. ValueError for values out of bounds."""
        return CrowdMap(
            terrain,
            self._method(terrain, drones if self.fleet_size is None else self.fleet_size),
            max_range_m=self.max_range_m,
            target_height_m=self.used("target_height_m"),
            coverage=self.coverage,
        )

    def _method(self, terrain: Terrain, fleet_size: int) -> Paper | Or:
        if self.method == "or":
            return Or(fleet_size=fleet_size, b_threshold=self.b_threshold)
        if self.method != "paper":
            raise ValueError(f'method is {self.method!r}; it must be "paper" or "or"')
        return Paper(
            Rates(self.used("true_positive_rate"), self.used("false_positive_rate")),
            _landing_prior(terrain) if self.prior is None else self.prior,
            alpha=self.alpha,
            decay_per_s=self.decay_per_s,
            fleet_size=fleet_size,
            b_threshold=self.b_threshold,
            unseen=self.unseen,
            normalise=self.normalise,
            initial=self.initial,
            decay_unit=self.decay_unit,
        )

    def parameters(self, crowd_map: CrowdMap) -> dict[str, str | int | float | bool]:
        """What the run really used, for files that explain themselves."""
        used = {name: value for name, value in asdict(self).items() if name not in _OF_ZONES}
        used.update({name: self.used(name) for name in UNSTATED})
        used["fleet_size"] = crowd_map.method.fleet_size
        if isinstance(crowd_map.method, Paper):
            used["prior"] = crowd_map.method.prior
        else:
            used = {name: value for name, value in used.items() if name not in _OF_PAPER}
        return used


def _stated(contract: Contract, name: FigureName) -> float | None:
    if name == "target_height_m":
        return contract.target_height_m
    estimate = (contract.rates or {}).get(name.removesuffix("_rate"))
    return None if estimate is None else float(estimate["rate"])


_OF_ZONES = ("method", "threshold", "min_area_m2", "stale_after_s")
_OF_PAPER = (
    "true_positive_rate",
    "false_positive_rate",
    "prior",
    "unseen",
    "normalise",
    "alpha",
    "decay_per_s",
    "decay_unit",
    "initial",
)


def _landing_prior(terrain: Terrain) -> float:
    from crowdfence.landing_area import landing_prior

    try:
        return landing_prior(terrain)
    except ValueError as error:
        raise ValueError(f"no prior can be taken from this terrain: {error}") from error
