"""Values of options of `simulate` that no scenario can have: the option is named, and its bound."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from crowdfence.cli.app import app
from crowdfence.simulation import scenarios
from support.command_line import crowdfence


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--frames", "0"], "--frames must be between 1 and 1e+07, got 0"),
        (["--drones", "0"], "--drones must be between 1 and 64, got 0"),
        (["--voxel", "0"], "--voxel must be between 0.1 and 20, got 0"),
        (["--voxel", "nan"], "--voxel must be between 0.1 and 20, got nan"),
        (["--time-of-day", "25"], "--time-of-day must be between 0 and 24, got 25"),
        (["--size", "9999999x10"], "--size must be"),
    ],
)
def test_what_no_scenario_can_have(tmp_path: Path, given: list[str], message: str) -> None:
    done = CliRunner().invoke(app, ["simulate", "race", "-o", str(tmp_path / "a.mcap"), *given])
    assert isinstance(done.exception, ValueError) and str(done.exception).startswith(message)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--season", "winter"], "--season does nothing with --no-rgb"),
        (["--time-of-day", "0"], "--time-of-day does nothing with --no-rgb"),
        (["--resume", "--force"], "--resume goes on with what is there and --force replaces it"),
    ],
)
def test_what_would_do_nothing_is_refused(tmp_path: Path, given: list[str], message: str) -> None:
    words = ["simulate", "empty", "-o", str(tmp_path / "a.mcap"), "--no-rgb", *given]
    done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, ValueError) and str(done.exception).startswith(message)
    assert not list(tmp_path.iterdir())


def test_what_a_file_says_is_said_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "parade.toml").write_text("drones = 0")
    words = ["simulate", str(tmp_path / "parade.toml"), "-o", str(tmp_path / "a.mcap"), "--frames", "3"]
    done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, ValueError) and "parade.toml: " in str(done.exception)


def test_a_mission_without_a_picture_is_refused(tmp_path: Path) -> None:
    """It was written, with 0 of 0 frames, and nothing was said."""
    late = tmp_path / "late.toml"
    empty = (Path(scenarios.__file__).parent / "empty.toml").read_text(encoding="utf-8")
    joins = [[drone, 900.0] for drone in range(3)]
    late.write_text(empty.replace("[trouble]", f"[trouble]\njoins_s = {joins}"), encoding="utf-8")
    few = ["--frames", "3", "--fps", "2", "--size", "64x48", "--voxel", "4", "--no-rgb"]
    refused = CliRunner().invoke(app, ["simulate", str(late), "-o", str(tmp_path / "late.mcap"), *few])
    assert "no drone takes a picture that arrives in the 1 s" in str(refused.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["late.toml"]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("voxel_size_m = -1.0", '"voxel_size_m" must be between 0.1 and 20, got -1'),
        ("altitude = 1", 'unknown key altitude; known are camera, .*, "georeference", .*, "voxel_size_m"'),
    ],
)
def test_a_mistake_in_a_scenario_file_is_told_by_its_key(tmp_path: Path, line: str, message: str) -> None:
    """Not as --voxel-size-m and --origin, which `simulate` does not have."""
    race = (Path(scenarios.__file__).parent / "race.toml").read_text(encoding="utf-8")
    scenario = tmp_path / "mine.toml"
    scenario.write_text(re.sub("^voxel_size_m.*", line, race, flags=re.MULTILINE), encoding="utf-8")
    refused = crowdfence("simulate", scenario, "-o", tmp_path / "a.mcap")
    assert refused.returncode == 1 and re.search(message, refused.stderr)
    assert "--" not in refused.stderr
