"""Map files -> `Terrain`, one module per kind of file."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from inspect import signature
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from crowdfence.errors import one_line, quoted
from crowdfence.maps.holes import MapHoles
from crowdfence.maps.map_error import MapError
from crowdfence.maps.map_reading import MapReading
from crowdfence.maps.voxel_size import require_voxel_size

if TYPE_CHECKING:
    from pyproj import CRS

    from crowdfence._core import Terrain
    from crowdfence.georeference import Georeference

__all__ = [
    "MapError",
    "MapHoles",
    "MapReading",
    "check_options",
    "leaves_geoid_open",
    "open_terrain",
    "read_map",
    "stated_place",
    "told",
]

SUFFIXES = (".bt", ".ot", ".tif", ".tiff", ".las", ".laz", ".ply", ".obj")

_RASTERS = (".asc", ".bil", ".dem", ".dt1", ".dt2", ".hgt", ".img", ".vrt")
"""Other kinds of height models, which GDAL reads; some name further files, so they are not opened here."""

_NUMBERS = ("int | None", "float | None", "float")
"""How readers declare options that are numbers."""
_MOST_NAMED = 5

Place = Literal["earth", "local", "unstated"]


def open_terrain(
    path: str | PathLike[str],
    *,
    voxel_size_m: float | None = None,
    georeference: Georeference | None = None,
    **options: Any,
) -> Terrain:
    """The terrain of `read_map`, which has the arguments and errors. What is doubtful about the map is a
    Python warning, one for each doubt."""
    return told(read_map(path, voxel_size_m=voxel_size_m, georeference=georeference, **options))


def told(reading: MapReading) -> Terrain:
    """Its terrain, for callers who take no more; its doubts become Python warnings (UserWarning)."""
    for doubt in reading.doubts:
        warnings.warn(doubt, stacklevel=3)
    return reading.terrain


def read_map(
    path: str | PathLike[str],
    *,
    voxel_size_m: float | None = None,
    georeference: Georeference | None = None,
    **options: Any,
) -> MapReading:
    """Read a map file as a terrain in local ENU metres, and say what was found on the way.

    `georeference` is the anchor of the local frame, usually that of the recording. Maps with a coordinate
    reference system are brought into its tangent plane; without an anchor they get one in their middle, and
    `terrain.georeference` says where. `voxel_size_m`, 1 mm to 100 m; None lets the file decide.

    | suffix | kind | options |
    |---|---|---|
    | .bt .ot | OctoMap, see `maps.octomap` | origin |
    | .tif .tiff | height model, see `maps.geotiff` | band, nodata, max_hole_m2 and those below |
    | .las .laz (also .copc.laz) | lidar points, see `maps.lidar` | surface, max_hole_m and those below |
    | both of these | | crs, height_unit, height_offset_m, assume_local |
    | .ply .obj | mesh, see `maps.mesh` | up, unit_m, origin |

    MapError (a ValueError) names the file, what is wrong with it and what to do; TypeError for an option that
    the kind of file does not have.
    """
    path = Path(path)
    reader = check_options(path, voxel_size_m=voxel_size_m, **options)
    with _naming(path):
        return reader(path, voxel_size_m=voxel_size_m, georeference=georeference, **options)


def check_options(
    path: Path, *, voxel_size_m: float | None = None, **options: Any
) -> Callable[..., MapReading]:
    """What reads such a map, of which nothing but the name is looked at. Errors are those of `read_map`."""
    reader = _reader(_suffix(path))
    _require_options(path, reader, options)
    _require_numbers(path, reader, {"voxel_size_m": voxel_size_m, **options})
    _require_origin(path, options.get("origin"))
    with _naming(path):
        require_voxel_size(voxel_size_m)
    return reader


def _require_options(path: Path, reader: Callable[..., MapReading], options: Mapping[str, Any]) -> None:
    known = [
        name for name in signature(reader).parameters if name not in ("path", "voxel_size_m", "georeference")
    ]
    if unknown := [name for name in options if name not in known]:
        raise TypeError(
            f"{path}: a {path.suffix} map has no option {unknown[0]!r}; it has {', '.join(known)}"
        )


def _require_numbers(path: Path, reader: Callable[..., MapReading], options: Mapping[str, Any]) -> None:
    parameters = signature(reader).parameters
    for name, value in options.items():
        # The command line hands on as text whatever is no number, and no comparison says whose it was.
        takes = str(parameters[name].annotation)
        if takes not in _NUMBERS or (value is None and takes.endswith("None")):
            continue
        if isinstance(value, bool) or not isinstance(value, Real):
            raise MapError(path, f"{name} is {value!r}; it must be a number")
        if takes.startswith("int") and not isinstance(value, Integral):
            raise MapError(path, f"{name} is {value!r}; it must be a whole number")


def _require_origin(path: Path, origin: object) -> None:
    """One number would be added to every coordinate, heights too."""
    if origin is None:
        return
    shown = origin.tolist() if isinstance(origin, np.ndarray) else origin
    values = shown if isinstance(shown, Sequence) and not isinstance(shown, str) else ()
    if len(values) != 3 or not all(_is_finite(value) for value in values):
        raise MapError(
            path,
            f"origin is {quoted(shown)}; it must be three numbers, metres to the east, to the north and up, "
            "such as [120.5, -40, 3]",
        )


def _is_finite(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def stated_place(path: str | PathLike[str], *, crs: str | int | CRS | None = None) -> Place:
    """What a map file says about the place of its coordinates; only its header is read.

    - "earth": on Earth, by a reference system (`crs` states a missing one) or the anchor in an OctoMap of
      ours.
    - "local": metres in a frame that no one has placed: meshes and other OctoMaps.
    - "unstated": a height model or point cloud without reference system.

    MapError as for `read_map`.
    """
    path = Path(path)
    suffix = _suffix(path)
    with _naming(path):
        if suffix in (".bt", ".ot"):
            from crowdfence.maps.octomap import stated_anchor

            return "local" if stated_anchor(path) is None else "earth"
        if suffix in (".ply", ".obj"):
            return "local"
        return "earth" if crs is not None or _stated_crs(suffix, path) is not None else "unstated"


def leaves_geoid_open(path: str | PathLike[str], *, crs: str | int | CRS | None = None) -> bool:
    """Whether heights of a map count from the ellipsoid because its reference system (`crs` states another)
    names nothing else; not for maps without one. Only its header is read. MapError as for `read_map`."""
    from crowdfence.maps.source_frame import stated_crs

    path = Path(path)
    suffix = _suffix(path)
    if suffix not in (".tif", ".tiff", ".las", ".laz"):
        return False
    with _naming(path):
        found = _stated_crs(suffix, path) if crs is None else stated_crs(crs)
    return found is not None and len(found.axis_info) < 3


def _stated_crs(suffix: str, path: Path) -> CRS | None:
    if suffix in (".tif", ".tiff"):
        from crowdfence.maps import geotiff

        return geotiff.stated_crs(path)
    from crowdfence.maps import lidar

    return lidar.stated_crs(path)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Whatever a reader stumbles over names the file."""
    try:
        yield
    except MapError:
        raise
    except (ValueError, OSError, MemoryError) as error:
        raise MapError(path, one_line(error)) from error


