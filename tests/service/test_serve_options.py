"""`crowdfence serve` takes what `crowdfence run` takes, and does the same with it."""

from pathlib import Path
from time import sleep

import pytest
from typer.testing import CliRunner

from crowdfence import open_recording
from crowdfence.cli.app import app
from crowdfence.service import server
from crowdfence.service.service import Service
from crowdfence.sources.convert import convert
from support.command_line import commands
from support.served import write_level_ground
from support.small_recordings import Flight, flight, write_folder


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


@pytest.mark.parametrize("how", [["--mount", "level:-60"], ["--topics", "camera=/a,pose=/b"]])
def test_what_a_recording_cannot_use_is_refused_as_by_run(tmp_path: Path, how: list[str]) -> None:
    """The options reach the reader: a mission file says these things itself."""
    convert(open_recording(write_folder(tmp_path / "whole", flight())), tmp_path / "whole.mcap")
    words = [str(tmp_path / "whole.mcap"), "--terrain", str(write_level_ground(tmp_path / "g.tif")), *how]
    served = CliRunner().invoke(app, ["serve", *words]).exception
    ran = CliRunner().invoke(app, ["run", *words, "-o", str(tmp_path / "out")]).exception
    assert isinstance(served, ValueError) and str(served) == str(ran)
