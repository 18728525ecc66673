"""Land (or sea) from the edge of the map to the horizon. Seen, but on no map: nobody flies there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.ground import Cover, Ground
from crowdfence.simulation.landscape.noise import fractal_noise
from crowdfence.simulation.rendering.ground_tiles import VERTEX

_RINGS = np.array([0.998, 1.02, 1.08, 1.2, 1.4, 1.7, 2.1, 2.6, 3.2, 4.0, 5.0, 6.5, 8.5])
_LEAST_HILLS_M = 90.0
_ALPINE_RELIEF_M = 100.0  # lower hills carry woods in place of rock and snow
_SPACING = 8  # lattice points between two spokes


def backdrop(ground: Ground, relief_m: float, seed: int) -> tuple[NDArray[np.void], NDArray[np.uint32]]:
    """Vertices and triangle indices of rings around the ground, rising to hills of about `relief_m`."""
    edge = _edge(ground)
    spokes, rings = len(edge), len(_RINGS)
    flat = edge["position"][:, :2]
    noise = fractal_noise(256, 5, 5, np.random.default_rng([seed, 601]), ridged=True)
    xy = flat[None] * _RINGS[:, None, None]
    cell = (xy / np.abs(flat).max() * 17.0 + 128).astype(int) % 256
    hills = np.clip(noise[cell[..., 1], cell[..., 0]], 0, 1) * max(1.9 * relief_m, _LEAST_HILLS_M)
    out = np.clip((_RINGS - 1.05) / 2.2, 0, 1)[:, None] ** 1.3
    land = edge["cover"][:, Cover.WATER] < 128
    height = edge["position"][:, 2] * (1 - out) + out * hills
    height = np.where(land[None], height, edge["position"][:, 2])
    # The first ring dips under the map's edge so that no gap shows the sky.
    height[0] -= 0.6
    vertices = np.zeros((rings, spokes), VERTEX)
    vertices["position"] = np.concatenate([xy, height[..., None]], axis=-1)
    vertices["normal"] = _normals(vertices["position"])
    vertices["cover"] = _cover(edge["cover"], vertices, relief_m)
    vertices["road"] = [1e3, 1e3, 0.0]
    # Distant woods are darker than meadows.
    woods = np.where(out > 0.05, 120 + 100 * noise[cell[..., 0], cell[..., 1]], 225)
    vertices["light"][..., 0] = np.clip(woods + 40, 0, 255)
    vertices["light"][..., 1] = np.where(land[None], np.clip(woods, 0, 255), edge["light"][:, 1])
    return vertices.reshape(-1), _strips(rings, spokes)


def _edge(ground: Ground) -> NDArray[np.void]:
    """Every eighth lattice point of the border, counter-clockwise from the south-west corner."""
    rows, columns = ground.lattice.rows, ground.lattice.columns
    x, y = ground.lattice.coordinates()
    points = np.zeros((rows, columns), VERTEX)
    points["position"] = np.stack([x, y, ground.height_m], axis=-1)
    points["cover"] = ground.cover
    last_row, last_column = rows - 1, columns - 1
    border = np.concatenate(
        [
            points[0, 0:last_column:_SPACING],
            points[0:last_row:_SPACING, last_column],
            points[last_row, last_column:0:-_SPACING],
            points[last_row:0:-_SPACING, 0],
        ]
    )
    return border


def _normals(position: NDArray[np.float32]) -> NDArray[np.float32]:
    along = np.roll(position, -1, axis=1) - np.roll(position, 1, axis=1)
    outwards = np.gradient(position, axis=0)
    normal = np.cross(outwards, along)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
    return np.asarray(np.where(normal[..., 2:] < 0, -normal, normal), dtype=np.float32)


def _cover(edge: NDArray[np.uint8], vertices: NDArray[np.void], relief_m: float) -> NDArray[np.uint8]:
    wild = np.zeros((*vertices.shape, len(Cover)))
    alpine = 1.0 if relief_m > _ALPINE_RELIEF_M else 0.0
    steep = alpine * np.clip((0.93 - vertices["normal"][..., 2]) / 0.12, 0, 1)
    high = alpine * np.clip((vertices["position"][..., 2] - 0.55 * relief_m) / (0.3 * relief_m), 0, 1)
    wild[..., Cover.ROCK] = steep
    wild[..., Cover.SNOW] = high * (1 - 0.6 * steep)
    wild[..., Cover.GRASS] = np.clip(1 - steep - high, 0, 1)
    wild *= 255 / np.maximum(wild.sum(axis=-1, keepdims=True), 1e-9)
    water = edge[None, :, Cover.WATER] > 127
    share = np.where(water, 0.0, np.clip((_RINGS - 1.0) / 0.05, 0, 1)[:, None])
    return np.asarray(edge[None] * (1 - share[..., None]) + wild * share[..., None], dtype=np.uint8)


def _strips(rings: int, spokes: int) -> NDArray[np.uint32]:
    ring, spoke = np.meshgrid(np.arange(rings - 1), np.arange(spokes), indexing="ij")
    inner, inner_next = ring * spokes + spoke, ring * spokes + (spoke + 1) % spokes
    outer, outer_next = inner + spokes, inner_next + spokes
    corners = np.stack([inner, outer, outer_next, inner, outer_next, inner_next], axis=-1)
    return corners.reshape(-1).astype(np.uint32)
