"""Errors that change from row to row: told from the rows, and smoothed away, and the way flown stays."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from crowdfence import Terrain, _core, open_recording
from crowdfence.cli.app import app
from crowdfence.service.ros.poses import RosPoses
from crowdfence.sources.convert import convert
from crowdfence.sources.pose_noise import (
    SPEED_CHANGE_M2_S3,
    PoseNoise,
    given_noise,
    noise_of,
    steadied,
    steadied_as,
    with_doubts,
)
from crowdfence.sources.pose_track import PoseTrack
from support.command_line import crowdfence
from support.small_recordings import flight, ground, write_folder

START_NS = 1_760_000_000_000_000_000


def seconds(rows: int = 500, hz: float = 50.0) -> NDArray[np.float64]:
    return np.arange(rows) / hz


def track(
    at_s: NDArray[np.float64], positions: NDArray[np.float64], attitudes: Rotation | None = None
) -> PoseTrack:
    attitudes = attitudes or Rotation.identity(len(at_s))
    stamps = START_NS + np.round(at_s * 1e9).astype(np.int64)
    return PoseTrack(stamps, positions, np.roll(attitudes.as_quat(), 1, axis=1))


def orbit(at_s: NDArray[np.float64]) -> PoseTrack:
    """Radius 20 m at 5 m/s, which is 1.25 m/s2, the camera turned to the middle and nodding by 5 degrees."""
    angle = at_s / 4.0
    positions = np.column_stack([20 * np.cos(angle), 20 * np.sin(angle), np.full(len(at_s), 15.0)])
    turns = np.column_stack([np.degrees(angle), np.zeros(len(at_s)), -120 + 5 * np.sin(at_s)])
    return track(at_s, positions, Rotation.from_euler("zyx", turns, degrees=True))


def noisy(exact: PoseTrack, noise: PoseNoise, seed: int) -> PoseTrack:
    """Quaternions come with either sign, as some autopilots log them."""
    dice = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(np.radians(noise.attitude_deg) * dice.standard_normal((len(exact), 3)))
    attitudes = (Rotation.from_quat(np.roll(exact.quaternions, -1, axis=1)) * turns).as_quat()
    signs = np.where(dice.random(len(exact)) < 0.5, 1.0, -1.0)[:, None]
    positions = exact.positions + noise.position_m * dice.standard_normal((len(exact), 3))
    return PoseTrack(exact.stamps_ns, positions, np.roll(signs * attitudes, 1, axis=1))


def off(one: PoseTrack, other: PoseTrack) -> PoseNoise:
    """Root of the mean square, per axis."""
    turns = [Rotation.from_quat(np.roll(some.quaternions, -1, axis=1)) for some in (one, other)]
    turned_deg = np.degrees((turns[0].inv() * turns[1]).as_rotvec())
    moved_m = one.positions - other.positions
    return PoseNoise(float(np.sqrt(np.mean(moved_m**2))), float(np.sqrt(np.mean(turned_deg**2))))


@given(st.floats(0.01, 1.0), st.floats(0.05, 1.0), st.integers(0, 1000))
@settings(max_examples=25)
def test_rows_tell_how_large_their_errors_are(position_m: float, attitude_deg: float, seed: int) -> None:
    found = noise_of(noisy(orbit(seconds()), PoseNoise(position_m, attitude_deg), seed))
    assert found is not None
    assert found.position_m == pytest.approx(position_m, rel=0.15)
    assert found.attitude_deg == pytest.approx(attitude_deg, rel=0.15)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_noise_of_one_axis_alone_is_told_and_smoothed(axis: int) -> None:
    """As of a barometer beside a steady GNSS, or of a compass on a steady gimbal. A median over the values of
    all axes took it for none."""
    exact, dice = orbit(seconds()), np.random.default_rng(axis)
    of_axis = np.outer(dice.standard_normal(len(exact)), np.eye(3)[axis])
    attitudes = Rotation.from_quat(np.roll(exact.quaternions, -1, axis=1)) * Rotation.from_rotvec(
        np.radians(2.0) * of_axis
    )
    rows = PoseTrack(exact.stamps_ns, exact.positions + of_axis, np.roll(attitudes.as_quat(), 1, axis=1))
    found = noise_of(rows)
    assert found is not None
    assert found.position_m == pytest.approx(np.sqrt(1 / 3), rel=0.15)
    assert found.attitude_deg == pytest.approx(2.0 * np.sqrt(1 / 3), rel=0.15)
    before, left = off(rows, exact), off(steadied_as(rows, "estimate"), exact)
    assert left.position_m < 0.3 * before.position_m
    assert left.attitude_deg < 0.5 * before.attitude_deg


def test_lost_rows_do_not_look_like_noise() -> None:
    at_s = seconds()[np.random.default_rng(3).random(500) > 0.3]
    found = noise_of(orbit(at_s))
    # Between rows .04 s apart a drone at 1.25 m/s2 leaves the line by 1.25 x .02^2 / 2 m.
    assert found is not None and found.position_m < 3e-4 and found.attitude_deg < 0.01


def test_rows_that_are_far_apart_tell_nothing() -> None:
    slow = orbit(seconds(200, hz=5.0))
    assert noise_of(slow) is None
    assert steadied_as(slow, "estimate") is slow
    assert steadied_as(slow, None) is slow


@given(st.integers(0, 1000), st.floats(0.1, 1.0), st.floats(0.1, 1.0))
@settings(max_examples=15)
def test_most_of_the_noise_goes(seed: int, position_m: float, attitude_deg: float) -> None:
    exact, noise = orbit(seconds()), PoseNoise(position_m, attitude_deg)
    left = off(steadied(noisy(exact, noise, seed), noise), exact)
    assert left.position_m < 0.4 * position_m
    assert left.attitude_deg < 0.5 * attitude_deg


def test_a_straight_way_stays_as_it_is() -> None:
    at_s = seconds(100)
    exact = track(at_s, np.array([100.0, -50.0, 30.0]) + np.outer(at_s, [6.0, -2.0, 0.5]))
    straight = steadied(exact, PoseNoise(2.0, 2.0))
    np.testing.assert_allclose(straight.positions, exact.positions, atol=1e-6)
    np.testing.assert_allclose(straight.quaternions, exact.quaternions, atol=1e-9)
    assert np.array_equal(straight.stamps_ns, exact.stamps_ns)


def test_poses_without_noise_stay_as_they_are() -> None:
    exact = orbit(seconds(100))
    np.testing.assert_array_equal(steadied(exact, PoseNoise(0.0, 0.0)).positions, exact.positions)
    left = off(steadied_as(exact, "estimate"), exact)
    assert left.position_m < 1e-3 and left.attitude_deg < 1e-3


def test_a_drone_that_brakes_hard_is_followed() -> None:
    """From 10 m/s to a stop at 5 m/s2: what smoothing changes stays below the noise it takes out."""
    at_s = seconds()
    speed = np.clip(10.0 - 5.0 * (at_s - 4.0), 0.0, 10.0)
    exact = track(at_s, np.column_stack([np.cumsum(speed) / 50.0, 0 * at_s, 0 * at_s]))
    moved = np.abs(steadied(exact, PoseNoise(0.5, 0.5)).positions - exact.positions)
    assert moved.max() < 0.25


def test_it_is_the_smoothing_spline_of_reinsch() -> None:
    """f = (I + stiffness Q R^-1 Q')^-1 y with the second differences Q and their Gram matrix R, by hand."""
    at_s = np.array([0.0, 0.1, 0.15, 0.4, 0.5, 0.9, 1.0])
    heights = np.array([0.0, 1.0, 0.5, 2.0, 1.0, 1.5, 3.0])
    gap = np.diff(at_s)
    count = len(at_s) - 2
    q, r = np.zeros((len(at_s), count)), np.zeros((count, count))
    for at in range(count):
        q[at : at + 3, at] = [1 / gap[at], -1 / gap[at] - 1 / gap[at + 1], 1 / gap[at + 1]]
        r[at, at] = (gap[at] + gap[at + 1]) / 3.0
        if at + 1 < count:
            r[at, at + 1] = r[at + 1, at] = gap[at + 1] / 6.0
    stiffness = 0.3**2 / SPEED_CHANGE_M2_S3
    expected = np.linalg.solve(np.eye(len(at_s)) + stiffness * q @ np.linalg.solve(r, q.T), heights)
    positions = np.column_stack([heights, -heights, 0 * heights])
    found = steadied(track(at_s, positions), PoseNoise(0.3, 0.0)).positions
    np.testing.assert_allclose(found, np.column_stack([expected, -expected, 0 * expected]), atol=1e-9)


def test_a_recording_is_opened_with_steady_poses(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "flight", flight())
    plain, steady = open_recording(folder), open_recording(folder, pose_noise="estimate")
    # Its rows are exact: they are said to be, and nothing moves by more than a rounding.
    assert {said.split(":")[0] for said in steady.warnings} == {f"poses of {drone}" for drone in plain.drones}
    for before, after in zip(plain.frames, steady.frames, strict=True):
        np.testing.assert_allclose(before.world_from_camera, after.world_from_camera, atol=2e-3)
    told = open_recording(folder, pose_noise=(0.5, 0.5))
    assert told.warnings == plain.warnings
    drone = plain.drones[0]
    expected = steadied(plain.tracks()[drone], PoseNoise(0.5, 0.5))
    frame = told.frames_of(drone)[2]
    np.testing.assert_array_equal(frame.world_from_camera, expected.at(frame.stamp_ns, 0.25))
    assert len(told.frames) == len(plain.frames)


def test_a_recording_tells_wherever_it_goes_by_what_it_was_smoothed(tmp_path: Path) -> None:
    """The report of a run on the converted file said that its poses were as recorded, and the same smoothing
    was taken once more."""
    folder, path = write_folder(tmp_path / "flight", flight()), tmp_path / "flight.mcap"
    smoothed = open_recording(folder, pose_noise=(0.5, 0.25))
    convert(smoothed, path)
    again = open_recording(path)
    noise = {"position_m": 0.5, "attitude_deg": 0.25}
    assert again.manifest["pose_noise"] == dict.fromkeys(smoothed.drones, noise)
    with pytest.raises(ValueError, match=r"uav1 in flight were smoothed before by 0\.5 m and 0\.25 deg"):
        open_recording(path, pose_noise=(0.5, 0.25))
    estimated = open_recording(path, pose_noise="estimate")
    assert estimated.manifest["pose_noise"] == again.manifest["pose_noise"]
    for one, other in zip(estimated.frames, again.frames, strict=True):
        np.testing.assert_array_equal(one.world_from_camera, other.world_from_camera)
    assert all("left as they are" in said for said in estimated.warnings)
    done = crowdfence(
        "run", path, "-t", level_map(tmp_path), "--detector", "recorded", "-o", tmp_path / "out"
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["pose_noise"] == again.manifest["pose_noise"]


def level_map(folder: Path) -> Path:
    terrain = Terrain.from_points(ground(), 2.0)
    path = folder / "ground.bt"
    path.write_bytes(_core.write_octomap_binary(terrain, np.arange(terrain.voxel_count)))
    return path


def test_poses_that_tremble_are_told_of(tmp_path: Path) -> None:
    """Of three drones one has rows off by half a metre; the others keep silent."""
    recording = open_recording(write_folder(tmp_path / "flight", flight(60)))
    drone = recording.drones[1]
    rows = noisy(recording.tracks()[drone], PoseNoise(0.5, 0.0), 4)
    shaken = with_doubts(replace(recording, pose_tracks={**recording.tracks(), drone: rows}))
    (said,) = set(shaken.warnings) - set(recording.warnings)
    assert said.startswith(f"poses of {drone}: each off by itself by 0.") and "--pose-noise" in said


@pytest.mark.parametrize(
    "text", ["0.5", "a,b", "1,2,3", "-1,0", "nan,0", "1,inf", "", "101,1", "1,46", "1e300,1"]
)
def test_noise_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="noise of poses is"):
        given_noise(text)


def test_the_command_line_takes_both_forms(tmp_path: Path) -> None:
    assert given_noise("0.5,0.25") == (0.5, 0.25)
    folder = write_folder(tmp_path / "flight", flight())
    for text in ("estimate", "0.5,0.5"):
        said = CliRunner().invoke(app, ["inspect", str(folder), "--pose-noise", text, "--json"])
        assert said.exit_code == 0, said.output
        warned = any("smoothed" in one for one in json.loads(said.stdout)["warnings"])
        assert warned == (text == "estimate")
    refused = CliRunner().invoke(app, ["inspect", str(folder), "--pose-noise", "0.5"])
    assert refused.exit_code != 0 and "noise of poses is" in str(refused.exception)


def test_live_poses_are_smoothed_as_far_as_they_have_come() -> None:
    exact, noise = orbit(seconds(150)), PoseNoise(0.5, 0.5)
    feeds = RosPoses("camera_pose", None), RosPoses("camera_pose", None, noise=(0.5, 0.5))
    rows = noisy(exact, noise, 1)
    for stamp_ns, (x, y, z), (qw, qx, qy, qz) in zip(
        rows.stamps_ns.tolist(), rows.positions.tolist(), rows.quaternions.tolist(), strict=True
    ):
        pose = SimpleNamespace(
            position=SimpleNamespace(x=x, y=y, z=z), orientation=SimpleNamespace(w=qw, x=qx, y=qy, z=qz)
        )
        stamp = SimpleNamespace(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        for feed in feeds:
            feed.posed(SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id="map"), pose=pose))
    # The newest is the hardest: nothing has come after it.
    last = [int(stamp) for stamp in exact.stamps_ns[-20:]]
    errors = [
        np.sqrt(np.mean([(feed.pose_at(at)[:3, 3] - exact.at(at, 1.0)[:3, 3]) ** 2 for at in last]))
        for feed in feeds
    ]
    assert errors[0] > 0.4 and errors[1] < 0.6 * errors[0]
