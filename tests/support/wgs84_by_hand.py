"""WGS84 from its definition, without PROJ: what the georeferenced exports are checked against."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Anchor = tuple[float, float, float]

SEMI_MAJOR_AXIS_M = 6378137.0
FLATTENING = 1 / 298.257223563
_E2 = FLATTENING * (2 - FLATTENING)


def earth_centred(latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike) -> Array:
    """Earth-centred coordinates [..., 3]."""
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    normal = SEMI_MAJOR_AXIS_M / np.sqrt(1 - _E2 * np.sin(latitude) ** 2)
    around = (normal + np.asarray(height_m)) * np.cos(latitude)
    up = (normal * (1 - _E2) + np.asarray(height_m)) * np.sin(latitude)
    return np.stack([around * np.cos(longitude), around * np.sin(longitude), up], axis=-1)


def local_axes(latitude_deg: float, longitude_deg: float) -> Array:
    """Rows: east, north and up in Earth-centred coordinates."""
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    east = [-np.sin(longitude), np.cos(longitude), 0.0]
    up = [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    return np.array([east, np.cross(up, east), up])


def local_from_geodetic(
    anchor: Anchor, latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike
) -> Array:
    """(east, north, up) [..., 3] of points in the frame anchored at (latitude, longitude, height)."""
    offset = earth_centred(latitude_deg, longitude_deg, height_m) - earth_centred(*anchor)
    return offset @ local_axes(*anchor[:2]).T


def ground_point(anchor: Anchor, latitude_deg: ArrayLike, longitude_deg: ArrayLike, up_m: float) -> Array:
    """Local points [..., 3] on the verticals of (latitude, longitude) whose local height is `up_m`."""
    foot = local_from_geodetic(anchor, latitude_deg, longitude_deg, np.zeros(np.shape(latitude_deg)))
    head = local_from_geodetic(anchor, latitude_deg, longitude_deg, np.full(np.shape(latitude_deg), 1e4))
    vertical = head - foot  # a straight line
    return foot + vertical * ((up_m - foot[..., 2]) / vertical[..., 2])[..., None]
