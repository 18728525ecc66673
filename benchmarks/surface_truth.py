"""Perfect heatmaps of unseen simulated races: how much of a crowd's ground does one view find?

A heatmap is perfect when a pixel is 1 where the ray through its centre meets the ground of a crowd, else 0:
on the simulator's own triangles, with people and trees taken away, since no map knows those. What a view
makes of it is compared with the ground of the crowds (`truth/crowd_ground.py`), over the columns of the map
whose surface point, at the column's centre, the camera has in its image, in range and in sight. A column is
called crowd when the mean of a voxel at its ground is above 0.5. Counts of all views are added up before the
ratio.

The rows `exact` are what a faultless back-projection reaches at this size of pixels and columns: `exact rays`
averages in every column the pixels that meet it, `exact full` gives the others in view the pixel that shows
their centre, and `exact centre` gives that to all of them.
"""

import argparse
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from exact_ground import Array, ExactGround
from numpy.typing import NDArray
from projections import projections
from scene import machine

from crowdfence import Camera, Observation, Terrain, View, project
from crowdfence.simulation.recording.terrain_files import known_terrain, top_height_m
from crowdfence.simulation.scenarios.scenario_file import load_scenario
from crowdfence.simulation.scene import Scene, build_scene
from crowdfence.truth.crowd_ground import CrowdGround, crowd_grounds

SEEDS = (9001, 9002, 9003)
TILT_EDGES_DEG = (0.0, 10.0, 15.0, 20.0, 30.0, 90.0)
RANGE_EDGES_M = (0.0, 150.0, 300.0)
MAX_RANGE_M = RANGE_EDGES_M[-1]
TILTS, BINS = len(TILT_EDGES_DEG) - 1, (len(TILT_EDGES_DEG) - 1) * (len(RANGE_EDGES_M) - 1)
EXACT = ("exact rays", "exact full", "exact centre")
CROWD_ABOVE = 0.5
AROUND_CROWDS_M = 15.0
"""Columns that far around a crowd are looked at, and farther ones where they are called crowd."""
SAMPLED_EVERY = 7
"""Completeness is measured on every 7th column in either direction."""

_GROUND_PIXEL_M = 0.125
_AT_GROUND_M = 1.5  # a voxel farther above or below the ground is another place
_COLUMN = np.int64(1) << 31

Keys = NDArray[np.int64]
Mask = NDArray[np.bool_]


def _no_columns() -> NDArray[np.int64]:
    return np.zeros(BINS, np.int64)


@dataclass
class Score:
    """Columns by range and tilt."""

    both: NDArray[np.int64] = field(default_factory=_no_columns)
    either: NDArray[np.int64] = field(default_factory=_no_columns)
    seen: NDArray[np.int64] = field(default_factory=_no_columns)
    """Of the sampled columns."""
    out_of_view: int = 0
    """Called crowd, but not in view."""


