"""Landscapes: heights on the drawn triangles, roads, obstacles; light of the day."""

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, translate

from crowdfence.simulation.landscape import build_landscape
from crowdfence.simulation.landscape.ground import Ground, cover_weights
from crowdfence.simulation.landscape.obstacles import Obstacles
from crowdfence.simulation.landscape.road import CentreLine
from crowdfence.simulation.landscape.surface_lattice import SurfaceLattice, square_lattice
from crowdfence.simulation.light import daylight, sun_direction
from crowdfence.simulation.scenarios.plans import LandscapePlan

PLANS = {
    "mountain_road": LandscapePlan(
        "mountain_road", size_m=512, relief_m=80, cell_m=4, road=True, trees=80, cars=6, rocks=30
    ),
    "field": LandscapePlan("field", size_m=512, relief_m=8, cell_m=4, tents=12, cars=10, trees=40),
    "street": LandscapePlan("street", size_m=512, relief_m=4, cell_m=2, road=True, buildings=12, trees=30),
    "beach": LandscapePlan("beach", size_m=512, relief_m=8, cell_m=4, tents=12, trees=20),
}


@pytest.fixture(scope="module", params=sorted(PLANS))
def landscape(request):
    return build_landscape(PLANS[request.param], seed=3)


def test_surface_is_linear_on_both_triangles_of_a_cell():
    lattice = SurfaceLattice(west_m=10.0, south_m=20.0, step_m=2.0, columns=2, rows=2)
    south_west, south_east, north_west, north_east = 1.0, 5.0, 2.0, 8.0
    height = np.array([[south_west, south_east], [north_west, north_east]])
    # Corners, the middle of the diagonal, and the middles of the two right angles' triangles.
    x = [10, 12, 10, 12, 11, 10 + 4 / 3, 10 + 2 / 3]
    y = [20, 20, 22, 22, 21, 20 + 2 / 3, 20 + 4 / 3]
    expected = [1, 5, 2, 8, 4.5, (1 + 5 + 8) / 3, (1 + 2 + 8) / 3]
    np.testing.assert_allclose(lattice.interpolate(height, x, y), expected, atol=1e-12)


def test_height_lies_on_the_drawn_triangles(landscape):
    mesh = landscape.ground
    rng = np.random.default_rng(1)
    corners = mesh.vertices[mesh.triangles[rng.integers(0, len(mesh.triangles), 500)]]
    weights = rng.dirichlet([1, 1, 1], 500)
    points = (weights[:, :, None] * corners).sum(axis=1)
    np.testing.assert_allclose(landscape.height_m(points[:, 0], points[:, 1]), points[:, 2], atol=1e-5)


def test_ground_faces_up_and_covers_its_extent(landscape):
    mesh = landscape.ground
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)[:, 2] / 2
    assert (area > 0).all()
    west, south, east, north = landscape.extent_m
    assert area.sum() == pytest.approx((east - west) * (north - south))


def test_equal_seeds_give_equal_landscapes_and_others_do_not():
    for plan in PLANS.values():
        first, again, other = (build_landscape(plan, seed) for seed in (5, 5, 6))
        assert first.surface.height_m.tobytes() == again.surface.height_m.tobytes()
        for one, two in zip(first.props, again.props, strict=True):
            assert one.kind == two.kind
            assert one.position.tobytes() == two.position.tobytes()
        assert first.surface.height_m.tobytes() != other.surface.height_m.tobytes()


def test_things_stand_on_the_ground_and_block_it(landscape):
    for props in landscape.props:
        x, y, z = props.position.T
        assert np.abs(landscape.height_m(x, y) - z).max() < 0.16
        if props.kind in ("conifer", "broadleaf", "birch", "rock", "car", "tent"):
            assert landscape.blocked(x, y, 0.2).all()


def test_nobody_stands_in_buildings_or_off_the_map():
    landscape = build_landscape(PLANS["street"], seed=3)
    assert len(landscape.solids) == 12
    for mesh in landscape.solids:
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        middle = (low + high) / 2
        assert landscape.blocked(middle[0], middle[1], 0.3).all()
    assert landscape.blocked([1e4, 0.0], [0.0, -1e4], 0.3).all()


