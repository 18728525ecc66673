"""Every knob of every method, turned one at a time."""

from dataclasses import fields
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from crowdfence.config import (
    EvidenceConfig,
    LinearPoolConfig,
    LogOddsConfig,
    LogPoolConfig,
    MethodConfig,
    MovingAverageConfig,
    OrConfig,
    PaperConfig,
    RunConfig,
)
from crowdfence.evaluation.knobs import KNOBS, Turned, turned, turns
from crowdfence.evaluation.replay import score
from crowdfence.pipeline import open_terrain
from crowdfence.sources import open_recording

DEMO = Path(__file__).parents[2] / "python" / "crowdfence" / "demo_data" / "race.mcap"
# What a detector or a layer says of itself, and thresholds, which are swept anyway.
NO_KNOBS = {
    "likelihood",
    "focal_px",
    "true_positive_rate",
    "false_positive_rate",
    "fleet_size",
    "decay_unit",
    "zone_log_odds",
    "clear_log_odds",
    "from_below",
}


@pytest.mark.parametrize("kind", get_args(MethodConfig))
def test_every_knob_of_every_method_is_turned(kind: type) -> None:
    own = {field.name for field in fields(kind)} - NO_KNOBS
    if kind in (EvidenceConfig, LogPoolConfig):
        own.remove("prior")  # moves the log odds of all places alike, which a threshold undoes
    if kind is OrConfig:
        own.remove("b_threshold")  # its threshold
    assert set(KNOBS[kind]) == own


@pytest.mark.parametrize("kind", get_args(MethodConfig))
def test_one_knob_at_a_time_and_never_to_where_it_is(kind: type) -> None:
    for turn in turns(kind()):
        changed = {
            field.name
            for field in fields(kind)
            if getattr(turn.method, field.name) != getattr(kind(), field.name)
        }
        assert changed == {turn.knob} and getattr(turn.method, turn.knob) == turn.value


def test_the_best_value_of_a_knob() -> None:
    assert Turned("alpha", [(0.1, 0.3), (0.3, 0.5), (1.0, 0.4)]).best == (0.3, 0.5)
    assert Turned("alpha", [(0.1, float("nan")), (0.3, 0.0)]).best == (0.3, 0.0)


def test_a_turn_scores_like_the_method_itself() -> None:
    """Beside another method or alone, an IoU is the same; own values stand among those that were tried."""
    recording = open_recording(DEMO)
    terrain = open_terrain(recording)
    own = LogPoolConfig(alpha=0.2)
    asked = [turn for turn in turns(own) if turn.knob == "alpha"][:2]
    found = score(
        recording,
        terrain,
        [RunConfig(own), RunConfig(MovingAverageConfig())],
        truth="world",
        swept=[RunConfig(turn.method) for turn in asked],
    )
    rows, swept = found.rows, found.swept
    alone = score(recording, terrain, [RunConfig(asked[0].method)], truth="world").rows[0]
    np.testing.assert_array_equal(swept[0].sweep.per_frame, alone.sweep.per_frame)
    assert swept[0].safety is None and rows[1].safety is not None
    (alpha,) = [one for one in turned(rows[0], list(zip(asked, swept, strict=True))) if one.knob == "alpha"]
    assert (0.2, rows[0].sweep.best()[1].mean) in alpha.values
    assert (asked[0].value, swept[0].sweep.best()[1].mean) in alpha.values
    assert {LinearPoolConfig, PaperConfig, LogOddsConfig} <= set(KNOBS)