@dataclass(frozen=True)
class Look:
    """One camera over one scene."""

    camera: Camera
    pose: Array
    ground: ExactGround

    def hits(self) -> tuple[Array, Mask]:
        """Where the rays of the pixels meet something [H * W, 3], and whether that is ground in range."""
        v, u = np.indices((self.camera.height, self.camera.width)) + 0.5
        rays = self.camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1)) @ self.pose[:3, :3].T
        t, is_ground = self.ground.meet(self.pose[:3, 3], rays)
        near = is_ground & (t * np.linalg.norm(rays, axis=1) <= MAX_RANGE_M)
        return self.pose[:3, 3] + np.where(near, t, 0.0)[:, None] * rays, near

    def pixels(self, points: Array) -> tuple[Keys, Mask]:
        """Flat index [N] of the pixel that shows points [N, 3], and whether they are in the image and in
        range; something may hide them."""
        in_camera = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        before = in_camera[:, 2] > 0.0
        column, row = np.full((2, len(points)), -1, np.int64)
        column[before], row[before] = np.floor(self.camera.project(in_camera[before])).astype(np.int64).T
        inside = (column >= 0) & (row >= 0) & (column < self.camera.width) & (row < self.camera.height)
        inside &= np.linalg.norm(in_camera, axis=1) <= MAX_RANGE_M
        return np.where(inside, row * self.camera.width + column, 0), inside

    def in_view(self, points: Array) -> Mask:
        """Whether points [N, 3] of the ground are in the image, in range and in sight."""
        _, seen = self.pixels(points)
        seen[seen] = self.ground.in_sight(self.pose[:3, 3], points[seen])
        return seen

    def bins(self, points: Array) -> Keys:
        """Bin [N] of range and tilt of the lines of sight; -1 above the horizon and out of range."""
        line = points - self.pose[:3, 3]
        level_m, range_m = np.linalg.norm(line[:, :2], axis=1), np.linalg.norm(line, axis=1)
        tilt = np.searchsorted(TILT_EDGES_DEG, np.degrees(np.arctan2(-line[:, 2], level_m)), side="right") - 1
        reach = np.searchsorted(RANGE_EDGES_M, range_m) - 1
        return np.where((tilt >= 0) & (range_m <= MAX_RANGE_M), reach * TILTS + tilt, -1)


@dataclass(frozen=True)
class Columns:
    """The columns of a terrain, each by one number."""

    terrain: Terrain
    ground: ExactGround

    def at(self, xy: Array) -> Keys:
        """Columns [N] that points [N, 2] lie in."""
        i, j = np.floor((xy - self._corner) / self.terrain.voxel_size_m).astype(np.int64).T
        return i * _COLUMN + j

    def surface(self, keys: Keys) -> Array:
        """Points [N, 3] of the ground at the columns' centres."""
        i = (keys + _COLUMN // 2) // _COLUMN
        xy = self._corner + (np.column_stack([i, keys - i * _COLUMN]) + 0.5) * self.terrain.voxel_size_m
        return np.column_stack([xy, self.ground.height_m(xy)])

    def of_voxels(self, ids: Keys) -> Keys:
        """Columns whose ground the voxels `ids` [N] are, sorted and unique."""
        centers = self.terrain.voxel_centers(ids)
        at_ground = np.abs(centers[:, 2] - self.ground.height_m(centers[:, :2])) <= _AT_GROUND_M
        return np.unique(self.at(centers[at_ground, :2]))

    def between(self, low: Array, high: Array, every: int = 1) -> Keys:
        """Every `every`-th column of a rectangle."""
        x, y = (np.arange(low[axis], high[axis], every * self.terrain.voxel_size_m) for axis in (0, 1))
        return self.at(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2))

    @property
    def _corner(self) -> Array:
        return np.asarray(self.terrain.origin)[:2]


