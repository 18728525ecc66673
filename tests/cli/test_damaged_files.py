"""Files that no program of ours wrote end a command in one line that names them."""

from pathlib import Path

import pytest

from crowdfence.cli.demo import RECORDING
from support.command_line import crowdfence


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    assert crowdfence("run", RECORDING, "--detector", "recorded", "-o", folder, "--json").returncode == 0
    return folder


@pytest.mark.parametrize("text", ["[" * 100_000, "[", "[]", "", "null"])
def test_files_of_another_kind_are_told_in_a_line(text: str, run: Path, tmp_path: Path) -> None:
    """JSON that is cut, of another shape, or nested deeper than anybody reads."""
    given, history = tmp_path / "given.json", tmp_path / "zone_history.jsonl"
    given.write_text(text)
    history.write_text(text)
    for command in (
        ("token", "list", "--tokens", given),
        ("export", run, "-f", "qgc", "--plan", given, "-o", tmp_path / "a.plan"),
        ("export", tmp_path, "-f", "kml", "-o", tmp_path / "a.kml"),
        ("explain", history, "-z", "Z1"),
        ("run", RECORDING, "--alignment", given, "-o", tmp_path / "out"),
    ):
        done = crowdfence(*command, columns=300)
        assert done.returncode == 1 and done.stdout == "", command
        (line,) = done.stderr.splitlines()
        assert line.startswith("error: ") and str(tmp_path) in line


def test_a_summary_of_another_kind_is_told_or_says_nothing(run: Path, tmp_path: Path) -> None:
    before = (run / "summary.json").read_text()
    command = ("convert", RECORDING, "--results", run, "-o", tmp_path / "a.mcap", "--force")
    (run / "summary.json").write_text("[" * 100_000)
    done = crowdfence(*command, columns=300)
    assert done.returncode == 1 and "summary.json is no summary of a run" in done.stderr
    (run / "summary.json").write_text("[]")
    assert crowdfence(*command).returncode == 0
    (run / "summary.json").write_text(before)
