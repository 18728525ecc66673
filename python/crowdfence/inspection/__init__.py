"""What is in a file: maps, recordings and saved crowd maps, measured rather than believed.

The reports are frozen dataclasses of plain values: `dataclasses.asdict` makes JSON of them.
"""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from crowdfence.inspection.options import InspectionOptions

if TYPE_CHECKING:
    from crowdfence.inspection.crowd_map import CrowdMapReport
    from crowdfence.inspection.recording import RecordingReport
    from crowdfence.inspection.terrain import MapReport

__all__ = ["InspectionOptions", "inspect_file"]


def inspect_file(
    path: str | PathLike[str],
    *,
    terrain: str | PathLike[str] | None = None,
    options: InspectionOptions | None = None,
    tell: Callable[[str], None] = lambda stage: None,
) -> MapReport | RecordingReport | CrowdMapReport:
    """Report on a map (.bt .ot .tif .las .laz .ply .obj), a recording (.mcap, folder) or a saved crowd map.

    `terrain` is the map below a recording (default: its own) or the one that a crowd map was made on. `tell`
    is called with a few words whenever the next step begins.

    OSError for a path that cannot be read; ValueError for one that is none of these, that is damaged, or for
    a `terrain` or options that do not fit.
    """
    from crowdfence.inspection.crowd_map import inspect_crowd_map
    from crowdfence.inspection.recording import inspect_recording
    from crowdfence.inspection.terrain import inspect_map

    path = Path(path)
    terrain_path = None if terrain is None else Path(terrain)
    options = options or InspectionOptions()
    kind = _kind(path)
    if kind != "recording":
        for name in options.source_options:
            raise ValueError(f"{path} is no recording: {name} does not apply")
    if kind == "map":
        if terrain_path is not None:
            raise ValueError(f"{path} is a map itself; --terrain goes with recordings and crowd maps")
        return inspect_map(path, options, tell)
    if kind == "crowd map":
        return inspect_crowd_map(path, terrain_path, options, tell)
    return inspect_recording(path, terrain_path, options, tell)


def _kind(path: Path) -> str:
    from crowdfence.inspection.crowd_map import MAGIC as CROWD_MAP_MAGIC
    from crowdfence.maps import SUFFIXES
    from crowdfence.sources import KINDS, is_flight, is_recording
    from crowdfence.sources.film.reader import LOG_SUFFIXES

    path.stat()  # FileNotFoundError and PermissionError name the file
    if path.is_dir():
        return "recording"
    suffix = path.suffix.lower()
    if suffix in SUFFIXES:
        return "map"
    with path.open("rb") as file:
        head = file.read(8)
    if suffix == ".crowdmap" or head == CROWD_MAP_MAGIC:
        return "crowd map"
    if is_recording(path) or is_flight(path) or suffix in LOG_SUFFIXES:
        return "recording"  # of the log alone the reader says which film to name
    raise ValueError(
        f"{path} is none of: a map ({' '.join(SUFFIXES)}), a recording ({KINDS}), a saved crowd map "
        "(.crowdmap)"
    )