class Benchmark:
    """Scores by the way a view is projected."""

    def __init__(self, projections: dict[str, dict[str, Any]]) -> None:
        self._projections = projections
        self.scores = {name: Score() for name in (*self._projections, *EXACT)}
        self.truth, self.sampled = _no_columns(), _no_columns()
        self.project_s = dict.fromkeys(self._projections, 0.0)
        self.views = 0

    def look(self, look: Look, columns: Columns, crowds: list[CrowdGround]) -> None:
        """Add one view."""
        self.views += 1
        met, is_met = look.hits()
        heat = np.zeros(len(met), np.bool_)
        heat[is_met] = _on_crowd(crowds, met[is_met])
        hit = columns.at(met[is_met, :2])
        observations = {name: self._observe(name, look, columns.terrain, heat) for name in self._projections}
        crowd_ids = {name: seen.voxel_ids[seen.mean > CROWD_ABOVE] for name, seen in observations.items()}
        called = {name: columns.of_voxels(ids) for name, ids in crowd_ids.items()}

        around = [columns.between(one.low - AROUND_CROWDS_M, one.high + AROUND_CROWDS_M) for one in crowds]
        keys = np.unique(np.concatenate([*around, *called.values()]))
        points = columns.surface(keys)
        in_view = look.in_view(points)
        at_centre = in_view & heat[look.pixels(points)[0]]
        says = {name: np.isin(keys, called[name]) for name in called}
        says |= zip(EXACT, _exact(hit, heat[is_met], keys, at_centre), strict=True)
        self._compare(says, _on_crowd(crowds, points), in_view, look.bins(points))

        seen = {name: columns.of_voxels(of.voxel_ids) for name, of in observations.items()}
        self._sample(look, columns, seen | {"exact rays": hit})

    def _observe(self, name: str, look: Look, terrain: Terrain, heat: Mask) -> Observation:
        heatmap = heat.reshape(look.camera.height, look.camera.width).astype(np.uint8) * np.uint8(255)
        view = View("drone", 0, look.camera, look.pose, heatmap)
        start = time.process_time()
        observation = project(view, terrain, max_range_m=MAX_RANGE_M, **self._projections[name])
        self.project_s[name] += time.process_time() - start
        return observation

    def _compare(self, says: dict[str, Mask], truth: Mask, in_view: Mask, bins: Keys) -> None:
        scored = in_view & (bins >= 0)
        self.truth += _counts(bins, truth & scored)
        for name, says_crowd in says.items():
            score = self.scores[name]
            score.both += _counts(bins, says_crowd & truth & scored)
            score.either += _counts(bins, (says_crowd | truth) & scored)
            score.out_of_view += int(np.count_nonzero(says_crowd & ~in_view))

    def _sample(self, look: Look, columns: Columns, seen: dict[str, Keys]) -> None:
        """Completeness, on columns spread over the range."""
        centre = look.pose[:2, 3]
        keys = columns.between(centre - MAX_RANGE_M, centre + MAX_RANGE_M, SAMPLED_EVERY)
        points = columns.surface(keys)
        bins = look.bins(points)
        in_view = look.in_view(points) & (bins >= 0)
        self.sampled += _counts(bins, in_view)
        for name, columns_seen in seen.items():
            self.scores[name].seen += _counts(bins, in_view & np.isin(keys, columns_seen))


def _exact(hit: Keys, on_crowd: Mask, keys: Keys, at_centre: Mask) -> tuple[Mask, Mask, Mask]:
    """Whether columns `keys` are called crowd by back-projections without fault, in the order of `EXACT`.
    Each pixel meets a column of `hit` and is crowd or not; `at_centre`: what the pixel shows that shows the
    column's centre."""
    met, column = np.unique(hit, return_inverse=True)
    mean = np.bincount(column, on_crowd, len(met)) / np.bincount(column, minlength=len(met))
    place = np.searchsorted(met, keys).clip(max=len(met) - 1)
    is_met = met[place] == keys
    by_rays = is_met & (mean[place] > CROWD_ABOVE)
    return by_rays, np.where(is_met, by_rays, at_centre), at_centre


def _on_crowd(crowds: list[CrowdGround], points: Array) -> Mask:
    """Whether points [N, 3] of the ground lie on that of a crowd."""
    on_crowd = np.zeros(len(points), np.bool_)
    for crowd in crowds:
        on_crowd |= crowd.contains(points[:, :2])
    return on_crowd


def _counts(bins: Keys, chosen: Mask) -> NDArray[np.int64]:
    return np.bincount(bins[chosen], minlength=BINS).astype(np.int64)


def looks(scene: Scene, instants: int) -> Iterator[tuple[Look, list[CrowdGround]]]:
    """Every drone's look at `instants` moments spread over the mission."""
    scenario, ground = scene.scenario, ExactGround(scene.landscape)
    definition = scenario.crowd_definition
    for t_s in (np.arange(instants) + 0.5) / instants * scenario.duration_s:
        crowds = list(
            crowd_grounds(
                scene.people.positions(t_s),
                definition.radius_m,
                definition.min_people,
                pixel_m=_GROUND_PIXEL_M,
            )
        )
        for drone in range(scenario.drones):
            pose = scene.flight.at(drone, t_s).world_from_camera
            yield Look(scenario.intrinsics(), pose, ground), crowds


