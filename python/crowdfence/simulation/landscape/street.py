"""A town: streets at right angles, houses with courtyards, a square, a park, two streets for walkers."""

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.building import Building
from crowdfence.simulation.landscape.buildings import house
from crowdfence.simulation.landscape.furnishing import CAR_COLOURS, CLOTH_COLOURS, Furnishing
from crowdfence.simulation.landscape.greenery import plant_bushes, plant_trees, stand_look_alikes
from crowdfence.simulation.landscape.ground import Ground, cover_weights
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.landscape.noise import closed, fractal_noise
from crowdfence.simulation.landscape.road import CentreLine, Road
from crowdfence.simulation.landscape.scatter import scatter
from crowdfence.simulation.landscape.surface_lattice import square_lattice
from crowdfence.simulation.scenarios.plans import LandscapePlan

# Multiples of 4 m: with cells of 1, 2 or 4 m the edges of road and pavement lie on lattice lines, sharp.
BLOCK_M = 72.0
HALF_WIDTH_M = 4.0
PAVED_M = 8.0  # from the middle of a street to the houses
STREET_START_M = -120.0
PLAZA = (0, 0)  # blocks (column, row); block (0, 0) lies north-east of the origin
PARK = (-1, -1)

Array = NDArray[np.float64]


def build_street(plan: LandscapePlan, seed: int) -> Landscape:
    """Streets every 72 m, the two through the origin for walkers; houses fill blocks from the middle."""
    rng = np.random.default_rng([seed, 121])
    surface = _ground(plan, rng)
    things = Furnishing(surface, np.random.default_rng([seed, 122]))
    buildings = _houses(plan, surface, things, rng)
    road = Road(_main_street(surface), HALF_WIDTH_M, surface.height_at) if plan.road else None
    _furnish(plan, surface, things)
    return Landscape(surface, road, buildings, tuple(things.props), _places(surface), things.obstacles)


def _main_street(surface: Ground) -> CentreLine:
    west, _, east, _ = surface.lattice.extent_m
    return CentreLine.through(np.array([west, east]), np.array([-BLOCK_M, -BLOCK_M]))


def _places(surface: Ground) -> dict[str, Array]:
    end = surface.lattice.extent_m[2] - 10.0
    along = np.arange(STREET_START_M, end, 10.0)
    lines = {
        "street_1": (along, np.zeros_like(along)),
        "street_2": (np.zeros_like(along), along),
        "pavement": (along, np.full_like(along, -BLOCK_M + 6.0)),
        "plaza": (np.array([BLOCK_M / 2]), np.array([BLOCK_M / 2])),
        "park": (np.array([-BLOCK_M / 2]), np.array([-BLOCK_M / 2])),
    }
    return {name: np.stack([x, y, surface.height_at(x, y)], axis=-1) for name, (x, y) in lines.items()}


def _to_street(values: NDArray[np.floating]) -> tuple[Array, NDArray[np.int64]]:
    """Signed distance to the nearest street line across one axis, and which one it is."""
    index = np.round(values / BLOCK_M).astype(np.int64)
    return np.asarray(values - BLOCK_M * index), index


