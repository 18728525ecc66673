"""The one exception of the map readers."""

from __future__ import annotations

from pathlib import Path


class MapError(ValueError):
    """A map file cannot become a terrain: `path` and `reason`, which says what to do about it."""

    def __init__(self, path: str | Path, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = Path(path)
        self.reason = reason
