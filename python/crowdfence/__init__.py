"""Crowds seen by a fleet of drones -> a probabilistic crowd map on 3D terrain -> no-fly zones.

Importing this module needs numpy only; the readers, exports and evaluation below are imported on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from crowdfence._core import (
    Camera,
    CrowdMap,
    Observation,
    Or,
    Paper,
    Rates,
    Terrain,
    Update,
    View,
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
from crowdfence.voxel_state import VoxelState

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract
    from crowdfence.detector.detector import Detector
    from crowdfence.evaluation.cells.rates import detector_rates
    from crowdfence.evaluation.iou import mean_iou
    from crowdfence.georeference import Georeference
    from crowdfence.landing_area import landing_prior
    from crowdfence.sources import open_recording
    from crowdfence.sources.recording import Recording

__all__ = [
    "Camera",
    "Contract",
    "CrowdMap",
    "CrowdfenceError",
    "Detector",
    "DetectorError",
    "FrameError",
    "Georeference",
    "MapFileError",
    "Observation",
    "Or",
    "Paper",
    "Rates",
    "Recording",
    "StampError",
    "Terrain",
    "Update",
    "View",
    "ViewError",
    "VoxelState",
    "__version__",
    "blend",
    "detector_rates",
    "landing_prior",
    "mean_iou",
    "open_recording",
    "pool",
    "project",
]

_LAZY = {
    "Contract": "crowdfence.detector.contract.contract",
    "Detector": "crowdfence.detector.detector",
    "Georeference": "crowdfence.georeference",
    "Recording": "crowdfence.sources.recording",
    "detector_rates": "crowdfence.evaluation.cells.rates",
    "landing_prior": "crowdfence.landing_area",
    "mean_iou": "crowdfence.evaluation.iou",
    "open_recording": "crowdfence.sources",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'crowdfence' has no attribute {name!r}")
    value = getattr(import_module(_LAZY[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
