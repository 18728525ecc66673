"""A winding road along the flank of a valley, between ridges."""

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.furnishing import CAR_COLOURS, CLOTH_COLOURS, Furnishing
from crowdfence.simulation.landscape.greenery import (
    Extent,
    plant_bushes,
    plant_trees,
    stand_look_alikes,
    strew_rocks,
)
from crowdfence.simulation.landscape.ground import Ground, cover_weights
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.landscape.noise import closed, fractal_noise, smooth_step
from crowdfence.simulation.landscape.road import CentreLine, Road
from crowdfence.simulation.landscape.scatter import Acceptance, scatter
from crowdfence.simulation.landscape.surface_lattice import SurfaceLattice, square_lattice
from crowdfence.simulation.scenarios.plans import LandscapePlan

HALF_WIDTH_M = 3.5
VERGE_M = 9.0  # level ground beside the road, where spectators stand

Array = NDArray[np.float64]


def build_mountain_road(plan: LandscapePlan, seed: int) -> Landscape:
    """Valley with a road; `plan.relief_m` is the height of the ridges above it."""
    rng = np.random.default_rng([seed, 101])
    lattice = square_lattice(plan.size_m, plan.cell_m)
    centre = _winding_line(lattice, rng)
    surface = _ground(plan, lattice, centre, rng)
    road = Road(centre, HALF_WIDTH_M, surface.height_at) if plan.road else None
    things = Furnishing(surface, np.random.default_rng([seed, 102]))
    _furnish(plan, surface, Road(centre, HALF_WIDTH_M, surface.height_at), things)
    verge = Road(centre, HALF_WIDTH_M, surface.height_at).position(
        np.arange(0.0, centre.length_m, 5.0), HALF_WIDTH_M + 3.0
    )
    return Landscape(surface, road, (), tuple(things.props), {"verge": verge}, things.obstacles)


def _winding_line(lattice: SurfaceLattice, rng: np.random.Generator) -> CentreLine:
    """A curve from the west edge to the east edge; no bend is tighter than about 35 m."""
    west, _, east, _ = lattice.extent_m
    x = np.arange(west, east + 0.5, 0.5, dtype=np.float64)
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    y = (
        105.0 * np.sin(x / 165.0 + phase[0])
        + 30.0 * np.sin(x / 66.0 + phase[1])
        + 7.0 * np.sin(x / 31.0 + phase[2])
    )
    return CentreLine.through(x, y)


