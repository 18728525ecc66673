"""`project` against a plain implementation over dense arrays (`slow_projection`)."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence import Camera, Observation, Terrain, View, project
from support.slow_projection import DenseTerrain, project_rays, project_tops

Array = NDArray[np.float64]

WIDTH, HEIGHT = 48, 40
RANGE_M = 60.0


def _landscape(rng: np.random.Generator) -> DenseTerrain:
    """Rough ground, towers, a bridge and canopies: much that hides and overhangs."""
    size = (30, 26, 16)
    occupied = np.zeros(size, bool)
    x, y = np.mgrid[: size[0], : size[1]]
    ground = 1.5 + 1.2 * np.sin(0.35 * x + rng.uniform(0, 6)) + np.cos(0.5 * y + rng.uniform(0, 6))
    ground = (ground + rng.uniform(0, 1, ground.shape)).astype(int).clip(0, 5)
    occupied[x, y, ground] = True
    for _ in range(4):
        i, j = rng.integers(0, 24, 2)
        occupied[i : i + rng.integers(1, 4), j : j + rng.integers(1, 4), : rng.integers(5, 12)] = True
    bridge = rng.integers(3, 22)
    occupied[:, bridge : bridge + 3, 8] = True
    occupied[..., 10] |= rng.random(size[:2]) < 0.04
    voxel_size_m = float(rng.choice([0.5, 1.0, 1.7]))
    return DenseTerrain(occupied, voxel_size_m, tuple(rng.uniform(-500, 500, 3)))


def _pose(position: Array, yaw_deg: float, down_deg: float, roll_deg: float) -> Array:
    """Camera looking `yaw_deg` from north over east, `down_deg` below the horizon, rolled about its axis."""
    yaw, down, roll = np.radians((yaw_deg, down_deg, roll_deg))
    forward = np.array([np.cos(down) * np.sin(yaw), np.cos(down) * np.cos(yaw), -np.sin(down)])
    right = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    below = np.cross(forward, right)
    world_from_camera = np.eye(4)
    world_from_camera[:3, 0] = np.cos(roll) * right + np.sin(roll) * below
    world_from_camera[:3, 1] = np.cos(roll) * below - np.sin(roll) * right
    world_from_camera[:3, 2] = forward
    world_from_camera[:3, 3] = position
    return world_from_camera


def _random_pose(rng: np.random.Generator, dense: DenseTerrain, where: str) -> Array:
    """Camera above the map, beside it, or among its towers and bridges, pointed roughly at its middle."""
    low = np.asarray(dense.origin)
    extent = np.array(dense.occupied.shape) * dense.voxel_size_m
    share = {
        "above": rng.uniform((0.0, 0.0, 1.2), (1.0, 1.0, 1.8)),
        "beside": rng.uniform((-0.3, 0.0, 0.4), (-0.1, 1.0, 0.9)),
        "among": rng.uniform((0.3, 0.3, 0.45), (0.7, 0.7, 0.48)),
    }[where]
    position = low + share * extent
    aim = low + rng.uniform((0.3, 0.3, 0.0), (0.7, 0.7, 0.2)) * extent - position
    yaw_deg = np.degrees(np.arctan2(aim[0], aim[1]))
    down_deg = np.degrees(np.arctan2(-aim[2], np.hypot(aim[0], aim[1])))
    return _pose(position, yaw_deg, down_deg, rng.uniform(-40, 40))


def _camera(lens: str, coarseness: int = 1) -> Camera:
    """`coarseness` 2 has half the pixels along each side."""
    width, height = WIDTH // coarseness, HEIGHT // coarseness
    fx, fy, cx, cy = (length / coarseness for length in (40.0, 42.0, 24.3, 19.1))
    if lens == "pinhole":
        return Camera.pinhole(width, height, fx, fy, cx, cy)
    if lens == "brown_conrady":
        return Camera.pinhole(width, height, fx, fy, cx, cy, (-0.12, 0.02, 1e-3, -2e-3, 0.001))
    return Camera.fisheye(width, height, fx / 2, fy / 2, cx, cy, (0.02, -0.003, 0.001, 0.0))


def _heatmap(rng: np.random.Generator, camera: Camera, stride: int, kind: str) -> NDArray[Any]:
    shape = (camera.height // stride, camera.width // stride)
    return rng.integers(0, 256, shape, np.uint8) if kind == "uint8" else rng.random(shape, np.float32)


def _values(heatmap: NDArray[Any]) -> Array:
    """What the core is told to read, in float64: float32 as it is, bytes as float32 of value / 255."""
    if heatmap.dtype == np.uint8:
        heatmap = heatmap.astype(np.float32) / np.float32(255)
    return heatmap.astype(np.float64)


def _by_cell(dense: DenseTerrain, terrain: Terrain, observation: Observation) -> dict[int, tuple[float, int]]:
    cells = dense.cells(terrain)[observation.voxel_ids]
    return {
        int(cell): (float(mean), int(count))
        for cell, mean, count in zip(cells, observation.mean, observation.pixel_count, strict=True)
    }


def _assert_same(actual: dict[int, tuple[float, int]], expected: dict[int, tuple[float, int]]) -> None:
    assert actual.keys() == expected.keys()
    for cell, (mean, count) in expected.items():
        # Pixels side by side are added up in float32: at most 48 in a row, in eight partial sums.
        assert actual[cell][0] == pytest.approx(mean, abs=(48 / 8 + 3) * 2.0**-24)
        assert actual[cell][1] == count


LENSES = ("pinhole", "brown_conrady", "fisheye")
SCENES = [
    (seed, where, lens, stride, kind)
    for seed, (where, lens) in enumerate(
        (where, lens) for where in ("above", "beside", "among") for lens in LENSES
    )
    for stride, kind in [((1, "float32"), (4, "uint8"), (8, "float32"), (1, "uint8"))[seed % 4]]
]


@pytest.mark.parametrize(("seed", "where", "lens", "stride", "kind"), SCENES)
def test_rays_agree_with_the_slow_projection(
    seed: int, where: str, lens: str, stride: int, kind: str
) -> None:
    rng = np.random.default_rng([1, seed])
    for _ in range(2):
        dense = _landscape(rng)
        terrain = dense.terrain()
        camera = _camera(lens)
        heatmap = _heatmap(rng, camera, stride, kind)
        view = View("a", 0, camera, _random_pose(rng, dense, where), heatmap)
        for max_range_m, target_height_m in (
            (RANGE_M, 0.0),
            (15.0 * dense.voxel_size_m, 0.0),
            (RANGE_M, 0.9),
        ):
            expected = project_rays(dense, view, _values(heatmap), max_range_m, target_height_m)
            observation = project(
                view,
                terrain,
                max_range_m=max_range_m,
                target_height_m=target_height_m,
                coverage="rays",
                surface="voxels",
            )
            _assert_same(_by_cell(dense, terrain, observation), expected)
            assert (np.diff(observation.voxel_ids) > 0).all()
            assert len(observation.occluded_ids) == 0
        assert len(project_rays(dense, view, _values(heatmap), RANGE_M)) > 30, "a scene that shows little"


@pytest.mark.parametrize("where", ["above", "beside", "among"])
@pytest.mark.parametrize(("lens", "stride", "kind"), [("fisheye", 1, "uint8"), ("fisheye", 4, "float32")])
def test_full_coverage_adds_what_has_a_free_line_of_sight(
    where: str, lens: str, stride: int, kind: str
) -> None:
    """Through a lens that looks so far aside that every pixel has its ray, the reference of the raster."""
    rng = np.random.default_rng([2, stride])
    dense = _landscape(rng)
    terrain = dense.terrain()
    camera = _camera(lens, coarseness=2)
    heatmap = _heatmap(rng, camera, stride, kind)
    view = View("a", 0, camera, _random_pose(rng, dense, where), heatmap)
    for max_range_m in (22.0 * dense.voxel_size_m, RANGE_M):
        by_rays = project_rays(dense, view, _values(heatmap), max_range_m)
        by_tops, hidden = project_tops(dense, view, _values(heatmap), max_range_m)
        added = {cell: (mean, 0) for cell, mean in by_tops.items() if cell not in by_rays}
        observation = project(view, terrain, max_range_m=max_range_m, surface="voxels")
        _assert_same(_by_cell(dense, terrain, observation), by_rays | added)
        occluded = set(dense.cells(terrain)[observation.occluded_ids].tolist())
        assert occluded == hidden - by_rays.keys()
    assert by_rays
    assert added
    assert occluded


def test_every_ray_that_meets_terrain_counts_once() -> None:
    rng = np.random.default_rng(3)
    dense = _landscape(rng)
    camera = _camera("pinhole")
    heatmap = _heatmap(rng, camera, 1, "float32")
    view = View("a", 0, camera, _random_pose(rng, dense, "above"), heatmap)
    observation = project(view, dense.terrain(), max_range_m=1e4, surface="voxels")
    pixels = np.stack(np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5), axis=-1).reshape(-1, 2)
    rays = view.camera.unproject(pixels) @ view.world_from_camera[:3, :3].T
    hit, _ = dense.first_hits(view.world_from_camera[:3, 3], rays, 1e4)
    assert observation.pixel_count.sum() == (hit >= 0).sum() > 0


def test_a_far_origin_changes_nothing() -> None:
    """Steps of 1/8 m are exact in float64 at 5 000 km, so the very same voxels and values must come out."""
    rng = np.random.default_rng(4)
    occupied = _landscape(rng).occupied
    camera = _camera("pinhole")
    heatmap = _heatmap(rng, camera, 4, "float32")
    near = DenseTerrain(occupied, 0.5, (0.0, 0.0, 0.0))
    pose = _pose(np.array([7.125, -3.5, 10.25]), 10.0, 35.0, 12.0)
    shift = np.array([691_608.0, 5_334_760.0, 512.0])
    shifted_pose = pose.copy()
    shifted_pose[:3, 3] += shift
    here = project(View("a", 0, camera, pose, heatmap), near.terrain(), max_range_m=RANGE_M)
    there = project(
        View("a", 0, camera, shifted_pose, heatmap),
        near.terrain().with_origin(shift.tolist()),
        max_range_m=RANGE_M,
    )
    np.testing.assert_array_equal(here.voxel_ids, there.voxel_ids)
    np.testing.assert_array_equal(here.mean, there.mean)
    np.testing.assert_array_equal(here.pixel_count, there.pixel_count)
    assert len(here.voxel_ids) > 30


def test_a_camera_inside_the_terrain_sees_nothing() -> None:
    dense = DenseTerrain(np.ones((4, 4, 4), bool), 1.0, (0.0, 0.0, 0.0))
    view = View(
        "a", 0, _camera("pinhole"), _pose(np.full(3, 2.5), 0.0, 0.0, 0.0), np.ones((1, 1), np.float32)
    )
    for coverage in ("rays", "full"):
        observation = project(view, dense.terrain(), max_range_m=RANGE_M, coverage=coverage)  # type: ignore[arg-type]
        assert len(observation.voxel_ids) == len(observation.occluded_ids) == 0


def test_terrain_and_pose_that_do_not_overlap_give_nothing() -> None:
    terrain = Terrain.from_occupancy(np.ones((4, 4, 1), bool), 1.0)
    view = View(
        "a", 0, _camera("pinhole"), _pose(np.full(3, 1e5), 0.0, 90.0, 0.0), np.ones((1, 1), np.float32)
    )
    observation = project(view, terrain, max_range_m=300.0, coverage="full")
    assert len(observation.voxel_ids) == len(observation.occluded_ids) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"max_range_m": 0.0}, "max_range_m is 0; it must be finite and > 0"),
        ({"max_range_m": -5.0}, "max_range_m is -5; it must be finite and > 0"),
        ({"max_range_m": float("nan")}, "max_range_m is NaN; it must be finite and > 0"),
        ({"max_range_m": float("inf")}, "max_range_m is inf; it must be finite and > 0"),
        ({"max_range_m": 1.0, "target_height_m": -1.0}, "target_height_m is -1; it must be in [0, 100]"),
        ({"max_range_m": 1.0, "target_height_m": 101.0}, "target_height_m is 101; it must be in [0, 100]"),
        ({"max_range_m": 1.0, "coverage": "all"}, 'coverage is "all"; it must be "rays" or "full"'),
    ],
)
def test_bounds_are_named(options: dict[str, Any], message: str) -> None:
    terrain = Terrain.from_occupancy(np.ones((1, 1, 1), bool), 1.0)
    view = View("a", 0, _camera("pinhole"), np.eye(4), np.ones((1, 1), np.float32))
    with pytest.raises(ValueError, match=re.escape(message)):
        project(view, terrain, **options)


NADIR = np.diag([1.0, -1.0, -1.0, 1.0])
PLAIN = Terrain.from_height_map(np.zeros((40, 40)), 1.0)


def _over_the_plain(heatmap: object) -> View:
    """From 10 m over a plain of 40 x 40 m, straight down on its middle: 8 x 8 m, north at the top."""
    pose = NADIR.copy()
    pose[:3, 3] = 20.0, 20.0, 10.0
    return View("uav1", 0, Camera.pinhole(64, 64, 80.0, 80.0, 32.0, 32.0), pose, heatmap)  # type: ignore[arg-type]


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.uint8])
def test_masked_cells_say_neither_crowd_nor_empty(dtype: type) -> None:
    # Crowd in the north-eastern quarter, of which nothing was looked at, and in one metre of the south-west.
    values = np.zeros((8, 8), dtype)
    values[:4, 4:] = values[6, 1] = 1 if dtype != np.uint8 else 255
    mask = np.zeros((8, 8), bool)
    mask[:4, 4:] = True
    view = _over_the_plain(np.ma.array(values, mask=mask))
    assert view.looked_at is not None and np.array_equal(view.looked_at, ~mask)
    assert view.heatmap.sum() == 1.0
    seen = project(view, PLAIN, max_range_m=100.0)
    at = [tuple(index[:2]) for index in PLAIN.voxel_indices(seen.voxel_ids).tolist()]
    everywhere = {(16 + east, 16 + north) for east in range(8) for north in range(8)}
    assert set(at) == everywhere - {(20 + east, 20 + north) for east in range(4) for north in range(4)}
    assert dict(zip(at, seen.mean, strict=True))[17, 17] == 1.0 and seen.mean.sum() == 1.0
    assert seen.crowd_mass.ground == 64.0 and seen.crowd_mass.sky == 0.0


@pytest.mark.parametrize("kept", [np.asfortranarray, lambda cells: np.repeat(cells, 2, axis=1)[:, ::2]])
def test_a_mask_is_that_of_its_cells_however_numpy_keeps_them(kept: Callable[[Any], Any]) -> None:
    # The first row was not looked at; nothing but its corner is on the diagonal.
    mask = np.zeros((8, 8), bool)
    mask[0] = True
    view = _over_the_plain(np.ma.array(kept(np.eye(8)), mask=kept(mask), copy=False))
    assert view.looked_at is not None and np.array_equal(view.looked_at, ~mask)
    assert np.array_equal(view.heatmap, np.where(mask, 0.0, np.eye(8)))


def test_what_lies_under_a_mask_may_be_anything() -> None:
    values = np.full((8, 8), np.nan)
    values[0, 0] = 0.5
    assert _over_the_plain(np.ma.masked_invalid(values)).heatmap.sum() == 0.5
    nothing = _over_the_plain(np.ma.masked_all((8, 8)))
    assert len(project(nothing, PLAIN, max_range_m=100.0).voxel_ids) == 0
    whole = _over_the_plain(np.ma.array(np.zeros((8, 8)), mask=False))
    assert whole.looked_at is None and len(project(whole, PLAIN, max_range_m=100.0).voxel_ids) == 64
    with pytest.raises(ValueError, match="row 0, column 1"):
        _over_the_plain(np.ma.array(values, mask=np.eye(8)))
