"""Methods on the bundled recording, which knows where everybody stood."""

from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from crowdfence._core import Terrain
from crowdfence.config import EvidenceConfig, OrConfig, PaperConfig, RunConfig, ZoneConfig
from crowdfence.evaluation.beside_map import beside_map_warning, nobody_on_map_warning
from crowdfence.evaluation.iou import IouAccumulator
from crowdfence.evaluation.replay import Scores, TruthKind, score, unrecorded_warning
from crowdfence.evaluation.untold_truth import UntoldTruth
from crowdfence.pipeline import heatmap_source, open_terrain, run
from crowdfence.pipeline.frame_loop import FrameLoop
from crowdfence.sources import Recording, open_recording
from crowdfence.sources.recorded_truth import RecordedPeople
from crowdfence.truth.over_time import CrowdsOfTheWorld

DEMO = Path(__file__).parents[2] / "python" / "crowdfence" / "demo_data" / "race.mcap"
STRICT = 0.9


def race() -> Recording:
    """Every third instant of the bundled recording: what holds here holds of few of them."""
    whole = open_recording(DEMO)
    kept = islice(whole.instants(RunConfig(EvidenceConfig()).grouping.tolerance_ms), 0, None, 3)
    return replace(whole, frames=tuple(frame for instant in kept for frame in instant.frames))


@cache
def race_ground() -> Terrain:
    return open_terrain(open_recording(DEMO))


@pytest.fixture(scope="module")
def scores() -> Scores:
    """With the heatmaps of the simulated detector."""
    recording = race()
    methods = (EvidenceConfig(), PaperConfig(), OrConfig(), OrConfig(b_threshold=STRICT))
    return score(recording, race_ground(), [RunConfig(one) for one in methods], truth="world")


def test_the_knob_of_or_is_its_b_threshold(scores: Scores) -> None:
    """One map tells what `or` would say at every other knob."""
    *_, usual, strict = scores.rows
    assert usual.sweep.at(STRICT).mean == strict.iou.mean
    assert strict.sweep.at(0.5).mean == usual.iou.mean
    assert usual.iou.mean != strict.iou.mean


@pytest.mark.parametrize("b_threshold", [0.0, 0.5])
def test_the_score_of_or_is_that_of_its_map(b_threshold: float) -> None:
    """With masks of 0 and 1 many voxels have a mean of exactly one half, which is not above one half."""
    recording = race()
    terrain = race_ground()
    masks = heatmap_source(
        lambda frame: (np.asarray(frame.heatmap()) > 127).astype(np.uint8) * np.uint8(255), None, 300.0
    )
    config = RunConfig(OrConfig(b_threshold=b_threshold)).with_layer("crowd", None).with_detector(None)
    (row,) = score(recording, terrain, [config], masks, truth="world").rows
    crowd_map = config.crowd_map(terrain, len(recording.drones), max_gap_s=float("inf"))
    loop, truth = FrameLoop(crowd_map, config.zones, closes=False), CrowdsOfTheWorld(recording, terrain)
    by_hand = IouAccumulator()
    for instant, found in masks.detected(recording.instants(config.grouping.tolerance_ms), 3):
        loop.integrate(found.views, instant.stamp_ns)
        ids, probability = crowd_map.seen_probability(instant.stamp_ns)
        seen, called = (np.zeros(terrain.voxel_count, np.bool_) for _ in range(2))
        seen[ids], called[ids] = True, probability >= row.threshold
        by_hand.update(called, truth.at(instant), seen)
    assert row.iou.mean == pytest.approx(by_hand.result().mean, abs=1e-12)


def test_people_are_counted_once_and_larger_buffers_hold_more_of_them(scores: Scores) -> None:
    people = set()
    for row in scores.rows:
        assert row.safety is not None
        people.add((row.safety.people, row.safety.people_in_range))
        assert (np.diff(row.safety.share_in_zone) >= 0.0).all()
        assert (np.diff(row.safety.blocked_m2) >= 0.0).all()
        assert 0.0 <= row.safety.share_on_empty <= 1.0 - row.safety.share_in_zone[0]
    # Without a detector nothing says in which range it was tested: any look counts.
    ((everybody, in_range),) = people
    assert everybody == in_range > 100


