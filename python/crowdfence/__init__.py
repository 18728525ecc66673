"""Crowds seen by a fleet of drones -> a probabilistic crowd map on 3D terrain -> no-fly zones.

Importing this module needs numpy only; what reads, runs, evaluates and writes is imported on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from crowdfence._core import (
    Camera,
    CrowdColumns,
    CrowdMap,
    CrowdMass,
    Evidence,
    LikelihoodRatio,
    LinearPool,
    LogOdds,
    LogPool,
    MovingAverage,
    Observation,
    Or,
    Paper,
    Rates,
    Terrain,
    Update,
    View,
    VoxelKnowledge,
    __version__,
    blend,
    pool,
    project,
)
from crowdfence.errors import (
    CrowdfenceError,
    DetectorError,
    FrameError,
    MapFileError,
    StampError,
    ViewError,
)
from crowdfence.no_telemetry import refuse_telemetry
from crowdfence.voxel_state import VoxelState

refuse_telemetry()

if TYPE_CHECKING:
    from crowdfence.config import (
        EvidenceConfig,
        GroupingConfig,
        OrConfig,
        PaperConfig,
        ProjectionConfig,
        RunConfig,
        ZoneConfig,
    )
    from crowdfence.detector.contract.contract import Contract
    from crowdfence.detector.detector import Detector
    from crowdfence.evaluation.cells.rates import detector_rates
    from crowdfence.evaluation.iou import mean_iou
    from crowdfence.exports.geojson import write_geojson
    from crowdfence.exports.geotiff import write_geotiff
    from crowdfence.georeference import Georeference
    from crowdfence.landing_area import landing_prior
    from crowdfence.pipeline import FrameLoop, Run, Step, open_terrain
    from crowdfence.pipeline.run import run
    from crowdfence.planner import ClearAir, safe_route
    from crowdfence.results import write_results
    from crowdfence.service.client import Client
    from crowdfence.sources import open_recording
    from crowdfence.sources.recording import Recording
    from crowdfence.static_zones import open_static_zones
    from crowdfence.surface_grid import SurfaceGrid
    from crowdfence.zones import Zone, ZoneEngine, ZoneSet, find_zones, safety_distance_m
    from crowdfence.zones.history import ZoneHistory

__all__ = [
    "Camera",
    "ClearAir",
    "Client",
    "Contract",
    "CrowdColumns",
    "CrowdMap",
    "CrowdMass",
    "CrowdfenceError",
    "Detector",
    "DetectorError",
    "Evidence",
    "EvidenceConfig",
    "FrameError",
    "FrameLoop",
    "Georeference",
    "GroupingConfig",
    "LikelihoodRatio",
    "LinearPool",
    "LogOdds",
    "LogPool",
    "MapFileError",
    "MovingAverage",
    "Observation",
    "Or",
    "OrConfig",
    "Paper",
    "PaperConfig",
    "ProjectionConfig",
    "Rates",
    "Recording",
    "Run",
    "RunConfig",
    "StampError",
    "Step",
    "SurfaceGrid",
    "Terrain",
    "Update",
    "View",
    "ViewError",
    "VoxelKnowledge",
    "VoxelState",
    "Zone",
    "ZoneConfig",
    "ZoneEngine",
    "ZoneHistory",
    "ZoneSet",
    "__version__",
    "blend",
    "detector_rates",
    "find_zones",
    "landing_prior",
    "mean_iou",
    "open_recording",
    "open_static_zones",
    "open_terrain",
    "pool",
    "project",
    "run",
    "safe_route",
    "safety_distance_m",
    "write_geojson",
    "write_geotiff",
    "write_results",
]

_LAZY = {
    "ClearAir": "crowdfence.planner",
    "Client": "crowdfence.service.client",
    "Contract": "crowdfence.detector.contract.contract",
    "Detector": "crowdfence.detector.detector",
    "EvidenceConfig": "crowdfence.config",
    "FrameLoop": "crowdfence.pipeline",
    "Georeference": "crowdfence.georeference",
    "GroupingConfig": "crowdfence.config",
    "OrConfig": "crowdfence.config",
    "PaperConfig": "crowdfence.config",
    "ProjectionConfig": "crowdfence.config",
    "Recording": "crowdfence.sources.recording",
    "Run": "crowdfence.pipeline",
    "RunConfig": "crowdfence.config",
    "Step": "crowdfence.pipeline",
    "SurfaceGrid": "crowdfence.surface_grid",
    "Zone": "crowdfence.zones",
    "ZoneConfig": "crowdfence.config",
    "ZoneEngine": "crowdfence.zones",
    "ZoneHistory": "crowdfence.zones.history",
    "ZoneSet": "crowdfence.zones",
    "detector_rates": "crowdfence.evaluation.cells.rates",
    "find_zones": "crowdfence.zones",
    "landing_prior": "crowdfence.landing_area",
    "mean_iou": "crowdfence.evaluation.iou",
    "open_recording": "crowdfence.sources",
    "open_static_zones": "crowdfence.static_zones",
    "open_terrain": "crowdfence.pipeline",
    "run": "crowdfence.pipeline",
    "safe_route": "crowdfence.planner",
    "safety_distance_m": "crowdfence.zones",
    "write_geojson": "crowdfence.exports.geojson",
    "write_geotiff": "crowdfence.exports.geotiff",
    "write_results": "crowdfence.results",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'crowdfence' has no attribute {name!r}")
    value = getattr(import_module(_LAZY[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
