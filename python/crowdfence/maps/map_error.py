"""The one exception of the map readers."""

from __future__ import annotations

from pathlib import Path

from crowdfence.errors import MapFileError


class MapError(MapFileError):
    """A map file cannot become a terrain: `path` and `reason`, which says what to do about it."""

    def __init__(self, path: str | Path, reason: str) -> None:
        super().__init__(path, reason)  # what pickle makes it from again
        self.path = Path(path)
        self.reason = reason

    def __str__(self) -> str:
        return f"{self.path}: {self.reason}"
