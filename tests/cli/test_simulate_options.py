"""Values of options of `simulate` that no scenario can have: the option is named, and its bound."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from crowdfence.cli.app import app


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


def test_what_a_file_says_is_said_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "parade.toml").write_text("drones = 0")
    words = ["simulate", str(tmp_path / "parade.toml"), "-o", str(tmp_path / "a.mcap"), "--frames", "3"]
    done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, ValueError) and "parade.toml: " in str(done.exception)
