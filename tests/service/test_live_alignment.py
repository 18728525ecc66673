"""Constant errors of poses, taken out of live views as `--alignment` takes them out of recordings."""

import json
from pathlib import Path
from threading import Condition

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from crowdfence import CrowdMap, View, open_recording
from crowdfence.cli.app import app
from crowdfence.service import opening, server
from crowdfence.service.gate import Refused
from crowdfence.service.inputs import Inputs
from crowdfence.service.poses import Poses
from crowdfence.service.service import Service
from crowdfence.service.watch import Watch
from crowdfence.sources.alignment_file import write_alignment
from crowdfence.sources.pose_offset import PoseOffset
from support.served import ORIGIN, write_level_ground
from support.small_recordings import flight, write_folder
from support.small_service import CONFIG, SECOND_NS, START_NS, message, plain, running, settle, view, views

TURNED = PoseOffset(pitch_deg=3.0, yaw_deg=-2.0, roll_deg=20.0, position_m=(1.5, -2.0, 0.5))


def misplaced(one: View) -> View:
    """As a drone gives it whose poses need `TURNED` to be right, by inverses of the three turns together."""
    turn = TURNED.pose(np.eye(4))[:3, :3]
    world_from_camera = one.world_from_camera.copy()
    world_from_camera[:3, :3] = world_from_camera[:3, :3] @ turn.T
    world_from_camera[:3, 3] -= TURNED.position_m
    return View(one.drone, one.stamp_ns, one.camera, world_from_camera, one.heatmap)


def test_a_drone_that_is_aligned_closes_what_a_right_one_closes(tmp_path: Path) -> None:
    """Only its own views are put right, and the journal holds right poses: a restart needs no alignment."""
    zones = []
    for name, offsets in (("right", {}), ("wrong", {}), ("aligned", {"uav1": TURNED})):
        with running(tmp_path / name, inputs=Inputs(offsets=offsets)) as service:
            assert service.live is not None
            for one in views(9):
                wrong = name != "right" and one.drone == "uav1"
                service.live.intake.give_view(message(misplaced(one) if wrong else one))
            settle(service)
            service.live.finish()
            zones.append(service.mission.found.zones)
    right, wrong, aligned = zones
    assert [zone.id for zone in right] == [zone.id for zone in aligned] != []
    for ours, theirs in zip(right, aligned, strict=True):
        assert ours.polygon.symmetric_difference(theirs.polygon).area < 1e-6
    assert sum(zone.polygon.area for zone in wrong) != pytest.approx(sum(zone.polygon.area for zone in right))
    with running(tmp_path / "aligned") as service:
        assert [zone.id for zone in service.mission.found.zones] == [zone.id for zone in aligned]


def test_telemetry_is_asked_for_the_time_that_a_picture_belongs_to() -> None:
    """4 m/s eastwards: a quarter of a second later is a metre further."""

    class Feed:
        changed = Condition()
        newest_ns = START_NS + 10_000_000_000
        frame = None

        def pose_at(self, stamp_ns: int) -> NDArray[np.float64]:
            world_from_camera = np.diag([1.0, -1.0, -1.0, 1.0])
            world_from_camera[:3, 3] = (4.0 * (stamp_ns - START_NS) / 1e9, 7.0, 20.0)
            return world_from_camera

    offsets = {"uav1": PoseOffset(time_s=0.25, position_m=(0.0, 0.5, -2.0))}
    poses = Poses({"uav1": Feed()}, wait_s=0.0, stale_s=1.0, started_ns=START_NS, offsets=offsets)
    found = poses.pose_at("uav1", START_NS + 1_000_000_000, START_NS)
    np.testing.assert_allclose(found[:3, 3], (5.0, 7.5, 18.0))


@pytest.mark.parametrize(
    ("clock_s", "time_s", "is_taken"),
    [
        (0.0, -3.0, True),  # pictures are stamped at the end of a video link that takes 3 s
        (3.0, 3.0, True),  # an autopilot's clock is 3 s ahead, which the alignment says
        (3.0, 0.5, False),
        (3.0, -0.5, False),
    ],
)
def test_pictures_that_are_stamped_late_are_no_clock_of_poses_that_is_ahead(
    clock_s: float, time_s: float, is_taken: bool
) -> None:
    """A good alignment of late pictures raised an alarm from half a second on, and cost every view from 2 s
    on, with advice to correct a clock that was right. 4 m/s eastwards by the clock of the poses."""
    now_ns = START_NS + 20 * SECOND_NS

    class Feed:
        changed = Condition()
        newest_ns = now_ns + round(clock_s * SECOND_NS)
        frame = doubt = None

        def pose_at(self, stamp_ns: int) -> NDArray[np.float64]:
            world_from_camera = np.eye(4)
            world_from_camera[0, 3] = 4.0 * (stamp_ns - now_ns) / SECOND_NS
            return world_from_camera

    offsets = {"uav1": PoseOffset(time_s=time_s)}
    bounds = {"wait_s": 0.0, "stale_s": 9.0, "max_ahead_s": 2.0}
    poses = Poses({"uav1": Feed()}, started_ns=now_ns, offsets=offsets, **bounds)
    stamp_ns = now_ns - SECOND_NS // 4
    if is_taken:
        assert poses.pose_at("uav1", stamp_ns, now_ns)[0, 3] == pytest.approx(4.0 * (time_s - 0.25))
        assert poses.trouble("uav1", now_ns) is None
        return
    with pytest.raises(Refused, match="s ahead of the clock of the service"):
        poses.pose_at("uav1", stamp_ns, now_ns)
    trouble = poses.trouble("uav1", now_ns)
    assert trouble is not None and trouble.cause == "ahead"


