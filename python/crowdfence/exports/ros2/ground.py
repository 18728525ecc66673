"""The ground: what is known of every cell as points, the terrain as a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.exports.colours import state_colours
from crowdfence.exports.ros2.zone_markers import ADD, TRIANGLE_LIST, HeightAt, points
from crowdfence.sources.mission.layout import MAP_FRAME
from crowdfence.sources.mission.ros2_messages import header
from crowdfence.surface_grid import SurfaceGrid

MOST_QUADS = 20_000
"""Of the mesh: finer terrain is shown coarser, because it stands for the eye only."""

_UINT8, _FLOAT32 = 2, 7
_POINT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("rgb", "<u4"),
        ("probability", "<f4"),
        ("state", "u1"),
    ]
)
_KINDS = {"state": _UINT8}
_LIGHT = np.array([-0.4, 0.4, 0.82])
"""From the north-west, as on maps."""
_EARTH_COLOUR = np.array([0.62, 0.60, 0.55])


def height_at(grid: SurfaceGrid) -> HeightAt:
    """Top of the ground at any place; beyond the map, and in its holes, the middle of what is there."""
    top_m = grid.top_m
    middle_m = float(np.nanmedian(top_m))

    def at(places: NDArray[np.float64]) -> NDArray[np.float64]:
        west, south, _, _ = grid.bounds_m
        cell = np.floor((places - (west, south)) / grid.cell_size_m).astype(np.int64)
        inside = ((cell >= 0) & (cell < grid.shape)).all(axis=1)
        clipped = cell.clip(0, np.array(grid.shape) - 1)
        found = top_m[clipped[:, 0], clipped[:, 1]]
        return np.where(inside & ~np.isnan(found), found, middle_m)

    return at


def ground_cloud(grid: SurfaceGrid, threshold: float, stamp_ns: int) -> dict[str, Any]:
    """sensor_msgs/PointCloud2: the top of every cell with terrain; P is NaN where nobody has looked."""
    i, j = np.nonzero(grid.has_surface)
    table = np.zeros(len(i), _POINT)
    table["x"] = (grid.east_edges_m[i] + grid.east_edges_m[i + 1]) / 2
    table["y"] = (grid.north_edges_m[j] + grid.north_edges_m[j + 1]) / 2
    table["z"] = grid.top_m[i, j]
    red, green, blue = state_colours(grid.probability[i, j], grid.state[i, j], threshold).astype(np.uint32).T
    table["rgb"] = red << 16 | green << 8 | blue
    table["probability"], table["state"] = grid.probability[i, j], grid.state[i, j]
    fields = [
        # Viewers expect a packed colour under the type of a float.
        {"name": name, "offset": _POINT.fields[name][1], "datatype": _KINDS.get(name, _FLOAT32), "count": 1}
        for name in _POINT.names or ()
        if _POINT.fields is not None
    ]
    return {
        "header": header(stamp_ns, MAP_FRAME),
        "height": 1,
        "width": len(table),
        "fields": fields,
        "is_bigendian": False,
        "point_step": table.itemsize,
        "row_step": table.nbytes,
        "data": table.tobytes(),
        "is_dense": False,
    }


def terrain_mesh(grid: SurfaceGrid, stamp_ns: int) -> dict[str, Any]:
    """visualization_msgs/MarkerArray of one mesh, in the light of a map."""
    x, y, z = _lattice(grid)
    corners = np.stack([*np.meshgrid(x, y, indexing="ij"), z], axis=-1)
    a, b, c, d = corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, 3)
    triangles = triangles[~np.isnan(triangles).any(axis=(1, 2))]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    shade = (0.35 + 0.65 * np.clip(normal @ _LIGHT, 0.0, 1.0))[:, None] * _EARTH_COLOUR
    colours = np.repeat(shade, 3, axis=0).tolist()
    marker = {
        "header": header(stamp_ns, MAP_FRAME),
        "ns": "terrain",
        "type": TRIANGLE_LIST,
        "action": ADD,
        "pose": {"position": {}, "orientation": {"w": 1.0}},
        "scale": {"x": 1.0, "y": 1.0, "z": 1.0},
        "color": {"r": 1.0, "g": 1.0, "b": 1.0, "a": 1.0},
        "points": points(triangles.reshape(-1, 3)),
        "colors": [{"r": red, "g": green, "b": blue, "a": 1.0} for red, green, blue in colours],
    }
    return {"markers": [marker]}


def _lattice(grid: SurfaceGrid) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Places x [X], y [Y] and mean heights [X, Y] of blocks of cells, NaN without terrain."""
    side = max(1, int(np.ceil(np.sqrt(grid.shape[0] * grid.shape[1] / MOST_QUADS))))
    whole = tuple(-(-length // side) * side for length in grid.shape)
    padded = np.full(whole, np.nan)
    padded[: grid.shape[0], : grid.shape[1]] = grid.top_m
    blocks = padded.reshape(whole[0] // side, side, whole[1] // side, side)
    known = (~np.isnan(blocks)).sum(axis=(1, 3))
    heights = np.where(known > 0, np.nansum(blocks, axis=(1, 3)) / np.maximum(known, 1), np.nan)
    west, south, _, _ = grid.bounds_m
    east_m, north_m = (
        (np.arange(count, dtype=np.float64) + 0.5) * side * grid.cell_size_m for count in heights.shape
    )
    return west + east_m, south + north_m, np.asarray(heights, dtype=np.float64)
