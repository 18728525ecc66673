"""Terrain and camera that the benchmarks share."""

import platform
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crowdfence import Camera, View
from crowdfence.usable_cores import usable_cores

FLIGHT_HEIGHT_M = 80.0


def hills_with_buildings(side_m: float, cell_size_m: float, seed: int = 1) -> NDArray[np.float32]:
    """Height map [X, Y]: rolling hills of 60 m and, on every hectare, about one building of 6 to 30 m."""
    rng = np.random.default_rng(seed)
    cells = round(side_m / cell_size_m)
    along_m = (np.arange(cells, dtype=np.float32) + 0.5) * np.float32(cell_size_m)
    height_m = np.full((cells, cells), 60.0, np.float32)
    for wavelength_m, amplitude_m in ((1900.0, 40.0), (610.0, 15.0), (170.0, 5.0)):
        phase = rng.uniform(0.0, 2 * np.pi, 2)
        wave_x = np.sin(2 * np.pi / wavelength_m * along_m + phase[0])
        wave_y = np.sin(2 * np.pi / wavelength_m * along_m + phase[1])
        height_m += (amplitude_m * wave_x[:, None] * wave_y).astype(np.float32)
    for _ in range(round(side_m**2 / 1e4)):
        x, y = rng.integers(0, cells, 2)
        width, depth = np.round(rng.uniform(10.0, 40.0, 2) / cell_size_m).astype(int)
        roof_m = height_m[x, y] + rng.uniform(6.0, 30.0)
        height_m[x : x + width, y : y + depth] = roof_m
    return height_m


def vga_view(height_m: NDArray[np.float32], cell_size_m: float, stamp_ns: int) -> View:
    """640 x 480 from 80 m above the middle of the map, 45 degrees down to the north, 80 degrees wide."""
    camera = Camera.pinhole(640, 480, 381.0, 381.0, 320.0, 240.0)
    middle = height_m.shape[0] // 2
    slant = np.sqrt(0.5)
    world_from_camera = np.array(
        [
            [1.0, 0.0, 0.0, middle * cell_size_m],
            [0.0, -slant, slant, middle * cell_size_m],
            [0.0, -slant, -slant, float(height_m[middle, middle]) + FLIGHT_HEIGHT_M],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
    heatmap = np.random.default_rng(2).random((480, 640), np.float32)
    return View("drone", stamp_ns, camera, world_from_camera, heatmap)


def machine() -> str:
    """Cores that this process may use, and the processor."""
    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        models = [line.partition(":")[2] for line in cpuinfo.read_text().splitlines() if "model name" in line]
        name = models[0].strip() if models else name
    return f"{usable_cores()} cores, {name}"
