"""Polygons of any GeoJSON (RFC 7946), from the ground up without end; those of our files with their band.

Circles are points with a radius in metres: those of a fence that `crowdfence fence pull` wrote, of files that
are ED-318 but for what it demands ("extent"), and of Azure Maps. What a fence keeps drones in is no zone.

Files from before RFC 7946, and many that GIS programs write today, name their reference system in "crs".
Degrees of another datum lie up to hundreds of metres from those of WGS 84, and are converted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.datum import datum_doubt, wgs84_from
from crowdfence.errors import quoted
from crowdfence.sources.layers import LANDING_SITE
from crowdfence.static_zones.given_zone import GivenCircle, GivenPolygon, GivenZone, band_of, naming, ring_of

if TYPE_CHECKING:
    from pyproj import Transformer

_CURE = "write it in WGS 84 (ogr2ogr -t_srs EPSG:4326)"


def geojson_zones(document: Mapping[str, Any], left_out: list[str]) -> Iterator[GivenZone]:
    """ValueError or KeyError where something is missing, and where places cannot be brought to WGS 84."""
    if document.get("crs", {}) is None:
        raise ValueError("its coordinates are local metres, not longitude and latitude")
    if document["type"] == "FeatureCollection":
        features = document["features"]
    elif document["type"] == "Feature":
        features = [document]
    else:
        features = [{"geometry": document, "properties": {}}]
    for number, feature in enumerate(features, start=1):
        properties = feature.get("properties") or {}
        name = str(feature.get("id") or properties.get("id") or properties.get("name") or f"feature {number}")
        title = str(properties.get("name") or "")
        if properties.get("fence") == "inclusion":
            left_out.append(
                f"{name}: an inclusion fence, which closes what lies around it; no zone does that"
            )
            continue
        if _is_of_sites(document):
            left_out.append(f"{name}: a landing site of ours, which closes nothing")
            continue
        crs = _stated_crs(document, feature, feature["geometry"])
        if crs is not None:
            _from_crs(crs)  # where it cannot be used that is no fault of this zone
        with naming(name):
            yield from _zones_of(name, title, feature["geometry"], properties, crs, left_out)


def _zones_of(
    name: str,
    title: str,
    drawn: Any,
    properties: Mapping[str, Any],
    crs: str | None,
    left_out: list[str],
) -> Iterator[GivenZone]:
    parts: list[GivenPolygon | GivenCircle] = []
    said_before = len(left_out)
    for geometry in _geometries(drawn):
        kind = geometry and geometry["type"]
        if kind == "Point" and (radius := _radius_of(geometry, properties)) is not None:
            centre = _in_wgs84(ring_of([geometry["coordinates"]]), crs)
            parts.append(GivenCircle(centre, float(radius)))
            continue
        if kind not in ("Polygon", "MultiPolygon"):
            left_out.append(f"{name}: a {kind} closes no ground")
            continue
        shapes = geometry["coordinates"]
        parts += [
            GivenPolygon([_in_wgs84(ring_of(ring), crs) for ring in rings])
            for rings in ([shapes] if kind == "Polygon" else shapes)
        ]
    if not parts:
        if len(left_out) == said_before:
            left_out.append(f"{name}: no polygon, closes no ground")
        return
    datum = properties.get("datum", "AGL")
    limits = properties.get("lower_m"), properties.get("upper_m")
    band = band_of(name, limits, "m", (datum, datum))
    yield GivenZone(name, parts, band, title=title)


def _radius_of(point: Mapping[str, Any], properties: Mapping[str, Any]) -> Any:
    """None for a point that is no circle."""
    if properties.get("fence") == "exclusion":
        return properties["radius_m"]
    if point.get("extent"):
        return point["extent"]["radius"]
    return properties["radius"] if properties.get("subType") == "Circle" else None


def _is_of_sites(document: Mapping[str, Any]) -> bool:
    """Whether it is the file of sites that a run of the layer wrote."""
    told = document.get("crowdfence")
    return isinstance(told, dict) and told.get("layer") == LANDING_SITE


def _geometries(geometry: Any) -> list[Any]:
    """Those of a collection, whatever collections are in it."""
    if not geometry or geometry["type"] != "GeometryCollection":
        return [geometry]
    return [one for part in geometry["geometries"] for one in _geometries(part)]


def _stated_crs(*holders: Mapping[str, Any] | None) -> str | None:
    """The name of the reference system that the innermost of them states; None: WGS 84, nothing is said."""
    crs = next((holder["crs"] for holder in reversed(holders) if holder and holder.get("crs")), None)
    if crs is None:
        return None
    name = (crs.get("properties") or {}).get("name")
    if not isinstance(name, str):
        raise ValueError(f"its reference system is not named: {quoted(crs)}; {_CURE}")
    return name


def _in_wgs84(ring: NDArray[np.float64], crs: str | None) -> NDArray[np.float64]:
    """Longitude and latitude [C, 2] of corners in a reference system."""
    if crs is None or not len(ring):
        return ring
    return np.column_stack(_from_crs(crs).transform(*ring.T)[:2])


@lru_cache(maxsize=8)
def _from_crs(name: str) -> Transformer:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        crs = CRS.from_user_input(name)
    except CRSError as error:
        raise ValueError(f"its reference system {name!r} is none that PROJ knows; {_CURE}") from error
    if not crs.is_geographic:
        raise ValueError(f"its coordinates are in {crs.name!r}, not in degrees; {_CURE}")
    if doubt := datum_doubt(crs):
        raise ValueError(doubt)
    return wgs84_from(crs)
