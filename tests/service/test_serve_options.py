"""`crowdfence serve` takes what `crowdfence run` takes, and does the same with it."""

import json
import logging
import math
import re
import socket
from pathlib import Path
from time import sleep

import pytest
from typer.testing import CliRunner

import crowdfence as package
from crowdfence import open_recording
from crowdfence.cli.app import app
from crowdfence.service import server
from crowdfence.service.service import Service
from crowdfence.service.settings import ServiceSettings
from crowdfence.sources.convert import convert
from support.command_line import commands, crowdfence
from support.served import ORIGIN, write_level_ground
from support.small_recordings import Flight, flight, write_folder

DEMO = Path(package.__file__).parent / "demo_data" / "race.mcap"
COARSE = "voxels of 4 m are coarse for people"
NO_PRIOR = "prior 0.5, because the map gives none"
OTHER_VOXELS = "the rates of crowdnet-s were measured with voxels of 0.5 m"


def test_every_option_of_run_but_those_about_files() -> None:
    """A service closes ground: it is about crowds, and has no other layer."""
    options = commands()
    files = {"--output", "-o", "--files", "--open", "--force"}
    assert options["run"] - options["serve"] == files | {"--layer"}


@pytest.fixture
def replayed(monkeypatch: pytest.MonkeyPatch) -> list[tuple[set[str], list[int]]]:
    """Drones and instants of every replay, in place of a server that never ends."""
    found: list[tuple[set[str], list[int]]] = []

    def watched(service: Service, *_: object) -> None:
        while service.mode != "finished":
            sleep(0.01)
        service.store.flush()
        stamps = [stamp for (stamp,) in service.store.rows("SELECT stamp_ns FROM moments ORDER BY number")]
        found.append((set(service.mission.drones), stamps))

    monkeypatch.setattr(server, "serve", watched)
    return found


def test_several_recordings_are_one_fleet(tmp_path: Path, replayed: list[tuple[set[str], list[int]]]) -> None:
    flown = flight()
    convert(open_recording(write_folder(tmp_path / "whole", flown)), tmp_path / "whole.mcap")
    for drones in (("uav1",), ("uav_2", "uav3")):
        part = Flight(drones, flown.frame_stamps_ns, flown.telemetry_stamps_ns)
        path = tmp_path / f"{drones[0]}.mcap"
        convert(open_recording(write_folder(tmp_path / drones[0], part)), path)
    how = ["--terrain", str(write_level_ground(tmp_path / "ground.tif")), "--max-range-m", "800"]
    how += ["--detector", "recorded", "--replay-speed", "inf", "--voxel-size-m", "4"]
    for names in (["whole.mcap"], ["uav1.mcap", "uav_2.mcap"]):
        words = ["serve", *(str(tmp_path / name) for name in names), *how]
        finished = CliRunner().invoke(app, words, catch_exceptions=False)
        assert finished.exit_code == 0
    assert replayed[0][0] == {"uav1", "uav_2", "uav3"} and len(replayed[0][1]) > 3
    assert replayed[1] == replayed[0]


def test_what_the_process_logs_to_is_as_before_once_a_service_has_ended(
    tmp_path: Path, replayed: list[tuple[set[str], list[int]]]
) -> None:
    """Else a program that served writes on into a stream that may be closed, a traceback a line."""
    root = logging.getLogger()
    before, level = list(root.handlers), root.level
    terrain = write_level_ground(tmp_path / "ground.tif")
    words = ["serve", str(write_folder(tmp_path / "flight", flight())), "--terrain", str(terrain)]
    words += ["--detector", "recorded", "--replay-speed", "inf", "--voxel-size-m", "4"]
    assert CliRunner().invoke(app, words, catch_exceptions=False).exit_code == 0
    assert (root.handlers, root.level) == (before, level)


@pytest.mark.parametrize("how", [["--mount", "level:-60"], ["--topics", "camera=/a,pose=/b"]])
def test_what_a_recording_cannot_use_is_refused_as_by_run(tmp_path: Path, how: list[str]) -> None:
    """The options reach the reader: a mission file says these things itself."""
    convert(open_recording(write_folder(tmp_path / "whole", flight())), tmp_path / "whole.mcap")
    words = [str(tmp_path / "whole.mcap"), "--terrain", str(write_level_ground(tmp_path / "g.tif")), *how]
    served = CliRunner().invoke(app, ["serve", *words]).exception
    ran = CliRunner().invoke(app, ["run", *words, "-o", str(tmp_path / "out")]).exception
    assert isinstance(served, ValueError) and str(served) == str(ran)


