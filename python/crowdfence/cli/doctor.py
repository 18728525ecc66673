"""`crowdfence doctor`: what works on this machine, what is missing, and the command that installs it."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import typer

from crowdfence.cli import console, options
from crowdfence.cli.exit_codes import FAILED

if TYPE_CHECKING:
    from rich.table import Table

    from crowdfence.doctor import Check, Diagnosis, Group

_TITLES: dict[Group, str] = {
    "needed": "Needed",
    "optional": "Optional",
    "machine": "This machine",
}
_COLOURS = {"ok": "green", "missing": "yellow", "broken": "red"}


def doctor(as_json: options.Json = False) -> None:
    """Say what works on this machine, what is missing, and the command that installs it.

    Exit code 1 when something that the main job needs does not work.
    """
    from crowdfence.doctor import diagnose

    with console.working() as tell:
        diagnosis = diagnose(tell)
    if as_json:
        console.print_json(asdict(diagnosis))
    else:
        _report(diagnosis)
    if not diagnosis.ok:
        raise typer.Exit(FAILED)


def _report(diagnosis: Diagnosis) -> None:
    out = console.stdout()
    for group, title in _TITLES.items():
        out.print(f"[bold]{title}[/]")
        out.print(_table([check for check in diagnosis.checks if check.group == group]))
        out.print()
    remedies: dict[str, list[str]] = {}
    for check in diagnosis.checks:
        if check.remedy is not None:
            remedies.setdefault(check.remedy, []).append(check.name)
    if remedies:
        out.print("[bold]What to do[/]")
    for remedy, names in remedies.items():
        out.print(f" {', '.join(names)}:\n   {remedy}", markup=False, soft_wrap=True)
    verdict = "Everything that crowdfence needs works." if diagnosis.ok else "A needed part does not work."
    out.print(f"\n{verdict}", style="green" if diagnosis.ok else "bold red")


def _table(checks: list[Check]) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(show_header=False, box=None)
    table.add_column(width=7)
    table.add_column(style="dim", width=18)
    table.add_column(overflow="fold")
    for check in checks:
        table.add_row(f"[{_COLOURS[check.state]}]{check.state}[/]", check.name, escape(check.detail))
    return table
