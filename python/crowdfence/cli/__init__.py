"""The command line: parse, call, print. One file per command."""

from __future__ import annotations

import os
import signal
from types import FrameType

from crowdfence.cli.exit_codes import INTERRUPTED

__all__ = ["main"]


def main() -> None:
    """Run the command line. Its modules take tenths of a second to import, and whoever interrupts that gets
    one word, not the traceback of whatever was being imported."""
    before = signal.signal(signal.SIGINT, _leave)
    from crowdfence.cli.app import main as run

    signal.signal(signal.SIGINT, before)
    run()


def _leave(number: int, frame: FrameType | None) -> None:
    # No exception: libraries turn one that meets them while they are imported into another.
    os.write(2, b"error: interrupted\n")
    os._exit(INTERRUPTED)
