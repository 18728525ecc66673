"""Rates per voxel observation: counts by hand, detectors with known rates, a recording on a plane."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import beta

from crowdfence import Camera, Terrain
from crowdfence.errors import FrameError
from crowdfence.evaluation.statistics.isotonic import pool_adjacent_violators
from crowdfence.evaluation.statistics.observed_range import ObservedRange
from crowdfence.evaluation.voxels.labelled_projection import LabelledObservation, LabelledProjection
from crowdfence.evaluation.voxels.likelihood_ratio import BORROWED, likelihood_ratio
from crowdfence.evaluation.voxels.rates import ProjectionSettings, VoxelRateCounter
from crowdfence.sources.fleet import joined
from crowdfence.sources.recorded_truth import FrameTruth, PeopleLog, RecordedPeople
from crowdfence.sources.recording import Frame, PixelSources, Recording
from crowdfence.truth.at_exposure import crowd_definition

BINS = {"distance_edges_m": (0.0, 50.0, 100.0), "tilt_edges_deg": (0.0, 45.0, 90.0)}


def observation(
    mean: list[float] | NDArray[np.float64],
    crowd: list[int] | NDArray[np.bool_],
    *,
    distance_m: float = 20.0,
    near_edge: list[int] | None = None,
) -> LabelledObservation:
    count = len(mean)
    return LabelledObservation(
        np.arange(count),
        np.asarray(mean, np.float64),
        np.asarray(crowd, np.bool_),
        np.asarray(near_edge or [0] * count, np.bool_),
        np.full(count, distance_m),
        np.full(count, 30.0),
        np.full(count, distance_m / 400.0),
        0,
    )


def test_rates_of_ten_observations_by_hand() -> None:
    """Crowd: 3 of 4 above 0.5 -> 3.5 / 5. Empty: 1 of 6 -> 1.5 / 7. One mission: Jeffreys alone."""
    counter = VoxelRateCounter(**BINS)
    mean = [0.9, 0.8, 0.6, 0.5, 0.7, 0.5, 0.1, 0.0, 0.0, 0.0]
    counter.add(observation(mean, [1] * 4 + [0] * 6, near_edge=[1] + [0] * 9), "a")
    result = counter.result(resamples=10)
    assert (result.missions, result.crowd_observations, result.empty_observations) == (1, 4, 6)
    tpr, fpr = result.rates
    assert tuple(tpr) == pytest.approx((3.5 / 5, *beta(3.5, 1.5).ppf([0.025, 0.975])))
    assert tuple(fpr) == pytest.approx((1.5 / 7, *beta(1.5, 5.5).ppf([0.025, 0.975])))
    assert result.away_from_edges.true_positive.value == pytest.approx(2.5 / 4)
    assert result.by_distance[0].true_positive == tpr
    assert np.isnan(result.by_distance[1].true_positive).all()
    assert result.by_tilt[0].false_positive == fpr


def test_missions_that_differ_widen_the_interval() -> None:
    """Two missions of 10 000 crowd voxels: all found, none found. Jeffreys alone would say 0.49 to 0.51."""
    counter = VoxelRateCounter(**BINS)
    for mission, value in (("a", 1.0), ("b", 0.0)):
        counter.add(observation(np.full(20_000, value), np.arange(20_000) < 10_000), mission)
    tpr = counter.result(resamples=200).rates.true_positive
    assert tpr.value == pytest.approx(0.5)
    assert tpr.low < 0.001 and tpr.high > 0.999


@pytest.mark.parametrize(("tpr", "fpr"), [(0.9, 0.02), (0.6, 0.2)])
def test_a_detector_with_known_rates_is_measured(tpr: float, fpr: float) -> None:
    """A detector that says 0.95 or 0.05, right with known rates: the rates and the two likelihood ratios,
    tpr / fpr and (1 - tpr) / (1 - fpr), come out."""
    rng = np.random.default_rng(0)
    counter = VoxelRateCounter(**BINS, mean_edges=(0.0, 0.5, 1.0))
    for mission in range(8):
        crowd = rng.random(20_000) < 0.3
        called = rng.random(20_000) < np.where(crowd, tpr, fpr)
        counter.add(observation(np.where(called, 0.95, 0.05), crowd), f"mission {mission}")
    result = counter.result(resamples=200)
    for measured, true in zip(result.rates, (tpr, fpr), strict=True):
        assert measured.value == pytest.approx(true, abs=0.01)
        assert measured.low < true < measured.high
    table = result.likelihood_ratio
    expected = np.log10([(1.0 - tpr) / (1.0 - fpr), tpr / fpr])
    np.testing.assert_allclose(table.log10_ratio[0, 0], expected, atol=0.05)
    assert (table.low[0, 0] <= expected).all() and (expected <= table.high[0, 0]).all()
    assert table.monotone[0, 0]
    # Nothing was seen at other distances and tilts: they follow what was.
    np.testing.assert_allclose(
        table.log10_ratio, np.broadcast_to(expected, table.log10_ratio.shape), atol=0.05
    )
    assert table.crowd[1].sum() == table.empty[1].sum() == 0
    assert table.high[1, 1, 0] - table.low[1, 1, 0] > table.high[0, 0, 0] - table.low[0, 0, 0]


def test_borrowing_by_hand() -> None:
    """One distance, one tilt, two bins of m. Crowd 2 and 6, empty 9 and 1. Overall shares 2.5 / 9, 6.5 / 9,
    9.5 / 11 and 1.5 / 11; the only distance adds BORROWED of those and a half to its counts, the only cell
    does so again."""
    counts = np.array([[[[[9, 2], [1, 6]]]]])
    table = likelihood_ratio(counts, [0, 1], [0, 1], [0, 0.5, 1])
    overall = np.array([[9.5 / 11, 2.5 / 9], [1.5 / 11, 6.5 / 9]])
    counted = counts[0, 0, 0]
    distance = (counted + BORROWED * overall + 0.5) / (counted.sum(axis=0) + BORROWED + 1.0)
    cell = (counted + BORROWED * distance + 0.5) / (counted.sum(axis=0) + BORROWED + 1.0)
    np.testing.assert_allclose(table.log10_ratio[0, 0], np.log10(cell[:, 1] / cell[:, 0]))
    np.testing.assert_allclose(table.all_log10_ratio, np.log10(overall[:, 1] / overall[:, 0]))


def test_never_seen_is_not_impossible() -> None:
    """A million empty looks without a single one in the upper bin, and crowd always in it: at distances
    that were never looked at, the ratio stays within what the borrowed thousand can say."""
    counts = np.zeros((3, 2, 1, 2, 2))
    counts[:, 0, 0] = [[1e6, 0], [0, 1e4]]
    table = likelihood_ratio(counts, [0, 1, 2], [0, 1], [0, 0.5, 1])
    assert 5.0 < table.log10_ratio[0, 0, 1] < 7.0
    assert 3.0 < table.log10_ratio[1, 0, 1] < 3.5
    assert np.isfinite(table.low).all() and np.abs(table.high).max() < 10.0


def test_what_the_data_contradict_is_not_forced_to_increase() -> None:
    """Many looks in several missions that say the opposite of the order stay as counted; few looks do not."""
    falling = np.array([[10_000, 90_000], [90_000, 10_000]])
    sure = likelihood_ratio(np.broadcast_to(falling, (5, 1, 1, 2, 2)), [0, 1], [0, 1], [0, 0.5, 1])
    assert not sure.monotone[0, 0]
    np.testing.assert_allclose(sure.log10_ratio[0, 0], [np.log10(9), -np.log10(9)], atol=0.01)
    few = likelihood_ratio(
        np.broadcast_to([[11, 12], [12, 11]], (1, 1, 1, 2, 2)), [0, 1], [0, 1], [0, 0.5, 1]
    )
    assert few.monotone[0, 0]
    np.testing.assert_allclose(few.log10_ratio[0, 0], 0.0, atol=0.01)


@given(st.lists(st.tuples(st.integers(1, 50), st.integers(1, 50)), min_size=1, max_size=12))
def test_pooled_ratios_increase_and_keep_the_counts(bins: list[tuple[int, int]]) -> None:
    up, down = np.array(bins, float).T
    pooled_up, pooled_down = pool_adjacent_violators(up, down)
    assert (np.diff(pooled_up / pooled_down) >= -1e-12).all()
    assert pooled_up.sum() == pytest.approx(up.sum()) and pooled_down.sum() == pytest.approx(down.sum())
    if (np.diff(up / down) > 0.0).all():
        np.testing.assert_array_equal(pooled_up, up)


def test_pooled_ratios_by_hand() -> None:
    """1/1 and 1/3 fall, together 2/4; the third, 4/1, is above it already."""
    pooled_up, pooled_down = pool_adjacent_violators([1, 1, 4], [1, 3, 1])
    np.testing.assert_allclose(pooled_up, [1, 1, 4])
    np.testing.assert_allclose(pooled_down, [2, 2, 1])


def test_the_json_of_a_contract() -> None:
    counter = VoxelRateCounter(**BINS)
    rng = np.random.default_rng(1)
    for mission in "abc":
        crowd = rng.random(500) < 0.4
        counter.add(observation(rng.beta(np.where(crowd, 4, 1), np.where(crowd, 1, 4)), crowd), mission)
    result = counter.result(resamples=50)
    document = json.loads(json.dumps(result.to_json(ProjectionSettings(0.5, 0.9, 150.0)), allow_nan=False))
    assert document["per"] == "voxel observation"
    assert (document["b_threshold"], document["voxel_size_m"], document["coverage"]) == (0.5, 0.5, "full")
    for name in ("true_positive", "false_positive"):
        rate = document[name]
        assert 0.0 < rate["low"] < rate["rate"] < rate["high"] < 1.0
    table = document["likelihood_ratio"]
    shape = (len(table["distance_m"]) - 1, len(table["tilt_deg"]) - 1, len(table["mean"]) - 1)
    for name in ("log10_ratio", "low", "high", "crowd", "empty"):
        assert np.shape(table[name]) == shape
    assert np.sum(table["crowd"]) + np.sum(table["empty"]) == 1500
    assert result.validity["tilt_deg"] == [30.0, 31.0]


def test_nothing_measured_is_an_error() -> None:
    counter = VoxelRateCounter(**BINS)
    with pytest.raises(ValueError, match="no observations"):
        counter.result()
    counter.add(observation([0.1, 0.2], [0, 0]), "a")
    with pytest.raises(ValueError, match="no crowd voxel among 2 observations"):
        counter.result()
    with pytest.raises(ValueError, match="mean_edges must run from 0 to 1"):
        VoxelRateCounter(mean_edges=(0.1, 1.0))
    with pytest.raises(ValueError, match="a: mean heatmap values"):
        counter.add(observation([1.5], [1]), "a")


@given(st.lists(st.floats(0.0, 9.99), min_size=1, max_size=200))
def test_the_middle_holds_its_share(values: list[float]) -> None:
    spread = ObservedRange(np.arange(0.0, 11.0))
    spread.add(np.array(values))
    low, high = spread.middle(0.8) or (np.nan, np.nan)
    inside = np.count_nonzero((np.array(values) >= low) & (np.array(values) < high))
    assert inside >= 0.8 * len(values)
    assert ObservedRange(np.arange(3.0)).middle() is None


# A camera 20 m above a plane at z = 0, looking straight down: voxel (i, j) of 1 m fills 5 x 5 pixels exactly.
SIDE, HEIGHT_M, FOCAL = 20, 20.0, 100.0
CROWD_FEET = np.array([[5.8, 5.8, 0.0], [6.2, 5.8, 0.0], [5.8, 6.2, 0.0], [6.2, 6.2, 0.0], [15.5, 15.5, 0.0]])


def plane() -> Terrain:
    return Terrain.from_height_map(np.zeros((SIDE, SIDE)), 1.0)


def looking_down(label: NDArray[np.bool_] | None = None) -> Frame:
    camera = Camera.pinhole(100, 100, FOCAL, FOCAL, 50.0, 50.0)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = 10.0, 10.0, HEIGHT_M
    regions = None if label is None else lambda: label.astype(np.uint8)
    return Frame("a", 1000, camera, pose, PixelSources(regions=regions))


def recording(frame: Frame, feet: NDArray[np.float64] | None = None) -> Recording:
    people = PeopleLog()
    if feet is not None:
        count = len(feet)
        world = RecordedPeople(
            1000,
            feet.astype(np.float32),
            np.arange(1, count + 1, dtype=np.uint32),
            np.zeros(count, np.uint32),
        )
        people = PeopleLog([1000], lambda _: world)
    return Recording("plane", ("a",), (frame,), None, None, (), (), {}, {}, people)


def on_the_plane(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heatmap [100, 100] of one value per voxel [east, north]; image rows run south."""
    return np.kron(values.T[::-1], np.ones((5, 5)))


