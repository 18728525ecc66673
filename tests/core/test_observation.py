"""`crowdfence.Observation` from Python: made by hand, refused, sent, and fused somewhere else."""

import re
from typing import Any

import numpy as np
import pytest

from crowdfence import (
    Camera,
    CrowdfenceError,
    CrowdMap,
    CrowdMass,
    MapFileError,
    Observation,
    Or,
    Paper,
    Rates,
    Terrain,
    View,
    ViewError,
    project,
)

SECOND_NS = 1_000_000_000
START_NS = 1_760_000_000 * SECOND_NS
COLUMNS: dict[str, Any] = {
    "voxel_ids": [3, 7],
    "mean": [0.25, 1.0],
    "pixel_count": [4, 0],
    "range_m": [20.0, 30.5],
    "tilt_deg": [90.0, -5.0],
    "occluded_ids": [5],
}


@pytest.fixture(scope="module")
def floor() -> Terrain:
    return Terrain.from_occupancy(np.ones((16, 16, 1), bool), 1.0)


def observed(terrain: Terrain, drone: str = "a", stamp_ns: int = START_NS, **columns: Any) -> Observation:
    return Observation(terrain, drone, stamp_ns, **{**COLUMNS, **columns})


def test_what_goes_in_comes_out(floor: Terrain) -> None:
    observation = observed(floor)
    assert (observation.drone, observation.stamp_ns, len(observation)) == ("a", START_NS, 2)
    assert observation.terrain_fingerprint == floor.fingerprint
    for name, values in COLUMNS.items():
        assert getattr(observation, name).tolist() == values


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"voxel_ids": [7, 3]}, "voxel_ids must be sorted and unique: 3 follows 7 at position 1"),
        ({"voxel_ids": [3, 3]}, "voxel_ids must be sorted and unique"),
        ({"voxel_ids": [3, 256]}, "voxel id 256 does not exist"),
        ({"voxel_ids": [-1, 3]}, "voxel id -1 does not exist"),
        ({"mean": [0.5, np.nan]}, "mean is NaN; it must be inside [0, 1]"),
        ({"mean": [0.5, 1.1]}, "mean is 1.1; it must be inside [0, 1]"),
        ({"mean": [0.5]}, "mean has 1 values; 2 are needed"),
        ({"range_m": [np.inf, 1.0]}, "range_m is inf; it must be finite and >= 0"),
        ({"tilt_deg": [0.0, 90.5]}, "tilt_deg is 90.5; it must be inside [-90, 90]"),
        ({"pixel_count": [-1, 0]}, "pixel_count is -1"),
        ({"occluded_ids": [7]}, "voxel 7 is both seen and occluded"),
        ({"voxel_ids": [[3, 7]]}, "ids has shape [1, 2]"),
    ],
)
def test_what_would_lie_is_refused(floor: Terrain, columns: dict[str, Any], message: str) -> None:
    with pytest.raises(CrowdfenceError, match=re.escape(message)):
        observed(floor, **columns)


def test_crowd_mass_travels_with_the_observation(floor: Terrain) -> None:
    mass = CrowdMass(ground=2.0, hole=0.5, unusable=0.25)
    observation = observed(floor, crowd_mass=mass)
    assert Observation.from_bytes(observation.to_bytes()).crowd_mass == observation.crowd_mass == mass
    assert observation != observed(floor) and observed(floor).crowd_mass == CrowdMass()
    assert (mass.total, mass.lost, mass.by_fate()["hole"]) == (2.75, 0.75, 0.5)
    parts = "ground=2, out_of_range=0, hole=0.5, off_map=0, sky=0, unusable=0.25"
    assert repr(mass) == f"CrowdMass({parts})" and repr(mass) in repr(observation)
    assert sum([mass, mass], CrowdMass(sky=1.0)) == CrowdMass(ground=4.0, hole=1.0, unusable=0.5, sky=1.0)


@pytest.mark.parametrize("mass", [-0.5, np.nan, np.inf])
def test_a_crowd_mass_that_cannot_be_is_refused(mass: float) -> None:
    with pytest.raises(CrowdfenceError, match=r"off_map is .*; it must be finite and >= 0"):
        CrowdMass(off_map=mass)