def _suffix(path: Path) -> str:
    """The kind of a file that is there and not empty."""
    suffix = path.suffix.lower()
    known = " ".join(SUFFIXES)
    if path.is_dir():
        inside = sorted(one.name for one in path.iterdir() if one.suffix.lower() in SUFFIXES)
        held = (
            f"name one of those in it: {', '.join(inside[:_MOST_NAMED])}"
            if inside
            else f"it holds no {known}"
        )
        if sum(Path(name).suffix.lower() in (".tif", ".tiff") for name in inside) > 1:
            held += "; tiles of a height model become one file with rio merge, see docs/maps.md"
        raise MapError(path, f"is a folder, not a map file; {held}")
    if suffix not in SUFFIXES:
        convert = f"; make a .tif of it: rio convert {path.name} {path.stem}.tif, see docs/maps.md"
        cure = convert if suffix in _RASTERS else ""
        raise MapError(path, f"suffix {suffix!r} is not one of a map file: {known}{cure}")
    if path.is_fifo():
        raise MapError(path, "is a pipe; save what it gives in a file, and name that")
    if not path.exists():
        raise MapError(path, "no such file")
    if path.stat().st_size == 0:
        raise MapError(path, "the file is empty (0 bytes)")
    return suffix


def _reader(suffix: str) -> Callable[..., MapReading]:
    if suffix in (".bt", ".ot"):
        from crowdfence.maps.octomap import open_octomap

        return open_octomap
    if suffix in (".tif", ".tiff"):
        from crowdfence.maps.geotiff import open_geotiff

        return open_geotiff
    if suffix in (".las", ".laz"):
        from crowdfence.maps.lidar import open_lidar

        return open_lidar
    from crowdfence.maps.mesh import open_mesh

    return open_mesh
