"""SIGTERM leaves every block that is open, as Ctrl-C does: what is half written is removed."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import NoReturn

from crowdfence.cli.exit_codes import ENDED

_AGAIN_S = 0.01
"""Long enough for a finaliser to end; where it meets another one, it comes once more."""


class _Ended(SystemExit):
    """Raised for the signal."""


def unwind_when_told_to_end() -> None:
    """From now on, unless somebody else wants the signal. A second one ends the process on the spot."""
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _unwind)
        signal.signal(signal.SIGALRM, _unwind)
        sys.unraisablehook = _once_more(sys.unraisablehook)


def _unwind(number: int, frame: FrameType | None) -> NoReturn:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    raise _Ended(ENDED)


def _once_more(
    hook: Callable[[sys.UnraisableHookArgs], object],
) -> Callable[[sys.UnraisableHookArgs], object]:
    """What is raised while Python runs a finaliser, as importing does, is ignored: it is raised again."""

    def ignored(what: sys.UnraisableHookArgs) -> None:
        if isinstance(what.exc_value, _Ended):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
        else:
            hook(what)

    return ignored
