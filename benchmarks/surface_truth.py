"""Perfect heatmaps of simulated races that nothing was tuned to: how much of the crowds' ground one view finds.

A heatmap is perfect when a pixel is 1 where the ray through its centre meets the ground of a crowd, else 0:
on the simulator's own triangles, with people and trees taken away, since no map knows those. What a view makes
of it is compared with the ground of the crowds (`truth/crowd_ground.py`), over the columns of the map whose
surface point, at the column's centre, the camera has in its image, in range and in sight. A column is called
crowd when the mean of a voxel at its ground is above 0.5.

The rows `exact` are what a faultless back-projection would reach at this size of pixels and columns:
`exact rays` averages in every column the pixels that meet it, `exact full` gives the others in view the pixel
that shows their centre, and `exact centre` gives that to all of them.
"""

import argparse
import inspect
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from exact_ground import Array, ExactGround
from numpy.typing import NDArray
from scene import machine

from crowdfence import Camera, Terrain, View, project
from crowdfence.simulation.recording.terrain_files import known_terrain
from crowdfence.simulation.scenarios.scenario_file import load_scenario
from crowdfence.simulation.scene import Scene, build_scene
from crowdfence.truth.crowd_ground import CrowdGround, crowd_grounds

SEEDS = (9001, 9002, 9003)
TILT_EDGES_DEG = (0.0, 10.0, 15.0, 20.0, 30.0, 90.0)
BINS = len(TILT_EDGES_DEG) - 1
MAX_RANGE_M = 300.0
CROWD_ABOVE = 0.5
AROUND_CROWDS_M = 15.0
"""Columns that far around a crowd are looked at, and farther ones where they are called crowd."""
SAMPLED_EVERY = 7
"""Completeness is measured on every so manieth column in either direction."""

_GROUND_PIXEL_M = 0.125
_AT_GROUND_M = 1.5  # a voxel farther above or below the ground is another place
_COLUMN = np.int64(1) << 31

Keys = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass
class Score:
    """Columns by tilt."""

    both: NDArray[np.int64]
    either: NDArray[np.int64]
    sampled_seen: NDArray[np.int64]
    hidden: int = 0
    """Called crowd, but not in view."""

    @staticmethod
    def empty() -> "Score":
        return Score(*(np.zeros(BINS, np.int64) for _ in range(3)))


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

    def tilt_bin(self, points: Array) -> Keys:
        """Bin [N] of the line of sight; -1 above the horizon."""
        line = points - self.pose[:3, 3]
        tilt_deg = np.degrees(np.arctan2(-line[:, 2], np.linalg.norm(line[:, :2], axis=1)))
        return np.searchsorted(TILT_EDGES_DEG, tilt_deg, side="right") - 1


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
        x, y = (
            np.arange(low[axis], high[axis], every * self.terrain.voxel_size_m) for axis in (0, 1)
        )
        return self.at(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2))

    @property
    def _corner(self) -> Array:
        return np.asarray(self.terrain.origin)[:2]


class Benchmark:
    """Scores by the way a view is projected."""

    def __init__(self, projections: list[dict[str, str]]) -> None:
        self._projections = {" ".join(projection.values()): projection for projection in projections}
        self.scores = {name: Score.empty() for name in (*self._projections, *EXACT)}
        self.truth, self.sampled = np.zeros(BINS, np.int64), np.zeros(BINS, np.int64)
        self.project_s = dict.fromkeys(self._projections, 0.0)
        self.views = 0

    def look(self, look: Look, columns: Columns, crowds: list[CrowdGround]) -> None:
        """Add one view."""
        self.views += 1
        hits, near = look.hits()
        heat = np.zeros(len(hits), np.bool_)
        heat[near] = _on_crowd(crowds, hits[near])
        seen, called = {}, {}
        for name, projection in self._projections.items():
            seen[name], called[name] = self._projected(name, projection, look, columns, heat)
        around = [columns.between(one.low - AROUND_CROWDS_M, one.high + AROUND_CROWDS_M) for one in crowds]
        keys = np.unique(np.concatenate([*around, *called.values()]))
        points = columns.surface(keys)
        in_view, tilt_bin = look.in_view(points), look.tilt_bin(points)
        truth, in_view = _on_crowd(crowds, points), in_view & (tilt_bin >= 0)
        self.truth += _counts(tilt_bin, truth & in_view)
        masks = {name: np.isin(keys, called[name]) for name in called}
        masks |= dict(zip(EXACT, _exact(look, columns, keys, points, hits[near], near, heat), strict=True))
        for name, mask in masks.items():
            score = self.scores[name]
            score.both += _counts(tilt_bin, mask & truth & in_view)
            score.either += _counts(tilt_bin, (mask | truth) & in_view)
            score.hidden += int(np.count_nonzero(mask & ~in_view))
        self._sample(look, columns, seen)

    def _projected(
        self, name: str, projection: dict[str, str], look: Look, columns: Columns, heat: Mask
    ) -> tuple[Keys, Keys]:
        """Columns seen, and columns called crowd."""
        heatmap = heat.reshape(look.camera.height, look.camera.width).astype(np.uint8) * np.uint8(255)
        view = View("drone", 0, look.camera, look.pose, heatmap)
        start = time.process_time()
        observation = project(view, columns.terrain, max_range_m=MAX_RANGE_M, **projection)
        self.project_s[name] += time.process_time() - start
        ids = observation.voxel_ids
        return columns.of_voxels(ids), columns.of_voxels(ids[observation.mean > CROWD_ABOVE])

    def _sample(self, look: Look, columns: Columns, seen: dict[str, Keys]) -> None:
        """Completeness, on columns spread over the range."""
        centre = look.pose[:2, 3]
        keys = columns.between(centre - MAX_RANGE_M, centre + MAX_RANGE_M, SAMPLED_EVERY)
        points = columns.surface(keys)
        tilt_bin = look.tilt_bin(points)
        in_view = look.in_view(points) & (tilt_bin >= 0)
        self.sampled += _counts(tilt_bin, in_view)
        for name in seen:
            self.scores[name].sampled_seen += _counts(tilt_bin, in_view & np.isin(keys, seen[name]))


