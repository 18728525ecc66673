"""Pictures of painted ground by arithmetic of our own: the ray of every pixel cut with it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import rasterio
import rasterio.transform
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation

from crowdfence import Terrain

WIDTH, HEIGHT, FOCAL = 320, 240, 200.0
EPOCH_NS = 1_760_000_000_000_000_000
PLACE = {"latitude_deg": 46.5, "longitude_deg": 8.0, "height_m": 1200.0}
SIDE_M, CELL_M = 120.0, 0.1
HAZE = 190.0

Way = Callable[[float], tuple[NDArray[np.float64], Rotation]]
"""Time -> position of the camera and world_from_camera."""
Relief = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""East, north -> height of the ground; it must be gentle."""


@cache
def paint(seed: int = 3) -> NDArray[np.float64]:
    """Blotches of two sizes on `SIDE_M` x `SIDE_M` of ground, [x, y] from its south-western corner."""
    cells = round(SIDE_M / CELL_M)
    noise = np.random.default_rng(seed).normal(size=(2, cells, cells))
    blotches = [gaussian_filter(layer, width) * width for layer, width in zip(noise, (3.0, 9.0), strict=True)]
    return 128 + 90 * np.clip(sum(blotches), -1.2, 1.2)


@dataclass(frozen=True)
class Flown:
    """How a drone flew, and what its telemetry is off: the camera is turned by `turned_deg` about its own
    axes and moved by `moved_m` against what is logged, a picture belongs to what is logged `late_s` later.
    Its pictures are `haze` to that share."""

    way: Way
    turned_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    late_s: float = 0.0
    moved_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    haze: float = 0.0