def with_exposure(frame: Frame) -> Frame:
    return replace(frame, truth=FrameTruth(exposure_ns=lambda: 1000))


def test_observations_of_a_plane_match_where_people_stand() -> None:
    """Four people around the corner of voxels 5 and 6 make a crowd on those four voxels; one alone at 15
    does not. Edge: the four crowd voxels and the twelve around them."""
    frame = with_exposure(looking_down())
    values = np.zeros((SIDE, SIDE))
    values[5:7, 5] = 1.0  # finds half of the crowd
    values[15, 15] = 1.0  # and calls one person a crowd
    seen = LabelledProjection(
        recording(frame, CROWD_FEET), plane(), target_height_m=0.0, max_range_m=100.0
    ).observe(frame, on_the_plane(values).astype(np.float32))
    assert len(seen.voxel_ids) == SIDE * SIDE and seen.excluded == 0
    i, j, _ = plane().voxel_indices(seen.voxel_ids).T
    np.testing.assert_allclose(seen.mean, values[i, j], atol=1e-6)
    np.testing.assert_array_equal(seen.crowd, ((i == 5) | (i == 6)) & ((j == 5) | (j == 6)))
    np.testing.assert_array_equal(seen.near_edge, (i >= 4) & (i <= 7) & (j >= 4) & (j <= 7))
    below = (i == 10) & (j == 10)
    to_centre = np.sqrt(0.5**2 + 0.5**2 + 19.5**2)  # ground at 0 lies in voxels from 0 to 1
    assert seen.distance_m[below] == pytest.approx(to_centre)
    assert seen.tilt_deg[below] == pytest.approx(np.degrees(np.arcsin(19.5 / to_centre)))
    assert seen.gsd_m[below] == pytest.approx(to_centre / FOCAL)


