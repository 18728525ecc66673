"""The real command line, in a process of its own."""

import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

FEW_FILES = ("--files", "frames.csv")
"""Of a run whose pictures nobody looks at: they are half of its time."""


def crowdfence(*arguments: object, columns: int = 120, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run `crowdfence ARGUMENTS` without colours on a terminal of so many columns; `variables` are added to
    its environment."""
    return subprocess.run(
        [sys.executable, "-m", "crowdfence", *map(str, arguments)],
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": str(columns), "NO_COLOR": "1", **variables},
        timeout=300,
        check=False,
    )


def commands() -> dict[str, set[str]]:
    """Commands as they are typed ("model check") and the options that each takes."""
    from crowdfence.cli.app import app
    from crowdfence.cli.command_line import command_line

    def below(name: str, command: Any) -> Iterator[tuple[str, set[str]]]:
        inner = getattr(command, "commands", None)
        if inner is None:
            yield name, {"--help", *_options(command)}
        for word, one in (inner or {}).items():
            yield from below(f"{name} {word}".strip(), one)

    return dict(below("", command_line(app)))


def _options(command: Any) -> Iterator[str]:
    for parameter in command.params:
        yield from (*parameter.opts, *parameter.secondary_opts)
