"""A fleet without a drone that saw nothing is the fleet of the others."""

import json
from pathlib import Path

import numpy as np
import pytest

import crowdfence as cf
from crowdfence.cli.exit_codes import FAILED
from crowdfence.sources.without_drones import without_drones
from support.command_line import crowdfence
from support.small_service import CONFIG, plain, recording, views

DEMO = Path(cf.__file__).parent / "demo_data" / "race.mcap"


def test_a_run_without_a_drone_is_that_of_the_others() -> None:
    flown = views(10)
    without = cf.run(without_drones(recording(flown), ["uav2"]), plain(), CONFIG)
    others = cf.run(recording([one for one in flown if one.drone != "uav2"]), plain(), CONFIG)
    assert without.crowd_map.to_bytes() == others.crowd_map.to_bytes()
    assert [zone.id for zone in without.zones] == [zone.id for zone in others.zones]
    assert "uav2 is left out, as asked: 10 frames" in without.warnings


def test_nothing_of_it_is_left() -> None:
    recorded = cf.open_recording(DEMO)
    left = cf.open_recording(DEMO, without=["uav1", "uav3"])
    assert left.drones == ("uav2",) and set(left.tracks()) == {"uav2"}
    assert [frame.stamp_ns for frame in left.frames] == [one.stamp_ns for one in recorded.frames_of("uav2")]
    assert left.georeference == recorded.georeference and left.manifest["left_out"] == ["uav1", "uav3"]


def test_a_drone_that_is_not_there_and_all_that_are() -> None:
    with pytest.raises(ValueError, match=r"no drone 'uav9' to leave out; it holds uav1, uav2, uav3"):
        cf.open_recording(DEMO, without=["uav9"])
    with pytest.raises(ValueError, match=r"one of them must be left"):
        cf.open_recording(DEMO, without=["uav1", "uav2", "uav3"])


def test_an_alignment_may_name_a_drone_that_is_left_out(tmp_path: Path) -> None:
    """It is of the flight as it was recorded."""
    from crowdfence.sources.alignment_file import write_alignment
    from crowdfence.sources.pose_offset import PoseOffset

    told = tmp_path / "offsets.json"
    write_alignment(told, {drone: PoseOffset(yaw_deg=1.0) for drone in ("uav1", "uav2")}, {})
    left = cf.open_recording(DEMO, alignment=told, without=["uav2"])
    assert left.drones == ("uav1", "uav3")
    before = cf.open_recording(DEMO)
    turned, straight = (one.frames_of("uav1")[0].world_from_camera for one in (left, before))
    assert not np.allclose(turned, straight)


def test_the_command_line_says_who_is_left_out(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["--detector", "recorded", "--files", "frames.csv,terrain.bt"]
    done = crowdfence("run", DEMO, "--without", "uav2", "-o", out, *words)
    assert done.returncode == 0 and "uav2 is left out, as asked" in " ".join(done.stderr.split())
    summary = json.loads((out / "summary.json").read_text())
    assert summary["left_out"] == ["uav2"] and list(summary["frames"]) == ["uav1", "uav3"]
    assert "uav2" not in (out / "frames.csv").read_text()
    wrong = crowdfence("run", DEMO, "--without", "uav9", "-o", tmp_path / "b", *words)
    assert wrong.returncode == FAILED and wrong.stderr.count("\n") == 1 and "no drone 'uav9'" in wrong.stderr
    live = crowdfence("serve", "--terrain", out / "terrain.bt", "--assume-local", "--without", "uav2")
    assert live.returncode == FAILED and "--without says something about a recording" in live.stderr