def test_rates_of_a_recording_with_world_truth() -> None:
    """2 of 4 crowd voxels found, 1 of 396 others called crowd."""
    frame = with_exposure(looking_down())
    values = np.zeros((SIDE, SIDE))
    values[5:7, 5] = values[15, 15] = 1.0
    source = recording(frame, CROWD_FEET)
    projection = LabelledProjection(source, plane(), target_height_m=0.0, max_range_m=100.0)
    counter = VoxelRateCounter()
    counter.add(projection.observe(frame, on_the_plane(values).astype(np.float32)), "one mission")
    result = counter.result()
    assert (result.crowd_observations, result.empty_observations) == (4, 396)
    assert result.rates.true_positive.value == pytest.approx(2.5 / 5)
    assert result.rates.false_positive.value == pytest.approx(1.5 / 397)


def test_labels_are_the_truth_where_nobody_was_recorded() -> None:
    label = on_the_plane(np.eye(SIDE)) > 0
    ignore = np.zeros((100, 100), np.bool_)
    ignore[0, 0] = True  # one pixel of the north-west voxel
    frame = looking_down(label)
    projection = LabelledProjection(
        recording(frame), plane(), target_height_m=0.0, max_range_m=100.0, ignore_of=lambda _: ignore
    )
    assert projection.truth == "labels"
    seen = projection.observe(frame, np.zeros((25, 25), np.uint8))
    i, j, _ = plane().voxel_indices(seen.voxel_ids).T
    assert seen.excluded == 1 and not ((i == 0) & (j == SIDE - 1)).any()
    np.testing.assert_array_equal(seen.crowd, i == j)


