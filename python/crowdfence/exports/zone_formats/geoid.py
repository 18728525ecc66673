"""Height of the geoid, mean sea level, above the ellipsoid of WGS 84."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pyproj import Transformer

GEOID = "EPSG:5773"
"""EGM96 height."""
_SPREAD_M = 0.5
"""How far the geoid may leave its values at four corners and the middle of a zone: where it is steepest it
falls 1 m in 10 km, and zones are smaller."""


def geoid_heights_m(bounds_deg: NDArray[np.float64]) -> tuple[float, float]:
    """Lowest and highest height (EGM96) within (west, south, east, north), with half a metre to both sides.

    ValueError where PROJ has no grid of it: calling both heights equal would be wrong by up to 100 m.
    """
    west, south, east, north = bounds_deg
    longitude = np.array([west, west, east, east, (west + east) / 2])
    latitude = np.array([south, north, south, north, (south + north) / 2])
    _, _, height_m = _above_sea().transform(longitude, latitude, np.zeros(5))
    if not np.isfinite(height_m).all():
        raise ValueError(
            f"PROJ's grid of EGM96 holds no height of the geoid at {south:g}, {west:g}; use AGL or WGS84"
        )
    undulation_m = -np.asarray(height_m)
    return float(undulation_m.min()) - _SPREAD_M, float(undulation_m.max()) + _SPREAD_M


def _above_sea() -> Transformer:
    """(longitude, latitude, height above the ellipsoid) -> the same with the height above the geoid."""
    from pyproj import Transformer, datadir
    from pyproj.exceptions import ProjError

    try:
        return Transformer.from_crs(
            "EPSG:4979", f"EPSG:4326+{GEOID.partition(':')[2]}", always_xy=True, allow_ballpark=False
        )
    except ProjError as error:
        raise ValueError(
            "heights above sea level need PROJ's grid of the geoid EGM96, us_nga_egm96_15.tif, which is "
            f"neither in {datadir.get_data_dir()} nor in {datadir.get_user_data_dir()}; install it "
            "(pyproj sync --file us_nga_egm96_15), or use AGL or WGS84"
        ) from error