def _ground(
    plan: LandscapePlan, lattice: SurfaceLattice, centre: CentreLine, rng: np.random.Generator
) -> Ground:
    x, y = lattice.coordinates()
    arc, lateral = centre.nearest(x, y)
    distance = np.abs(lateral)
    size = lattice.rows - 1
    rolling = closed(fractal_noise(size, 4, 7, rng))
    crest = closed(fractal_noise(size, 3, 8, rng, ridged=True, gain=0.52))
    bumps = closed(fractal_noise(size, size // 12, 3, rng))
    profile = 11.0 * np.sin(arc / 250.0 + rng.uniform(0, 6.0)) + 5.0 * np.sin(arc / 105.0)
    valley = 1.0 - np.exp(-((distance / 190.0) ** 2))
    # Uphill on the left, downhill to the stream on the right, then ridges on both sides.
    flank = 26.0 * np.tanh(lateral / 70.0)
    ridges = valley * plan.relief_m * (0.15 + 0.55 * rolling + 1.15 * np.clip(crest - 0.28, 0.0, None))
    wild = flank + ridges + 7.0 * rolling + 1.1 * bumps
    hill = smooth_step(VERGE_M, 46.0, distance)
    near_bumps = 0.5 * bumps * smooth_step(HALF_WIDTH_M + 1.5, 12.0, distance)
    height = (profile + hill * wild + near_bumps).astype(np.float32)
    slope = np.hypot(*np.gradient(height.astype(np.float64), lattice.step_m))
    cover = _cover(slope, height, distance, rolling, bumps, plan.relief_m)
    return Ground(
        lattice,
        height,
        cover,
        (distance - HALF_WIDTH_M if plan.road else np.full_like(distance, 1e3)).astype(np.float32),
        lateral.astype(np.float32),
        arc.astype(np.float32),
    )


def _cover(
    slope: Array, height: NDArray[np.float32], distance: Array, rolling: Array, bumps: Array, relief_m: float
) -> NDArray[np.uint8]:
    rock = smooth_step(0.55, 0.95, slope + 0.25 * bumps)
    snow = smooth_step(0.50, 0.72, height / max(relief_m, 1.0) + 0.25 * rolling) * (1 - 0.8 * rock)
    dirt = 0.75 * smooth_step(0.12, 0.45, bumps + 0.5 * rolling) * (1 - rock) * (1 - snow)
    gravel = 1.0 - smooth_step(HALF_WIDTH_M + 1.0, HALF_WIDTH_M + 4.5, distance + 3.0 * bumps)
    keep = 1.0 - gravel
    return cover_weights(
        distance.shape, rock=rock * keep, snow=snow * keep, dirt=dirt * keep, gravel=0.9 * gravel
    )


def _furnish(plan: LandscapePlan, surface: Ground, road: Road, things: Furnishing) -> None:
    _roadside(plan, road, things)
    lattice = surface.lattice
    extent = lattice.extent_m
    height = surface.height_m.astype(np.float64)
    slope = np.hypot(*np.gradient(height, lattice.step_m))
    tree_line_m = 0.55 * max(plan.relief_m, 60.0)

    def wood(x: Array, y: Array) -> Array:
        margin = lattice.interpolate(surface.road_margin_m, x, y)
        steep = lattice.interpolate(slope, x, y)
        high = lattice.interpolate(surface.height_m, x, y) > tree_line_m
        near = np.exp(-np.maximum(margin, 0.0) / 260.0)
        return np.asarray((margin > 13.0) * (steep < 0.85) * ~high * (0.18 + 0.82 * near))

    _trees(plan, things, wood, extent)

    def open_ground(x: Array, y: Array) -> Array:
        margin = lattice.interpolate(surface.road_margin_m, x, y)
        return np.asarray((margin > plan.plants_from_road_m) * np.exp(-np.maximum(margin, 0.0) / 120.0))

    plant_bushes(things, plan.bushes, extent, open_ground)
    strew_rocks(things, plan.rocks, extent, open_ground)
    stand_look_alikes(things, plan.sculptures, plan.animals, extent, open_ground)


def _trees(plan: LandscapePlan, things: Furnishing, wood: Acceptance, extent: Extent) -> None:
    rng = things.rng
    x, y = scatter(plan.trees, extent, rng, wood)
    pull = rng.random(len(x)) < 0.65
    # Two thirds huddle: pull them towards the cell centres of a coarse noise so that groves appear.
    grove_x, grove_y = np.round(x / 46.0) * 46.0, np.round(y / 46.0) * 46.0
    spread = rng.normal(0.0, 9.0, (2, len(x)))
    moved_x, moved_y = np.where(pull, grove_x + spread[0], x), np.where(pull, grove_y + spread[1], y)
    good = wood(moved_x, moved_y) > 0.0
    x, y = moved_x[good], moved_y[good]
    plant_trees(things, x, y, shares=(0.62, 0.26, 0.12))


def _roadside(plan: LandscapePlan, road: Road, things: Furnishing) -> None:
    rng = things.rng
    s = np.linspace(10.0, road.length_m - 10.0, max(plan.posts, 1))[: plan.posts]
    side = np.where(np.arange(len(s)) % 2 == 0, 1.0, -1.0)
    point = road.position(s, side * (road.half_width_m + 1.0))
    things.place("post", point[:, 0], point[:, 1], heading_rad=road.heading_rad(s), colour=(236, 234, 228))
    x, y, heading = things.beside(road, plan.cars, (road.half_width_m + 8.0, road.half_width_m + 13.0))
    heading = heading + rng.choice([0.0, np.pi], len(x)) + rng.normal(0.0, 0.12, len(x))
    van = rng.random(len(x)) < 0.3
    for kind, mine in (("car", ~van), ("van", van)):
        palette = CAR_COLOURS if kind == "car" else np.vstack([CAR_COLOURS[2:3], CAR_COLOURS])
        colour = things.choose(palette, int(mine.sum()))
        things.place(kind, x[mine], y[mine], heading_rad=heading[mine], colour=colour)  # type: ignore[arg-type]
    x, y, heading = things.beside(road, plan.tents, (road.half_width_m + 15.0, road.half_width_m + 26.0))
    good = things.free(x, y, 3.0)
    x, y, heading = x[good], y[good], heading[good]
    large = rng.random(len(x)) < 0.4
    things.place(
        "tent", x[~large], y[~large], scale=rng.uniform(0.8, 1.3, int((~large).sum())),
        colour=things.choose(CLOTH_COLOURS, int((~large).sum())),
    )  # fmt: skip
    colour = things.choose(CLOTH_COLOURS, int(large.sum()))
    things.place("marquee", x[large], y[large], heading_rad=heading[large], colour=colour)
    _rows_of_barriers(plan.barriers, road, things)
    x, y, _ = things.beside(road, plan.flags, (road.half_width_m + 1.6, road.half_width_m + 10.0))
    good = things.free(x, y, 0.5)
    things.place("flag", x[good], y[good], colour=things.choose(CLOTH_COLOURS, int(good.sum())))


def _rows_of_barriers(count: int, road: Road, things: Furnishing) -> None:
    """Barriers in rows of up to ten along the edge of the road."""
    rng = things.rng
    for start in range(0, count, 10):
        length = min(10, count - start)
        s = rng.uniform(100.0, road.length_m - 130.0) + 2.4 * np.arange(length)
        point = road.position(s, rng.choice([-1.0, 1.0]) * (road.half_width_m + 0.45))
        things.place(
            "barrier", point[:, 0], point[:, 1], heading_rad=road.heading_rad(s), colour=(150, 155, 162)
        )