def plane(east: NDArray[np.float64], north: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.zeros_like(east)


def photograph(
    ground: NDArray[np.float64],
    eye: NDArray[np.float64],
    turn: Rotation,
    parasols_m: float = 0.0,
    relief: Relief = plane,
) -> NDArray[np.uint8]:
    """What a camera at `eye` sees, [HEIGHT, WIDTH, 3]; parasols so high hide a quarter of the ground."""
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
    rays = turn.apply(np.stack([x, y, np.full_like(x, FOCAL)], axis=-1).reshape(-1, 3))
    grey, _ = _painted(ground, eye, rays, relief)
    if parasols_m:
        cloth, (east, north) = _painted(paint(seed=4), eye - [0.0, 0.0, parasols_m], rays)
        grey = np.where((east % 8.0 < 4.0) & (north % 8.0 < 4.0), cloth, grey)
    return np.repeat(grey.reshape(HEIGHT, WIDTH, 1), 3, axis=2).astype(np.uint8)


def _painted(
    ground: NDArray[np.float64], eye: NDArray[np.float64], rays: NDArray[np.float64], relief: Relief = plane
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Grey of the ground on each ray, and where that is [2, N]."""
    height = np.zeros(len(rays))
    for _ in range(1 if relief is plane else 25):
        with np.errstate(divide="ignore"):
            reach = np.where(rays[:, 2] < -1e-6, (height - eye[2]) / rays[:, 2], np.nan)
        at = (eye[:2] + reach[:, None] * rays[:, :2]).T
        height = (height + np.nan_to_num(relief(*at))) / 2
    place = np.nan_to_num((at + SIDE_M / 2) / CELL_M - 0.5, nan=-1.0)
    return map_coordinates(ground, place, order=1, cval=128.0), at


def looking(azimuth_deg: float, tilt_deg: float) -> Rotation:
    """A camera without roll; azimuth counter-clockwise from east, tilt below the horizon."""
    a, t = np.radians([azimuth_deg, tilt_deg])
    forward = np.array([np.cos(t) * np.cos(a), np.cos(t) * np.sin(a), -np.sin(t)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    return Rotation.from_matrix(np.stack([right, np.cross(forward, right), forward], axis=1))


def circling(t_s: float) -> tuple[NDArray[np.float64], Rotation]:
    """Round the middle at 14 m and a changing height, looking inwards and now and then elsewhere."""
    angle = 24.0 * t_s
    eye = np.array(
        [14 * np.cos(np.radians(angle)), 14 * np.sin(np.radians(angle)), 20 + 4 * np.sin(0.7 * t_s)]
    )
    return eye, looking(angle + 180 + 15 * np.sin(0.9 * t_s), 55 + 8 * np.cos(0.5 * t_s))


def opposite(t_s: float) -> tuple[NDArray[np.float64], Rotation]:
    """The same from across."""
    return circling(t_s + 7.5)


def hovering(t_s: float) -> tuple[NDArray[np.float64], Rotation]:
    return np.array([0.0, 0.0, 20.0]), looking(90.0, 60.0)


def passing(t_s: float) -> tuple[NDArray[np.float64], Rotation]:
    """Eastwards at 3 m/s, straight down."""
    return np.array([3.0 * t_s - 20.0, 0.0, 20.0]), looking(0.0, 89.9)


def write_flight(
    folder: Path,
    way: Way,
    ground: NDArray[np.float64],
    *,
    turned_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    late_s: float = 0.0,
    frames: int = 18,
    parasols_m: float = 0.0,
) -> Path:
    """`write_fleet` of one drone."""
    flown = {"uav1": Flown(way, turned_deg, late_s)}
    return write_fleet(folder, flown, ground, frames=frames, parasols_m=parasols_m)


def write_fleet(
    folder: Path,
    drones: Mapping[str, Flown],
    ground: NDArray[np.float64],
    *,
    frames: int = 18,
    parasols_m: float = 0.0,
    relief: Relief = plane,
) -> Path:
    """A folder of `frames` pictures of each drone, 0.8 s apart, whose telemetry is wrong."""
    (folder / "images").mkdir(parents=True)
    rows = ["drone,stamp_ns,x,y,z,qw,qx,qy,qz"]
    for name, flown in drones.items():
        off = Rotation.from_rotvec(np.radians(flown.turned_deg))
        for k in range(frames):
            t_s = 1.0 + 0.8 * k
            eye, logged = flown.way(t_s + flown.late_s)
            picture = photograph(ground, eye + flown.moved_m, logged * off, parasols_m, relief)
            picture = ((1 - flown.haze) * picture + flown.haze * HAZE).astype(np.uint8)
            Image.fromarray(picture).save(folder / "images" / f"{name}_{EPOCH_NS + round(1e9 * t_s)}.png")
        for t_s in np.arange(0.0, 0.8 * frames + 2.0, 0.05):
            eye, logged = flown.way(t_s)
            x, y, z, w = logged.as_quat()
            rows.append(f"{name},{EPOCH_NS + round(1e9 * t_s)},{eye[0]},{eye[1]},{eye[2]},{w},{x},{y},{z}")
    (folder / "poses.csv").write_text("\n".join(rows) + "\n")
    camera = {
        "width": WIDTH,
        "height": HEIGHT,
        "fx": FOCAL,
        "fy": FOCAL,
        "cx": WIDTH / 2,
        "cy": HEIGHT / 2,
    }
    (folder / "recording.json").write_text(json.dumps({"cameras": {"*": camera}, "georeference": PLACE}))
    return folder


def level() -> Terrain:
    """The plane z = 0."""
    return shaped(plane, 1.0)


def shaped(relief: Relief, cell_m: float = 0.5) -> Terrain:
    """The map of a relief."""
    middles = (np.arange(round(SIDE_M / cell_m)) + 0.5) * cell_m - SIDE_M / 2
    heights = relief(*np.meshgrid(middles, middles, indexing="ij"))
    return Terrain.from_height_map(heights, cell_m, origin=(-SIDE_M / 2, -SIDE_M / 2, 0.0))


def write_level(path: Path) -> Path:
    """The same as a height model on Earth."""
    cells = round(SIDE_M)
    place = rasterio.transform.from_origin(-SIDE_M / 2, SIDE_M / 2, 1.0, 1.0)
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "width": cells, "height": cells}
    crs = "+proj=aeqd +lat_0=46.5 +lon_0=8 +datum=WGS84"
    with rasterio.open(path, "w", transform=place, crs=crs, **profile) as raster:
        raster.write(np.full((cells, cells), PLACE["height_m"], np.float32), 1)
    return path
