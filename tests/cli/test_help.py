"""The help of every command, as a terminal shows it."""

import contextlib
import io
import re

import pytest

from crowdfence.cli.app import app
from crowdfence.cli.command_line import command_line
from support.command_line import commands


@pytest.fixture(params=[80, 120])
def columns(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setenv("COLUMNS", str(request.param))
    monkeypatch.setenv("NO_COLOR", "1")
    return int(request.param)


def help_of(command: str) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as out, pytest.raises(SystemExit) as left:
        command_line(app)([*command.split(), "--help"])
    assert left.value.code == 0
    return out.getvalue()


@pytest.mark.parametrize("command", ["", *commands()])
def test_help_is_read_whole_and_has_no_words_of_python(columns: int, command: str) -> None:
    told = help_of(command)
    assert f"{command} [OPTIONS]".strip() in " ".join(told.split())
    assert max(map(len, told.splitlines())) <= columns
    assert "…" not in told
    assert re.findall(r"<[\w|-]*\w +[^│<>]*│\n", told) == []  # choices are broken between their values alone
    for word in ("<bool>", "BOOLEAN", "list[", "Path]"):
        assert word not in told


def test_options_stand_in_the_order_of_their_use(columns: int) -> None:
    panels = re.findall(r"^╭─ (.*?) ─+╮$", help_of("run"), re.MULTILINE)
    assert panels == [
        "Arguments",
        "Options",
        "Recordings of others",
        "Zones",
        "Projection and map",
        "Method",
        "Method evidence",
        "Methods paper, or and those for comparison",
    ]