def _ground(plan: LandscapePlan, rng: np.random.Generator) -> Ground:
    lattice = square_lattice(plan.size_m, plan.cell_m)
    x, y = lattice.coordinates()
    size = lattice.rows - 1
    height = plan.relief_m * closed(fractal_noise(size, 2, 3, rng))
    (dx, column), (dy, row) = _to_street(x), _to_street(y)
    # Streets 0 are for walkers: no traffic there.
    drive_x = np.where(column == 0, 1e3, np.abs(dx) - HALF_WIDTH_M)
    drive_y = np.where(row == 0, 1e3, np.abs(dy) - HALF_WIDTH_M)
    margin = np.minimum(drive_x, drive_y) if plan.road else np.full_like(x, 1e3)
    along_x = drive_y <= drive_x
    block = np.floor(x / BLOCK_M), np.floor(y / BLOCK_M)
    plaza = (block[0] == PLAZA[0]) & (block[1] == PLAZA[1])
    paved = (np.minimum(np.abs(dx), np.abs(dy)) <= PAVED_M) | plaza
    worn = closed(fractal_noise(size, size // 8, 3, rng))
    return Ground(
        lattice,
        height.astype(np.float32),
        cover_weights(x.shape, paving=paved * 1.0, dirt=(~paved) * np.clip(0.2 + worn, 0, 0.6)),
        margin.astype(np.float32),
        np.where(along_x, dy, -dx).astype(np.float32),
        np.where(along_x, x, y).astype(np.float32),
    )


def _houses(
    plan: LandscapePlan, surface: Ground, things: Furnishing, rng: np.random.Generator
) -> tuple[Building, ...]:
    _, _, east, north = surface.lattice.extent_m
    reach = int(min(east, north) // BLOCK_M)
    blocks = [
        (i, j) for i in range(-reach, reach) for j in range(-reach, reach) if (i, j) not in (PLAZA, PARK)
    ]
    blocks.sort(key=lambda at: ((at[0] + 0.5) ** 2 + (at[1] + 0.5) ** 2, at))
    buildings: list[Building] = []
    for column, row in blocks:
        for low_x, low_y, high_x, high_y in (
            (8, 8, 48, 22),
            (50, 8, 64, 48),
            (24, 50, 64, 64),
            (8, 24, 22, 64),
        ):
            if len(buildings) == plan.buildings:
                return tuple(buildings)
            x0, y0 = column * BLOCK_M, row * BLOCK_M
            rectangle = (x0 + low_x, y0 + low_y, x0 + high_x, y0 + high_y)
            buildings.append(house(rectangle, _foot(surface, rectangle), int(rng.integers(2, 6)), rng))
            things.obstacles.add_rectangle(
                (rectangle[0] + rectangle[2]) / 2,
                (rectangle[1] + rectangle[3]) / 2,
                0.0,
                (rectangle[2] - rectangle[0]) / 2,
                (rectangle[3] - rectangle[1]) / 2,
            )
    return tuple(buildings)


def _foot(surface: Ground, rectangle: tuple[float, float, float, float]) -> tuple[float, float]:
    west, south, east, north = rectangle
    x, y = np.meshgrid(np.linspace(west, east, 9), np.linspace(south, north, 9))
    heights = surface.height_at(x, y)
    return float(heights.min()), float(heights.max())


def _furnish(plan: LandscapePlan, surface: Ground, things: Furnishing) -> None:
    extent = surface.lattice.extent_m
    _avenue(things, min(plan.trees // 3, 80))

    def green(x: Array, y: Array) -> Array:
        from_street = np.minimum(np.abs(_to_street(x)[0]), np.abs(_to_street(y)[0]))
        plaza = (np.floor(x / BLOCK_M) == PLAZA[0]) & (np.floor(y / BLOCK_M) == PLAZA[1])
        return np.asarray((from_street > PAVED_M + 1.5) * ~plaza * things.free(x, y, 2.0) * 1.0)

    x, y = scatter(plan.trees - min(plan.trees // 3, 80), extent, things.rng, green)
    plant_trees(things, x, y, shares=(0.08, 0.72, 0.2), size=0.85)
    plant_bushes(things, plan.bushes, extent, green)
    _parked_cars(plan.cars, things, extent)
    _plaza(plan, things)
    x = np.linspace(extent[0] + 20, extent[2] - 20, max(plan.posts, 1), dtype=np.float64)[: plan.posts]
    y = np.where(np.arange(len(x)) % 2 == 0, -BLOCK_M + 4.8, -BLOCK_M - 4.8)
    crossing = np.abs(_to_street(x)[0]) > PAVED_M
    things.place("lamp", x[crossing], y[crossing], heading_rad=np.where(y[crossing] > -BLOCK_M, -1.57, 1.57))
    stand_look_alikes(things, max(plan.sculptures - 3, 0), plan.animals, extent, green)


def _avenue(things: Furnishing, count: int) -> None:
    """Trees along both sides of the walkers' streets: who is below is hidden from above."""
    rng = things.rng
    step = 11.0
    k = np.arange(count // 2)
    along = STREET_START_M + step * (k // 2)
    side = np.where(k % 2 == 0, 6.0, -6.0)
    for x, y in ((along, side), (side, along)):
        clear = np.minimum(np.abs(_to_street(along)[0]), 99.0) > 10.0
        px, py = (
            x[clear] + rng.normal(0, 0.2, int(clear.sum())),
            y[clear] + rng.normal(0, 0.2, int(clear.sum())),
        )
        plant_trees(things, px, py, shares=(0.0, 0.9, 0.1), size=0.8)


def _parked_cars(count: int, things: Furnishing, extent: tuple[float, float, float, float]) -> None:
    rng = things.rng
    reach = int(extent[2] // BLOCK_M)
    streets = np.array([k for k in range(-reach, reach + 1) if k != 0])
    line = BLOCK_M * rng.choice(streets, count)
    along = rng.uniform(extent[0] + 12, extent[2] - 12, count)
    along = np.round(along / 5.6) * 5.6
    side = rng.choice([-1.0, 1.0], count)
    across = line + side * (HALF_WIDTH_M - 1.1)
    east_west = rng.random(count) < 0.5
    x, y = np.where(east_west, along, across), np.where(east_west, across, along)
    heading = np.where(east_west, 0.0, np.pi / 2) + np.where(side > 0, np.pi, 0.0)
    keep = np.abs(_to_street(along)[0]) > PAVED_M + 3.0
    _, first = np.unique(np.stack([x, y], axis=-1), axis=0, return_index=True)
    mask = np.zeros(count, bool)
    mask[first] = True
    keep &= mask
    colour = things.choose(CAR_COLOURS, count)
    things.place("car", x[keep], y[keep], heading_rad=heading[keep], colour=colour[keep])


def _plaza(plan: LandscapePlan, things: Furnishing) -> None:
    centre = BLOCK_M / 2
    statues = min(plan.sculptures, 3)
    x = centre + np.array([-22.0, 22.0, 0.0])[:statues]
    y = centre + np.array([18.0, -18.0, 22.0])[:statues]
    things.place("statue", x, y, colour=(170, 168, 160))
    angle = np.arange(plan.flags) * 2 * np.pi / max(plan.flags, 1)
    edge = 25.0 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    colour = things.choose(CLOTH_COLOURS, plan.flags)
    things.place("flag", centre + edge * np.cos(angle), centre + edge * np.sin(angle), colour=colour)
    row = 2.4 * (np.arange(plan.barriers, dtype=np.float64) - plan.barriers / 2)
    row = row[np.abs(row) < 24]
    things.place(
        "barrier", centre + row, np.full(len(row), centre + 20.0), heading_rad=0.0, colour=(150, 155, 162)
    )