EXACT = ("exact rays", "exact full", "exact centre")


def _exact(
    look: Look, columns: Columns, keys: Keys, points: Array, hits: Array, near: Mask, heat: Mask
) -> tuple[Mask, Mask, Mask]:
    """Columns called crowd by back-projections without fault, in the order of `EXACT`."""
    hit, column = np.unique(columns.at(hits[:, :2]), return_inverse=True)
    mean = np.bincount(column, heat[near], len(hit)) / np.bincount(column, minlength=len(hit))
    place = np.searchsorted(hit, keys).clip(max=len(hit) - 1)
    is_hit = hit[place] == keys
    by_rays = is_hit & (mean[place] > CROWD_ABOVE)
    pixel, _ = look.pixels(points)
    in_view = look.in_view(points)
    by_centre = in_view & heat[pixel]
    return by_rays, np.where(is_hit, by_rays, by_centre), by_centre


def _on_crowd(crowds: list[CrowdGround], points: Array) -> Mask:
    """Whether points [N, 3] of the ground lie on that of a crowd."""
    on_crowd = np.zeros(len(points), np.bool_)
    for crowd in crowds:
        on_crowd |= crowd.contains(points[:, :2])
    return on_crowd


def _counts(tilt_bin: Keys, chosen: Mask) -> NDArray[np.int64]:
    return np.bincount(tilt_bin[chosen], minlength=BINS).astype(np.int64)


def looks(scene: Scene, instants: int) -> Iterator[tuple[Look, list[CrowdGround]]]:
    """Every drone's look at `instants` moments spread over the mission."""
    scenario, ground = scene.scenario, ExactGround(scene.landscape)
    definition = scenario.crowd_definition
    for t_s in (np.arange(instants) + 0.5) / instants * scenario.duration_s:
        crowds = list(
            crowd_grounds(
                scene.people.positions(t_s), definition.radius_m, definition.min_people, pixel_m=_GROUND_PIXEL_M
            )
        )
        for drone in range(scenario.drones):
            pose = scene.flight.at(drone, t_s).world_from_camera
            yield Look(scenario.intrinsics(), pose, ground), crowds


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="race")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--instants", type=int, default=8, help="moments of each race, seen by all drones")
    options = parser.parse_args()

    benchmark = Benchmark(projections())
    for seed in options.seeds:
        scene = build_scene(load_scenario(options.scenario), seed)
        terrain = known_terrain(scene)
        for look, crowds in looks(scene, options.instants):
            benchmark.look(look, Columns(terrain, look.ground), crowds)
    print(f"{benchmark.views} views of {options.scenario}, seeds {options.seeds}; {machine()}\n")
    report(benchmark, terrain.voxel_size_m**2)


def projections() -> list[dict[str, str]]:
    """Arguments of `project`, a row of the table each."""
    coverages = [{"coverage": "rays"}, {"coverage": "full"}]
    if "surface" not in inspect.signature(project).parameters:
        return coverages
    return [{"surface": surface, **coverage} for surface in ("voxels", "true") for coverage in coverages]


def report(benchmark: Benchmark, column_m2: float) -> None:
    tilts = [f"{low:g}-{high:g}" for low, high in zip(TILT_EDGES_DEG, TILT_EDGES_DEG[1:], strict=False)]
    print(f"| tilt | {' | '.join(tilts)} | called out of view |\n|---{'|---' * (BINS + 1)}|")
    for name, score in benchmark.scores.items():
        iou = score.both / np.maximum(score.either, 1)
        print(f"| IoU, {name} | {_row(iou)} | {score.hidden * column_m2:.0f} m2 |")
    print(f"| crowd columns in view | {' | '.join(str(count) for count in benchmark.truth)} | |")
    for name, score in benchmark.scores.items():
        if name not in EXACT:
            print(f"| seen of those in view, {name} | {_row(score.sampled_seen / benchmark.sampled)} | |")
    print()
    for name, seconds in benchmark.project_s.items():
        print(f"project, {name}: {1e3 * seconds / benchmark.views:.0f} ms of CPU a view")


def _row(values: Array) -> str:
    return " | ".join(f"{value:.3f}" for value in values)


if __name__ == "__main__":
    main()