def _of_heights(scene: Scene) -> Terrain:
    """A height map of the scenario's voxels, like the raster of a simulated mission."""
    size_m, (west, south, east, north) = scene.scenario.voxel_size_m, scene.landscape.extent_m
    x = np.arange(west + size_m / 2, east, size_m)
    y = np.arange(south + size_m / 2, north, size_m)
    at = (side.ravel() for side in np.meshgrid(x, y, indexing="ij"))
    height_m = top_height_m(scene.landscape, *at).reshape(len(x), len(y))
    return Terrain.from_height_map(height_m, size_m, origin=(west, south, 0.0))


def _of_voxels(scene: Scene) -> Terrain:
    """Voxels alone, as an OctoMap holds them."""
    terrain = known_terrain(scene)
    indices = terrain.voxel_indices(np.arange(terrain.voxel_count))
    return Terrain.from_indices(indices, terrain.voxel_size_m, terrain.origin)


MAPS = {"triangles": known_terrain, "heights": _of_heights, "voxels": _of_voxels}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="race")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--map", choices=MAPS, default="triangles", help="what the terrain is built from")
    parser.add_argument("--instants", type=int, default=8, help="moments of each race, seen by all drones")
    options = parser.parse_args()

    benchmark = Benchmark(projections())
    for seed in options.seeds:
        scene = build_scene(load_scenario(options.scenario), seed)
        terrain = MAPS[options.map](scene)
        for look, crowds in looks(scene, options.instants):
            benchmark.look(look, Columns(terrain, look.ground), crowds)
    print(f"{benchmark.views} views of {options.scenario}, seeds {options.seeds}, map of {options.map}")
    print(f"{machine()}, load {os.getloadavg()[0]:.1f}\n")
    report(benchmark, terrain.voxel_size_m**2)


def report(benchmark: Benchmark, column_m2: float) -> None:
    for ranges in range(1, len(RANGE_EDGES_M)):
        print(f"columns up to {RANGE_EDGES_M[ranges]:g} m away\n")
        _table(benchmark, ranges)
        print()
    print("| | called crowd out of view | project, CPU a view |\n|---|---|---|")
    for name, score in benchmark.scores.items():
        seconds = benchmark.project_s.get(name)
        time_a_view = "" if seconds is None else f"{1e3 * seconds / benchmark.views:.0f} ms"
        print(f"| {name} | {score.out_of_view * column_m2:.0f} m2 | {time_a_view} |")


def _table(benchmark: Benchmark, ranges: int) -> None:
    """Over the first so many ranges."""

    def by_tilt(counts: NDArray[np.int64]) -> NDArray[np.int64]:
        return counts.reshape(-1, TILTS)[:ranges].sum(axis=0)

    def shares(some: NDArray[np.int64], of: NDArray[np.int64]) -> str:
        return " | ".join(f"{share:.3f}" for share in by_tilt(some) / np.maximum(by_tilt(of), 1))

    tilts = [f"{low:g}-{high:g}" for low, high in pairwise(TILT_EDGES_DEG)]
    print(f"| tilt, degrees | {' | '.join(tilts)} |\n|---{'|---' * TILTS}|")
    for name, score in benchmark.scores.items():
        print(f"| IoU, {name} | {shares(score.both, score.either)} |")
    for name, score in benchmark.scores.items():
        if score.seen.any():
            print(f"| seen of what is in view, {name} | {shares(score.seen, benchmark.sampled)} |")
    print(f"| crowd columns in view | {' | '.join(str(count) for count in by_tilt(benchmark.truth))} |")


if __name__ == "__main__":
    main()