def test_a_view_says_where_its_crowd_went(floor: Terrain) -> None:
    """Of 48 pixels, a voxel each, one looks through a hole and a row of 8 beyond the floor."""
    indices = floor.voxel_indices(np.arange(floor.voxel_count)).tolist()
    holed = Terrain.from_indices([index for index in indices if index != [8, 13, 0]], 1.0)
    at_edge = np.diag([1.0, -1.0, -1.0, 1.0])
    at_edge[:3, 3] = (8.0, 14.0, 9.0)
    north = View("a", START_NS, Camera.pinhole(8, 6, 8.0, 8.0, 4.0, 3.0), at_edge, np.full((6, 8), 0.75))
    mass = project(north, holed, max_range_m=300.0).crowd_mass
    assert mass == CrowdMass(ground=0.75 * 39, hole=0.75 * 1, off_map=0.75 * 8)
    assert project(north, holed, max_range_m=300.0, crowd_threshold=0.75).crowd_mass == CrowdMass()
    with pytest.raises(CrowdfenceError, match=re.escape("crowd_threshold is 1.5; it must be inside [0, 1]")):
        project(north, holed, max_range_m=300.0, crowd_threshold=1.5)


def test_a_crowd_map_asks_its_method_what_shows_crowd(floor: Terrain) -> None:
    for b_threshold, expected in ((0.5, 0.0), (0.25, 0.375 * 48)):
        (observation,) = (
            CrowdMap(floor, Or(b_threshold=b_threshold))
            .integrate([view("a", 0.375, START_NS)], START_NS)
            .observations
        )
        assert observation.crowd_mass == CrowdMass(ground=expected)


def test_a_drone_without_a_name_is_refused(floor: Terrain) -> None:
    with pytest.raises(ViewError, match="drone name is empty"):
        observed(floor, drone="")


def view(drone: str, m: float, stamp_ns: int) -> View:
    """8 m above the floor's middle, straight down: 8 x 6 voxels, a pixel each."""
    world_from_camera = np.diag([1.0, -1.0, -1.0, 1.0])
    world_from_camera[:3, 3] = (8.0, 8.0, 9.0)
    heatmap = np.full((6, 8), m, np.float32)
    return View(drone, stamp_ns, Camera.pinhole(8, 6, 8.0, 8.0, 4.0, 3.0), world_from_camera, heatmap)


def test_views_projected_elsewhere_give_the_same_map(floor: Terrain) -> None:
    """Each drone projects on its own machine and sends bytes; one machine fuses them."""
    method = Paper(Rates(0.9, 0.05), 0.2, fleet_size=2)
    here, there = (CrowdMap(floor, method, coverage="full") for _ in range(2))
    for second, (m_a, m_b) in enumerate([(0.9, 0.1), (0.2, 0.8), (1.0, 1.0)]):
        stamp_ns = START_NS + second * SECOND_NS
        views = [view("a", m_a, stamp_ns), view("b", m_b, stamp_ns)]
        here.integrate(views, stamp_ns)
        sent = [project(one, floor, max_range_m=300.0, coverage="full").to_bytes() for one in views]
        there.integrate_observations([Observation.from_bytes(data) for data in sent], stamp_ns)
    assert here.to_bytes() == there.to_bytes()


def test_range_and_tilt_of_a_projected_view(floor: Terrain) -> None:
    observation = project(view("a", 0.5, START_NS), floor, max_range_m=300.0)
    to_voxel = floor.voxel_centers(observation.voxel_ids) - (8.0, 8.0, 9.0)
    range_m = np.linalg.norm(to_voxel, axis=1)
    assert observation.range_m == pytest.approx(range_m, rel=1e-6)
    assert observation.tilt_deg == pytest.approx(np.degrees(np.arcsin(-to_voxel[:, 2] / range_m)), rel=1e-6)


def test_bytes_that_are_none(floor: Terrain) -> None:
    data = observed(floor).to_bytes()
    flipped = bytearray(data)
    flipped[60] ^= 1
    for damaged, message in (
        (b"", "not an observation: the file is too short"),
        (CrowdMap(floor, Or()).to_bytes(), "not an observation: it does not begin with CROWDOBS"),
        (bytes(flipped), "observation is damaged at byte"),
        (data[:-1], "shorter or longer"),
    ):
        with pytest.raises(MapFileError, match=message):
            Observation.from_bytes(damaged)


def test_an_observation_of_another_terrain_is_not_fused(floor: Terrain) -> None:
    moved = floor.with_origin((0.5, 0.0, 0.0))
    crowd_map = CrowdMap(moved, Or())
    with pytest.raises(MapFileError, match="observation belongs to another terrain"):
        crowd_map.integrate_observations([observed(floor)], START_NS)
    assert crowd_map.instant_count == 0
