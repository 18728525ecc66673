"""Landing sites as GeoJSON (RFC 7946); without a georeference in local metres, as `geojson` has zones.

Outlines are shrunk by a centimetre, which outweighs what writing them in degrees moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import write_bytes
from crowdfence.exports.geographic_outline import MAX_EDGE_M, geojson_geometry, in_degrees
from crowdfence.exports.geojson import LOCAL_FRAME
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.one_a_line import one_a_line
from crowdfence.georeference import Georeference
from crowdfence.iso_time import iso_utc
from crowdfence.zones.sites import LandingSite

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

SHRUNK_M = 0.01
DECIMALS = 8
"""A millimetre."""
_MEANING = (
    "A site is ground that looks of the drones and the known map speak for at this stamp. It is no "
    "clearance: people move, and ground outside the sites is not known to be unfit. Nothing "
    "here was checked against no-fly zones other than those named in closed_zones."
)


def write_sites(
    path: str | PathLike[str],
    sites: Sequence[LandingSite],
    description: MapDescription,
    georeference: Georeference | None,
    closed_ids: Sequence[str] = (),
) -> None:
    """Write what `sites_geojson` gives. OSError when the file cannot be written."""
    write_bytes(path, sites_geojson(sites, description, georeference, closed_ids).encode())


def sites_geojson(
    sites: Sequence[LandingSite],
    description: MapDescription,
    georeference: Georeference | None,
    closed_ids: Sequence[str] = (),
) -> str:
    """One Feature per site, one a line. `closed_ids` are the zones that were kept free of sites. ValueError
    for a site within one degree of a pole."""
    head: dict[str, Any] = {
        "type": "FeatureCollection",
        "crowdfence": {
            "layer": description.layer,
            "method": description.method,
            "threshold": description.threshold,
            "stamp_utc": iso_utc(description.stamp_ns),
            "stamp_ns": description.stamp_ns,
            "parameters": dict(description.parameters),
            "mission": description.mission,
            "drones": list(description.drones),
            "sites": len(sites),
            "sites_area_m2": sum(site.area_m2 for site in sites),
            "closed_zones": list(closed_ids),
            "meaning": _MEANING,
        },
    }
    if georeference is None:
        head |= {"crs": None, "coordinate_frame": LOCAL_FRAME}
    features = [_feature(site, description, georeference) for site in sites]
    return one_a_line(head, "features", features)


def _feature(
    site: LandingSite, description: MapDescription, georeference: Georeference | None
) -> dict[str, Any]:
    return {
        "type": "Feature",
        "id": site.id,
        "geometry": geojson_geometry(_outline(site, georeference)),
        "properties": {
            "id": site.id,
            "kind": description.layer,
            "area_m2": site.area_m2,
            "centre": _centre(site, georeference),
            "radius_m": site.radius_m,
            "slope_deg": site.slope_deg,
            "probability_min": site.probability_min,
            "probability_mean": site.probability_mean,
            "last_seen_utc": iso_utc(site.last_seen_ns),
            "last_seen_age_s": (description.stamp_ns - site.last_seen_ns) / 1e9,
            "oldest_look_age_s": (description.stamp_ns - site.oldest_look_ns) / 1e9,
            "seen_by": list(site.seen_by),
        },
    }


def _centre(site: LandingSite, georeference: Georeference | None) -> dict[str, float]:
    """Middle of the largest disc inside, on the ground."""
    x, y, z = site.centre
    local = {"x": x, "y": y, "z": z}
    if georeference is None:
        return local
    latitude, longitude, height = georeference.geodetic_from_local(np.array([site.centre]))
    return {
        "latitude_deg": round(float(latitude[0]), DECIMALS),
        "longitude_deg": round(float(longitude[0]), DECIMALS),
        "height_wgs84_m": round(float(height[0]), 3),
        **local,
    }


def _outline(site: LandingSite, georeference: Georeference | None) -> Polygon | MultiPolygon:
    import shapely

    inside = shapely.buffer(site.polygon, -SHRUNK_M, join_style="mitre")
    if georeference is None:
        return inside

    def on_ground(corners: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([corners, np.full(len(corners), site.centre[2])])

    dense = shapely.segmentize(inside, MAX_EDGE_M)
    return in_degrees(dense, on_ground, georeference, DECIMALS, f"site {site.id}")
