"""Distances on a sphere."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def great_circle_m(
    middle: tuple[float, float],
    longitude: NDArray[np.float64],
    latitude: NDArray[np.float64],
    sphere_m: float,
) -> NDArray[np.float64]:
    """Distances [N] of places from one place (longitude, latitude), degrees, on a sphere of a radius, by the
    haversine formula."""
    east, north = (np.deg2rad(values - middle[i]) / 2 for i, values in enumerate((longitude, latitude)))
    share = np.sin(north) ** 2 + np.cos(np.deg2rad(latitude)) * math.cos(math.radians(middle[1])) * (
        np.sin(east) ** 2
    )
    return np.asarray(2.0 * sphere_m * np.arcsin(np.sqrt(np.minimum(share, 1.0))))
