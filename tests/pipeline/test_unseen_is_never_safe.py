"""What everything rests on, from views to zones, against lines of sight that share nothing with the core."""

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from crowdfence import Camera, CrowdMap, Terrain, View, project
from crowdfence.config import EvidenceConfig, ZoneConfig
from crowdfence.pipeline import FrameLoop
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone
from support.random_ground import RandomGround, camera, pixels_of, ray_of

START_NS = 1_760_000_000_000_000_000
SECOND_NS = 1_000_000_000
STRIDE = 4
ASKED = 25
"""Voxels of an instant whose lines of sight are drawn."""
SEEDS = st.integers(0, 2**32 - 1)


class Flown(NamedTuple):
    camera: Camera
    pose: NDArray[np.float64]


def loop_over(terrain: Terrain, drones: int, max_range_m: float) -> FrameLoop:
    method = EvidenceConfig().fusion_method(terrain, drones=drones)
    everything = ZoneConfig(min_area_m2=0.0)  # however little of it is shown
    return FrameLoop(CrowdMap(terrain, method, max_range_m=max_range_m), everything)


def heatmap(
    camera: Camera, hot: tuple[slice, slice] | None = None, value: float = 0.97
) -> NDArray[np.float32]:
    values = np.zeros((camera.height // STRIDE, camera.width // STRIDE), np.float32)
    if hot is not None:
        values[hot] = value
    return values


def could_see(flown: Flown, ground: RandomGround, centre: NDArray[np.float64], max_range_m: float) -> bool:
    """Whether any point in or just around a voxel is in the picture, in range and in sight, but for what
    surely hides it. What holes and slopes show of a column, down to two voxels below it, belongs to its
    lowest voxel (`Solid::SKIRT`).
    """
    up = np.linspace(-2.5, 0.8, 12)
    for across in (
        np.zeros(1),
        np.linspace(-0.5, 0.5, 5),
    ):  # mostly its middle tells, and the rest need not be asked
        around = np.stack(np.meshgrid(across, across, up, indexing="ij"), -1).reshape(-1, 3)
        if any_in_sight(flown, ground, centre + ground.voxel_size_m * around, max_range_m):
            return True
    return False


def any_in_sight(flown: Flown, ground: RandomGround, points: NDArray[np.float64], max_range_m: float) -> bool:
    size_m = ground.voxel_size_m
    u, v = pixels_of(flown.camera, flown.pose, points).T
    away = points - flown.pose[:3, 3]
    distance_m = np.linalg.norm(away, axis=1)
    # What reaches into the picture by a corner may lie between two of the points, a quarter of a voxel apart.
    beside = 1.5 + 0.18 * size_m * flown.camera.fx / np.maximum(distance_m, 1e-3)
    shown = (np.abs(u - flown.camera.width / 2) < flown.camera.width / 2 + beside) & (
        np.abs(v - flown.camera.height / 2) < flown.camera.height / 2 + beside
    )
    inside = shown & (distance_m < max_range_m + 2 * size_m)
    part = np.linspace(0.0, 1.0, 120)[1:-1]
    x, y, z = np.moveaxis(flown.pose[:3, 3] + away[inside, None] * part[:, None], -1, 0)
    clear = ~ground.surely_hides(x, y, z)
    arrives = distance_m[inside, None] * (1.0 - part) < 1.5 * size_m
    return bool((clear | arrives).all(axis=1).any())


@settings(max_examples=40)
@given(SEEDS)
@example(233961)  # the bottom of a pit, by its steep top, behind a wall next to a low camera
@example(3588074647)  # ground behind a wall, in a pixel that shows the slope at its foot
def test_no_ground_is_called_empty_that_no_camera_could_see(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert_nobody_calls_empty_what_nobody_could_see(RandomGround.of(rng), rng)


@settings(max_examples=40)
@given(SEEDS)
@example(18143)  # the inside of the ground, under its surface, through a hole of the map before it
def test_no_ground_under_a_roof_is_called_empty_that_no_camera_could_see(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert_nobody_calls_empty_what_nobody_could_see(RandomGround.of(rng).with_roofs(rng), rng)


def assert_nobody_calls_empty_what_nobody_could_see(ground: RandomGround, rng: np.random.Generator) -> None:
    terrain, drones, max_range_m = ground.terrain(), int(rng.integers(1, 4)), float(rng.choice([15, 40, 120]))
    loop = loop_over(terrain, drones, max_range_m)
    # Through a hole of the map a camera sees what lies under the ground behind it, where nobody stands.
    places = np.rint(terrain.voxel_centers(np.arange(terrain.voxel_count)) / ground.voxel_size_m - 0.5)
    filled = {tuple(place) for place in places}
    has_holes = bool(np.isnan(ground.heights_m).any())
    is_asked = np.array([not has_holes or (x, y, z + 1.0) not in filled for x, y, z in places])
    cameras = [camera(rng) for _ in range(drones)]
    flown: list[Flown] = []
    stamp_ns = START_NS
    for _ in range(3):
        stamp_ns += int(rng.choice([0.1, 0.5, 2.0, 8.0]) * SECOND_NS)
        views = []
        for drone, eye in enumerate(cameras):
            pose, (i, j) = ground.pose(rng), rng.integers(0, 8, 2)
            hot = (slice(i, i + 4), slice(j, j + 4)) if rng.random() < 0.6 else None
            views.append(View(f"uav{drone}", stamp_ns, eye, pose, heatmap(eye, hot)))
            flown.append(Flown(eye, pose))
        loop.step(views, stamp_ns)
        empty = np.flatnonzero((loop.crowd_map.state(stamp_ns) == VoxelState.EMPTY) & is_asked)
        asked = rng.permutation(empty)[:ASKED]
        for centre in terrain.voxel_centers(asked):
            assert any(could_see(one, ground, centre, max_range_m) for one in flown), centre


@settings(max_examples=150)
@given(SEEDS)
def test_crowd_that_was_plainly_seen_is_not_empty_and_stays_closed_until_it_is_looked_at(seed: int) -> None:
    """One look at a crowd, then minutes of looks of another drone elsewhere, with nobody on them."""
    rng = np.random.default_rng(seed)
    ground = RandomGround.of(rng)
    terrain, eye, max_range_m = ground.terrain(), camera(rng), float(rng.choice([40, 120]))
    loop, pose = loop_over(terrain, 2, max_range_m), ground.pose(rng)
    rows, columns = (int(rng.integers(2, side // STRIDE - 6)) for side in (eye.height, eye.width))
    crowd = heatmap(eye, (slice(rows, rows + 5), slice(columns, columns + 5)))
    step = loop.step([View("a", START_NS, eye, pose, crowd)], START_NS)

    top = top_voxels(terrain)
    shown = plainly_shown(ground, Flown(eye, pose), rows, columns, max_range_m)
    states = loop.crowd_map.state(START_NS)
    for column in shown:
        assert states[top[column]] in (VoxelState.CROWD, VoxelState.NOT_CLEARED), column
    called = [column for column in shown if states[top[column]] == VoxelState.CROWD]
    assert all(in_a_zone(step.zones, column, ground) for column in called)

    stamp_ns = START_NS
    for _ in range(3):
        stamp_ns += int(rng.choice([0.5, 5.0, 60.0]) * SECOND_NS)
        view = View("b", stamp_ns, eye, ground.pose(rng), heatmap(eye))
        seen = set(project(view, terrain, max_range_m=max_range_m).voxel_ids.tolist())
        step = loop.step([view], stamp_ns)
        called = [column for column in called if top[column] not in seen]
        states = loop.crowd_map.state(stamp_ns)
        assert all(in_a_zone(step.zones, column, ground) for column in called)
        assert all(states[top[column]] != VoxelState.EMPTY for column in called)


def plainly_shown(
    ground: RandomGround, flown: Flown, rows: int, columns: int, max_range_m: float
) -> list[tuple[int, int]]:
    """Columns that many rays from the inner 3 x 3 of the 5 x 5 marked cells meet, on even ground."""
    hits: Counter[tuple[int, int]] = Counter()
    for u in np.arange((columns + 1) * STRIDE, (columns + 4) * STRIDE, 2) + 0.5:
        for v in np.arange((rows + 1) * STRIDE, (rows + 4) * STRIDE, 2) + 0.5:
            ray = ray_of(flown.camera, flown.pose, (u, v))
            hits[ground.first_column(flown.pose[:3, 3], ray, max_range_m - 2 * ground.voxel_size_m)] += 1
    inner = range(1, len(ground.heights_m) - 1)
    return [
        (i, j)
        for (i, j), count in ((at, count) for at, count in hits.items() if at is not None)
        if count >= 4
        and i in inner
        and j in inner
        and np.ptp(ground.heights_m[i - 1 : i + 2, j - 1 : j + 2]) < 0.5 * ground.voxel_size_m
    ]


def top_voxels(terrain: Terrain) -> dict[tuple[int, int], int]:
    """The highest voxel of every column."""
    indices = terrain.voxel_indices(np.arange(terrain.voxel_count))
    upwards = np.argsort(indices[:, 2], kind="stable")
    return {
        (i, j): number for number, (i, j, _) in zip(upwards.tolist(), indices[upwards].tolist(), strict=True)
    }


def in_a_zone(zones: Iterable[Zone], column: tuple[int, int], ground: RandomGround) -> bool:
    place = shapely.Point((np.array(column) + 0.5) * ground.voxel_size_m)
    return any(zone.polygon.covers(place) for zone in zones)
