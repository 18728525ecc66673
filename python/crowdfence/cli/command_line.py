"""The application as one command, its help made readable in one place."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from functools import partial
from typing import Any

import typer

from crowdfence.cli.options import PANELS

_GROUPS = {
    "From a flight to zones": ("demo", "inspect", "run", "explain", "export", "route", "serve", "fence"),
    "Recordings": ("convert", "align", "simulate"),
    "Detectors": ("detect", "model", "data", "train", "calibrate"),
    "Research": ("evaluate",),
    "This machine": ("doctor",),
}
"""What somebody looks for first comes first."""

_TYPE_WIDTH = 16
"""Wider choices are broken between their values: beside them, help has a third of a narrow terminal."""


def command_line(app: typer.Typer) -> Any:
    """The click command of the application: commands in groups, options in the order of their use, help that
    fits the width, and no type beside switches."""
    command = typer.main.get_command(app)
    _in_groups(command)
    for one in _all(command):
        _tidy(one)
    return command


def _all(command: Any) -> Iterator[Any]:
    yield command
    for one in getattr(command, "commands", {}).values():
        yield from _all(one)


def _in_groups(command: Any) -> None:
    group_of = {name: group for group, names in _GROUPS.items() for name in names}
    order = {name: place for place, name in enumerate(group_of)}
    commands = sorted(command.commands.items(), key=lambda entry: order.get(entry[0], len(order)))
    command.commands = dict(commands)
    for name, one in commands:
        one.rich_help_panel = group_of.get(name, "More")


def _tidy(command: Any) -> None:
    given = command.get_params

    def get_params(context: Any) -> list[Any]:
        parameters = given(context)
        for parameter in parameters:
            if getattr(parameter, "is_flag", False):
                parameter.metavar = ""
            elif hasattr(parameter, "display_type") and "display_type" not in vars(parameter):
                parameter.display_type = partial(_shown_type, parameter.display_type)
                parameter.display_type_rich = partial(_in_lines, parameter.display_type_rich)
        return sorted(parameters, key=place)

    command.get_params = get_params
    if command.help:
        # The lines of a docstring are not those of the terminal.
        paragraphs = inspect.cleandoc(command.help).split("\n\n")
        command.help = "\n\n".join(" ".join(part.split()) for part in paragraphs)


def _shown_type(given: Any, context: Any) -> str:
    """What a value is, without words of Python: <list[Path]> is <path>..., and <int range>, which stands
    before its bounds, is <int>."""
    shown = str(given(context)).replace(" range>", ">")
    several = re.fullmatch(r"<list\[(.*)\]>", shown)
    return f"<{several[1].lower()}>..." if several else shown


def _in_lines(given: Any, ctx: Any) -> str:
    """What a value is, in lines that end between the values of a choice."""
    lines = [""]
    for value in re.findall(r"[^|]+\|?", str(given(ctx=ctx))):
        if lines[-1] and len(lines[-1]) + len(value) > _TYPE_WIDTH:
            lines.append("")
        lines[-1] += value
    return "\n".join(lines)


def place(parameter: Any) -> int:
    """Of a parameter among those of its command, by its panel; panels without a place come before."""
    panel = getattr(parameter, "rich_help_panel", None)
    return PANELS.index(panel) + 1 if panel in PANELS else 0
