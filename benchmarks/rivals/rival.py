"""What the Python rivals share, as rival.h for those in C++: files, the stages after the rays, the orders."""

import json
import sys
import time
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

NO_CELL = -1
MAX_RANGE_M = 300.0
HEATMAPS = 12
ALPHA, DECAY_PER_S, THRESHOLD = 0.1, 0.05, 0.5
POST_POSITIVE = 0.9 * 0.2 / (0.9 * 0.2 + 0.05 * 0.8)  # rates 0.9 and 0.05, prior 0.2
POST_NEGATIVE = 0.1 * 0.2 / (0.1 * 0.2 + 0.95 * 0.8)
LOOK = np.dtype([("cell", "<u4"), ("pixels", "<u4"), ("mean", "<f4"), ("probability", "<f4")])

Cells = NDArray[np.int64]
Points = NDArray[np.float32]


class Rival(Protocol):
    def cells(self, origin: Points, directions: Points, threads: int) -> Cells:
        """The cell that each ray [N, 3] of length 1 meets first, NO_CELL for none."""


class Columns:
    """Voxels column by column, see `Columns` in rival.h."""

    def __init__(self, folder: Path) -> None:
        with (folder / "columns.bin").open("rb") as file:
            self.shape = np.fromfile(file, "<u4", 2).astype(int)
            self.voxel_m = np.fromfile(file, "<f8", 1)[0]
            self.start = np.fromfile(file, "<u4", self.shape.prod() + 1).astype(np.int64)
            self.level = np.fromfile(file, "<i2", self.start[-1])
        self.column = np.repeat(np.arange(self.shape.prod(), dtype=np.int32), np.diff(self.start))
        self.order = self.column * np.int64(1 << 16) + self.level  # of the voxels, ascending

    def cells_at(self, points: Points) -> Cells:
        i, j, k = np.floor(points / self.voxel_m).astype(np.int64).T
        best = self._nearest(i, j, k)
        # A mesh leans its walls over half a cell: there the neighbour with a voxel at this height is meant.
        off = np.flatnonzero(self._off(best, k) > 1)
        for beside in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            cell = self._nearest(i[off] + beside[0], j[off] + beside[1], k[off])
            nearer = self._off(cell, k[off]) < self._off(best[off], k[off])
            best[off[nearer]] = cell[nearer]
        return best

    def _nearest(self, i: Cells, j: Cells, k: Cells) -> Cells:
        inside = (i >= 0) & (j >= 0) & (i < self.shape[0]) & (j < self.shape[1])
        column = np.where(inside, i * self.shape[1] + j, 0)
        first, count = self.start[column], self.start[column + 1] - self.start[column]
        known = inside & (count > 0)
        guess = first + np.clip(k - self.level[first - (count == 0)], 0, np.maximum(count, 1) - 1)
        gap = np.flatnonzero(known & (self.level[guess * known] != k))
        above = np.searchsorted(self.order, column[gap] * (1 << 16) + k[gap])
        above = np.clip(above, first[gap], first[gap] + count[gap] - 1)
        below = np.maximum(above - 1, first[gap])
        is_above_nearer = np.abs(self.level[above] - k[gap]) < np.abs(self.level[below] - k[gap])
        guess[gap] = np.where(is_above_nearer, above, below)
        return np.where(known, guess, NO_CELL)

    def _off(self, cell: Cells, k: Cells) -> Cells:
        return np.where(cell == NO_CELL, 1 << 30, np.abs(self.level[cell] - k))


