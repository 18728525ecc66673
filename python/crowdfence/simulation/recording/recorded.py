"""What recorders take and give, whatever the format."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crowdfence.simulation.recording.terrain_files import TerrainFiles

Progress = Callable[[int, int], None]
"""Called with (frames recorded, frames in all)."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """What came out of a simulation."""

    path: Path
    complete: bool
    """False when it was interrupted; it can be resumed."""
    frames: int
    planned_frames: int
    resumed_frames: int
    """Frames taken over from an earlier run."""
    size_bytes: int
    """Of the recording, without the map."""
    statistics: dict[str, Any]
    renderer: str
    map_files: TerrainFiles

    @property
    def terrain(self) -> tuple[Path, ...]:
        """The files of the known map."""
        return tuple(self.map_files)


def require_folder(path: Path) -> None:
    """OSError unless `path` can be made in its folder."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise FileNotFoundError(f"cannot write {path}: the folder {folder} does not exist")
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"cannot write {path}: no permission to write into {folder}")


def require_nothing_there(path: Path, state: str) -> None:
    """FileExistsError that says how to go on."""
    if path.exists():
        raise FileExistsError(f"{path} {state}: go on with it (--resume) or replace it (--force)")
