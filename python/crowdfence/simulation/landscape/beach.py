"""A sandy beach: sea in the south, dunes and a promenade in the north."""

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.furnishing import CLOTH_COLOURS, Furnishing
from crowdfence.simulation.landscape.greenery import (
    plant_bushes,
    plant_trees,
    stand_look_alikes,
    strew_rocks,
)
from crowdfence.simulation.landscape.ground import Ground, cover_weights
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.landscape.noise import closed, fractal_noise, smooth_step
from crowdfence.simulation.landscape.road import CentreLine, Road
from crowdfence.simulation.landscape.scatter import scatter
from crowdfence.simulation.landscape.surface_lattice import square_lattice
from crowdfence.simulation.scenarios.plans import LandscapePlan

SHORE_NORTH_M = -40.0
SAND_WIDTH_M = 85.0
PROMENADE_M = 105.0  # north of the waterline
HALF_WIDTH_M = 3.0

Array = NDArray[np.float64]


def build_beach(plan: LandscapePlan, seed: int) -> Landscape:
    """Waterline from west to east; the drawn sea is flat at height 0 and part of the ground."""
    rng = np.random.default_rng([seed, 131])
    phase = rng.uniform(0, 2 * np.pi, 2)
    surface = _ground(plan, phase, rng)
    things = Furnishing(surface, np.random.default_rng([seed, 132]))
    promenade = _line(surface, phase, PROMENADE_M)
    road = Road(promenade, HALF_WIDTH_M, surface.height_at, marked=False) if plan.road else None
    _furnish(plan, surface, phase, things)
    shore = _line(surface, phase, 0.0, west_m=-200.0)
    places = {
        name: np.stack([line.x_m, line.y_m, surface.height_at(line.x_m, line.y_m)], axis=-1)[::5]
        for name, line in (("shore", shore), ("promenade", promenade))
    }
    return Landscape(surface, road, (), tuple(things.props), places, things.obstacles)


def _shore_north(x: Array, phase: Array) -> Array:
    return np.asarray(SHORE_NORTH_M + 9.0 * np.sin(x / 95.0 + phase[0]) + 3.5 * np.sin(x / 31.0 + phase[1]))


def _line(surface: Ground, phase: Array, inland_m: float, west_m: float = -1e9) -> CentreLine:
    west, _, east, _ = surface.lattice.extent_m
    x = np.arange(max(west + 4.0, west_m), east - 3.0, 2.0, dtype=np.float64)
    return CentreLine.through(x, _shore_north(x, phase) + inland_m)


def _ground(plan: LandscapePlan, phase: Array, rng: np.random.Generator) -> Ground:
    lattice = square_lattice(plan.size_m, plan.cell_m)
    x, y = lattice.coordinates()
    size = lattice.rows - 1
    inland = y - _shore_north(x, phase)
    dunes = closed(fractal_noise(size, max(4, size // 24), 4, rng))
    ripples = closed(fractal_noise(size, size // 6, 2, rng))
    slope = np.where(inland > 0, 0.035 * inland, 0.055 * inland)
    dune = smooth_step(SAND_WIDTH_M - 30, SAND_WIDTH_M - 5, inland)
    level = 1 - smooth_step(6.0, 14.0, np.abs(inland - PROMENADE_M))
    bed = slope + (1 - level) * dune * plan.relief_m * (0.25 + 0.8 * dunes) + 0.10 * ripples * (inland > 6)
    bed += (1 - level) * smooth_step(PROMENADE_M + 20, PROMENADE_M + 120, inland) * plan.relief_m * 0.8
    depth = np.clip(-bed, 0.0, None)
    height = np.maximum(bed, 0.0)
    water = smooth_step(-0.02, 0.06, depth)
    sand = (1 - smooth_step(SAND_WIDTH_M - 12, SAND_WIDTH_M + 12, inland + 22 * dunes)) * (1 - water)
    lateral = inland - PROMENADE_M
    paved = (np.abs(lateral) < HALF_WIDTH_M) * (0.0 if plan.road else 1.0)
    keep = 1 - paved
    cover = cover_weights(
        x.shape,
        water=water,
        sand=sand * keep,
        paving=paved,
        dirt=0.5 * keep * (1 - sand - water).clip(0) * (ripples > 0.1),
    )
    margin = np.abs(lateral) - HALF_WIDTH_M if plan.road else np.full_like(x, 1e3)
    return Ground(
        lattice,
        height.astype(np.float32),
        cover,
        margin.astype(np.float32),
        lateral.astype(np.float32),
        x.astype(np.float32),
        depth.astype(np.float32),
    )


def _furnish(plan: LandscapePlan, surface: Ground, phase: Array, things: Furnishing) -> None:
    extent, rng = surface.lattice.extent_m, things.rng

    def inland(x: Array, y: Array) -> Array:
        return np.asarray(y - _shore_north(x, phase))

    def on_sand(x: Array, y: Array) -> Array:
        return np.asarray((inland(x, y) > 12.0) * (inland(x, y) < SAND_WIDTH_M - 15.0) * 1.0)

    def on_dunes(x: Array, y: Array) -> Array:
        off = np.abs(inland(x, y) - PROMENADE_M) > HALF_WIDTH_M + 2.5
        return np.asarray((inland(x, y) > SAND_WIDTH_M - 12.0) * off * 1.0)

    def behind(x: Array, y: Array) -> Array:
        return np.asarray((inland(x, y) > PROMENADE_M + 6.0) * 1.0)

    _camps(things, scatter(plan.tents, extent, rng, on_sand))
    x, y = scatter(max(plan.tents // 12, 0), extent, rng, on_sand)
    good = things.free(x, y, 2.5)
    things.place("boat", x[good], y[good], colour=things.choose(CLOTH_COLOURS, int(good.sum())))
    x, y = scatter(plan.flags, extent, rng, on_sand)
    good = things.free(x, y, 1.0)
    things.place("flag", x[good], y[good], colour=things.choose(CLOTH_COLOURS, int(good.sum())))
    posts = plan.posts
    x = np.linspace(extent[0] + 10, extent[2] - 10, max(posts, 1), dtype=np.float64)[:posts]
    things.place("post", x, _shore_north(x, phase) + PROMENADE_M - HALF_WIDTH_M - 1.5, colour=(140, 110, 76))
    x, y = scatter(plan.trees, extent, rng, behind)
    plant_trees(things, x, y, shares=(0.45, 0.4, 0.15), size=0.8)
    plant_bushes(things, plan.bushes, extent, on_dunes)
    strew_rocks(things, plan.rocks, extent, lambda x, y: on_dunes(x, y) + 0.04 * on_sand(x, y))
    stand_look_alikes(things, plan.sculptures, plan.animals, extent, on_dunes)


def _camps(things: Furnishing, at: tuple[Array, Array]) -> None:
    """Places of families: a parasol or a small tent, and towels around it."""
    rng = things.rng
    x, y = at
    tent = rng.random(len(x)) < 0.25
    things.place("tent", x[tent], y[tent], scale=0.8, colour=things.choose(CLOTH_COLOURS, int(tent.sum())))
    things.place("parasol", x[~tent], y[~tent], colour=things.choose(CLOTH_COLOURS, int((~tent).sum())))
    angle = rng.uniform(0, 2 * np.pi, len(x))
    for turn in (0.0, 1.9):
        tx, ty = x + 2.0 * np.cos(angle + turn), y + 2.0 * np.sin(angle + turn)
        things.place("towel", tx, ty, colour=things.choose(CLOTH_COLOURS, len(x)))