def test_what_cannot_be_put_right_is_refused(tmp_path: Path) -> None:
    offsets = {"uav1": PoseOffset(time_s=0.1), "uav2": TURNED}
    crowd_map = CrowdMap(plain(), CONFIG.method.fusion_method(plain(), 3), max_range_m=80.0)
    (seen,) = crowd_map.integrate([view("uav2", 0)], START_NS).observations
    with running(tmp_path, inputs=Inputs(offsets=offsets)) as service:
        assert service.live is not None
        with pytest.raises(Refused, match=r"pictures of uav1 are \+0.100 s off"):
            service.live.intake.give_view(message(view("uav1", 0)))
        with pytest.raises(Refused, match="uav2 projects itself"):
            service.live.intake.give_observation(seen.to_bytes())
        service.live.intake.give_view(message(view("uav3", 0)))
        assert service.live.heard.refused == {"(unknown)": 2} and service.live.heard.accepted == {"uav3": 1}


def test_a_drone_that_is_aligned_and_never_comes_is_told_once_the_fleet_is_there(tmp_path: Path) -> None:
    """A misspelled name leaves wrong poses as they are. One that is expected is told as silent."""
    offsets = dict.fromkeys(("UAV1", "uav2", "uav3"), TURNED)

    def give(service: Service, drone: str, after_s: float) -> None:
        assert service.live is not None
        one = view("uav1", 0)
        stamp_ns = START_NS + round(after_s * SECOND_NS)
        moved = View(drone, stamp_ns, one.camera, one.world_from_camera, one.heatmap)
        service.live.intake.give_view(message(moved))
        settle(service)

    def told(service: Service, *, active: bool = True) -> dict[str | None, str]:
        found = [one for one in service.alerts.all() if one.kind == "alignment_unused"]
        return {one.drone: one.text for one in found if (one.cleared_ns is None) == active}

    with running(tmp_path, inputs=Inputs(offsets=offsets), drones=["uav3"]) as service:
        watch = Watch(service)
        steps = ((None, 0.0, 0), ("uav1", 0.0, 0), ("uav1", 50.0, 0), ("uav4", 55.0, 0), ("uav1", 114.0, 0))
        for drone, after_s, count in (*steps, ("uav1", 115.0, 2), ("uav1", 120.0, 2)):
            if drone is not None:
                give(service, drone, after_s)
            watch.look()
            assert len(told(service)) == count, (drone, after_s)
        assert told(service)["UAV1"] == (
            "--alignment names UAV1, of which no view was taken; there are uav1, uav3, uav4: under a "
            "misspelled name poses stay as wrong as they are"
        )
        give(service, "uav2", 121.0)
        watch.look()
        assert (set(told(service)), set(told(service, active=False))) == ({"UAV1"}, {"uav2"})


def test_serve_reads_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Opened(Exception):
        pass

    def opened(*_: object, inputs: Inputs, **__: object) -> None:
        raise Opened(json.dumps({drone: offset.pitch_deg for drone, offset in inputs.offsets.items()}))

    monkeypatch.setattr(opening, "live", opened)
    write_alignment(tmp_path / "offsets.json", {"uav1": PoseOffset(pitch_deg=0.75)})
    words = ["serve", "--terrain", str(write_level_ground(tmp_path / "ground.tif")), "--origin", ORIGIN]
    words += ["--data", str(tmp_path / "data"), "--alignment", str(tmp_path / "offsets.json")]
    finished = CliRunner().invoke(app, words).exception
    assert isinstance(finished, Opened) and json.loads(str(finished)) == {"uav1": 0.75}


@pytest.mark.parametrize(
    ("offset", "is_told"),
    [
        (PoseOffset(pitch_deg=0.75, roll_deg=-0.5), False),
        (PoseOffset(pitch_deg=0.75, time_s=0.2), True),
        (PoseOffset(position_m=(0.0, 0.0, -2.0)), True),
    ],
)
def test_places_and_clocks_of_another_flight_are_told_of_before_views_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, offset: PoseOffset, is_told: bool
) -> None:
    """As with a recording of another time: receivers are elsewhere off on every flight, and a live one is
    always another. How a camera is mounted stays."""
    monkeypatch.setattr(server, "serve", lambda *_: None)
    found_on = open_recording(write_folder(tmp_path / "monday", flight()))
    write_alignment(tmp_path / "offsets.json", {"uav1": offset}, recording=found_on)
    words = ["serve", "--terrain", str(write_level_ground(tmp_path / "ground.tif")), "--origin", ORIGIN]
    words += ["--data", str(tmp_path / "data"), "--alignment", str(tmp_path / "offsets.json")]
    done = CliRunner().invoke(app, [*words, "--voxel-size-m", "4"], catch_exceptions=False)
    assert done.exit_code == 0
    assert ("offsets.json was found on monday, from " in done.stderr) == is_told
