"""The flat ground of a data set as a map file: readers of maps take files, so it is written into a folder
that lives as long as the process."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from crowdfence.sources.multi_camera.layout import CELL_M, Layout


@cache
def flat_ground(layout: Layout) -> Path:
    """A mesh of the ground that is annotated, at height 0."""
    west, south = layout.corner_m
    east, north = west + CELL_M * layout.columns, south + CELL_M * layout.rows
    corners = [(west, south), (east, south), (east, north), (west, north)]
    lines = [f"v {x:g} {y:g} 0" for x, y in corners]
    path = Path(_folder().name) / f"{layout.name.lower()}.obj"
    path.write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4", ""]), encoding="utf-8")
    return path


@cache
def _folder() -> TemporaryDirectory[str]:
    return TemporaryDirectory(prefix="crowdfence-flat-ground-")
