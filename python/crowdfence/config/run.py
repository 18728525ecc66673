"""The whole configuration of a run."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, get_args

from crowdfence._core import CrowdMap, LikelihoodRatio, Terrain
from crowdfence.config.evidence import EvidenceConfig
from crowdfence.config.grouping import GroupingConfig
from crowdfence.config.layer import least_threshold, with_layer
from crowdfence.config.method import MethodConfig
from crowdfence.config.projection import ProjectionConfig
from crowdfence.config.zones import ZoneConfig
from crowdfence.errors import quoted

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract

_PARTS: dict[str, tuple[type, ...]] = {
    "method": get_args(MethodConfig),
    "projection": (ProjectionConfig,),
    "grouping": (GroupingConfig,),
    "zones": (ZoneConfig,),
}


@dataclass(frozen=True, slots=True)
class RunConfig:
    """How a recording is fused; complete by default."""

    method: MethodConfig = field(default_factory=EvidenceConfig)
    projection: ProjectionConfig = field(default_factory=ProjectionConfig)
    grouping: GroupingConfig = field(default_factory=GroupingConfig)
    zones: ZoneConfig = field(default_factory=ZoneConfig)

    def __post_init__(self) -> None:
        """TypeError for a part that is none."""
        for name, kinds in _PARTS.items():
            if not isinstance(given := getattr(self, name), kinds):
                such = f"such as {kinds[0].__name__}()"
                raise TypeError(f"{name} of a RunConfig is {quoted(given)}; it must be {such}")

    @property
    def whole_looks(self) -> bool:
        """Whether every look must take in all of its picture: all methods but `evidence` compare what the
        drones say of a place at the same instant, and to some a drone that does not see it says empty."""
        return not isinstance(self.method, EvidenceConfig)

    def with_detector(self, contract: Contract | None) -> RunConfig:
        """The same with what is left to the detector filled in: from its contract, else by default.

        ValueError when the contract states a rate that equation 1 cannot use.
        """
        return replace(
            self,
            method=self.method.with_detector(contract),
            projection=self.projection.with_detector(contract),
        )

    def with_layer(self, layer: str, contract: Contract | None = None) -> RunConfig:
        """The same with what a layer of another class than crowd starts from filled in, unless a detector's
        contract says it (`config.layer`); to be called before `with_detector`."""
        method = with_layer(self.method, layer, contract)
        least = least_threshold(method, layer, contract)
        zones = self.zones if least is None or self.zones.threshold else replace(self.zones, threshold=least)
        return replace(self, method=method, zones=zones)

    def with_terrain(self, terrain: Terrain) -> tuple[RunConfig, tuple[str, ...]]:
        """The same with what is left to the terrain (the prior of `paper`) filled in, and what is doubtful
        about that, one sentence each."""
        method, doubts = self.method.with_terrain(terrain)
        return replace(self, method=method), doubts

    def crowd_map(self, terrain: Terrain, drones: int, *, max_gap_s: float = 3600.0) -> CrowdMap:
        """An empty crowd map on a terrain for a fleet of `drones`. What is left to the detector has its
        default; call `with_detector` before where there is one. ValueError for values out of bounds.

        `max_gap_s`: longest time between two instants; whoever has judged the clocks before raises it."""
        projection = self.projection.with_detector(None)
        assert projection.target_height_m is not None
        return CrowdMap(
            terrain,
            self.method.fusion_method(terrain, drones),
            max_range_m=projection.max_range_m,
            target_height_m=projection.target_height_m,
            coverage=projection.coverage,
            surface=projection.surface,
            max_gap_s=max_gap_s,
        )

    def parameters(self, crowd_map: CrowdMap) -> dict[str, str | int | float | bool]:
        """What the run really used, for files that explain themselves: the method's own parameters, then how
        views were projected and grouped."""
        return {
            **crowd_map.method.parameters,
            "max_range_m": crowd_map.max_range_m,
            "target_height_m": crowd_map.target_height_m,
            "coverage": crowd_map.coverage,
            "surface": crowd_map.surface,
            "tolerance_ms": self.grouping.tolerance_ms,
        }

    def zone_parameters(
        self, default_threshold: float | None = None
    ) -> dict[str, str | int | float | bool | None]:
        """How zones were drawn, for files that explain themselves; an area without bound is None. Thresholds
        that are left to the method are what follows from its `default_threshold`, where that is given."""
        least_area_m2 = self.zones.least_area_m2(self.projection.coverage)
        told = {**asdict(self.zones), "min_area_m2": least_area_m2}
        if default_threshold is not None:
            rules = self.zones.rules(default_threshold)
            told |= {"threshold": rules.threshold, "off_threshold": rules.off_threshold}
        return {name: None if value == float("inf") else value for name, value in told.items()}

    def to_json(self) -> dict[str, Any]:
        """Every field by its name, ready for JSON."""
        parts = (self.method, self.projection, self.grouping, self.zones)
        fields = {name: _plain(value) for part in parts for name, value in asdict(part).items()}
        return {"method": self.method.name, **fields, **self.zone_parameters()}


def _plain(value: Any) -> Any:
    if not isinstance(value, LikelihoodRatio):
        return value
    table = {name: getattr(value, name).tolist() for name in ("gsd_m", "tilt_deg", "mean", "log_ratio")}
    return table if value.finer is None else {**table, "finer": [value.finer[0], _plain(value.finer[1])]}
