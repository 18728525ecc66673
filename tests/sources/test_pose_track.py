"""Pose tracks: values worked out by hand, agreement with SciPy's Slerp, refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from crowdfence.sources import PoseGapError, PoseTrack
from crowdfence.sources.pose_track import track_from_rows
from crowdfence.sources.rotation import from_yaw_pitch_roll_deg, multiply, rotation_matrix
from crowdfence.sources.stamps import stamp_faults

SECOND = 1_000_000_000
IDENTITY = (1.0, 0.0, 0.0, 0.0)
QUARTER_TURN_ABOUT_Z = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))


def two_poses(first=IDENTITY, second=QUARTER_TURN_ABOUT_Z, seconds=1.0):
    stamps = [5 * SECOND, 5 * SECOND + int(seconds * SECOND)]
    return PoseTrack(np.array(stamps), np.array([[0.0, 0, 0], [8.0, -4, 2]]), np.array([first, second]))


def scipy_rotation(quaternions):
    """SciPy's order is x y z w."""
    return Rotation.from_quat(np.roll(np.asarray(quaternions), -1, axis=-1))


def test_half_way_is_the_mean_position_and_half_the_turn():
    pose = two_poses().at(5 * SECOND + SECOND // 2, max_gap_s=1.0)
    half = np.sqrt(0.5)  # cos 45 deg = sin 45 deg
    expected = [[half, -half, 0, 4], [half, half, 0, -2], [0, 0, 1, 1], [0, 0, 0, 1]]
    np.testing.assert_allclose(pose, expected, atol=1e-15)


def test_a_third_of_a_quarter_turn_is_thirty_degrees():
    pose = two_poses().at(5 * SECOND + SECOND // 3, max_gap_s=1.0)
    assert pose[0, 0] == pytest.approx(np.cos(np.radians(30)), abs=1e-9)  # a third of a second, cut to ns
    assert pose[1, 0] == pytest.approx(0.5, abs=1e-9)


def test_samples_are_exact_whatever_the_gap():
    turn = normal([0.3, -0.4, 0.5, 0.7])
    track = two_poses(second=turn, seconds=1000.0)
    pose = track.at(1005 * SECOND, max_gap_s=0.1)
    assert pose[:3, 3].tolist() == [8.0, -4.0, 2.0]
    np.testing.assert_allclose(pose[:3, :3], scipy_rotation(turn).as_matrix(), atol=1e-14)


def test_the_shorter_way_round_is_taken():
    # -q is the same attitude as q: nothing may turn between them.
    pose = two_poses(first=QUARTER_TURN_ABOUT_Z, second=tuple(-np.array(QUARTER_TURN_ABOUT_Z))).at(
        5 * SECOND + SECOND // 4, max_gap_s=1.0
    )
    np.testing.assert_allclose(pose[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)


def normal(values):
    return np.asarray(values, dtype=float) / np.linalg.norm(values)


unit_quaternions = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(
    lambda q: np.linalg.norm(q) > 0.1
)


@given(unit_quaternions, unit_quaternions, st.integers(0, SECOND))
def test_agrees_with_scipy(first, second, after_ns):
    first, second = normal(first), normal(second)
    if abs(np.dot(first, second)) < 1e-6:
        return  # exactly opposite attitudes: both ways round are equally short
    ours = two_poses(first, second).at(5 * SECOND + after_ns, max_gap_s=2.0)
    theirs = Slerp([0, SECOND], scipy_rotation([first, second]))(after_ns).as_matrix()
    np.testing.assert_allclose(ours[:3, :3], theirs, atol=1e-8)


@given(unit_quaternions, unit_quaternions)
def test_products_and_matrices_agree_with_scipy(a, b):
    a, b = normal(a), normal(b)
    np.testing.assert_allclose(rotation_matrix(a), scipy_rotation(a).as_matrix(), atol=1e-14)
    product = rotation_matrix(multiply(a, b))
    np.testing.assert_allclose(product, (scipy_rotation(a) * scipy_rotation(b)).as_matrix(), atol=1e-14)


@given(st.floats(-180, 180), st.floats(-90, 90), st.floats(-180, 180))
def test_yaw_pitch_roll_agree_with_scipy(yaw, pitch, roll):
    ours = rotation_matrix(from_yaw_pitch_roll_deg(yaw, pitch, roll))
    theirs = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix()
    np.testing.assert_allclose(ours, theirs, atol=1e-14)


def test_a_gap_is_not_bridged():
    track = two_poses(seconds=1.24)
    with pytest.raises(PoseGapError, match=r"gap of 1\.240 s .*limit max_pose_gap_s = 0\.25 s"):
        track.at(5 * SECOND + 1, max_gap_s=0.25)
    track.at(5 * SECOND + 1, max_gap_s=1.24)


@pytest.mark.parametrize(
    ("stamp_ns", "message"),
    [
        (5 * SECOND - 132_000_000, r"0\.132 s before the first"),
        (6 * SECOND + 50_000_000, r"0\.050 s after the last"),
    ],
)
def test_nothing_is_extrapolated(stamp_ns, message):
    with pytest.raises(PoseGapError, match=message):
        two_poses().at(stamp_ns, max_gap_s=3600.0)


def test_an_empty_track_has_no_pose():
    with pytest.raises(PoseGapError, match="no telemetry"):
        PoseTrack(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4))).at(0, max_gap_s=1.0)


@pytest.mark.parametrize(
    ("stamps", "positions", "quaternions", "message"),
    [
        ([1, 1], np.zeros((2, 3)), [IDENTITY] * 2, "row 1 has 1 after 1"),
        ([1, 2], np.zeros((2, 2)), [IDENTITY] * 2, "stamps \\[N\\]"),
        ([1, 2], [[0, 0, 0], [0, np.nan, 0]], [IDENTITY] * 2, "row 1 of the pose track"),
        ([1], np.zeros((1, 3)), [(0.9, 0, 0, 0)], "length 1 within 1 %"),
    ],
)
def test_unusable_tracks_are_refused(stamps, positions, quaternions, message):
    with pytest.raises(ValueError, match=message):
        PoseTrack(np.array(stamps), np.array(positions), np.array(quaternions))


def test_logged_rows_that_are_no_poses_are_left_out_and_reported():
    stamps = [10, 20, 30, 40, 35, 50]
    positions = np.arange(18.0).reshape(6, 3) / 10
    positions[1, 2] = np.inf
    quaternions = np.array([IDENTITY] * 6)
    quaternions[2] = 0.0
    track, remarks = track_from_rows(stamps, positions, quaternions)
    assert track.stamps_ns.tolist() in (
        [10, 40, 50],
        [10, 35, 50],
    )  # either of 40, 35 leaves an increasing track
    assert len(remarks) == 2
    assert remarks[0].startswith("2 of 6 pose rows are no poses") and "first at row 1" in remarks[0]
    assert remarks[1].startswith("1 of 6 pose rows are out of order")


def flown(clock, rate_hz, seconds=60.0, phase_s=0.0):
    """Stamps and true times of a drone that flies east at 10 m/s; `clock` is what it stamps at a time."""
    times = np.arange(phase_s, seconds, 1 / rate_hz)
    return [round(clock(time) * SECOND) for time in times], times


def placed(clock, *, pose_hz, frame_hz):
    """How many frames get a pose, by how many metres the worst is off, and what is said of the rows."""
    stamps, times = flown(clock, pose_hz)
    positions = np.column_stack([10.0 * times, np.zeros((len(times), 2))])
    track, remarks = track_from_rows(stamps, positions, np.tile(IDENTITY, (len(times), 1)))
    frame_stamps, frame_times = flown(clock, frame_hz, phase_s=0.013)
    off_m = []
    for stamp_ns, time, fault in zip(
        frame_stamps, frame_times, stamp_faults(frame_stamps, 3600.0), strict=True
    ):
        try:
            if fault is None:
                off_m.append(abs(track.at(stamp_ns, 0.25)[0, 3] - 10.0 * time))
        except PoseGapError:
            continue
    return len(off_m), max(off_m), remarks


@pytest.mark.parametrize("back_s", [0.8, 3.3, 5.0, 20.0])
@pytest.mark.parametrize(("pose_hz", "frame_hz"), [(50, 2), (10, 2), (30, 1)])
def test_a_clock_that_is_set_back_moves_no_frame(back_s, pose_hz, frame_hz):
    """Frames and rows of the same stamps were taken twice, and nothing says which belong together."""
    count, off_m, remarks = placed(
        lambda time: time if time < 31.7 else time - back_s, pose_hz=pose_hz, frame_hz=frame_hz
    )
    assert off_m < 1e-5
    assert count >= (60.0 - 2 * back_s) * frame_hz - 4
    assert any("twice" in remark for remark in remarks)


def test_rows_that_come_again_as_they_were_change_nothing():
    """A link that repeats, and one that delivers a batch late."""
    stamps = [10, 20, 30, 10, 20, 30, 40, 50, 50, 60]
    positions = np.column_stack([np.array(stamps, float), np.zeros((10, 2))])
    track, remarks = track_from_rows(stamps, positions, [IDENTITY] * 10)
    assert track.stamps_ns.tolist() == [10, 20, 30, 40, 50, 60]
    assert not any("twice" in remark for remark in remarks)
    late = [10, 60, 70, 20, 30, 40, 80]
    track, remarks = track_from_rows(late, np.zeros((7, 3)), [IDENTITY] * 7)
    assert track.stamps_ns.tolist() == [10, 20, 30, 40, 80]
    assert not any("twice" in remark for remark in remarks)


def test_stamps_of_a_damaged_log_take_no_other_rows_with_them():
    """Two rows in a row with stamps from nowhere, around everything else."""
    stamps = [SECOND * number for number in range(20, 30)]
    stamps[5:5] = [SECOND, 100 * SECOND]
    track, _ = track_from_rows(stamps, np.zeros((12, 3)), [IDENTITY] * 12)
    assert track.stamps_ns.tolist() == [SECOND * number for number in range(20, 30)]


def test_tracks_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        two_poses().positions[0, 0] = 1.0


def test_shifting_moves_stamps_only():
    track = two_poses()
    np.testing.assert_array_equal(
        track.shifted(-SECOND).at(4 * SECOND + 123_456_789, 1.0), track.at(5 * SECOND + 123_456_789, 1.0)
    )
