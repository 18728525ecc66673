"""Heights that wait for the map: put on it, said, and refused where the map ends."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crowdfence import Georeference, Terrain, open_recording
from crowdfence.sources.convert import convert
from crowdfence.sources.geographic_track import GeographicPoses, HeightOptions, local_track
from crowdfence.sources.ground_contact import ground_heights, on_ground, settled_track
from crowdfence.sources.ground_start import from_the_ground
from crowdfence.sources.recording import GroundContact, Recording
from support.small_recordings import flight, write_folder


@pytest.fixture(scope="module")
def slope() -> Terrain:
    """A plane that rises by 0.1 m a metre eastwards, 100 m at x = 0, 800 m wide."""
    x = np.arange(-400, 400) + 0.5
    return Terrain.from_height_map(
        np.repeat((100 + 0.1 * x)[:, None], 800, axis=1).astype(np.float32), 1.0, origin=(-400, -400, 0)
    )


@pytest.fixture
def flown(tmp_path: Path) -> Recording:
    return open_recording(write_folder(tmp_path / "flight", flight()))


def test_the_ground_is_found_from_above(slope: Terrain) -> None:
    found = ground_heights(slope, [[0.0, 0.0], [50.5, 20.0], [900.0, 0.0]])
    assert np.allclose(found[:2], [100.0, 105.05], atol=0.01) and np.isnan(found[2])


def test_the_take_off_is_put_on_the_map(slope: Terrain, flown: Recording) -> None:
    waiting = replace(flown, ground_contacts={"uav1": GroundContact((30.0, 0.0, 4.0), "home")})
    settled = on_ground(waiting, slope)
    for drone, moved in (("uav1", 103.0 - 4.0), ("uav3", 0.0)):
        before, after = flown.tracks()[drone].positions, settled.tracks()[drone].positions
        assert np.allclose(after - before, [0, 0, moved], atol=0.01)
        for old, new in zip(flown.frames_of(drone), settled.frames_of(drone), strict=True):
            assert np.allclose(
                new.world_from_camera[:3, 3] - old.world_from_camera[:3, 3], [0, 0, moved], atol=0.01
            )
            assert np.array_equal(new.world_from_camera[:3, :3], old.world_from_camera[:3, :3])
    # 2 m around the place, the slope is 0.2 m higher and lower.
    assert (
        "uav1: its take-off (home) is put on the map's ground, which lies within 0.2 m"
        in settled.warnings[-1]
    )
    assert on_ground(settled, slope) is settled


def test_a_flight_whose_heights_wait_has_no_views(slope: Terrain, flown: Recording) -> None:
    """Walked through by instants, it flew 4 m above the origin of its frame, under the ground of the map."""
    waiting = replace(flown, ground_contacts={"uav1": GroundContact((30.0, 0.0, 4.0), "home")})
    with pytest.raises(ValueError, match=r"heights of uav1 count from the ground \(home\).*on_ground in Py"):
        next(waiting.instants()).views()
    settled = on_ground(waiting, slope)
    views, _ = next(settled.instants()).views()
    for view in views:
        before = flown.frames_of(view.drone)[0].world_from_camera[2, 3]
        moved = 99.0 if view.drone == "uav1" else 0.0
        assert view.world_from_camera[2, 3] - before == pytest.approx(moved, abs=0.01)


def test_heights_above_the_ground_below_follow_it(slope: Terrain, flown: Recording) -> None:
    settled = on_ground(replace(flown, ground_contacts={"uav1": GroundContact(None, "below")}), slope)
    before, after = flown.tracks()["uav1"].positions, settled.tracks()["uav1"].positions
    assert np.allclose(after[:, 2] - before[:, 2], 100 + 0.1 * before[:, 0], atol=0.01)


def test_heights_above_the_ground_below_are_the_same_far_from_the_anchor() -> None:
    """8 km east of it level ground lies 5 m below the anchor's plane, and the camera stands 30 m above it: as
    far below that plane as the ground, it was put 5 m nearer to the ground than it was."""
    anchor = Georeference(46.5, 8.0, 1200.0)
    latitude_deg, longitude_deg, _ = anchor.geodetic_from_local([[8000.0, 0.0, 0.0], [8010.0, 0.0, 0.0]])
    east = np.arange(7900.5, 8100.0)
    falls = -(east**2) / (2 * 6.388e6)  # radius of the ellipsoid there, across the meridian
    ground = np.repeat(falls[:, None], 200, axis=1).astype(np.float32)
    terrain = Terrain.from_height_map(ground, 1.0, origin=(7900.0, -100.0, 0.0))
    poses = GeographicPoses(
        stamps_ns=[0, 10**9],
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        heights_m={"ground": np.array([30.0, 31.0])},
        attitudes_ned=np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)),
    )
    found = local_track(poses, HeightOptions("ground"), anchor)
    assert found.contact is not None
    places = settled_track("uav1", found.track, found.contact, terrain).positions
    assert places[:, 2] - ground_heights(terrain, places[:, :2]) == pytest.approx([30.0, 31.0], abs=0.02)
    assert places[0, 2] == pytest.approx(30.0 - 8000.0**2 / (2 * 6.388e6), abs=0.02)


def test_the_bias_of_a_barometer_is_estimated_and_said(tmp_path: Path, slope: Terrain) -> None:
    found = open_recording(write_folder(tmp_path / "flight", flight()), ground_start=True)
    assert set(found.ground_contacts) == set(found.drones)
    settled = on_ground(found, slope)
    for drone in found.drones:
        x, _, z = found.tracks()[drone].positions[0]
        assert settled.tracks()[drone].positions[0, 2] == pytest.approx(100 + 0.1 * x, abs=0.01)
        (said,) = (one for one in settled.warnings if one.startswith(f"{drone}: heights moved by"))
        moved = re.search(r"moved by ([-+][\d.]+) m: its first pose is put on the map's ground", said)
        assert moved is not None and float(moved[1]) == pytest.approx(100 + 0.1 * x - z, abs=0.06)


def test_what_a_barometer_says_on_the_ground_is_taken_out_of_heights_above_the_take_off(
    slope: Terrain, flown: Recording
) -> None:
    """It had drifted by 3 m before the start; --ground-start did nothing, and did not say so."""
    x, y, z = flown.tracks()["uav1"].positions[0]
    home = GroundContact((x + 40.0, y, z - 3.0), "recorded home")
    found = from_the_ground(replace(flown, ground_contacts={"uav1": home}))
    settled = on_ground(found, slope)
    assert settled.tracks()["uav1"].positions[0, 2] == pytest.approx(100 + 0.1 * x, abs=0.01)
    assert any("(its first pose, +3.0 m from there by its own height)" in one for one in settled.warnings)


@pytest.mark.parametrize("below_m", [None, 40.0])
def test_a_drone_that_begins_in_flight_is_not_put_on_the_ground(
    flown: Recording, below_m: float | None
) -> None:
    x, y, z = flown.tracks()["uav1"].positions[0]
    place = None if below_m is None else (x, y, z - below_m)
    found = from_the_ground(replace(flown, ground_contacts={"uav1": GroundContact(place, "recorded home")}))
    assert found.ground_contacts["uav1"].place == place and found.ground_contacts["uav3"].absolute
    (said,) = (one for one in found.warnings if "moves nothing" in one)
    assert said.startswith("uav1: ") and ("begins +40 m from" if below_m else "ground below") in said


def test_beside_the_map_there_is_no_take_off(slope: Terrain, flown: Recording, tmp_path: Path) -> None:
    waiting = replace(flown, ground_contacts={"uav1": GroundContact((900.0, 0.0, 0.0), "home")})
    with pytest.raises(
        ValueError, match=r"no ground at x 900.0, y 0.0 m, where uav1 took off \(home\).*--take-off"
    ):
        on_ground(waiting, slope)
    with pytest.raises(ValueError, match=r"heights of uav1 count from the ground \(home\)"):
        convert(waiting, tmp_path / "x.mcap")
    assert not (tmp_path / "x.mcap").exists()
