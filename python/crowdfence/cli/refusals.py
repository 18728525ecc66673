"""Frames that took no part, as commands tell them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from crowdfence.cli import console
from crowdfence.cli.wording import counted, in_options
from crowdfence.sources.recording import RefusedFrame


def refusal_lines(refused: Iterable[RefusedFrame]) -> list[str]:
    """A line for each reason, the most frequent first: hundreds of frames with the same one would hide all
    others."""
    from crowdfence.inspection.recording import group_trouble

    return [
        in_options(
            trouble.first
            if trouble.count == 1
            else f"refused {counted(trouble.count, 'frame')} ({', '.join(trouble.drones)}), the first: "
            f"{trouble.first}"
        )
        for trouble in group_trouble(refused)
    ]


def warn_of_data(warnings: Iterable[str], unused: Sequence[str]) -> None:
    """What is doubtful about labelled missions, and which of their frames were not used and why."""
    for warning in warnings:
        console.warn(warning)
    if unused:
        console.warn(f"{len(unused)} frames were not used, the first: {unused[0]}")
