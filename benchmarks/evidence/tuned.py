"""Every method with what was found for it on training missions (`tune.py`, `tune_pools.py`): its parameters,
its threshold for zones and the one for the IoU. `paper` stands here as published, with what closes little for
its people and with what has the best IoU, `or` with the last two."""

from __future__ import annotations

from typing import NamedTuple

from crowdfence.config import (
    EvidenceConfig,
    LinearPoolConfig,
    LogOddsConfig,
    LogPoolConfig,
    MethodConfig,
    MovingAverageConfig,
    OrConfig,
    PaperConfig,
)


class Tuned(NamedTuple):
    name: str
    method: MethodConfig
    iou_threshold: float
    zone_threshold: float | None = None
    """None: the method's own."""


PUBLISHED = Tuned("paper, as published", PaperConfig(), 0.06)
TUNED = (
    Tuned("evidence", EvidenceConfig(), 0.095),
    Tuned("paper, tuned for people", PaperConfig(prior=0.015), 0.044, 0.02),
    Tuned(
        "paper, tuned for mIoU",
        PaperConfig(prior=0.005, b_threshold=0.9, alpha=0.3, decay=0.0),
        0.006,
        0.006,
    ),
    Tuned("or, tuned for people", OrConfig(b_threshold=0.8), 0.5),
    Tuned("or, tuned for mIoU", OrConfig(b_threshold=0.9), 0.5),
)
POOLS = (
    Tuned("linear-pool", LinearPoolConfig(prior=0.2, b_threshold=0.7, alpha=0.1, decay=0.005), 0.243),
    Tuned("log-pool", LogPoolConfig(alpha=0.3, decay=0.005), 0.243),
    Tuned("log-odds", LogOddsConfig(prior=0.015, b_threshold=0.7), 0.388),
    Tuned("moving-average", MovingAverageConfig(prior=0.005, memory_s=5.0), 0.178),
)