def test_buildings_are_closed_solids_whose_roofs_stick_out():
    landscape = build_landscape(PLANS["street"], seed=3)
    for building in landscape.buildings:
        corners = building.mesh.vertices[building.mesh.triangles]
        # Divergence theorem: the signed volume of a closed surface does not depend on the origin.
        volumes = [
            np.einsum("ni,ni->n", np.cross(c[:, 0], c[:, 1]), c[:, 2]).sum() / 6
            for c in (corners, corners + np.array([50.0, -30.0, 20.0]))
        ]
        assert volumes[0] > 0
        assert volumes[0] == pytest.approx(volumes[1], rel=1e-6)
        walls = corners[building.windows].reshape(-1, 3)
        assert corners[..., 0].max() > walls[:, 0].max() + 0.5


def test_road_points_lie_on_the_road_and_the_shoulder_does_not():
    for kind in ("mountain_road", "street"):
        landscape = build_landscape(PLANS[kind], seed=3)
        road = landscape.road
        s = np.linspace(30, road.length_m - 30, 60)
        middle = road.position(s)
        assert landscape.on_road(middle[:, 0], middle[:, 1]).all()
        np.testing.assert_allclose(landscape.height_m(middle[:, 0], middle[:, 1]), middle[:, 2])
        if kind == "mountain_road":
            beside = road.position(s, road.half_width_m + 1.0)
            assert not landscape.on_road(beside[:, 0], beside[:, 1]).any()


def test_roads_of_the_town_have_sharp_edges():
    landscape = build_landscape(PLANS["street"], seed=3)
    # The street along y = 72 m is 8 m wide; x = 30 m is far from any crossing.
    y = 72.0 + np.array([-4.01, -3.99, 0.0, 3.99, 4.01])
    assert landscape.on_road(np.full(5, 30.0), y).tolist() == [False, True, True, True, False]


def test_the_sea_is_flat_and_too_deep_to_stand_in():
    landscape = build_landscape(PLANS["beach"], seed=3)
    _, south, _, _ = landscape.extent_m
    assert landscape.height_m([-100.0, 0.0, 100.0], [south + 20] * 3).tolist() == [0.0, 0.0, 0.0]
    assert landscape.blocked([0.0], [south + 20], 0.3).all()
    shore = landscape.places["shore"]
    assert (np.diff(shore[:, 0]) > 0).all()
    north = shore[:, 1] + 8.0
    assert (landscape.height_m(shore[:, 0], north) > 0.1).all()


def test_centre_line_of_a_circle():
    angle = np.linspace(0, np.pi / 2, 400)
    line = CentreLine.through(100 * np.cos(angle), 100 * np.sin(angle))
    assert line.length_m == pytest.approx(50 * np.pi, rel=1e-4)
    x, y, heading = line.at([0.0, 25 * np.pi])
    np.testing.assert_allclose(x, [100, 100 / np.sqrt(2)], atol=0.05)
    np.testing.assert_allclose(y, [0, 100 / np.sqrt(2)], atol=0.05)
    np.testing.assert_allclose(heading, [np.pi / 2, 3 * np.pi / 4], atol=0.01)
    # The centre of the circle lies to the left of a counter-clockwise curve.
    s, lateral = line.nearest([90 / np.sqrt(2)], [90 / np.sqrt(2)])
    np.testing.assert_allclose([s[0], lateral[0]], [25 * np.pi, 10.0], atol=0.1)


def test_obstacles_are_discs_and_turned_rectangles():
    obstacles = Obstacles()
    obstacles.add_circles(np.array([0.0]), np.array([0.0]), 1.0)
    obstacles.add_rectangle(10.0, 0.0, np.pi / 2, 3.0, 1.0)
    x = [0.0, 1.4, 1.6, 10.0, 10.0, 11.4, 11.6, 10.0, 10.0]
    y = [0.5, 0.0, 0.0, 0.0, 2.9, 0.0, 0.0, 3.4, 3.6]
    expected = [True, True, False, True, True, True, False, True, False]
    assert obstacles.blocked(x, y, 0.5).tolist() == expected


