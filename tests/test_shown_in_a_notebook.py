"""What a notebook shows of an object is a line to read, however much the object holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

import crowdfence as cf
from crowdfence.zones.zone import Zone
from support.small_recordings import flight, ground, write_folder

DEMO = Path(cf.__file__).parent / "demo_data" / "race.mcap"


@pytest.fixture(scope="module")
def recording() -> cf.Recording:
    return cf.open_recording(DEMO)


def test_recording_and_what_it_holds(recording: cf.Recording) -> None:
    first, last = recording.frames[0], recording.frames[-1]
    seconds = (last.stamp_ns - first.stamp_ns) / 1e9
    frames = f"{len(recording.frames)} frames in {seconds:.1f} s, 1 refused"
    assert repr(recording) == f"Recording('race', drones uav1, uav2, uav3, {frames})"
    east, north, up = first.world_from_camera[:3, 3]
    place = f"({east:.1f}, {north:.1f}, {up:.1f}) m"
    assert repr(first) == f"Frame({first.drone} at {first.stamp_ns}, 320x240, from {place})"
    instant = next(iter(recording.instants()))
    assert repr(instant).startswith(f"Instant({instant.stamp_ns}, uav")
    poses = recording.tracks()["uav1"]
    assert repr(poses).startswith(f"PoseTrack({len(poses.stamps_ns)} poses in ")


def test_run(tmp_path: Path) -> None:
    few = cf.open_recording(write_folder(tmp_path / "flight", flight(3)))
    run = cf.run(few, cf.Terrain.from_points(ground(), 2.0), cf.RunConfig(cf.OrConfig()))
    assert repr(run) == f"Run('flight', or, {len(run.rows)} instants, {len(run.zones)} zones from 0.5 on)"


def test_detector() -> None:
    def nobody(image: NDArray[np.uint8]) -> NDArray[np.float32]:
        return np.zeros((60, 80), np.float32)

    assert repr(cf.Detector.from_callable(nobody, stride=4)) == "Detector('nobody', stride 4)"


def test_zone() -> None:
    zone = Zone(
        id="Z1",
        polygon=shapely.box(0, 0, 10, 5),
        cell_count=40,
        area_m2=40.0,
        probability_max=0.987,
        probability_mean=0.5,
        lower_m=0.0,
        upper_m=1.0,
        last_seen_ns=1,
        oldest_look_ns=0,
        seen_by=("uav1",),
    )
    assert repr(zone) == "Zone('Z1', 40 m2 of crowd, P up to 0.99)"
    drawn = Zone(**{name: getattr(zone, name) for name in zone.__slots__} | {"kind": "static"})
    assert repr(drawn) == "Zone('Z1', static, 50 m2)"
