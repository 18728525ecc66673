"""Sun, sky and air of one mission: a function of season, hour, latitude and seed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_DAY_OF_YEAR = {"summer": 190, "autumn": 285, "winter": 20, "dry": 235}

Rgb = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Light:
    """Linear RGB radiances in units in which a white wall in noon sun is about 3."""

    season: str
    sun_direction: tuple[float, float, float]
    """Unit vector towards the sun (or, at night, the moon); local ENU."""
    sun_colour: Rgb
    sky_colour: Rgb
    haze_colour: Rgb
    haze_per_m: float
    """Extinction: the share 1 - exp(-haze_per_m * distance) of the light comes from the air."""
    cloud_cover: float
    """0 = clear, 1 = overcast."""
    exposure: float


def sun_direction(day_of_year: int, solar_time_h: float, latitude_deg: float) -> tuple[float, float, float]:
    """Unit vector (east, north, up) towards the sun; declination after Cooper (1969)."""
    declination = math.radians(23.44) * math.sin(2.0 * math.pi * (284 + day_of_year) / 365.0)
    hour_angle = math.radians(15.0 * (solar_time_h - 12.0))
    latitude = math.radians(latitude_deg)
    east = -math.cos(declination) * math.sin(hour_angle)
    north = math.cos(latitude) * math.sin(declination) - math.sin(latitude) * math.cos(
        declination
    ) * math.cos(hour_angle)
    up = math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(
        hour_angle
    )
    return east, north, up


def daylight(season: str, time_of_day_h: float, seed: int, *, latitude_deg: float = 46.5) -> Light:
    """Light of a day of that season; haze and clouds vary with the seed. KeyError for an unknown season."""
    rng = np.random.default_rng([seed, 501])
    cloud_cover = float(rng.uniform(0.1, 0.6) + (0.2 if season in ("autumn", "winter") else 0.0))
    haze = float(rng.uniform(0.00022, 0.0006) * (1.8 if season == "autumn" else 1.0))
    east, north, up = sun_direction(_DAY_OF_YEAR[season], time_of_day_h, latitude_deg)
    if up < -0.05:
        return _moonlight(season, cloud_cover, haze)
    # A sun just below the horizon still lights the sky: keep it at least 3 degrees up, and dim it.
    dusk = float(np.clip((up + 0.05) / 0.35, 0.0, 1.0))
    direction = _above_horizon(east, north, up)
    warm = (1.0 - dusk) ** 1.5
    strength = (0.25 + 2.75 * dusk) * (1.0 - 0.45 * max(cloud_cover - 0.5, 0.0))
    sun = (strength * 1.0, strength * (0.94 - 0.38 * warm), strength * (0.84 - 0.66 * warm))
    sky_strength = (0.20 + 0.55 * dusk) * (1.0 + 0.3 * cloud_cover)
    sky = (sky_strength * (0.62 + 0.1 * warm), sky_strength * 0.76, sky_strength * 1.0)
    haze_colour = (0.26 + 0.30 * dusk + 0.22 * warm, 0.28 + 0.37 * dusk + 0.02 * warm, 0.33 + 0.44 * dusk)
    return Light(season, direction, sun, sky, haze_colour, haze, cloud_cover, 0.62 + 1.3 * (1.0 - dusk) ** 2)


def _above_horizon(east: float, north: float, up: float) -> tuple[float, float, float]:
    lowest = math.sin(math.radians(5.0))
    if up >= lowest:
        return east, north, up
    flat = math.hypot(east, north)
    shrink = math.sqrt(1.0 - lowest**2) / max(flat, 1e-9)
    return east * shrink, north * shrink, lowest


def _moonlight(season: str, cloud_cover: float, haze_per_m: float) -> Light:
    direction = (0.35, -0.5, math.sqrt(1.0 - 0.35**2 - 0.5**2))
    sun, sky, air = (0.16, 0.20, 0.30), (0.05, 0.07, 0.12), (0.05, 0.07, 0.11)
    return Light(season, direction, sun, sky, air, haze_per_m, cloud_cover, 3.2)
