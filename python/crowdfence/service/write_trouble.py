"""Whether the disk takes what is written. Where it is full, a small write that still fits would tell that all
is well while views are refused: trouble is over once as much went through as was refused."""

from __future__ import annotations

import shutil
from pathlib import Path

LEAST_FREE_BYTES = 200_000_000
"""Less room than this is told before it is full."""
_PAGE_BYTES = 4096
"""The least that a write needs."""


class WriteTrouble:
    """Of the writes to one folder; told by the thread that writes."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.text: str | None = None
        """What went wrong, until it is over."""
        self._largest = self._through = 0
        """Bytes of the largest write that was refused, and of those that went through since the last one."""
        self._was_short = False

    def refused(self, error: Exception, size: int) -> None:
        """A write of `size` bytes."""
        self.text = str(error)
        self._largest, self._through = max(self._largest, size, _PAGE_BYTES), 0
        self._was_short = self._free_bytes() < LEAST_FREE_BYTES

    def passed(self, size: int) -> None:
        """Writes of `size` bytes together are on disk."""
        if self.text is None:
            return
        self._through += size
        # Room that was there already is none: a quota, say, is full before its disk.
        made_room = self._was_short and self._free_bytes() >= LEAST_FREE_BYTES
        if made_room or self._through >= self._largest:
            self.text, self._largest = None, 0

    def _free_bytes(self) -> int:
        return free_bytes(self._folder) or 0


def free_bytes(folder: Path) -> int | None:
    """None where the folder is gone, which writes tell."""
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return None
