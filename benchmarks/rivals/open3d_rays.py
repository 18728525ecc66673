"""Open3D's RaycastingScene: the triangles of embree.cpp, from Python."""

import sys
import time
from pathlib import Path

import numpy as np
import open3d as o3d
from rival import MAX_RANGE_M, NO_CELL, Cells, Columns, Points, obey


class Open3d:
    def __init__(self, folder: Path, columns: Columns) -> None:
        self.columns = columns
        with (folder / "scene.bin").open("rb") as file:
            shape, cell_size_m = np.fromfile(file, "<u4", 2), np.fromfile(file, "<f8", 1)[0]
            vertices, triangles = np.fromfile(file, "<u8", 2)
            height_m = np.fromfile(file, "<f4", shape.prod()).reshape(shape)
            above = (np.fromfile(file, "<f4", 3 * vertices), np.fromfile(file, "<u4", 3 * triangles))
        self.scenes: dict[int, o3d.t.geometry.RaycastingScene] = {}
        self.meshes = [_ground(height_m, cell_size_m)]
        if triangles:
            self.meshes.append((above[0].reshape(-1, 3), above[1].reshape(-1, 3)))
        self._scene(1)

    def _scene(self, threads: int) -> o3d.t.geometry.RaycastingScene:
        if threads not in self.scenes:
            self.scenes[threads] = o3d.t.geometry.RaycastingScene(nthreads=threads)
            for mesh in self.meshes:
                self.scenes[threads].add_triangles(
                    *(o3d.core.Tensor(np.ascontiguousarray(part)) for part in mesh)
                )
            self.scenes[threads].cast_rays(o3d.core.Tensor(np.ones((1, 6), np.float32)))  # builds it
        return self.scenes[threads]

    def cells(self, origin: Points, directions: Points, threads: int) -> Cells:
        rays = np.hstack([np.broadcast_to(origin, directions.shape), directions])
        answer = self._scene(threads).cast_rays(o3d.core.Tensor(rays), nthreads=threads)
        distance = answer["t_hit"].numpy()
        cells = np.full(len(directions), NO_CELL)
        hit = distance <= MAX_RANGE_M
        cells[hit] = self.columns.cells_at(origin + distance[hit, None] * directions[hit])
        return cells


def _ground(height_m: Points, cell_size_m: float) -> tuple[Points, np.ndarray]:
    columns, rows = height_m.shape
    east, north = np.indices(height_m.shape, np.float32)
    vertices = np.stack([(east + 0.5) * cell_size_m, (north + 0.5) * cell_size_m, height_m], axis=-1)
    at = np.arange(columns * rows, dtype=np.uint32).reshape(columns, rows)[:-1, :-1].ravel()
    triangles = np.concatenate(
        [np.stack([at, at + rows, at + rows + 1], 1), np.stack([at, at + rows + 1, at + 1], 1)]
    )
    known = np.isfinite(height_m.ravel())
    vertices = np.nan_to_num(vertices.reshape(-1, 3).astype(np.float32))
    return vertices, triangles[known[triangles].all(axis=1)]


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    columns = Columns(folder)
    start = time.perf_counter()
    rival = Open3d(folder, columns)
    obey(rival, folder, len(columns.level), time.perf_counter() - start)