@pytest.mark.parametrize("seed", range(5))
def test_a_crowd_is_held_against_the_obstacles_near_it_only(seed):
    """And so found as blocked as each of its people alone, by all obstacles."""
    rng = np.random.default_rng(seed)
    obstacles = Obstacles()
    circles = np.column_stack([rng.uniform(-60, 60, (80, 2)), rng.choice([0.3, 1.0, 3.0, 12.0], 80)])
    obstacles.add_circles(*circles.T)
    for _ in range(30):
        obstacles.add_rectangle(*rng.uniform(-60, 60, 2), *rng.uniform(0, 6, 3))
    places = rng.uniform(-60, 60, 2) + rng.uniform(-15, 15, (200, 2))
    shapes = [shapely.Point(x, y).buffer(radius, 256) for x, y, radius in circles]
    for x, y, heading, length, width in np.concatenate(obstacles.rectangles):
        box = rotate(shapely.box(-length, -width, length, width), heading, origin=(0, 0), use_radians=True)
        shapes.append(translate(box, x, y))
    away_m = np.min([shapely.distance(shape, shapely.points(places)) for shape in shapes], axis=0)
    clear = np.abs(away_m - 0.3) > 1e-2  # circles of shapely have corners
    blocked = obstacles.blocked(*places.T, 0.3)
    np.testing.assert_array_equal(blocked[clear], away_m[clear] < 0.3)
    assert 20 < blocked.sum() < 190


def test_cover_weights_fill_up_with_grass():
    dirt = np.array([[0.0, 0.25, 1.0]])
    weights = cover_weights((1, 3), dirt=dirt)
    assert weights[0, :, 0].tolist() == [255, 191, 0]
    assert weights[0, :, 1].tolist() == [0, 64, 255]


def test_lattice_is_a_whole_number_of_tiles():
    for size_m, step_m in ((1500, 2.0), (100, 10.0), (700, 2.0)):
        lattice = square_lattice(size_m, step_m)
        assert (lattice.columns - 1) % 64 == 0
        west, south, east, north = lattice.extent_m
        assert west == -east
        assert south == -north


def test_sun_stands_where_astronomy_says():
    # Equinox (day 81), equator: in the zenith at noon, in the east at 6 o'clock solar time.
    np.testing.assert_allclose(sun_direction(81, 12.0, 0.0), (0, 0, 1), atol=1e-2)
    np.testing.assert_allclose(sun_direction(81, 6.0, 0.0), (1, 0, 0), atol=1e-2)
    # Noon height at latitude 46.5 in midsummer is 90 - 46.5 + 23.44 degrees, and the sun is in the south.
    east, north, up = sun_direction(172, 12.0, 46.5)
    assert up == pytest.approx(np.sin(np.radians(66.94)), abs=1e-3)
    assert north < 0
    assert abs(east) < 1e-9


@pytest.mark.parametrize("hour", [0.0, 4.5, 12.0, 19.5, 24.0])
@pytest.mark.parametrize("season", ["summer", "autumn", "winter", "dry"])
def test_light_always_comes_from_above(season, hour):
    light = daylight(season, hour, seed=1)
    assert np.linalg.norm(light.sun_direction) == pytest.approx(1.0)
    assert light.sun_direction[2] > 0.05
    assert min(*light.sun_colour, *light.sky_colour, *light.haze_colour) > 0


def test_ground_of_a_road_margin_uses_the_same_triangles():
    lattice = SurfaceLattice(0.0, 0.0, 1.0, 3, 3)
    x, _ = lattice.coordinates()
    flat = np.zeros((3, 3), np.float32)
    ground = Ground(lattice, flat, cover_weights((3, 3)), (x - 0.75).astype(np.float32), flat, flat)
    assert ground.on_road([0.7, 0.8], [1.0, 1.0]).tolist() == [True, False]


@pytest.mark.parametrize("from_road_m", [1.5, 8.5, 20.0])
def test_plants_begin_where_the_plan_says(from_road_m):
    plan = LandscapePlan(
        "mountain_road", size_m=512, road=True, bushes=1500, rocks=1500, plants_from_road_m=from_road_m
    )
    landscape = build_landscape(plan, seed=4)
    for kind in ("bush", "rock"):
        feet = np.concatenate([props.position for props in landscape.props if props.kind == kind])
        lateral = landscape.road.nearest(feet[:, 0], feet[:, 1])[1]
        nearest_m = (np.abs(lateral) - landscape.road.half_width_m).min()
        assert from_road_m - 0.1 < nearest_m < from_road_m + 1.5
