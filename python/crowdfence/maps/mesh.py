"""Triangle meshes (.ply, .obj) -> Terrain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.errors import one_line
from crowdfence.georeference import Georeference
from crowdfence.maps.map_error import MapError
from crowdfence.maps.map_reading import MapReading
from crowdfence.maps.obj_lines import plain_obj
from crowdfence.maps.ply_faces import UNEVEN, check_ply_lines, cut_polygons, require_even_faces
from crowdfence.maps.voxel_size import chosen_voxel_size, round_voxel_size_m

LONGEST_SIDE_M = 1e6
"""Larger ones are a mistake of units: a voxel tree spans as many cells of a metre."""
_WALL = 3.0
"""Times as much surface seen from one side as from above and from the other is no land."""
_FINEST_STEP = 0.25
"""Of a voxel: coordinates in wider steps move surfaces to other voxels."""
_DIGITS = 6
"""Those that many programs write of a number unless told otherwise (%g, C++'s streams)."""
_CHUNK_TRIANGLES = 1 << 20


def open_mesh(
    path: Path,
    *,
    voxel_size_m: float | None = None,
    georeference: Georeference | None = None,
    up: Literal["z", "y"] = "z",
    unit_m: float = 1.0,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
) -> MapReading:
    """Every voxel that a triangle touches.

    Vertices are local: x east, y north, z up, in units of `unit_m` metres.
    `up="y"` is for files whose y axis points up, as many modelling tools write them: their (x, y, z) becomes
    (x, -z, y). `origin` is then added, in metres. Textures and materials are not read. Without `voxel_size_m`
    it is a thousandth of the longest side, rounded up to 1, 2 or 5 times a power of ten, and at least 0.25 m;
    where that is above a metre it is 0.5 m, or as fine as ten million columns allow.
    A mesh knows no place on Earth, so `georeference` is taken as given.
    """
    if up not in ("z", "y"):
        raise MapError(path, f"up is {up!r}, must be 'z' or 'y'")
    if not (math.isfinite(unit_m) and unit_m > 0):
        raise MapError(path, f"unit_m is {unit_m}, must be finite and > 0")
    vertices, triangles = _read(path)
    step_m = _single_precision_step(vertices) * unit_m
    digits_step_m = _few_digits_step(vertices, triangles) * unit_m
    with np.errstate(over="ignore"):
        vertices = vertices * unit_m
    if up == "y":
        vertices = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=-1)
    vertices += np.asarray(origin, np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        sides_m = np.ptp(vertices, axis=0)
    if not sides_m.max() <= LONGEST_SIDE_M:  # not a number where it overflows
        raise MapError(
            path,
            f"its longest side is {sides_m.max():.3g} m, the bound is {LONGEST_SIDE_M:g}; check unit_m, "
            f"which is {unit_m:g}",
        )
    thousandth_m = round_voxel_size_m(float(sides_m.max()) / 1000)
    voxels = chosen_voxel_size(
        voxel_size_m, thousandth_m, "a thousandth of its longest side", float(sides_m[:2].prod())
    )
    terrain = Terrain.from_triangles(vertices, triangles, voxels.size_m)
    terrain.georeference = georeference
    doubts = (
        *_rounded(
            step_m,
            voxels.size_m,
            why="are of single precision (float32)",
            what="edges and heights",
            write="in double precision",
        ),
        *_rounded(
            digits_step_m, voxels.size_m, why="have six digits", what="places", write="with more digits"
        ),
        *_stands_upright(vertices, triangles, up),
    )
    return MapReading(terrain, voxel_size_why=voxels.why, doubts=doubts)


def _single_precision_step(vertices: NDArray[np.float64]) -> float:
    """The widest step between neighbouring coordinates of single precision, in units of the file; 0 where
    they are of double precision. Whole numbers may be either."""
    widest = 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        for axis in vertices.T:
            step = float(np.spacing(np.float32(np.abs(axis).max())))
            is_single = bool((axis == axis.astype(np.float32)).all())
            if is_single and (step > 1.0 or bool((axis != np.round(axis)).any())):
                widest = max(widest, step)
    return widest


def _few_digits_step(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> float:
    """The step, a unit of the file or more, in which coordinates were written with six digits; 0 where they
    have more. A grid that has such steps itself is no sign, unless triangles fell together on it."""
    widest = 0.0
    for axis in vertices.T[:2]:
        with np.errstate(divide="ignore"):
            step = 10.0 ** (np.floor(np.log10(np.abs(axis).max())) - (_DIGITS - 1))
        if not 1.0 <= step < np.inf:
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            steps = 10.0 ** (np.floor(np.log10(np.abs(axis))) - (_DIGITS - 1))
            has_few = np.isclose(axis, np.round(axis / steps) * steps, rtol=1e-12, atol=0.0) | (axis == 0.0)
        if has_few.all() and (_is_uneven(axis) or _has_slivers(vertices, triangles)):
            widest = max(widest, step)
    return float(widest)


def _is_uneven(axis: NDArray[np.float64]) -> bool:
    """Whether the gaps between the coordinates along an axis differ."""
    gaps = np.diff(np.unique(axis))
    return bool(len(gaps) > 0 and not np.allclose(gaps, gaps[0]))


def _has_slivers(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> bool:
    """Whether corners of triangles fell together."""
    a, b, c = (vertices[corner] for corner in triangles.T)
    return any(bool((one == other).all(axis=1).any()) for one, other in ((a, b), (b, c), (c, a)))


def _rounded(step_m: float, voxel_size_m: float, *, why: str, what: str, write: str) -> tuple[str, ...]:
    """One sentence where coordinates were rounded to steps that the voxels show."""
    if not step_m > voxel_size_m * _FINEST_STEP:
        return ()
    return (
        f"its coordinates {why}, so far from 0 in steps of {step_m:g} m, beside voxels of {voxel_size_m:g} "
        f"m: {what} are rounded by up to {step_m / 2:g} m; write it {write}, or around an origin of "
        "its own and pass that",
    )


def _stands_upright(
    vertices: NDArray[np.float64], triangles: NDArray[np.int64], up: Literal["z", "y"]
) -> tuple[str, ...]:
    """One sentence where the mesh shows a wall to whoever looks north, and next to nothing from above: the
    ground of a file whose other axis points up. None of a town, whose walls face all ways."""
    seen_m2 = np.zeros(3)  # from the west, the south and above
    for first in range(0, len(triangles), _CHUNK_TRIANGLES):
        a, b, c = (vertices[corner] for corner in triangles[first : first + _CHUNK_TRIANGLES].T)
        seen_m2 += np.abs(np.cross(b - a, c - a)).sum(axis=0) / 2.0
    west_m2, south_m2, above_m2 = seen_m2.tolist()
    if south_m2 == 0.0 or south_m2 < _WALL * max(west_m2, above_m2):
        return ()
    other = "z" if up == "y" else "y"
    return (
        f"it shows {south_m2:,.0f} m2 of surface from the south and {above_m2:,.0f} m2 from above, a wall "
        f"and no ground: does its {other} axis point up? Then pass up='{other}'",
    )


def _read(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Finite vertices [N, 3] and triangles [M, 3] with existing vertices, both not empty."""
    mesh = _parse(path)
    vertices = np.asarray(getattr(mesh, "vertices", np.empty((0, 3))), np.float64)
    triangles = np.asarray(getattr(mesh, "faces", np.empty((0, 3))), np.int64)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise MapError(path, f"its vertices have the shape {list(vertices.shape)}, must be [N, 3]")
    if len(triangles) == 0:
        raise MapError(
            path,
            "holds no triangles. Points alone leave gaps in the ground; write them as .las to use them",
        )
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        first = int(np.argmax(bad))
        raise MapError(path, f"vertex {first} is {vertices[first].tolist()}; coordinates must be finite")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise MapError(
            path,
            f"triangles use vertices {int(triangles.min())} to {int(triangles.max())}, but there are "
            f"{len(vertices)}: the file is damaged",
        )
    return vertices, cut_polygons(path, mesh, vertices, triangles)


def _parse(path: Path) -> Any:
    try:
        import trimesh
    except ImportError as error:
        raise MapError(path, "reading meshes needs trimesh: pip install 'crowdfence[mesh]'") from error

    data, kind = path.read_bytes(), path.suffix.lower()[1:]
    if kind == "ply":
        check_ply_lines(path, data)
    else:
        # Names of materials may be in any encoding; they do not matter.
        data = plain_obj(path, data).decode("utf-8", errors="replace").encode()
    try:
        # Bytes instead of a path: without a folder to look in, no texture or material can be opened. Without
        # fix_texture, a vertex is not doubled for its textures, and faces keep its number.
        mesh = trimesh.load_mesh(
            BytesIO(data),
            file_type=kind,
            process=False,
            maintain_order=True,
            skip_materials=True,
            fix_texture=False,
        )
    except Exception as error:  # trimesh raises whatever its parsers stumble over
        if kind == "ply" and "unexpected length" in str(error):
            raise MapError(path, UNEVEN) from error
        raise MapError(path, f"not a readable mesh ({type(error).__name__}: {one_line(error)})") from error
    if kind == "ply":
        require_even_faces(path, mesh)
    return mesh
