"""What a run is told: one typed configuration in its natural parts, complete by default."""

from crowdfence.config.comparison import (
    LinearPoolConfig,
    LogOddsConfig,
    LogPoolConfig,
    MovingAverageConfig,
)
from crowdfence.config.evidence import EvidenceConfig
from crowdfence.config.grouping import GroupingConfig
from crowdfence.config.method import MethodConfig, OrConfig, PaperConfig
from crowdfence.config.projection import ProjectionConfig
from crowdfence.config.run import RunConfig
from crowdfence.config.zones import ZoneConfig

__all__ = [
    "EvidenceConfig",
    "GroupingConfig",
    "LinearPoolConfig",
    "LogOddsConfig",
    "LogPoolConfig",
    "MethodConfig",
    "MovingAverageConfig",
    "OrConfig",
    "PaperConfig",
    "ProjectionConfig",
    "RunConfig",
    "ZoneConfig",
]
