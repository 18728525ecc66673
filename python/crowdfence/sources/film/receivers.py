"""Whether an autopilot's positions rest on satellites, by what its receivers say (GPS_RAW_INT, GPS2_RAW)."""

from __future__ import annotations

from typing import Any

RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")
ADRIFT = (
    "are by dead reckoning, no receiver had a fix: they drift, and what was seen then may be put elsewhere"
)
"""What is told of positions, as the end of a sentence that begins with which they are."""
_3D_FIX = 3


class Receivers:
    """Of one drone."""

    def __init__(self) -> None:
        self._has_fix: dict[str, bool] = {}

    def heard(self, message: Any) -> None:
        """A decoded message of one of the receivers."""
        self._has_fix[message.get_type()] = message.fix_type >= _3D_FIX

    @property
    def are_lost(self) -> bool:
        """Whether none has a fix; False where none was heard, as of those who do not send these messages."""
        return bool(self._has_fix) and not any(self._has_fix.values())