def test_frames_without_truth_are_refused_with_their_reason() -> None:
    frame = looking_down(np.zeros((100, 100), np.bool_))
    source = recording(frame, CROWD_FEET)  # the world is recorded, but not when the frame was exposed
    projection = LabelledProjection(source, plane(), target_height_m=0.0, max_range_m=99.0)
    with pytest.raises(FrameError, match="has no true time"):
        projection.observe(frame, np.zeros((4, 4)))
    with pytest.raises(ValueError, match="does not record where people are"):
        LabelledProjection(recording(frame), plane(), target_height_m=0.0, max_range_m=99.0, truth="world")
    labelled = LabelledProjection(recording(frame), plane(), target_height_m=0.0, max_range_m=99.0)
    with pytest.raises(FrameError, match="frame of a at 1000"):
        labelled.observe(frame, np.full((4, 4), np.nan))


def test_a_world_log_that_ends_too_early_refuses_the_frame() -> None:
    late = replace(looking_down(), truth=FrameTruth(exposure_ns=lambda: 2_000_000_000))
    projection = LabelledProjection(
        recording(late, CROWD_FEET), plane(), target_height_m=0.0, max_range_m=99.0
    )
    with pytest.raises(FrameError, match="nobody's position is recorded within"):
        projection.observe(late, np.zeros((4, 4)))


def test_the_definition_of_a_crowd_is_the_recordings() -> None:
    simulated = {"simulation": {"scenario": {"crowd_definition": {"min_people": 5, "radius_m": 1.5}}}}
    assert crowd_definition(simulated) == {"radius_m": 1.5, "min_people": 5}
    assert crowd_definition({"kind": "folder"}) == {"radius_m": 2.0, "min_people": 3}
    # Of the drones of one simulation in files of their own too: they fell back to three people within 2 m.
    one = Recording("a", ("a",), (), None, None, (), (), simulated, {})
    fleet = joined([one, replace(one, name="b", drones=("b",))])
    assert crowd_definition(fleet.manifest) == {"radius_m": 1.5, "min_people": 5}
