"""Files that are open, and whether their names still lead to them: what is written into one that was removed
or moved away is found by nobody after a restart, though every write works."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


class HeldFiles:
    """As they are when it is made."""

    def __init__(self, paths: Sequence[Path]) -> None:
        """OSError for one that is not there."""
        self._held = {path: _identity(path) for path in paths}

    @property
    def lost(self) -> Path | None:
        """The first that is no longer there, or is another file now."""
        for path, held in self._held.items():
            try:
                if _identity(path) != held:
                    return path
            except OSError:
                return path
        return None


def _identity(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_dev, found.st_ino
