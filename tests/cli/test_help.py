"""The help of every command, as a terminal of 80 columns shows it."""

import contextlib
import io
import re

import pytest

from crowdfence.cli.app import app
from crowdfence.cli.command_line import command_line
from support.command_line import commands


def help_of(command: str) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as out, pytest.raises(SystemExit) as left:
        command_line(app)([*command.split(), "--help"])
    assert left.value.code == 0
    return out.getvalue()


@pytest.fixture(autouse=True)
def narrow_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "1")


@pytest.mark.parametrize("command", commands())
def test_no_word_of_the_help_is_cut(command: str) -> None:
    told = help_of(command)
    assert "…" not in told
    # A choice is broken between its values alone.
    assert re.findall(r"<[\w|-]*\w +[^│<>]*│\n", told) == []


def test_options_stand_in_the_order_of_their_use() -> None:
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
