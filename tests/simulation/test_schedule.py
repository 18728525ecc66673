"""Captures, clocks and telemetry: what goes wrong, how much of it, and that all of it is accounted for."""

import json
from dataclasses import asdict, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence.simulation.flight.gimbal import CAMERA_IN_BODY_M
from crowdfence.simulation.flight.telemetry import Telemetry
from crowdfence.simulation.scenarios.plans import TroublePlan
from crowdfence.simulation.scenarios.scenario import EPOCH_NS
from crowdfence.simulation.scene import Scene
from crowdfence.simulation.schedule import Capture, Schedule, build_schedule
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.rotation import multiply, rotation_matrix
from support.simulated_scenes import scene_of

PERFECT = TroublePlan()


def with_trouble(trouble: TroublePlan, frames: int = 100, name: str = "empty") -> Schedule:
    scene = scene_of(name)
    scenario = replace(scene.scenario, trouble=trouble, frames=frames)
    return build_schedule(replace(scene, scenario=scenario))


def captures(schedule: Schedule, drone: int = 0) -> list[Capture]:
    return list(schedule.captures(drone))


def angle_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between rotations given as quaternions [N, 4], from their matrices."""
    difference = np.einsum("nij,nij->n", rotation_matrix(a), rotation_matrix(b))
    return np.degrees(np.arccos(np.clip(0.5 * (difference - 1.0), -1.0, 1.0)))


def test_a_perfect_mission() -> None:
    schedule = with_trouble(PERFECT)
    for drone in range(3):
        taken = captures(schedule, drone)
        assert [c.frame for c in taken] == list(range(100))
        assert [c.stamp_ns for c in taken] == [EPOCH_NS + k * 100_000_000 for k in range(100)]
        assert not any(c.dropped or c.duplicate_of is not None or c.late_by_s for c in taken)
        rows = schedule.telemetry(drone)
        np.testing.assert_allclose(rows.noisy.camera_position, rows.true.camera_position, atol=1e-9)
        assert angle_deg(rows.noisy.camera_quaternion, rows.true.camera_quaternion).max() < 1e-5
        np.testing.assert_array_equal(np.diff(rows.stamps_ns), 20_000_000)


fractions = st.floats(0.0, 0.9)


@given(
    trouble=st.builds(
        TroublePlan,
        trigger_spread_ms=st.floats(0.0, 1000.0),
        clock_offset_ms=st.floats(0.0, 10_000.0),
        clock_jitter_ms=st.floats(0.0, 1000.0),
        dropped=fractions,
        duplicated=fractions,
        late=fractions,
        joins_s=st.one_of(st.just(()), st.tuples(st.tuples(st.just(0), st.floats(0.0, 120.0)))),
        leaves_s=st.one_of(st.just(()), st.tuples(st.tuples(st.just(0), st.floats(0.0, 120.0)))),
    ),
    frames=st.integers(1, 1100),
)
@settings(max_examples=50)
def test_every_frame_is_accounted_for(trouble: TroublePlan, frames: int) -> None:
    schedule = with_trouble(trouble, frames)
    taken = captures(schedule)
    stamps = [c.stamp_ns for c in taken]
    assert all(a < b for a, b in pairwise(stamps)), "stamps increase"
    joins, leaves = dict(trouble.joins_s).get(0, -np.inf), dict(trouble.leaves_s).get(0, np.inf)
    expected = [k for k in range(frames) if joins <= schedule.exposure_s(0, k) < leaves]
    assert [c.frame for c in taken] == expected
    whole = {c.frame for c in taken if not c.dropped and c.duplicate_of is None}
    for c in taken:
        assert c.arrival_ns >= c.stamp_ns
        if c.duplicate_of is not None:
            assert c.duplicate_of == c.frame - 1 and c.duplicate_of in whole and not c.dropped


@given(frames=st.integers(2, 1300))
@settings(max_examples=20)
def test_a_shorter_mission_is_the_beginning_of_a_longer_one(frames: int) -> None:
    trouble = TroublePlan(clock_jitter_ms=3, dropped=0.1, duplicated=0.1, late=0.1)
    longer = captures(with_trouble(trouble, 1300))
    assert captures(with_trouble(trouble, frames)) == longer[:frames]


def test_as_much_trouble_as_planned() -> None:
    """5000 frames: four standard deviations of a fraction of 10 % are 0.017."""
    trouble = TroublePlan(dropped=0.1, late=0.1, late_ms=250.0, clock_jitter_ms=5.0, duplicated=0.1)
    taken = captures(with_trouble(trouble, 5000))
    assert np.mean([c.dropped for c in taken]) == pytest.approx(0.1, abs=0.017)
    assert np.mean([c.late_by_s > 0 for c in taken]) == pytest.approx(0.1, abs=0.017)
    assert {c.late_by_s for c in taken} == {0.0, 0.25}
    # A frame is repeated only after one that arrived whole: 0.1 * (1 - 0.1 - 0.1) = 0.08.
    assert np.mean([c.duplicate_of is not None for c in taken]) == pytest.approx(0.08, abs=0.017)
    off_ms = np.array([(c.stamp_ns - EPOCH_NS) * 1e-6 - c.t_s * 1e3 for c in taken])
    assert off_ms.std() == pytest.approx(5.0, rel=0.05) and abs(off_ms.mean()) < 0.3


def test_clocks_of_the_drones_differ_but_each_is_one_clock() -> None:
    schedule = with_trouble(TroublePlan(clock_offset_ms=50.0, trigger_spread_ms=80.0))
    offsets = []
    for drone in range(3):
        first, rows = captures(schedule, drone)[0], schedule.telemetry(drone)
        offsets.append((first.stamp_ns - EPOCH_NS) * 1e-9 - first.t_s)
        np.testing.assert_allclose((rows.stamps_ns - EPOCH_NS) * 1e-9 - rows.t_s, offsets[-1], atol=2e-9)
        assert 0.0 <= first.t_s <= 0.08
    assert len(set(offsets)) == 3 and max(np.abs(offsets)) < 0.3


@pytest.mark.parametrize("name", ["race", "empty"])
def test_poses_interpolated_from_telemetry(name: str) -> None:
    """50 Hz rows, linear and slerp, against the pose at the true exposure: the flight is smooth enough."""
    schedule = with_trouble(TroublePlan(clock_offset_ms=40.0, trigger_spread_ms=80.0), 60, name)
    for drone in range(3):
        rows = schedule.telemetry(drone)
        track = PoseTrack(rows.stamps_ns, rows.true.camera_position, rows.true.camera_quaternion)
        for capture in captures(schedule, drone):
            found = track.at(capture.stamp_ns, max_gap_s=0.1)
            truth = schedule.flight.at(drone, capture.t_s).world_from_camera
            assert np.linalg.norm(found[:3, 3] - truth[:3, 3]) < 1e-3
            turned = np.degrees(
                np.arccos(np.clip(0.5 * (np.trace(found[:3, :3].T @ truth[:3, :3]) - 1), -1, 1))
            )
            assert turned < 0.02


def test_noise_and_bias_have_the_planned_size() -> None:
    trouble = TroublePlan(
        position_noise_m=0.1, position_bias_m=2.0, attitude_noise_deg=0.5, gimbal_noise_deg=0.2
    )
    schedule = with_trouble(trouble, 200)
    rows = schedule.telemetry(1)
    error = rows.noisy.body_position - rows.true.body_position
    np.testing.assert_allclose(error.std(axis=0), 0.1, rtol=0.1)
    np.testing.assert_allclose(error.mean(axis=0), schedule.biases[1].position_m, atol=0.02)
    # A rotation vector with three normal parts is sqrt(3) times as long in the root mean square.
    turned = angle_deg(rows.noisy.body_quaternion, rows.true.body_quaternion)
    assert np.sqrt(np.mean(turned**2)) == pytest.approx(0.5 * np.sqrt(3), rel=0.1)
    turned = angle_deg(rows.noisy.gimbal_quaternion, rows.true.gimbal_quaternion)
    assert np.sqrt(np.mean(turned**2)) == pytest.approx(0.2 * np.sqrt(3), rel=0.1)
    assert not np.allclose(schedule.biases[0].position_m, schedule.biases[1].position_m)


def test_camera_rows_follow_from_airframe_and_gimbal() -> None:
    rows = with_trouble(scene_of("race").scenario.trouble, 20, "race").telemetry(2)
    for poses in (rows.true, rows.noisy):
        turned = multiply(poses.body_quaternion, poses.gimbal_quaternion)
        assert angle_deg(turned, poses.camera_quaternion).max() < 1e-5
        mount = np.einsum("nij,j->ni", rotation_matrix(poses.body_quaternion), CAMERA_IN_BODY_M)
        np.testing.assert_allclose(poses.camera_position, poses.body_position + mount, atol=1e-9)


@lru_cache(maxsize=1)
def lossy_telemetry() -> tuple[Schedule, Telemetry]:
    schedule = with_trouble(TroublePlan(telemetry_loss=0.3, position_noise_m=1.0), 300)
    return schedule, schedule.telemetry(0)


@given(start=st.integers(-400, 16_000), span=st.integers(0, 4_800))
@settings(max_examples=20)
def test_any_span_of_telemetry_is_a_piece_of_the_whole(start: int, span: int) -> None:
    schedule, whole = lossy_telemetry()
    piece = schedule.telemetry(0, start / 400, (start + span) / 400)
    # Rows come at 50 Hz and spans begin and end on eighths of a row, so whole numbers decide.
    eighths = 8 * np.rint(whole.t_s * 50.0).astype(np.int64)
    inside = (eighths >= start) & (eighths < start + span)
    np.testing.assert_array_equal(piece.stamps_ns, whole.stamps_ns[inside])
    np.testing.assert_array_equal(piece.noisy.body_position, whole.noisy.body_position[inside])


def test_lost_telemetry_and_presence() -> None:
    trouble = TroublePlan(telemetry_loss=0.2, joins_s=((1, 4.0),), leaves_s=((1, 20.0),))
    schedule = with_trouble(trouble, 1000)
    rows = schedule.telemetry(1)
    assert rows.t_s.min() >= 3.75 and rows.t_s.max() < 20.25
    assert len(rows.t_s) == pytest.approx(0.8 * 16.5 * 50, rel=0.1)
    times = [c.t_s for c in captures(schedule, 1)]
    assert (min(times), max(times)) == pytest.approx((4.0, 19.9))
    assert len(captures(schedule, 0)) == 1000
    assert with_trouble(TroublePlan(joins_s=((0, 1e6),)), 10).telemetry(0).t_s.size == 0


def test_the_manifest_names_every_parameter() -> None:
    scene: Scene = scene_of("race")
    manifest = json.loads(json.dumps(build_schedule(scene).manifest()))
    assert set(manifest["plan"]) == set(asdict(TroublePlan()))
    assert manifest["plan"]["dropped"] == scene.scenario.trouble.dropped
    assert [drone["name"] for drone in manifest["drones"]] == ["uav1", "uav2", "uav3"]
    assert all(len(drone["gimbal_bias_deg"]) == 3 for drone in manifest["drones"])
