"""Constant errors of poses: taken out as they were put in, and read from a file that says what is wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence import open_recording
from crowdfence.sources.alignment_file import read_alignment, write_alignment
from crowdfence.sources.convert import convert
from crowdfence.sources.fleet import joined
from crowdfence.sources.pose_offset import PoseOffset, without_offsets
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.recording import Recording
from support.small_recordings import flight, write_folder

LEVEL_NORTH = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])
"""Right is east, down is down, forward is north."""


@pytest.fixture
def flown(tmp_path: Path) -> Recording:
    return open_recording(write_folder(tmp_path / "flight", flight()))


def standing() -> PoseTrack:
    stamps = np.arange(5) * 100_000_000
    positions = np.column_stack([np.arange(5.0), np.zeros(5), np.full(5, 20.0)])
    return PoseTrack(stamps, positions, np.tile(LEVEL_NORTH, (5, 1)))


@pytest.mark.parametrize(
    ("offset", "column", "points"),
    [
        (PoseOffset(pitch_deg=90.0), 2, [0, 0, 1]),  # forward, which was north, is up
        (PoseOffset(yaw_deg=90.0), 2, [1, 0, 0]),  # forward is east
        (PoseOffset(roll_deg=90.0), 0, [0, 0, -1]),  # the right side, which was east, is down
    ],
)
def test_angles_turn_the_camera_as_their_names_say(
    offset: PoseOffset, column: int, points: list[float]
) -> None:
    pose = offset.track(standing()).at(200_000_000, 0.25)
    np.testing.assert_allclose(pose[:3, column], points, atol=1e-12)
    np.testing.assert_allclose(pose[:3, 3], [2, 0, 20])


def test_a_picture_belongs_to_later_telemetry() -> None:
    """The way is 10 m/s eastwards, so 0.1 s later is a metre further."""
    pose = PoseOffset(time_s=0.1, position_m=(0.0, 0.5, -2.0)).track(standing()).at(200_000_000, 0.25)
    np.testing.assert_allclose(pose[:3, 3], [3.0, 0.5, 18.0])


@given(st.tuples(*[st.floats(-20, 20)] * 3), st.floats(-0.1, 0.1), st.tuples(*[st.floats(-5, 5)] * 3))
@settings(max_examples=40)
def test_the_opposite_offset_takes_it_back(
    angles: tuple[float, float, float], time_s: float, place: tuple[float, float, float]
) -> None:
    there = PoseOffset(*angles, time_s, place)
    back = PoseOffset(*(-a for a in angles), -time_s, tuple(-p for p in place))  # type: ignore[arg-type]
    track = standing()
    again = back.track(there.track(track))
    np.testing.assert_array_equal(again.stamps_ns, track.stamps_ns)
    np.testing.assert_allclose(again.positions, track.positions, atol=1e-12)
    np.testing.assert_allclose(again.quaternions, track.quaternions, atol=1e-12)


def test_other_drones_stay_as_they_are(flown: Recording) -> None:
    drone, other = flown.drones[:2]
    righted = without_offsets(flown, {drone: PoseOffset(yaw_deg=1.0)})
    for before, after in zip(flown.frames_of(other), righted.frames_of(other), strict=True):
        assert np.array_equal(before.world_from_camera, after.world_from_camera)
    for before, after in zip(flown.frames_of(drone), righted.frames_of(drone), strict=True):
        turn = before.world_from_camera[:3, :3].T @ after.world_from_camera[:3, :3]
        assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) == pytest.approx(1.0, abs=1e-6)


def test_frames_that_leave_the_telemetry_are_refused(flown: Recording) -> None:
    drone = flown.drones[0]
    righted = without_offsets(flown, {drone: PoseOffset(time_s=1e4)})
    assert righted.frames_of(drone) == []
    lost = [one for one in righted.refused if one.drone == drone]
    assert len(lost) == len(flown.frames_of(drone)) and "moved by its time offset" in lost[0].reason


def test_a_drone_of_another_recording_is_named(flown: Recording) -> None:
    with pytest.raises(ValueError, match="another recording: .* no drone .uav9., it holds uav1, .*mend"):
        without_offsets(flown, {"uav9": PoseOffset()})


def test_nothing_is_put_right_twice_by_one_alignment(flown: Recording, tmp_path: Path) -> None:
    """As by `convert --alignment` and then `run --alignment`, which moved every zone as far again."""
    drone, other = flown.drones[:2]
    write_alignment(tmp_path / "a.json", {drone: PoseOffset(0.1, time_s=0.05, position_m=(1.0, 2.0, -3.0))})
    write_alignment(tmp_path / "b.json", {drone: PoseOffset(0.2), other: PoseOffset(yaw_deg=1.0)})
    folder = tmp_path / "flight"
    righted = open_recording(folder, alignment=tmp_path / "a.json")
    convert(righted, tmp_path / "righted.mcap")
    assert len(open_recording(tmp_path / "righted.mcap").frames) == len(righted.frames)
    with pytest.raises(ValueError, match=f"the poses of {drone} in righted were put right by this alignment"):
        open_recording(tmp_path / "righted.mcap", alignment=tmp_path / "a.json")
    # What is found of righted poses is another alignment; both are told, and neither is taken again.
    finer = open_recording(tmp_path / "righted.mcap", alignment=tmp_path / "b.json")
    assert [one["pitch_deg"] for one in finer.manifest["alignment"][drone]] == [0.1, 0.2]
    convert(finer, tmp_path / "finer.mcap")
    for file in ("a.json", "b.json"):
        with pytest.raises(ValueError, match="before: it would move them once more"):
            open_recording(tmp_path / "finer.mcap", alignment=tmp_path / file)


def test_an_alignment_found_anew_is_not_taken_on_top_of_one(flown: Recording, tmp_path: Path) -> None:
    """Two alignments of the same poses differ a little, by their pictures; the second moved poses that the
    first had put right as far again. One of righted poses does nothing for those that are not."""
    drone = flown.drones[0]
    folder = tmp_path / "flight"
    write_alignment(tmp_path / "a.json", {drone: PoseOffset(yaw_deg=3.0)}, None, flown)
    write_alignment(tmp_path / "b.json", {drone: PoseOffset(yaw_deg=2.9)}, None, flown)
    convert(open_recording(folder, alignment=tmp_path / "a.json"), tmp_path / "righted.mcap")
    righted = open_recording(tmp_path / "righted.mcap")
    with pytest.raises(ValueError, match=f"of {drone} as they were recorded, and those in righted were put"):
        open_recording(tmp_path / "righted.mcap", alignment=tmp_path / "b.json")
    write_alignment(tmp_path / "rest.json", {drone: PoseOffset(yaw_deg=0.1)}, None, righted)
    with pytest.raises(ValueError, match=f"of {drone} that were put right before, and those in flight"):
        open_recording(folder, alignment=tmp_path / "rest.json")
    finer = open_recording(tmp_path / "righted.mcap", alignment=tmp_path / "rest.json")
    assert [one["yaw_deg"] for one in finer.manifest["alignment"][drone]] == [3.0, 0.1]


def test_a_fleet_keeps_what_was_put_right_in_its_parts(flown: Recording, tmp_path: Path) -> None:
    drone, other = flown.drones[:2]
    offsets = {drone: PoseOffset(0.1)}
    parts = [
        replace(
            flown, name=name, drones=(name,), frames=tuple(flown.frames_of(name)), pose_tracks={name: track}
        )
        for name, track in flown.tracks().items()
        if name in (drone, other)
    ]
    righted = [without_offsets(one, offsets) if one.name == drone else one for one in parts]
    convert(joined(righted), tmp_path / "fleet.mcap")
    write_alignment(tmp_path / "a.json", offsets)
    with pytest.raises(ValueError, match=f"the poses of {drone} in fleet were put right by this alignment"):
        open_recording(tmp_path / "fleet.mcap", alignment=tmp_path / "a.json")


def test_an_alignment_of_another_day_is_doubted(flown: Recording, tmp_path: Path) -> None:
    path, offsets = tmp_path / "a.json", {flown.drones[0]: PoseOffset(0.1)}
    folder = tmp_path / "flight"
    day_ns = 86_400 * 10**9
    for later_ns, doubted in ((0, False), (day_ns, True), (-day_ns, True)):
        frames = tuple(replace(one, stamp_ns=one.stamp_ns + later_ns) for one in flown.frames)
        write_alignment(path, offsets, None, replace(flown, name="monday", frames=frames))
        told = [
            one for one in open_recording(folder, alignment=path).warnings if "was found on monday" in one
        ]
        assert len(told) == doubted
    content = json.loads(path.read_text())
    for damaged in (None, [], {"span_ns": 3}, {"span_ns": [1e300, "x"]}, {"span_ns": [-(10**30), 10**30]}):
        path.write_text(json.dumps({**content, "recording": damaged}))
        assert len(open_recording(folder, alignment=path).frames) == len(flown.frames)


@pytest.mark.parametrize(
    ("other", "doubted"),
    [
        ("itself", False),
        ("a part of it", False),
        ("on another map, whose middle lies elsewhere", False),
        ("its pictures a moment later", True),
        ("another way at the same moments", True),
    ],
)
def test_an_alignment_of_other_pictures_of_the_time_is_doubted(
    flown: Recording, tmp_path: Path, other: str, doubted: bool
) -> None:
    """Names of drones are alike in many recordings, and two may be made at a time, or simulated ones begin
    with the same stamp."""
    path, frames = tmp_path / "a.json", list(flown.frames)
    if other == "a part of it":
        frames = frames[::2]
    for number, one in enumerate(frames if doubted or "map" in other else ()):
        pose = one.world_from_camera.copy()
        pose[0, 3] += 1000.0 if "map" in other else 4.0 * number if "way" in other else 0.0
        stamp_ns = one.stamp_ns + (1_000_000 if "moment later" in other else 0)
        frames[number] = replace(one, stamp_ns=stamp_ns, world_from_camera=pose)
    offsets = {flown.drones[0]: PoseOffset(0.1)}
    write_alignment(path, offsets, None, replace(flown, name="other", frames=tuple(frames)))
    told = [one for one in open_recording(tmp_path / "flight", alignment=path).warnings if "found on" in one]
    assert len(told) == doubted, told
    if doubted:
        assert f"found on other, and the pictures of {flown.drones[0]} there are none of flight" in told[0]
    content = json.loads(path.read_text())
    for damaged in (3, {flown.drones[0]: 3}, {flown.drones[0]: [[1, "x", 0, 0]]}, {"nobody": []}):
        content["recording"]["pictures"] = damaged
        path.write_text(json.dumps(content))
        assert len(open_recording(tmp_path / "flight", alignment=path).frames) == len(flown.frames)


def test_the_file_gives_back_what_was_written(flown: Recording, tmp_path: Path) -> None:
    offsets = {flown.drones[0]: PoseOffset(0.1, -0.2, 0.3, 0.05, (1.0, 2.0, -3.0))}
    path = tmp_path / "offsets.json"
    write_alignment(path, offsets, {"pictures": 3})
    assert read_alignment(path) == offsets
    righted = open_recording(write_folder(tmp_path / "again", flight()), alignment=path)
    expected = without_offsets(flown, offsets)
    for a, b in zip(righted.frames, expected.frames, strict=True):
        assert np.array_equal(a.world_from_camera, b.world_from_camera)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is no alignment"),
        ('{"drones": {}}', "`crowdfence align` writes one"),
        ('{"kind": "crowdfence alignment", "drones": []}', "names with their offsets"),
        ('{"kind": "crowdfence alignment", "drones": {"a": {"pitch": 1}}}', "a must have pitch_deg"),
        ('{"kind": "crowdfence alignment", "drones": {"a": {"pitch_deg": "1"}}}', "a has '1' where"),
        ('{"kind": "crowdfence alignment", "drones": {"a": {"position_m": [1, 2]}}}', "east, north and up"),
        ('{"kind": "crowdfence alignment", "drones": {}}', "names no drone"),
        (
            '{"kind": "crowdfence alignment", "drones": {"a": {"yaw_deg": 1}, "a": {"yaw_deg": -1}}}',
            "has 'a' twice",
        ),
        (
            '{"kind": "crowdfence alignment", "drones": {"a": {"yaw_deg": 1, "yaw_deg": 2}}}',
            "has 'yaw_deg' twice",
        ),
        (
            '{"kind": "crowdfence alignment", "drones": {"a": {"time_s": NaN}}}',
            r"offsets.json: time_s of a is nan; it must be finite",
        ),
        ('{"kind": "crowdfence alignment", "drones": {"a": {"time_s": 1e300}}}', "time_s of a is 1e.*86400"),
        (
            '{"kind": "crowdfence alignment", "drones": {"a": {"yaw_deg": 1%s}}}' % ("0" * 400),
            r"yaw_deg of a is 10+\.\.\., beyond 180",
        ),
        (
            '{"kind": "crowdfence alignment", "drones": {"a": {"position_m": [0, -1500, 0]}}}',
            "position_m of a is -1500, beyond 1000",
        ),
        (
            '{"kind": "crowdfence alignment", "drones": {"a": {"roll_deg": "%s"}}}' % ("1" * 400),
            r"a has '1{80}\.\.\.' where a number is needed$",
        ),
        ("[" * 100_000, "is no alignment"),
    ],
)
def test_a_file_that_is_none_says_why(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "offsets.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        read_alignment(path)
