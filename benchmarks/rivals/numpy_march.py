"""The naive start: all rays step half a voxel at a time through an array of voxels, until they are in one."""

import sys
import time
from pathlib import Path

import numpy as np
from rival import MAX_RANGE_M, NO_CELL, Cells, Columns, Points, obey


class Occupancy:
    def __init__(self, columns: Columns) -> None:
        self.columns = columns
        self.lowest = int(columns.level.min())
        layers = int(columns.level.max()) - self.lowest + 1
        self.occupied = np.zeros((*columns.shape, layers), bool)
        i, j = columns.column // columns.shape[1], columns.column % columns.shape[1]
        self.occupied[i, j, columns.level - self.lowest] = True

    def cells(self, origin: Points, directions: Points, threads: int) -> Cells:
        """Inexact: a step may pass the corner of a voxel."""
        cells = np.full(len(directions), NO_CELL)
        voxel_m, shape = self.columns.voxel_m, self.occupied.shape
        at = np.tile(origin / voxel_m - np.array([0, 0, self.lowest], np.float32), (len(directions), 1))
        steps, rays = 0.5 * directions, np.arange(len(directions))
        for _ in range(round(2 * MAX_RANGE_M / voxel_m)):
            at += steps
            i, j, k = np.floor(at).astype(np.int32).T
            coming = (i >= 0) & (j >= 0) & (k >= 0) & (i < shape[0]) & (j < shape[1])
            inside = np.flatnonzero(coming & (k < shape[2]))
            hit = inside[self.occupied[i[inside], j[inside], k[inside]]]
            index = np.stack([i[hit], j[hit], k[hit] + self.lowest], axis=1)
            cells[rays[hit]] = self.columns.cells_at((index + 0.5) * voxel_m)
            coming[hit] = False
            at, steps, rays = at[coming], steps[coming], rays[coming]
            if len(rays) == 0:
                break
        return cells


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    columns = Columns(folder)
    start = time.perf_counter()
    rival = Occupancy(columns)
    obey(rival, folder, len(columns.level), time.perf_counter() - start)