def test_pictures_of_topics_need_a_detector_from_the_start(tmp_path: Path) -> None:
    """Else each is refused as it comes. With one, what is missing here is the router."""
    words = ["serve", "--terrain", str(write_level_ground(tmp_path / "g.tif")), "--origin", ORIGIN]
    words += ["--data", str(tmp_path / "live"), "--zenoh", "tcp/127.0.0.1:9"]
    pictures = ["--topics", "drone=uav1,camera=/uav1/image,info=/uav1/info,camera_pose=/uav1/pose"]
    refused = CliRunner().invoke(app, [*words, *pictures]).exception
    assert isinstance(refused, ValueError) and "of uav1 (/uav1/image): name a detector" in str(refused)
    assert not (tmp_path / "live").exists()
    heatmaps = ["--topics", "drone=uav1,heatmap=/uav1/heat,info=/uav1/info,camera_pose=/uav1/pose"]
    for how in ([*pictures, "--detector", "crowdnet-s"], heatmaps):
        words[words.index("--data") + 1] += "x"
        assert "no Zenoh session" in str(CliRunner().invoke(app, [*words, *how]).exception)


def test_what_is_doubtful_of_a_recording_is_told_as_by_run(
    tmp_path: Path, replayed: list[tuple[set[str], list[int]]]
) -> None:
    """One row of the poses is no number, and nothing tells the camera of a frame long after the last."""
    folder = write_folder(tmp_path / "flight", flight())
    rows = (folder / "poses.csv").read_text().splitlines()
    (folder / "poses.csv").write_text("\n".join([*rows, "uav1,x,0,0,0,1,0,0,0"]) + "\n")
    heatmap = next((folder / "heatmaps").glob("uav1_*"))
    late = int(heatmap.stem.split("_")[1]) + 60_000_000_000
    heatmap.with_name(f"uav1_{late}{heatmap.suffix}").write_bytes(heatmap.read_bytes())
    words = [str(folder), "--terrain", str(write_level_ground(tmp_path / "g.tif")), "--max-range-m", "800"]
    words += ["--voxel-size-m", "4"]
    ran = CliRunner().invoke(app, ["run", *words, "-o", str(tmp_path / "out")], catch_exceptions=False)
    served = CliRunner().invoke(app, ["serve", *words, "--replay-speed", "inf"], catch_exceptions=False)
    assert ran.exit_code == served.exit_code == 0
    for said in ("poses.csv: 1 rows cannot be read", f"uav1 at {late}: no pose"):
        assert said in ran.stderr and said in served.stderr


def test_what_a_map_does_to_zones_is_told_as_by_run(
    tmp_path: Path, replayed: list[tuple[set[str], list[int]]]
) -> None:
    """Cells of 4 m may miss a small crowd, and level ground gives `paper` no prior."""
    words = [str(write_folder(tmp_path / "flight", flight())), "--max-range-m", "800", "--method", "paper"]
    words += ["--terrain", str(write_level_ground(tmp_path / "g.tif")), "--voxel-size-m", "4"]
    ran = CliRunner().invoke(app, ["run", *words, "-o", str(tmp_path / "out")], catch_exceptions=False)
    served = CliRunner().invoke(app, ["serve", *words, "--replay-speed", "inf"], catch_exceptions=False)
    assert ran.exit_code == served.exit_code == 0
    for doubt in (COARSE, NO_PRIOR):
        assert doubt in ran.stderr and doubt in served.stderr


