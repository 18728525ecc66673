"""What a map file's own header says, without reading the rest.

The file has been opened as a terrain before, so it is known to be sound."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from crowdfence.maps.geo_keys import (
    compound_systems,
    crs_of,
    las_directory,
    tiff_vertical_unit,
    vertical_unit,
)
from crowdfence.maps.lidar import stated_crs
from crowdfence.maps.source_frame import HeightRules

if TYPE_CHECKING:
    from pyproj import CRS

Facts = dict[str, str | int | float]

_KINDS = {
    ".bt": "OctoMap, occupancy only (.bt)",
    ".ot": "OctoMap, full tree (.ot)",
    ".tif": "GeoTIFF height model",
    ".tiff": "GeoTIFF height model",
    ".las": "LAS lidar points",
    ".laz": "LAZ lidar points (compressed)",
    ".ply": "PLY mesh",
    ".obj": "OBJ mesh",
}
# More than any header of these text formats has.
_HEADER_BYTES = 64 * 1024


def map_file_kind(path: Path) -> str:
    """The kind of map in words, by its suffix."""
    return _KINDS[path.suffix.lower()]


def map_file_facts(path: Path) -> Facts:
    """Names (units in them) and values; empty for kinds without a header."""
    suffix = path.suffix.lower()
    if suffix in (".bt", ".ot"):
        return _octomap_facts(path)
    if suffix in (".tif", ".tiff"):
        return _geotiff_facts(path)
    if suffix in (".las", ".laz"):
        return _lidar_facts(path)
    return _ply_facts(path) if suffix == ".ply" else {}


def _octomap_facts(path: Path) -> Facts:
    header = dict(line.split(maxsplit=1) for line in _header_lines(path, until="data") if " " in line.strip())
    facts: Facts = {}
    if "id" in header:
        facts["tree_type"] = header["id"].strip()
    if "size" in header:
        facts["tree_nodes"] = int(header["size"])
    return facts


def _ply_facts(path: Path) -> Facts:
    facts: Facts = {}
    for line in _header_lines(path, until="end_header"):
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            facts["format"] = words[1]
        elif words[:1] == ["element"] and len(words) == 3:
            facts[f"{words[1]}_count"] = int(words[2])
    return facts


def _header_lines(path: Path, until: str) -> list[str]:
    with path.open("rb") as file:
        text = file.read(_HEADER_BYTES).decode("latin-1")
    lines = text.splitlines()
    return lines[: lines.index(until)] if until in lines else lines[:1]


def _geotiff_facts(path: Path) -> Facts:
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with compound_systems(), rasterio.open(path, driver="GTiff") as dataset:
            crs = crs_of(dataset)
            facts: Facts = {
                "width_px": dataset.width,
                "height_px": dataset.height,
                "bands": dataset.count,
                "type": dataset.dtypes[0],
                "pixel_size": max(dataset.res),
                "nodata": "none declared" if dataset.nodata is None else f"{dataset.nodata:g}",
            }
            label = tiff_vertical_unit(path) or dataset.units[0]
            unsaid = HeightRules().unsaid_unit(crs, label) is not None
            facts |= _crs_facts(crs, "not stated" if unsaid else _metres_per_height(crs, label))
    return facts


def _lidar_facts(path: Path) -> Facts:
    import laspy

    with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs) as reader:
        header = reader.header
        label = vertical_unit(las_directory([*header.vlrs, *(header.evlrs or ())]))
        facts: Facts = {
            "las_version": f"{header.version.major}.{header.version.minor}",
            "point_format": int(header.point_format.id),
            "points": int(header.point_count),
        }
    crs = stated_crs(path)
    return facts | _crs_facts(crs, _metres_per_height(crs, label))


def _metres_per_height(crs: CRS | None, label: str | None) -> float | str:
    try:
        return HeightRules().metres_per_height(crs, label)
    except ValueError:  # a unit that has no name here, or two: the caller has said which
        return "not clear"


def _crs_facts(crs: CRS | None, metres_per_height: float | str) -> Facts:
    if crs is None:
        return {"reference_system": "none"}
    facts: Facts = {
        "reference_system": _crs_name(crs),
        "horizontal_unit": crs.axis_info[0].unit_name,
        "metres_per_height": metres_per_height,
    }
    if len(crs.axis_info) < 3:
        facts["vertical_datum"] = "not stated, taken as the WGS84 ellipsoid"
    return facts


def _crs_name(crs: CRS) -> str:
    code = crs.to_epsg()
    if code is not None:
        return f"{crs.name} (EPSG:{code})"
    operation = crs.coordinate_operation
    return f"{crs.name} ({operation.method_name})" if operation is not None else crs.name