class Bench:
    def __init__(self, rival: Rival, cell_count: int) -> None:
        self.rival = rival
        self.sums, self.pixels = np.zeros(cell_count, np.float32), np.zeros(cell_count, np.int32)
        self.mark = np.zeros(cell_count, np.int32)
        self.belief = np.zeros(cell_count)
        self.stamp_s = 0.0

    def instant(
        self, pose: NDArray[np.float64], focal_px: float, heatmap: Points, threads: int, step: int
    ) -> dict:
        wall, start = time.perf_counter(), time.process_time()
        rows = np.arange(step // 2, len(heatmap), step)
        directions = _rays(pose, focal_px, heatmap.shape, rows)
        cells = self.rival.cells(pose[:, 3].astype(np.float32), directions, threads)
        traced = time.process_time()
        self._average(cells, heatmap[rows].ravel())
        averaged = time.process_time()
        self._fuse()
        end = time.process_time()
        times = {
            "rays": traced - start,
            "average": averaged - traced,
            "fuse": end - averaged,
            "cpu": end - start,
        }
        times["wall"] = time.perf_counter() - wall
        return {name: 1e3 * seconds for name, seconds in times.items()} | {"touched": len(self.touched)}

    def _average(self, cells: Cells, values: Points) -> None:
        hit = cells != NO_CELL
        cells, values = cells[hit], values[hit]
        np.add.at(self.sums, cells, values)
        np.add.at(self.pixels, cells, 1)
        order = np.arange(len(cells), dtype=np.int32)
        self.mark[cells] = order  # the last pixel of each cell stays: no sorting to find the cells once
        self.touched = cells[self.mark[cells] == order]
        self.count = self.pixels[self.touched]
        self.mean = self.sums[self.touched] / self.count
        self.sums[self.touched] = self.pixels[self.touched] = 0

    def _fuse(self) -> None:
        self.stamp_s += 0.1
        growth = np.exp(DECAY_PER_S * self.stamp_s)
        posterior = np.where(self.mean > THRESHOLD, POST_POSITIVE, POST_NEGATIVE)
        pooled = np.abs(self.mean - 0.5) / 0.5 * posterior
        self.belief[self.touched] = ALPHA * growth * pooled + (1 - ALPHA) * self.belief[self.touched]

    def looks(self) -> NDArray[np.void]:
        looks = np.empty(len(self.touched), LOOK)
        looks["cell"], looks["pixels"], looks["mean"] = self.touched, self.count, self.mean
        looks["probability"] = self.belief[self.touched] / np.exp(DECAY_PER_S * self.stamp_s)
        return looks


def _rays(pose: NDArray[np.float64], focal_px: float, shape: tuple[int, ...], rows: Cells) -> Points:
    x = (np.arange(shape[1]) + 0.5 - shape[1] / 2) / focal_px
    y = (rows + 0.5 - shape[0] / 2) / focal_px
    rays = pose[:, 2] + x[None, :, None] * pose[:, 0] + y[:, None, None] * pose[:, 1]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return rays.reshape(-1, 3).astype(np.float32)


def obey(rival: Rival, folder: Path, cell_count: int, build_s: float) -> None:
    """One order a line, one answer a line, as rival.h; one drone at a time."""
    print(json.dumps({"build_s": build_s}), flush=True)
    bench, shown, heatmaps = Bench(rival, cell_count), None, np.empty(0)
    for line in sys.stdin:
        order, _, name, *others = line.split()
        width, height, *others = others
        shape = (HEATMAPS, int(height), int(width))
        if shown != shape:
            path = folder.parent / f"heatmaps-{width}x{height}.bin"
            heatmaps = np.fromfile(path, np.uint8).reshape(shape).astype(np.float32) / np.float32(255.0)
            shown = shape
        with (folder / f"{name}.bin").open("rb") as file:
            count, focal_px = np.fromfile(file, "<u4", 1)[0], np.fromfile(file, "<f8", 1)[0] * int(width)
            poses = np.fromfile(file, "<f8").reshape(count, 3, 4)
        if order == "dump":
            view, fresh = int(others[0]), Bench(rival, cell_count)
            fresh.instant(poses[view], focal_px, heatmaps[view % HEATMAPS], 1, 1)
            fresh.looks().tofile(others[1])
            print("{}", flush=True)
        else:
            _, threads, step, instants = map(int, others)
            views = [(poses[at], focal_px, heatmaps[at % HEATMAPS]) for at in range(instants)]
            print(json.dumps([bench.instant(*view, threads, step) for view in views]), flush=True)