def test_warnings_before_the_page_are_lines_of_a_log_in_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever reads a line as JSON stumbled over them, or never saw them."""
    monkeypatch.setattr(server, "serve", lambda *_: None)
    words = ["serve", "--terrain", str(write_level_ground(tmp_path / "g.tif")), "--voxel-size-m", "4"]
    words += ["--data", str(tmp_path / "live"), "--origin", ORIGIN, "--json-logs"]
    done = CliRunner().invoke(app, words, catch_exceptions=False)
    lines = [json.loads(line) for line in done.stderr.splitlines()]
    told = [line["message"] for line in lines if line["level"] == "warning"]
    assert any(COARSE in message for message in told) and any("no geoid" in message for message in told)


CAMERAS_OFF, ZONES_OFF = "and cameras are too high", "and though poses count from its ground, zones are"


@pytest.mark.parametrize(
    ("how", "told"),
    [
        (["--origin", ORIGIN], CAMERAS_OFF),  # poses over HTTP count from there, above the ellipsoid
        (["--assume-local"], ZONES_OFF),  # and here from the map's lowest height, whatever that counts from
        (["--origin", ORIGIN, "--mavlink", "uav1=udp:127.0.0.1:0"], ZONES_OFF),  # above the take-off
        (["--origin", ORIGIN, "--mavlink", "uav1=udp:127.0.0.1:0", "--heights", "sea"], CAMERAS_OFF),
        (["--assume-local", "--mavlink", "uav1=udp:127.0.0.1:0", "--heights", "sea"], CAMERAS_OFF),
        (["--origin", ORIGIN, "--terrain-option", "height_offset_m=48"], None),
    ],
)
def test_a_map_that_names_no_geoid_is_told_of_live(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: list[str], told: str | None
) -> None:
    """As `run` tells it: heights of such a map mostly count from the sea, and what was seen lay tens of
    metres off without a word, or the air above it that a file closes."""
    monkeypatch.setattr(server, "serve", lambda *_: None)
    words = ["serve", "--terrain", str(write_level_ground(tmp_path / "g.tif")), "--voxel-size-m", "4"]
    words += ["--data", str(tmp_path / "live"), *how]
    done = CliRunner().invoke(app, words, catch_exceptions=False)
    assert done.exit_code == 0
    assert ("g.tif names no geoid that its heights count from" in done.stderr) == (told is not None)
    assert told is None or told in done.stderr


@pytest.mark.parametrize(
    ("views", "doubts"),
    [("recorded", (OTHER_VOXELS, "tilt below the horizon: 1.5% of")), ("live", (OTHER_VOXELS, COARSE))],
)
def test_where_a_detector_was_not_tested_is_told_before_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, views: str, doubts: tuple[str, ...]
) -> None:
    monkeypatch.setattr(server, "serve", lambda *_: None)
    live = ["--terrain", str(write_level_ground(tmp_path / "g.tif")), "--origin", ORIGIN]
    live += ["--voxel-size-m", "4", "--data", str(tmp_path / "live")]
    words = ["serve", *([str(DEMO)] if views == "recorded" else live), "--detector", "crowdnet-s"]
    done = CliRunner().invoke(app, words, catch_exceptions=False)
    assert done.exit_code == 0 and all(doubt in done.stderr for doubt in doubts), done.stderr


def test_a_port_that_is_taken_is_one_line(tmp_path: Path) -> None:
    """And no gate that was not met, which is what exit code 3 says."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        ground = write_level_ground(tmp_path / "g.tif")
        done = crowdfence(
            *("serve", "--terrain", ground, "--origin", ORIGIN, "--voxel-size-m", 2),
            *("--terrain-option", "height_offset_m=0"),
            *("--data", tmp_path / "data", "--port", port),
        )
    errors = [line for line in done.stderr.splitlines() if not line.startswith("INFO")]
    assert done.returncode == 1
    assert errors == [
        f"error: cannot listen on 127.0.0.1:{port}: Address already in use; --port takes another, 0 any that "
        "is free"
    ]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"silent_after_s": 1e300}, "silent_after_s is 1e+300; it must be at most 3600"),
        ({"max_delay_ms": 1e9}, "max_delay_ms is 1e+09; it must be at most 3.6e+06"),
        ({"keep_s": 1e300}, "keep_s is 1e+300; it must be at most"),
        ({"silent_after_s": math.nan}, "silent_after_s is nan; it must be finite and above 0"),
    ],
)
def test_a_setting_that_no_alarm_would_live_to_see_is_refused(
    setting: dict[str, float], message: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        ServiceSettings(**setting)  # type: ignore[arg-type]


@pytest.mark.parametrize("speed", ["nan", "0", "-1", "1e-300"])
def test_a_replay_that_would_stand_still_is_refused(tmp_path: Path, speed: str) -> None:
    """At 1e-300 the replay ended in a traceback, and the page went on showing the first instant."""
    flown = write_folder(tmp_path / "flight", flight())
    ground = write_level_ground(tmp_path / "ground.tif")
    how = ["--terrain", ground, "--detector", "recorded", "--voxel-size-m", 4, "--port", 0]
    done = crowdfence("serve", flown, *how, "--max-range-m", 800, "--replay-speed", speed)
    assert done.returncode == 1
    assert f"replay speed is {float(speed):g}; it must be at least 0.001" in done.stderr


@pytest.mark.parametrize("hours", ["nan", "0", "-1", "1e300"])
def test_hours_that_nothing_is_kept_for_are_refused(tmp_path: Path, hours: str) -> None:
    done = crowdfence("serve", "-t", "nowhere.tif", "--data", tmp_path / "data", "--keep-h", hours)
    assert done.returncode == 2 and "--keep-h" in done.stderr