def test_nobody_in_a_region_too_small_for_a_zone_counts_as_in_one() -> None:
    """The least area is that of a run's zones; the largest crowd of the race has some 100 m2."""
    everything, large, none = (
        score(
            race(),
            race_ground(),
            [RunConfig(EvidenceConfig(), zones=ZoneConfig(min_area_m2=least))],
            truth="world",
        )
        .rows[0]
        .safety
        for least in (0.0, 50.0, 1e6)
    )
    assert everything is not None and large is not None and none is not None
    assert everything.in_zone[0] > large.in_zone[0] > 0
    assert everything.closed_m2[0] > large.closed_m2[0] > 0.0
    assert none.in_zone.tolist() == [0] * len(none.in_zone) and none.closed_m2[0] == 0.0
    assert everything.people == large.people == none.people


def test_evidence_calls_less_ground_of_crowds_empty_than_the_others(scores: Scores) -> None:
    evidence, paper, either, _ = (row.safety for row in scores.rows)
    assert evidence is not None and paper is not None and either is not None
    assert evidence.share_on_empty < 0.1 * min(paper.share_on_empty, either.share_on_empty)


@pytest.mark.parametrize("truth", ["world", "projected"])
def test_instants_without_recorded_people_are_left_out_and_told(truth: TruthKind) -> None:
    """People are kept of the instants in the first third alone: those within 0.25 s of the last of them are
    the last that count."""
    whole = race()
    stamps_ns = list(whole.people.stamps_ns)[: len(whole.people.stamps_ns) // 3]
    recording = replace(whole, people=replace(whole.people, stamps_ns=stamps_ns))
    config = RunConfig(EvidenceConfig())
    terrain = race_ground()
    exposures = [one.frames[-1].exposure_ns() for one in recording.instants(config.grouping.tolerance_ms)]
    known = [min(abs(one - stamp) for stamp in stamps_ns) <= 250_000_000 for one in exposures]
    assert 0 < sum(known) < len(known)
    found = score(recording, terrain, [config], truth=truth)
    (row,) = found.rows
    stamps_ns = [one.stamp_ns for one in recording.instants(config.grouping.tolerance_ms)]
    told_ns = [one for one, is_known in zip(stamps_ns, known, strict=True) if is_known or truth != "world"]
    assert list(found.stamps_ns) == told_ns and len(row.iou.per_frame) == len(told_ns)
    assert row.safety is not None and row.safety.people > 0
    told = unrecorded_warning(recording, config.grouping.tolerance_ms, truth)
    assert told is not None and f"of {len(known) - sum(known)} of {len(known)} instants" in told
    assert unrecorded_warning(whole, config.grouping.tolerance_ms, truth) is None

    another_clock = replace(whole, people=replace(whole.people, stamps_ns=[17]))
    if truth == "world":
        with pytest.raises(ValueError, match=r"at no time within 0.25 s of an exposure"):
            score(another_clock, terrain, [config], truth=truth)
    else:
        assert score(another_clock, terrain, [config], truth=truth).rows[0].safety is None


def test_people_beside_the_map_are_in_no_figure_and_told(scores: Scores) -> None:
    """One walker of a crowd who left the map ended the evaluation."""
    whole = race()
    terrain, config = race_ground(), RunConfig(EvidenceConfig())
    tolerance_ms = config.grouping.tolerance_ms
    assert beside_map_warning(whole, terrain, tolerance_ms) is None

    def moved(by_m: float, every: int) -> Recording:
        """Everybody, or every second, that far east."""

        def read(stamp_ns: int) -> RecordedPeople:
            people = whole.people_truth(stamp_ns)
            assert people is not None
            position = people.position.copy()
            position[::every, 0] += by_m
            return replace(people, position=position)

        return replace(whole, people=replace(whole.people, read=read))

    some = moved(5000.0, 2)
    told = beside_map_warning(some, terrain, tolerance_ms)
    assert told is not None and "instants people of crowds stand beside the map, up to" in told
    (row,) = score(some, terrain, [config], truth="world").rows
    assert row.safety is not None and scores.rows[0].safety is not None
    assert 0 < row.safety.people < scores.rows[0].safety.people
    with pytest.raises(ValueError, match=r"all people of crowds in race stand beside the map .* check frame"):
        beside_map_warning(moved(50_000.0, 1), terrain, tolerance_ms)


def test_people_in_centimetres_are_told_to_be_beside_the_map() -> None:
    """A hundred times as far apart they are no crowd, of which alone it was told: every method scored 0."""
    whole = race()

    def read(stamp_ns: int) -> RecordedPeople:
        people = whole.people_truth(stamp_ns)
        assert people is not None
        return replace(people, position=people.position * 100 + np.float32(50_000.0))

    other = replace(whole, people=replace(whole.people, read=read))
    told = beside_map_warning(other, race_ground(), RunConfig(EvidenceConfig()).grouping.tolerance_ms)
    assert told is not None and "everybody recorded in race stands beside the map at all times" in told
    nobody = replace(whole, people=replace(whole.people, stamps_ns=()))
    assert nobody_on_map_warning(nobody, race_ground()) is None


def test_crowd_that_a_method_closes_nothing_for_is_told_of_that_method(scores: Scores) -> None:
    recording = race()
    methods = (EvidenceConfig(), EvidenceConfig(zone_log_odds=9.0))
    found = score(
        recording,
        race_ground(),
        [RunConfig(one) for one in methods],
        truth="world",
        swept=[RunConfig(EvidenceConfig(zone_log_odds=12.0))],
    )
    usual, strict = found.rows
    assert [*usual.unheeded, *scores.rows[0].unheeded, *found.swept[0].unheeded] == []
    (told,) = strict.unheeded
    assert "s after the first instant every look of" in told and "nothing is closed for it" in told
    assert run(recording, race_ground(), RunConfig(methods[1])).unheeded == strict.unheeded


def _damaged(what: str, every: int) -> Recording:
    """The bundled recording, of which every so many frames cannot tell their truth, from the last on."""
    whole = race()

    def nothing(*_: object) -> NoReturn:
        raise ValueError("it is cut off")

    if what == "people":
        damaged_ns = set(list(whole.people.stamps_ns)[::every])

        def read(stamp_ns: int) -> RecordedPeople:
            people = nothing() if stamp_ns in damaged_ns else whole.people_truth(stamp_ns)
            assert people is not None
            return people

        return replace(whole, people=replace(whole.people, read=read))
    frames = list(whole.frames)
    for number in range(len(frames) - 1, -1, -every):
        one = frames[number]
        if what == "labels":
            frames[number] = replace(one, pixels=replace(one.pixels, regions=nothing))
        else:
            frames[number] = replace(one, truth=replace(one.truth, exposure_ns=None))
    return replace(whole, frames=tuple(frames))


@pytest.mark.parametrize("truth", ["world", "projected"])
@pytest.mark.parametrize(
    ("what", "why"),
    [
        ("time", "has no true time"),
        ("labels", "crowd regions cannot be read: it is cut off"),
        ("people", "people of the world cannot be read: it is cut off"),
    ],
)
def test_a_frame_whose_truth_cannot_be_told_is_left_out_and_told(
    scores: Scores, truth: TruthKind, what: str, why: str
) -> None:
    """One of them ended the whole evaluation."""
    config, untold = RunConfig(EvidenceConfig()), UntoldTruth()
    recording = _damaged(what, 15)
    found = score(recording, race_ground(), [config], truth=truth, untold=untold)
    (row,) = found.rows
    assert row.safety is not None and scores.rows[0].safety is not None
    assert row.safety.people == scores.rows[0].safety.people or what == "people"
    lost = len(scores.rows[0].iou.per_frame) - len(row.iou.per_frame)
    assert lost == (2 if what == "people" and truth == "world" else 0)
    if what == "labels" and truth == "world":  # they are asked for by nobody here
        assert untold.warnings == []
        return
    (told,) = untold.warnings
    assert " frames (uav" in told and ", the first: frame of uav" in told and why in told


@pytest.mark.parametrize("truth", ["world", "projected"])
def test_where_no_frame_can_be_used_there_is_nothing_to_judge(truth: TruthKind) -> None:
    """It was told that nobody of a crowd stood on ground in view, as of a mission without crowds."""
    recording = race()
    frames = [replace(one, pixels=replace(one.pixels, heatmap=None)) for one in recording.frames]
    blind = replace(recording, frames=tuple(frames))
    with pytest.raises(ValueError, match="race.*has no heatmap"):
        score(blind, race_ground(), [RunConfig(EvidenceConfig())], truth=truth)


def test_no_configuration_is_nothing_to_score() -> None:
    """It was an IndexError."""
    recording = race()
    with pytest.raises(ValueError, match="configs is empty: give a RunConfig"):
        score(recording, race_ground(), [])


@pytest.mark.parametrize(("what", "truth"), [("time", "world"), ("people", "world"), ("labels", "projected")])
def test_where_no_frame_tells_its_truth_there_is_nothing_to_judge(what: str, truth: TruthKind) -> None:
    recording = _damaged(what, 1)
    with pytest.raises(ValueError, match=r"the truth of race can be told of no frame: frame of uav"):
        score(recording, race_ground(), [RunConfig(EvidenceConfig())], truth=truth)
