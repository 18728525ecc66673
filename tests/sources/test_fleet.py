"""Several recordings as one fleet: what each of them knows stays known, and what nobody knows is told."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crowdfence.georeference import Georeference
from crowdfence.sources import open_recording
from crowdfence.sources.convert import convert
from crowdfence.sources.fleet import joined
from crowdfence.sources.layers import LayerGround
from crowdfence.sources.mission.writer import MissionWriter
from crowdfence.sources.moved_frame import in_frame
from crowdfence.sources.recorded_truth import RecordedPeople
from crowdfence.truth.at_exposure import crowd_definition
from support.foreign_recordings import camera_pose_messages, picture_messages, write_bag
from support.small_recordings import EPOCH_NS, ORIGIN, flight, write_folder

S = 1_000_000_000
PLACED = Georeference(*ORIGIN)


def part(folder: Path, drone: str, *, placed: bool) -> Path:
    write_folder(folder, replace(flight(), drones=(drone,)))
    if not placed:
        said = json.loads((folder / "recording.json").read_text())
        del said["georeference"]
        (folder / "recording.json").write_text(json.dumps(said))
    return folder


@pytest.mark.parametrize("placed", [False, True])
def test_drones_that_count_from_nowhere_on_earth_are_doubted(tmp_path: Path, placed: bool) -> None:
    """Each may count from its own take-off. Of drones in one bag that was said, of two bags it was not."""
    paths = [part(tmp_path / drone, drone, placed=placed) for drone in ("uav1", "uav3")]
    fleet = open_recording(paths)
    doubts = [line for line in fleet.warnings if "(0, 0, 0)" in line]
    assert len(doubts) == (0 if placed else 1)
    assert all("uav1, uav3" in line and "--origin" not in line for line in doubts)
    convert(fleet, tmp_path / "fleet.mcap")
    again = open_recording(tmp_path / "fleet.mcap")
    assert sum("(0, 0, 0)" in line for line in again.warnings) == len(doubts)
    alone = open_recording(paths[0])
    assert not any("(0, 0, 0)" in line for line in alone.warnings)


def test_bags_of_one_drone_each_are_doubted_as_drones_of_one_bag_are(tmp_path: Path) -> None:
    paths = []
    for drone in ("uav1", "uav2"):
        messages = [*picture_messages(drone, f"{drone}_optical"), *camera_pose_messages(drone)]
        paths.append(write_bag(tmp_path / drone, "sqlite", messages))
    fleet = open_recording(paths)
    assert any("uav1, uav2" in line and "(0, 0, 0)" in line for line in fleet.warnings), fleet.warnings


def people(stamp_ns: int, east_m: float) -> RecordedPeople:
    places = np.array([[east_m, 0, 0], [east_m + 1, 0, 0]], np.float32)
    return RecordedPeople(stamp_ns, places, np.array([1, 2], np.uint32), np.array([1, 1], np.uint32))


def mission(
    path: Path, drone: str, world: dict[int, float], *, layer: str = "", radius_m: float = 2.0
) -> Path:
    with MissionWriter(path, georeference=PLACED) as writer:
        writer.add_simulation({"scenario": {"crowd_definition": {"radius_m": radius_m, "min_people": 3}}})
        writer.add_pose(drone, EPOCH_NS, [0, 0, 10], (1.0, 0.0, 0.0, 0.0))
        if layer:
            writer.add_layer_ground(layer, LayerGround(np.ones((2, 3), np.bool_), 1.0, 0, 0, 2.0), EPOCH_NS)
        for stamp_ns, east_m in sorted(world.items()):
            writer.add_people(people(stamp_ns, east_m))
    return path


def test_the_world_of_any_of_them_is_that_of_the_fleet(tmp_path: Path) -> None:
    """Only that of the first was kept: whoever named the files the other way round had no truth."""
    bare = mission(tmp_path / "a.mcap", "uav1", {})
    early = mission(tmp_path / "b.mcap", "uav2", {EPOCH_NS: 0.0, EPOCH_NS + S: 1.0}, layer="landing-site")
    late = mission(tmp_path / "c.mcap", "uav3", {EPOCH_NS + S: 1.0, EPOCH_NS + 9 * S: 9.0})
    fleet = open_recording([bare, early, late])
    assert list(fleet.people.stamps_ns) == [EPOCH_NS, EPOCH_NS + S, EPOCH_NS + 9 * S]
    for stamp_ns, east_m in ((EPOCH_NS, 0.0), (EPOCH_NS + S, 1.0), (EPOCH_NS + 9 * S, 9.0)):
        found = fleet.people_truth(stamp_ns)
        assert found is not None and found.position[0, 0] == east_m
    assert list(fleet.layer_grounds) == ["landing-site"]


def test_one_world_recorded_from_two_places_is_one(tmp_path: Path) -> None:
    """Feet are kept in single precision: moved into another frame they come back a millimetre off."""
    one = mission(tmp_path / "a.mcap", "uav1", {EPOCH_NS: 0.0})
    elsewhere = in_frame(open_recording(one), Georeference(46.52, 8.04, 1350.0))
    renamed = replace(elsewhere, drones=("uav2",), pose_tracks={"uav2": elsewhere.tracks()["uav1"]})
    fleet = joined([open_recording(one), renamed])
    assert not fleet.people.unreadable
    assert list(fleet.people.stamps_ns) == [EPOCH_NS]


def test_two_worlds_are_none(tmp_path: Path) -> None:
    """Simulated flights all begin at one time and place."""
    one = mission(tmp_path / "a.mcap", "uav1", {EPOCH_NS: 0.0})
    other = mission(tmp_path / "b.mcap", "uav2", {EPOCH_NS: 50.0})
    fleet = open_recording([one, other])
    assert not len(fleet.people.stamps_ns)
    assert "b and a tell of different people at one time" in fleet.people.unreadable
    assert fleet.people.unreadable in fleet.warnings


@pytest.mark.parametrize(("of_second_m", "told_m"), [(3.0, 3.0), (4.0, 2.0)])
def test_what_a_crowd_is_stays_where_all_say_the_same(
    tmp_path: Path, of_second_m: float, told_m: float
) -> None:
    one = mission(tmp_path / "a.mcap", "uav1", {}, radius_m=3.0)
    other = mission(tmp_path / "b.mcap", "uav2", {}, radius_m=of_second_m)
    assert crowd_definition(open_recording([one, other]).manifest)["radius_m"] == told_m
