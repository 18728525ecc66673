"""Recordings whose local frames count from different places: nothing moves on Earth when they are joined."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer

from crowdfence.georeference import Georeference
from crowdfence.sources import open_recording
from crowdfence.sources.convert import convert
from crowdfence.sources.fleet import joined
from crowdfence.sources.layers import LayerGround
from crowdfence.sources.mission.writer import MissionWriter
from crowdfence.sources.moved_frame import FrameMove, in_frame
from crowdfence.sources.recorded_truth import RecordedPeople
from crowdfence.sources.recording import GroundContact, Recording
from support.small_recordings import EPOCH_NS, ORIGIN, flight, write_folder

HERE = Georeference(*ORIGIN)
NORTH_EAST = Georeference(46.52, 8.04, 1350.0)
"""About 2.2 km north and 3.1 km east of the first."""
EARTH = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)


def on_earth(anchor: Georeference, points: np.ndarray) -> np.ndarray:
    """Earth-centred metres [N, 3], by PROJ alone."""
    latitude, longitude, height = anchor.geodetic_from_local(points)
    return np.column_stack(EARTH.transform(longitude, latitude, height))


def part(folder: Path, drone: str, anchor: Georeference | None) -> Path:
    write_folder(folder, replace(flight(), drones=(drone,)))
    said = json.loads((folder / "recording.json").read_text())
    said["georeference"] = anchor and {
        "latitude_deg": anchor.latitude_deg,
        "longitude_deg": anchor.longitude_deg,
        "height_m": anchor.height_m,
    }
    if anchor is None:
        del said["georeference"]
    (folder / "recording.json").write_text(json.dumps(said))
    return folder


anchors = st.builds(
    Georeference,
    st.floats(-89.9, 89.9, allow_nan=False),
    st.floats(-180, 180, allow_nan=False),
    st.floats(-400, 9000, allow_nan=False),
)


@given(old=anchors, new=anchors, places=st.lists(st.tuples(*[st.floats(-2000, 2000)] * 3), min_size=1))
def test_every_point_stays_where_it_is_on_earth(
    old: Georeference, new: Georeference, places: list[tuple[float, float, float]]
) -> None:
    points = np.array(places)
    moved = FrameMove.between(old, new).points(points)
    # The new frame by itself, without PROJ's degrees: these lose their meaning at its antipode.
    up = np.radians([new.latitude_deg, new.longitude_deg])
    (sin_lat, sin_lon), (cos_lat, cos_lon) = np.sin(up), np.cos(up)
    east = np.array([-sin_lon, cos_lon, 0.0])
    north = np.array([-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat])
    axes = np.stack([east, north, np.cross(east, north)])
    expected = (on_earth(old, points) - on_earth(new, np.zeros((1, 3)))) @ axes.T
    np.testing.assert_allclose(moved, expected, atol=2e-6)


def test_cameras_of_a_fleet_look_at_the_same_places_on_earth(tmp_path: Path) -> None:
    """Each drone of a fleet of robots counts from where it was switched on."""
    paths = [part(tmp_path / "a", "uav1", HERE), part(tmp_path / "b", "uav3", NORTH_EAST)]
    alone, fleet = open_recording(paths[1]), open_recording(paths)
    assert fleet.georeference == HERE
    assert fleet.drones == ("uav1", "uav3")
    ahead = np.array([[0, 0, 0, 1], [0.0, 0, 200, 1], [50, 0, 200, 1]]).T  # of the camera
    for before, after in zip(alone.frames, fleet.frames_of("uav3"), strict=True):
        looked_at = on_earth(NORTH_EAST, (before.world_from_camera @ ahead).T[:, :3])
        now = on_earth(HERE, (after.world_from_camera @ ahead).T[:, :3])
        np.testing.assert_allclose(now, looked_at, atol=1e-5)
    # 3.1 km, 2.2 km: drones were 120 m apart where they counted from one place.
    apart = fleet.frames_of("uav3")[0].world_from_camera - fleet.frames_of("uav1")[0].world_from_camera
    assert 3000 < apart[0, 3] < 3300 and 2200 < apart[1, 3] < 2500
    assert all("(0, 0, 0)" not in line for line in fleet.warnings)


def test_the_first_one_stays_as_it_was_recorded_to_the_bit(tmp_path: Path) -> None:
    paths = [part(tmp_path / "a", "uav1", HERE), part(tmp_path / "b", "uav3", NORTH_EAST)]
    alone, fleet = open_recording(paths[0]), open_recording(paths)
    for before, after in zip(alone.frames, fleet.frames_of("uav1"), strict=True):
        np.testing.assert_array_equal(after.world_from_camera, before.world_from_camera)


def test_what_was_joined_is_converted_with_the_same_poses(tmp_path: Path) -> None:
    fleet = open_recording([part(tmp_path / "a", "uav1", HERE), part(tmp_path / "b", "uav3", NORTH_EAST)])
    convert(fleet, tmp_path / "fleet.mcap")
    again = open_recording(tmp_path / "fleet.mcap")
    assert again.georeference == HERE
    for before, after in zip(fleet.frames, again.frames, strict=True):
        np.testing.assert_array_equal(after.world_from_camera, before.world_from_camera)


def test_the_frame_is_that_of_the_map_that_came_with_one_of_them(tmp_path: Path) -> None:
    """A map without a place on Earth lies in the frame of its own recording."""
    first = part(tmp_path / "a", "uav1", HERE)
    with_map = replace(
        open_recording(part(tmp_path / "b", "uav3", NORTH_EAST)), terrain=tmp_path / "local.bt"
    )

    fleet = joined([open_recording(first), with_map])
    assert fleet.georeference == NORTH_EAST
    assert fleet.terrain == tmp_path / "local.bt"


@pytest.mark.parametrize("nowhere", [0, 1])
def test_one_that_says_its_place_and_one_that_does_not_are_no_fleet(tmp_path: Path, nowhere: int) -> None:
    places = [HERE, HERE]
    paths = [
        part(tmp_path / "a", "uav1", None if nowhere == 0 else places[0]),
        part(tmp_path / "b", "uav3", None if nowhere == 1 else places[1]),
    ]
    names = ("a", "b") if nowhere == 1 else ("b", "a")
    with pytest.raises(ValueError, match=f"^{names[0]} says where on Earth .* and {names[1]} does not"):
        open_recording(paths)


def simulated(path: Path) -> Recording:
    with MissionWriter(path, georeference=NORTH_EAST) as writer:
        writer.add_pose("uav2", EPOCH_NS, [5, 6, 10], (1.0, 0.0, 0.0, 0.0))
        writer.add_layer_ground("landing-site", LayerGround(np.ones((2, 3), np.bool_), 1, 0, 0, 2), EPOCH_NS)
        places = np.array([[5, 6, 0], [7, 6, 0]], np.float32)
        writer.add_people(RecordedPeople(EPOCH_NS, places, np.array([1, 2]), np.array([1, 0])))
    return open_recording(path)


def test_people_and_take_offs_move_along(tmp_path: Path) -> None:
    there = simulated(tmp_path / "there.mcap")
    waiting = {
        "uav2": GroundContact((5.0, 6.0, -1.0), "its first row"),
    }
    moved = in_frame(replace(there, ground_contacts=waiting), HERE)
    people = moved.people_truth(EPOCH_NS)
    assert people is not None
    before = on_earth(NORTH_EAST, np.array([[5.0, 6, 0], [7, 6, 0], [5, 6, -1]]))
    place = moved.ground_contacts["uav2"].place
    assert place is not None
    after = on_earth(HERE, np.array([*people.position, place]))
    np.testing.assert_allclose(after, before, atol=5e-4)  # places of people are float32
    np.testing.assert_allclose(after[2], before[2], atol=1e-6)
    assert people.crowd.tolist() == [1, 0]


def test_heights_above_the_ground_below_stay_what_they_are(tmp_path: Path) -> None:
    there = simulated(tmp_path / "there.mcap")
    waiting = {"uav2": GroundContact(None, "its range finder")}
    moved = in_frame(replace(there, ground_contacts=waiting), HERE)
    assert moved.tracks()["uav2"].positions[0, 2] == 10.0
    assert moved.tracks()["uav2"].positions[0, 0] > 3000


def test_ground_of_other_classes_that_cannot_be_turned_is_told(tmp_path: Path) -> None:
    moved = in_frame(simulated(tmp_path / "there.mcap"), HERE)
    assert not moved.layer_grounds
    assert sum("where landing-site is in the world of there" in line for line in moved.warnings) == 1


def test_a_recording_that_is_there_is_itself(tmp_path: Path) -> None:
    there = simulated(tmp_path / "there.mcap")
    assert in_frame(there, NORTH_EAST) is there
    with pytest.raises(ValueError, match="does not say where on Earth"):
        in_frame(replace(there, georeference=None), HERE)
