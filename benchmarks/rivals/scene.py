"""Scenes for the rivals, each from a seed: mountains with a valley, a city with overhangs, a forest.

All programs read the same little-endian files of one folder:
- `scene.bin`: u32 columns, u32 rows; f64 cell size; u64 vertices, u64 triangles; f32 height [X, Y] in metres
  at the centres of the cells, NaN where nothing is known; f32 vertex [N, 3]; u32 triangle [T, 3]: overhangs.
- `reporting.bin`, `tuning.bin`: u32 views; f64 focal length / image width; f64 world_from_camera [V, 3, 4].
- `heatmaps-<width>x<height>.bin`: u8 [H, height, width], value / 255. View i reads heatmap i modulo H.
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

VIEWS = 48  # figures are of the first 12; the rest flies when 48 drones do
HEATMAPS = 12
FOCAL_PER_WIDTH = 0.5  # 90 degrees across
SEEDS = {"tuning": 101, "reporting": 202}
BOX = "021 123 456 576 014 154 263 367 042 246 135 375"
TRIANGLES_OF_BOX = np.array([[int(corner) for corner in triangle] for triangle in BOX.split()])
KINDS = ("mountains", "city", "forest")

Heights = NDArray[np.float32]


@dataclass
class Scene:
    height_m: Heights  # [X, Y]
    cell_size_m: float
    vertices: NDArray[np.float32]
    triangles: NDArray[np.uint32]


def make_scene(kind: str, side_m: float, cell_size_m: float, seed: int = 7) -> Scene:
    rng = np.random.default_rng(seed)
    return {"mountains": _mountains, "city": _city, "forest": _forest}[kind](side_m, cell_size_m, rng)


def write_scene(scene: Scene, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "scene.bin").open("wb") as file:
        file.write(struct.pack("<IId", *scene.height_m.shape, scene.cell_size_m))
        file.write(struct.pack("<QQ", len(scene.vertices), len(scene.triangles)))
        for array, kind in ((scene.height_m, "<f4"), (scene.vertices, "<f4"), (scene.triangles, "<u4")):
            array.astype(kind, copy=False).tofile(file)
    for name, seed in SEEDS.items():
        poses = _poses(scene, np.random.default_rng(seed))
        header = struct.pack("<Id", VIEWS, FOCAL_PER_WIDTH)
        (folder / f"{name}.bin").write_bytes(header + poses.astype("<f8").tobytes())


def write_heatmaps(folder: Path, width: int, height: int, seed: int = 3) -> None:
    """Soft blobs, about a sixth of the picture above 0.5."""
    rng = np.random.default_rng(seed)
    rows, columns = (np.arange(height) + 0.5) / 40.0, (np.arange(width) + 0.5) / 40.0
    with (folder / f"heatmaps-{width}x{height}.bin").open("wb") as file:
        for _ in range(HEATMAPS):
            knots = rng.random((height // 40 + 2, width // 40 + 2), np.float32)
            blurred = _between(_between(knots, rows).T, columns).T
            np.clip(255.0 * (1.9 * blurred - 0.75), 0.0, 255.0).astype(np.uint8).tofile(file)


def _between(knots: Heights, at: NDArray[np.float64]) -> Heights:
    """Linear interpolation along the first axis."""
    low = at.astype(int)
    weight = (at - low).astype(np.float32)[:, None]
    return knots[low] * (1 - weight) + knots[low + 1] * weight


def _mountains(side_m: float, cell_size_m: float, rng: np.random.Generator) -> Scene:
    height_m = _waves(side_m, cell_size_m, rng, longest_m=1500.0, relief_m=75.0)
    along_m = _centres(side_m, cell_size_m)
    middle_m = side_m / 2 + 0.1 * side_m * np.sin(along_m / 260.0)
    for i in range(len(along_m)):
        off_road_m = np.abs(along_m - middle_m[i])
        # A flat road of 12 m, then the valley's flanks rise into the mountains over 150 m.
        height_m[i] *= np.clip((off_road_m - 6.0) / 150.0, 0.0, 1.0)
        height_m[i] += 0.25 * np.maximum(off_road_m - 6.0, 0.0).clip(max=300.0)
    _drill_holes(height_m, cell_size_m, rng)
    return Scene(height_m + np.float32(200.0), cell_size_m, *_mesh([]))


def _city(side_m: float, cell_size_m: float, rng: np.random.Generator) -> Scene:
    """Streets every 90 m; four houses a block with eaves, market roofs on air, bridges over the streets."""
    height_m = _waves(side_m, cell_size_m, rng, longest_m=900.0, relief_m=4.0) + np.float32(50.0)
    boxes = []
    for block_x in np.arange(8.0, side_m - 90.0, 90.0):
        for block_y in np.arange(8.0, side_m - 90.0, 90.0):
            for lot in range(4):
                low = np.array([block_x + 38.0 * (lot % 2), block_y + 38.0 * (lot // 2)]) + rng.uniform(
                    2, 6, 2
                )
                high = low + rng.uniform(14.0, 30.0, 2)
                i, j = (low / cell_size_m).astype(int)
                k, m = (high / cell_size_m).astype(int)
                ground_m = float(height_m[i:k, j:m].max())
                if rng.random() < 0.15:
                    boxes.append([*low, ground_m + 5.0, *high, ground_m + 5.6])  # a roof over a market
                else:
                    roof_m = ground_m + rng.uniform(6.0, 30.0)
                    height_m[i:k, j:m] = roof_m
                    boxes.append([*(low - 1.2), roof_m - 0.8, *(high + 1.2), roof_m + 0.3])
            if rng.random() < 0.2:
                ground_m = float(height_m[int(block_x / cell_size_m), int(block_y / cell_size_m)])
                low = [block_x - 8.0, block_y + 34.0, ground_m + 8.0]
                boxes.append([*low, low[0] + 82.0, low[1] + 6.0, low[2] + 1.0])
    _drill_holes(height_m, cell_size_m, rng)
    corners = np.array(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]]
    )
    ends = np.reshape(boxes, (-1, 2, 3))
    solids = [(low + corners * (high - low), TRIANGLES_OF_BOX) for low, high in ends]
    return Scene(height_m, cell_size_m, *_mesh(solids))


def _forest(side_m: float, cell_size_m: float, rng: np.random.Generator) -> Scene:
    """Canopies over hills, 60 a hectare, thinned to clearings."""
    height_m = _waves(side_m, cell_size_m, rng, longest_m=700.0, relief_m=18.0) + np.float32(100.0)
    ball, faces = _ball()
    solids = []
    for x, y in rng.uniform(8.0, side_m - 8.0, (round(side_m**2 * 0.006), 2)):
        if np.sin(x / 47.0) * np.sin(y / 61.0) > 0.55:
            continue
        ground_m = height_m[int(x / cell_size_m), int(y / cell_size_m)]
        radius = rng.uniform(1.5, 3.5)
        crown_m = rng.uniform(radius, 1.8 * radius)
        centre = np.array([x, y, ground_m + rng.uniform(2.0, 5.0) + crown_m])
        solids.append((centre + ball * [radius, radius, crown_m], faces))
    _drill_holes(height_m, cell_size_m, rng)
    return Scene(height_m, cell_size_m, *_mesh(solids))


def _waves(
    side_m: float, cell_size_m: float, rng: np.random.Generator, longest_m: float, relief_m: float
) -> Heights:
    """Waves in all directions, from the longest down to 3 m, each about as steep as the next."""
    along_m = _centres(side_m, cell_size_m)
    height_m = np.zeros((len(along_m), len(along_m)), np.float32)
    wavelength_m, amplitude_m = longest_m, relief_m / 2
    while wavelength_m > 3.0:
        azimuth, phase = rng.uniform(0.0, 2 * np.pi, 2)
        wave = 2 * np.pi / wavelength_m * np.array([np.cos(azimuth), np.sin(azimuth)])
        x, y = wave[0] * along_m + phase, wave[1] * along_m
        for factor_x, factor_y in ((np.sin(x), np.cos(y)), (np.cos(x), np.sin(y))):
            height_m += (amplitude_m * factor_x).astype(np.float32)[:, None] * factor_y.astype(np.float32)
        wavelength_m, amplitude_m = wavelength_m * 0.62, amplitude_m * 0.57
    return height_m


def _drill_holes(height_m: Heights, cell_size_m: float, rng: np.random.Generator) -> None:
    """No data within 8 m of four places a square kilometre."""
    side_m, reach = len(height_m) * cell_size_m, round(8.0 / cell_size_m)
    east, north = np.indices((2 * reach, 2 * reach)) - reach + 0.5
    disc = np.hypot(east, north) < reach
    for x, y in rng.uniform(20.0, side_m - 20.0, (max(1, round(4e-6 * side_m**2)), 2)):
        i, j = round(x / cell_size_m) - reach, round(y / cell_size_m) - reach
        height_m[i : i + 2 * reach, j : j + 2 * reach][disc] = np.nan


def _ball() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """80 triangles: an icosahedron with every edge halved."""
    golden = (1 + 5**0.5) / 2
    plane = [(s, t * golden) for s in (-1, 1) for t in (-1, 1)]
    corners = np.array([p for a, b in plane for p in ((0, a, b), (a, b, 0), (b, 0, a))], float)
    near = np.isclose(((corners[:, None] - corners) ** 2).sum(-1), 4.0)
    triples = [(a, b, c) for a in range(12) for b in range(a) for c in range(b)]
    faces = [
        [corners[i] for i in t] for t in triples if near[t[0], t[1]] and near[t[1], t[2]] and near[t[0], t[2]]
    ]
    halved = []
    for a, b, c in faces:
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        halved += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    points, index = np.unique(np.reshape(halved, (-1, 3)).round(9), axis=0, return_inverse=True)
    return points / np.linalg.norm(points, axis=1, keepdims=True), index.reshape(-1, 3)


def _mesh(
    solids: list[tuple[NDArray[np.float64], NDArray[np.int64]]],
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    if not solids:
        return np.empty((0, 3), np.float32), np.empty((0, 3), np.uint32)
    first = np.cumsum([0, *(len(points) for points, _ in solids)])
    triangles = np.concatenate([faces + at for (_, faces), at in zip(solids, first, strict=False)])
    vertices = np.concatenate([points for points, _ in solids])
    return vertices.astype(np.float32), triangles.astype(np.uint32)


def _poses(scene: Scene, rng: np.random.Generator) -> NDArray[np.float64]:
    """20 to 80 m above what stands within 5 m, 10 to 60 degrees down, rolled up to 5, far from the edge."""
    height_m, cell_size_m = scene.height_m, scene.cell_size_m
    side_m, reach = len(height_m) * cell_size_m, round(5.0 / cell_size_m)
    poses = np.empty((VIEWS, 3, 4))
    for pose in poses:
        x, y = rng.uniform(0.25 * side_m, 0.75 * side_m, 2)
        i, j = round(x / cell_size_m), round(y / cell_size_m)
        top_m = np.nanmax(height_m[i - reach : i + reach, j - reach : j + reach], initial=0.0)
        pose[:, :3] = _looking(*np.radians(rng.uniform([0.0, 10.0, -5.0], [360.0, 60.0, 5.0])))
        pose[:, 3] = x, y, top_m + rng.uniform(20.0, 80.0)
    return poses


def _looking(azimuth: float, down: float, roll: float) -> NDArray[np.float64]:
    """World from camera: camera axes right, down, forward as columns."""
    ahead = np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    forward = np.cos(down) * ahead - np.sin(down) * np.array([0.0, 0.0, 1.0])
    right = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0])
    below = np.cross(forward, right)
    return np.column_stack(
        [np.cos(roll) * right + np.sin(roll) * below, np.cos(roll) * below - np.sin(roll) * right, forward]
    )


def _centres(side_m: float, cell_size_m: float) -> NDArray[np.float64]:
    return np.asarray((np.arange(round(side_m / cell_size_m)) + 0.5) * cell_size_m)
