"""An open field in gentle hills, made ready for a festival."""

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.furnishing import CAR_COLOURS, CLOTH_COLOURS, Furnishing
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

HALF_WIDTH_M = 2.5
ARENA_M = 118.0  # half side of the square that is kept free for people
STAGE_NORTH_M = 86.0
LANE_NORTH_M = -150.0

Array = NDArray[np.float64]


def build_field(plan: LandscapePlan, seed: int) -> Landscape:
    """Meadow with a trampled middle, a stage in its north, camp, car park and stalls around it."""
    rng = np.random.default_rng([seed, 111])
    surface = _ground(plan, rng)
    road = None
    if plan.road:
        road = Road(_lane(surface), HALF_WIDTH_M, surface.height_at, marked=False)
    things = Furnishing(surface, np.random.default_rng([seed, 112]))
    _arena(plan, things)
    _camp_and_cars(plan, things)
    _green(plan, surface, things)
    middle = np.array([[0.0, 0.0], [0.0, STAGE_NORTH_M - 40.0]])
    places = {
        "arena": _on(surface, middle[:1]),
        "stage": _on(surface, middle[1:]),
        "stalls": _on(surface, np.array([[-100.0, -112.0], [100.0, -112.0]])),
    }
    return Landscape(surface, road, (), tuple(things.props), places, things.obstacles)


def _on(surface: Ground, xy: Array) -> Array:
    return np.column_stack([xy, surface.height_at(xy[:, 0], xy[:, 1])])


def _lane(surface: Ground) -> CentreLine:
    west, _, east, _ = surface.lattice.extent_m
    x = np.arange(west, east + 0.5, 1.0, dtype=np.float64)
    return CentreLine.through(x, LANE_NORTH_M + 9.0 * np.sin(x / 70.0))


def _ground(plan: LandscapePlan, rng: np.random.Generator) -> Ground:
    lattice = square_lattice(plan.size_m, plan.cell_m)
    x, y = lattice.coordinates()
    size = lattice.rows - 1
    rolling = closed(fractal_noise(size, 3, 6, rng))
    patches = closed(fractal_noise(size, size // 10, 3, rng))
    reach = np.maximum(np.abs(x), np.abs(y))
    height = plan.relief_m * rolling * (0.25 + 0.75 * smooth_step(60.0, 200.0, reach)) + 0.12 * patches
    trampled = (1 - smooth_step(40.0, ARENA_M + 15.0, reach + 60.0 * rolling)) * (0.35 + 0.9 * patches)
    front = np.exp(-(((x) / 34.0) ** 2) - ((y - STAGE_NORTH_M + 34.0) / 26.0) ** 2)
    paths = np.exp(-(((np.abs(x - 18.0 * np.sin(y / 50.0)) - 3.0).clip(0) / 2.5) ** 2)) * (reach < 190)
    dirt = np.clip(trampled + 0.7 * front + 0.6 * paths, 0, 0.9)
    margin = np.full(x.shape, 1e3)
    lateral, arc = margin.copy(), np.zeros_like(margin)
    empty = Ground(
        lattice,
        height.astype(np.float32),
        cover_weights(x.shape, dirt=dirt),
        *_as_float32(margin, lateral, arc),
    )
    if not plan.road:
        return empty
    arc, lateral = _lane(empty).nearest(x, y)
    return Ground(
        lattice,
        empty.height_m,
        empty.cover,
        *_as_float32(np.abs(lateral) - HALF_WIDTH_M, lateral, arc),
    )


def _as_float32(*arrays: Array) -> tuple[NDArray[np.float32], ...]:
    return tuple(array.astype(np.float32) for array in arrays)


def _arena(plan: LandscapePlan, things: Furnishing) -> None:
    rng = things.rng
    if plan.tents:
        things.place(
            "stage", np.array([0.0]), np.array([STAGE_NORTH_M]), heading_rad=-np.pi / 2, colour=(196, 60, 52)
        )
    stalls = min(plan.tents // 3, 16)
    x = np.linspace(-105.0, 105.0, max(stalls, 1))[:stalls] + rng.uniform(-1.5, 1.5, stalls)
    colour = things.choose(CLOTH_COLOURS, stalls)
    things.place("marquee", x, np.full(stalls, -ARENA_M - 2.0), heading_rad=np.pi / 2, colour=colour)
    count = plan.barriers
    row = 2.4 * (np.arange(count) - count / 2)
    along = np.where(np.abs(row) < 30, row, np.sign(row) * 30.0)
    away = STAGE_NORTH_M - 8.0 - np.maximum(np.abs(row) - 30.0, 0.0) * 0.35
    things.place("barrier", along, away, heading_rad=0.0, colour=(150, 155, 162))
    angle = np.arange(plan.flags) * 2 * np.pi / max(plan.flags, 1)
    edge = ARENA_M / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    colour = things.choose(CLOTH_COLOURS, plan.flags)
    things.place("flag", edge * np.cos(angle), edge * np.sin(angle), colour=colour)


def _camp_and_cars(plan: LandscapePlan, things: Furnishing) -> None:
    rng = things.rng
    tents = plan.tents - min(plan.tents // 3, 16)
    x, y = scatter(tents, (-215.0, -110.0, -ARENA_M - 10.0, 110.0), rng)
    colour = things.choose(CLOTH_COLOURS, tents)
    things.place("tent", x, y, scale=rng.uniform(0.8, 1.4, tents), colour=colour)
    slot = np.arange(plan.cars)
    x = ARENA_M + 14.0 + 7.5 * (slot // 24) + rng.normal(0, 0.2, plan.cars)
    y = -60.0 + 3.1 * (slot % 24) + rng.normal(0, 0.15, plan.cars)
    van = rng.random(plan.cars) < 0.2
    heading = rng.choice([0.0, np.pi], plan.cars) + rng.normal(0, 0.04, plan.cars)
    colour = things.choose(CAR_COLOURS, plan.cars)
    things.place("car", x[~van], y[~van], heading_rad=heading[~van], colour=colour[~van])
    things.place("van", x[van], y[van], heading_rad=heading[van], colour=colour[van])
    posts = plan.posts
    y = np.linspace(-110.0, 110.0, max(posts, 1), dtype=np.float64)[:posts]
    things.place("post", np.full(posts, ARENA_M + 8.0), y, heading_rad=0.0, colour=(120, 92, 60))


def _green(plan: LandscapePlan, surface: Ground, things: Furnishing) -> None:
    lattice, extent = surface.lattice, surface.lattice.extent_m
    west, south, east, north = extent

    def away(x: Array, y: Array) -> Array:
        far = smooth_step(ARENA_M + 15.0, ARENA_M + 70.0, np.maximum(np.abs(x), np.abs(y)))
        clear = (lattice.interpolate(surface.road_margin_m, x, y) > 6.0) * things.free(x, y, 4.0)
        return np.asarray(far * clear)

    x, y = scatter(plan.trees, extent, things.rng, away)
    plant_trees(things, x, y, shares=(0.1, 0.7, 0.2))
    plant_bushes(things, plan.bushes, extent, away)
    strew_rocks(things, plan.rocks, extent, away)
    stand_look_alikes(
        things, plan.sculptures, plan.animals, (0.7 * west, 0.7 * south, 0.7 * east, 0.7 * north), away
    )
    x, y = scatter(14, extent, things.rng, away)
    things.place("bale", x, y)
