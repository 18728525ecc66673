"""The commands and their options as a page of Markdown, from the code that parses them:

python -m crowdfence.cli.reference > docs/cli.md
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from enum import Enum
from typing import Any

from crowdfence.cli.app import app
from crowdfence.cli.command_line import command_line, place

_HEAD = """# Commands and options

Every command takes `--json` (data for programs on stdout) and `--help`. Exit codes: 0 ok, 1 failed, 2 usage,
3 a gate was not met. This page is made from the code: `make cli-reference`.
"""


def reference() -> str:
    """The whole page."""
    command = command_line(app)
    parts = [_HEAD]
    group = ""
    for name, one in command.commands.items():
        if one.rich_help_panel != group:
            group = one.rich_help_panel
            parts.append(f"## {group}\n")
        for words, inner in _leaves(f"crowdfence {name}", one):
            parts.append(_section(words, inner))
    return "\n".join(parts)


def _leaves(words: str, command: Any) -> Iterator[tuple[str, Any]]:
    inner = getattr(command, "commands", None)
    if inner is None:
        yield words, command
    for name, one in (inner or {}).items():
        yield from _leaves(f"{words} {name}", one)


def _section(words: str, command: Any) -> str:
    arguments = [one for one in command.params if one.param_type_name == "argument"]
    options = [
        one for one in sorted(command.params, key=place) if one.param_type_name == "option" and not one.hidden
    ]
    taken = "".join(f" {_argument(one)}" for one in arguments)
    lines = [f"### {words}\n", f"    {words}{taken} [OPTIONS]\n", _text(command.help) + "\n"]
    lines += [f"- `{_argument(one)}`: {_text(one.help)}" for one in arguments]
    if arguments:
        lines.append("")
    panels: dict[str, list[Any]] = {}
    for option in options:
        panels.setdefault(option.rich_help_panel or "", []).append(option)
    context = command.make_context(words, [], resilient_parsing=True)
    for panel, members in panels.items():
        lines += [f"| {panel or 'option'} | what it does |", "|---|---|"]
        lines += [_row(option, context) for option in members]
        lines.append("")
    return "\n".join(lines)


def _argument(parameter: Any) -> str:
    name = str(parameter.name).upper()
    return name if parameter.required else f"[{name}]"


def _row(option: Any, context: Any) -> str:
    names = ", ".join(f"`{name}`" for name in (*option.opts, *option.secondary_opts))
    if not option.is_flag:
        names += f" `{_value(option, context)}`"
    text = _text(option.help)
    if option.required:
        text += " **Required.**"
    elif (default := _default(option)) is not None:
        text += f" [{default}]"
    return f"| {names} | {text} |"


def _value(option: Any, context: Any) -> str:
    """What an option takes: its choices, what its parts are called, or a type."""
    several = "..." if option.multiple else ""
    if option.metavar:
        # A bar would end the cell.
        named = str(option.metavar).replace("|", "/")
        return named if named.endswith("...") else named + several
    shown = str(option.display_type(context)).removesuffix("...")
    if "|" in shown:
        return "{" + shown.strip("<>").replace("|", ",") + "}" + several
    return shown + several


def _default(option: Any) -> str | None:
    value = option.default
    if isinstance(value, Enum):
        value = value.value
    if isinstance(value, bool) or value is None or callable(value) or value in ("", []):
        return None
    if isinstance(value, (list, tuple)):
        return ", ".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _text(help_text: str | None) -> str:
    words = " ".join(inspect.cleandoc(help_text or "").replace("\\[", "[").split())
    return words.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


if __name__ == "__main__":
    print(reference(), end="")
