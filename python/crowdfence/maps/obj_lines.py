"""The lines of an .obj file, brought into the one form that the parser reads right.

trimesh counts negative indices from the end of the whole file, takes index 0 for 1 and leaves out faces that
are indented, follow a tab or were cut off, and a first line behind a byte order mark, all silently: houses
vanish, and the ground behind them would be called empty. It also cuts faces of many corners into fans, which
roof over the courts of houses. The format (Wavefront, appendix B1) counts from 1,
and negative indices from the last vertex before the face.
"""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import quoted
from crowdfence.maps.map_error import MapError
from crowdfence.maps.polygons import MOST_CORNERS, fans_from_second, triangles_of

_INDENTED = (b"\n ", b"\n\t", b"\nf\t", b"\nv\t")
_TEXTURE_AND_NORMAL = re.compile(rb"/\S*")
_CONTINUED = (b"\\\n", b"\\\r")
_UNREAD = (b"fo ", b"call ", b"surf ", b"bzp ", b"bsp ", b"cdp ")
"""Outlined faces of old, other files and free-form surfaces, which the parser leaves out."""


def plain_obj(path: Path, data: bytes) -> bytes:
    """`data` with vertices and faces that begin their lines, with positive indices, those of vertices alone,
    with triangles for faces of five corners and more, and with quads whose notch is at the first corner or
    the third, so that a fan covers them; the same bytes where they are so already, which costs 2 s for
    100 MB.
    MapError names a line with a surface of another kind, a face of fewer than three corners or too many, or
    an index that is none; whether a positive one exists, the parser finds out."""
    data = data.removeprefix(BOM_UTF8)
    lines = data.splitlines()
    unlike = any(mark in data for mark in (*_INDENTED, *_CONTINUED)) or data[:1] in (b" ", b"\t")
    if unlike:
        lines = _joined([_unindented(line) for line in lines])
    _require_read(path, lines)
    slashed = _without_slashes(lines)
    faces = [line for line in lines if line.startswith(b"f ")]
    together = b"\n".join(faces)
    words = {len(line.split()) for line in faces}
    places = _places(lines) if words and max(words) > 4 else np.empty((0, 3))
    is_plain = not (b"-" in together or b" 0" in together or not words <= {4, 5})
    if not is_plain:
        _make_plain(path, lines, places)
    turned = 5 in words and _turn_quads(lines, places)
    return data if is_plain and not turned and not unlike and not slashed else b"\n".join(lines)


def _require_read(path: Path, lines: list[bytes]) -> None:
    for number, line in enumerate(lines, start=1):
        if line.startswith(_UNREAD):
            kind = line.split()[0].decode()
            raise MapError(
                path,
                f"line {number} is a {kind!r}, a surface that cannot be read, and what it hides would be "
                "called seen: write it as triangles (f), as a modelling program does that opens and saves it",
            )


def _without_slashes(lines: list[bytes]) -> bool:
    """Whether faces named textures or normals, which are left out, in place: the parser goes by the count of
    numbers in a line, and of the first one."""
    slashed = [number for number, line in enumerate(lines) if line.startswith(b"f ") and b"/" in line]
    if not slashed:
        return False
    together = b"\n".join([lines[number] for number in slashed])
    for number, line in zip(slashed, _TEXTURE_AND_NORMAL.sub(b"", together).split(b"\n"), strict=True):
        lines[number] = line
    return True


def _unindented(line: bytes) -> bytes:
    return b" ".join(line.split()) if line[:1] in (b" ", b"\t") or line[1:2] == b"\t" else line


def _joined(lines: list[bytes]) -> list[bytes]:
    """As many lines, with those of vertices and faces whole; a comment that ends with a backslash is a path
    and continues nothing."""
    result, begun = list(lines), -1
    for number, line in enumerate(lines):
        at = number
        if begun >= 0:
            result[number], at = b"", begun
        more = line.endswith(b"\\")
        words = line[:-1] if more else line
        result[at] = result[at] + words if at < number else words
        begun = at if more and result[at][:1] in (b"v", b"f") else -1
    return result


def _make_plain(path: Path, lines: list[bytes], places: NDArray[np.float64]) -> None:
    """Faces as "f 1 2 3": absolute indices, in place, and triangles for those of five corners and more."""
    vertices = 0
    for number, line in enumerate(lines, start=1):
        if line.startswith(b"v "):
            vertices += 1
        elif line.startswith(b"f "):
            corners = line.split()[1:]
            if len(corners) < 3:
                raise MapError(
                    path, f"line {number} gives a face {len(corners)} corners: truncated or damaged"
                )
            if len(corners) > MOST_CORNERS:
                raise MapError(
                    path,
                    f"line {number} gives a face {len(corners)} corners, the bound is {MOST_CORNERS}; write "
                    "it with triangles alone",
                )
            indices = [_absolute(path, corner, number, vertices) for corner in corners]
            faces = _cut(indices, places)
            lines[number - 1] = b"\n".join(b"f %s" % " ".join(map(str, face)).encode() for face in faces)


def _turn_quads(lines: list[bytes], places: NDArray[np.float64]) -> bool:
    """Whether a face of four corners had to begin with another one, in place, for a fan to cover it."""
    numbers = [
        number for number, line in enumerate(lines) if line.startswith(b"f ") and len(line.split()) == 5
    ]
    corners = b" ".join(lines[number][2:] for number in numbers)
    try:
        quads = np.array(list(map(int, corners.split())), np.int64).reshape(-1, 4)
    except (ValueError, OverflowError):  # no indices, which the parser complains about
        return False
    if quads.min() < 1 or quads.max() > len(places):
        return False
    with np.errstate(over="ignore", invalid="ignore"):
        turned = np.flatnonzero(fans_from_second(places[quads - 1]))
    for number in (numbers[quad] for quad in turned.tolist()):
        _, first, *rest = lines[number].split()
        lines[number] = b" ".join([b"f", *rest, first])
    return len(turned) > 0


def _places(lines: list[bytes]) -> NDArray[np.float64]:
    """Vertices [N, 3]; none where a line is not three numbers, which the parser complains about."""
    rows = [line.split()[1:4] for line in lines if line.startswith(b"v ")]
    if any(len(row) != 3 for row in rows):
        return np.empty((0, 3))
    try:
        return np.array(list(map(float, chain.from_iterable(rows))), np.float64).reshape(-1, 3)
    except ValueError:
        return np.empty((0, 3))


def _cut(indices: list[int], places: NDArray[np.float64]) -> list[list[int]]:
    if len(indices) <= 4 or max(indices) > len(places):
        return [indices]
    corners = places[np.array(indices) - 1]
    if not np.isfinite(corners).all():
        return [indices]
    return [[indices[corner] for corner in triangle] for triangle in triangles_of(corners)]


def _absolute(path: Path, corner: bytes, number: int, vertices: int) -> int:
    try:
        index = int(corner)
    except ValueError:
        index = 0
    if index == 0 or index < -vertices:
        raise MapError(
            path,
            f"line {number} gives a face the corner {quoted(corner.decode(errors='replace'))}, and "
            f"{vertices} vertices come before it; indices count from 1, or from -1 backwards: the file is "
            "damaged",
        )
    return index if index > 0 else vertices + 1 + index
