"""What commands print: data to stdout, everything else to stderr."""

from __future__ import annotations

import json
import logging
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from crowdfence.legible import shown

if TYPE_CHECKING:
    from rich.console import Console, RenderableType


def stdout() -> Console:
    from rich.console import Console

    return Console(highlight=False)


def stderr() -> Console:
    from rich.console import Console

    return Console(stderr=True, highlight=False)


def fail(message: str) -> None:
    stderr().print(f"[bold red]error[/]: {escaped(message)}", soft_wrap=True)


_warnings_to: Callable[[str], None] | None = None


def warn(message: str) -> None:
    if _warnings_to is not None:
        _warnings_to(message)
        return
    stderr().print(f"[yellow]warning[/]: {escaped(message)}", soft_wrap=True)


@contextmanager
def warnings_logged(*, on: bool = True) -> Iterator[None]:
    """While the block runs warnings are lines of the log, if `on`: stderr may hold nothing but its JSON."""
    global _warnings_to
    before = _warnings_to
    _warnings_to = logging.getLogger(__name__).warning if on else None
    try:
        yield
    finally:
        _warnings_to = before


def print_json(value: Any) -> None:
    """Numbers that are none, such as a share of nothing, are null: NaN and Infinity are no JSON."""
    print(json.dumps(_finite(value), indent=2, ensure_ascii=False, allow_nan=False))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def facts(title: str, rows: dict[str, str]) -> RenderableType:
    """A title, then two columns: what, value."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None)
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    for name, value in rows.items():
        table.add_row(name, escaped(value))
    return Group(Text(shown(title), style="bold"), table)  # a table's own title wraps at the table's width


@contextmanager
def progress(what: str, total: int, unit: str) -> Iterator[Any]:
    """A progress bar on stderr with rate and time left; silent when stderr is no terminal.

    Yields a function to call with the number of units done since the last call.
    """
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            speed = task.finished_speed or task.speed
            return Text(f"{speed:.1f} {unit}/s" if speed else "")

    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        Rate(),
        TimeRemainingColumn(),
        console=stderr(),
        disable=not sys.stderr.isatty(),
        transient=True,
    )
    with bar:
        task = bar.add_task(what, total=total)
        yield lambda units=1: bar.advance(task, units)


@contextmanager
def working() -> Iterator[Callable[[str], None]]:
    """One line on stderr that says what is being done; silent when stderr is no terminal.

    Yields a function to call when the next step begins.
    """
    if not sys.stderr.isatty():
        yield lambda step: None
        return
    with stderr().status("") as status:
        yield lambda step: status.update(escaped(step))


def escaped(text: object) -> str:
    """As it stands: brackets are no style, and what a terminal obeys is told by its number."""
    from rich.markup import escape

    return escape(shown(str(text)))
