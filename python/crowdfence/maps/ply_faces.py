"""The faces of a .ply as they are written.

trimesh cuts faces of many corners into fans, which roof over the courts of houses, reads all faces of a
binary file by the number of corners of the first, and takes an ASCII file that ends early for whole.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import quoted
from crowdfence.maps.map_error import MapError
from crowdfence.maps.polygons import triangles_of_faces

UNEVEN = (
    "its faces have different numbers of corners, which cannot be read from a binary .ply, or it is cut off: "
    "write it with triangles alone, or as .obj"
)
_INDICES = ("vertex_index", "vertex_indices")


def check_ply_lines(path: Path, data: bytes) -> None:
    """MapError for strips of triangles, for two elements of one name, and for an ASCII .ply, which has one
    line per element, with fewer lines than its header says."""
    head, _, body = data.partition(b"end_header")
    words = [line.split() for line in head.splitlines()]
    if any(line[:2] == [b"element", b"tristrips"] and line[2:] != [b"0"] for line in words):
        raise MapError(
            path,
            "its triangles are written as strips (element tristrips), which cannot be read: write them as "
            "faces (element face), as a modelling program does that opens and saves it",
        )
    names = [line[1] for line in words if len(line) == 3 and line[0] == b"element"]
    if twice := [name for name in names if names.count(name) > 1]:
        raise MapError(
            path,
            f"its header has the element {quoted(twice[0].decode(errors='replace'))} twice, of which the "
            "first would be left out: write it with one of them, as a modelling program does that opens and "
            "saves it",
        )
    if [b"format", b"ascii"] not in [line[:2] for line in words]:
        return
    counts = [line[2] for line in words if len(line) == 3 and line[0] == b"element"]
    promised = sum(int(count) for count in counts if count.isdigit())
    lines = sum(1 for line in body.splitlines() if line.strip())
    if lines < promised:
        raise MapError(
            path, f"its header promises {promised} elements, but {lines} lines follow: truncated or damaged"
        )


def require_even_faces(path: Path, mesh: Any) -> None:
    """MapError where binary faces have other numbers of corners than the first one, by which all were read:
    where what one has more another has less, the file is as long as if they had not."""
    raw = _raw(mesh, "face")
    lists = () if getattr(raw, "dtype", None) is None else (raw.dtype.names or ())
    counts = [raw[name]["f0"] for name in lists if raw[name].dtype.names and "f0" in raw[name].dtype.names]
    if any(len(count) > 0 and bool((count != count[0]).any()) for count in counts):
        raise MapError(path, UNEVEN)


def cut_polygons(
    path: Path, mesh: Any, vertices: NDArray[np.float64], triangles: NDArray[np.int64]
) -> NDArray[np.int64]:
    """`triangles` [M, 3] of a mesh of triangles; else those that cover its faces and no more. All faces use
    existing `vertices`. MapError for a face of too many corners."""
    faces = _polygons(_raw(mesh, "face"))
    if all(some.shape[1] == 3 for some in faces):
        return triangles
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # too large ones are refused by their size
            return np.concatenate([triangles_of_faces(vertices, some) for some in faces])
    except ValueError as error:
        raise MapError(path, str(error)) from error


def _raw(mesh: Any, element: str) -> Any:
    return getattr(mesh, "metadata", {}).get("_ply_raw", {}).get(element, {}).get("data")


def _polygons(raw: Any) -> list[NDArray[np.int64]]:
    """Faces [N, K] for every number of corners K of three and more."""
    if isinstance(raw, dict):  # ASCII
        named = [raw[name] for name in _INDICES if name in raw]
    else:
        names = () if raw is None else (raw.dtype.names or ())
        named = [raw[name]["f1"] for name in names if name in _INDICES or len(names) == 1]
    if not named:
        return []
    faces = named[0]
    if faces.dtype != object:
        return [faces.astype(np.int64)] if faces.ndim == 2 and faces.shape[1] >= 3 else []
    corners = np.array([len(face) for face in faces])
    return [np.stack(faces[corners == count]).astype(np.int64) for count in np.unique(corners) if count >= 3]
