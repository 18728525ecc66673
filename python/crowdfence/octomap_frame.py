"""Where an OctoMap of ours lies.

An OctoMap's grid always starts at zero. Voxels are therefore moved by as many whole voxels as bring them to
where they are (`shift_of`): other programs find them within half a voxel of their local metres. What is left,
how far they were moved, and the anchor of the local frame stand in a comment that every OctoMap reader skips:
`# crowdfence {"origin_m": [x, y, z], "moved": [i, j, k], "anchor_wgs84": [lat, lon, height], ...}`.
So do columns that nobody measured, as runs from south to north: `"unmeasured": [[i, first j, columns], ...]`.
"""

from __future__ import annotations

import json
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.georeference import Georeference

_MARK = b"# crowdfence "
LARGEST_KEY = 1 << 15
"""OctoMap's grid indices end below it."""
LONGEST_HEADER = 1 << 24
"""Bytes of a file that are searched for the comment; it stands on the second line."""

_NO_RUNS: NDArray[np.int64] = np.empty((0, 3), np.int64)


class OctomapFrame(NamedTuple):
    """From tree coordinates to the world."""

    origin_m: tuple[float, float, float]
    """Added to tree coordinates gives local ENU metres."""
    georeference: Georeference | None
    moved: tuple[int, int, int] = (0, 0, 0)
    """By how many voxels the terrain's grid was moved."""
    grid_origin_m: tuple[float, float, float] | None = None
    """Origin of the terrain's grid where it was moved."""
    unmeasured: NDArray[np.int64] = _NO_RUNS
    """Columns of the tree that nobody measured: runs (i, first j, columns) [R, 3]."""


def shift_of(terrain: Terrain) -> tuple[int, int, int]:
    """Whole voxels from the tree's zero to the terrain's grid; none where OctoMap's keys do not reach."""
    shift = np.rint(np.array(terrain.origin) / terrain.voxel_size_m).astype(np.int64)
    low, high = (terrain.bounds - np.array(terrain.origin)) / terrain.voxel_size_m
    if (low + shift < -LARGEST_KEY).any() or (high + shift > LARGEST_KEY).any():
        return (0, 0, 0)
    return int(shift[0]), int(shift[1]), int(shift[2])


def moved_back(terrain: Terrain, frame: OctomapFrame) -> Terrain:
    """The terrain as it was before it was written."""
    if frame.grid_origin_m is None:
        return terrain
    every_id = np.arange(terrain.voxel_count, dtype=np.int64)
    indices = terrain.voxel_indices(every_id) - np.array(frame.moved)
    back = Terrain.from_indices(indices, terrain.voxel_size_m, frame.grid_origin_m)
    return back.with_unmeasured(terrain.unmeasured - frame.moved[:2]) if len(terrain.unmeasured) else back


def marked(terrain: Terrain, frame: OctomapFrame) -> Terrain:
    """The terrain as the tree has it, with the columns that nobody measured. Costs the map, not what a file
    claims."""
    if not len(frame.unmeasured):
        return terrain
    columns = terrain.columns()[:, :2]
    i, first, length = frame.unmeasured[np.lexsort(frame.unmeasured.T[1::-1])].T
    begin, place = (i << 32) + first, (columns[:, 0] << 32) + columns[:, 1]
    run = np.searchsorted(begin, place, "right") - 1
    return terrain.with_unmeasured(columns[(run >= 0) & (place < np.maximum.accumulate(begin + length)[run])])


def described(terrain: Terrain) -> dict[str, Any]:
    """The frame of a terrain, as the comment holds it."""
    shift = shift_of(terrain)
    frame: dict[str, Any] = {"frame": "tree + origin_m = local east-north-up metres"}
    frame["origin_m"] = (np.array(terrain.origin) - np.array(shift) * terrain.voxel_size_m).tolist()
    if shift != (0, 0, 0):
        frame |= {"moved": list(shift), "grid_origin_m": list(terrain.origin)}
    if terrain.georeference is not None:
        anchor = terrain.georeference
        frame["anchor_wgs84"] = [anchor.latitude_deg, anchor.longitude_deg, anchor.height_m]
    if len(terrain.unmeasured):
        frame["unmeasured"] = _runs(terrain.unmeasured + shift[:2]).tolist()
    return frame


def _runs(columns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sorted columns (i, j) [U, 2] as runs (i, first j, columns) [R, 3]."""
    begins = np.flatnonzero((np.diff(columns, axis=0, prepend=columns[:1] - 2) != (0, 1)).any(axis=1))
    return np.column_stack([columns[begins], np.diff(begins, append=len(columns))])


def annotated(data: bytes, content: dict[str, Any]) -> bytes:
    """The file with the comment after its first line."""
    rest = data.index(b"\n") + 1
    comment = json.dumps(content).encode("ascii")  # has no line breaks, whatever the mission is called
    if rest + len(comment) > LONGEST_HEADER - len(_MARK):
        raise ValueError(
            f"what an OctoMap says of its frame would be {len(comment)} bytes, the bound is 2^24"
        )
    return b"".join([data[:rest], _MARK, comment, b"\n", memoryview(data)[rest:]])  # a map has many bytes


def read_frame(data: bytes) -> OctomapFrame | None:
    """The frame in the comment of a file; None where there is no comment. ValueError when it is broken."""
    for line in BytesIO(data[:LONGEST_HEADER]):
        if line.startswith(_MARK):
            return _parsed(line.removeprefix(_MARK))
        if line.strip() == b"data":
            break
    return None


def _parsed(text: bytes) -> OctomapFrame:
    try:
        content = json.loads(text)
        x, y, z = (float(value) for value in content["origin_m"])
        anchor = content.get("anchor_wgs84")
        i, j, k = (int(value) for value in content.get("moved", (0, 0, 0)))
        grid = content.get("grid_origin_m")
        return OctomapFrame(
            (x, y, z),
            None if anchor is None else Georeference(*map(float, anchor)),
            (i, j, k),
            None if grid is None else (float(grid[0]), float(grid[1]), float(grid[2])),
            np.array(content.get("unmeasured", ()), np.int64).reshape(-1, 3),
        )
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ValueError(f"the crowdfence comment in the header cannot be read: {error}") from error
