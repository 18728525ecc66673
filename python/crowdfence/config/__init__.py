"""What a run is told: one typed configuration in its natural parts, complete by default."""

from crowdfence.config.evidence import EvidenceConfig
from crowdfence.config.grouping import GroupingConfig
from crowdfence.config.method import MethodConfig, OrConfig, PaperConfig
from crowdfence.config.projection import ProjectionConfig
from crowdfence.config.run import RunConfig
from crowdfence.config.zones import ZoneConfig

__all__ = [
    "EvidenceConfig",
    "GroupingConfig",
    "MethodConfig",
    "OrConfig",
    "PaperConfig",
    "ProjectionConfig",
    "RunConfig",
    "ZoneConfig",
]
