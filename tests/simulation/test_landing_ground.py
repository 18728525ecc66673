"""Where a drone could land in a simulated landscape, and the stand-in that sees it."""

import numpy as np
import pytest

from crowdfence import Camera
from crowdfence.simulation.landing_detector import LandingDetector, shown
from crowdfence.simulation.landing_ground import CLEAR_M, MAX_SLOPE_DEG, landing_ground
from crowdfence.simulation.rendering.mesh_catalogue import prop_families
from crowdfence.sources.layers import LayerGround
from support.simulated_scenes import scene_of


@pytest.fixture(scope="module", params=["beach", "street"])
def place(request: pytest.FixtureRequest):
    landscape = scene_of(request.param).landscape
    return landscape, landing_ground(landscape)


def some_cells(ground: LayerGround, fits: bool, count: int = 400):
    """Middles [N, 2] of cells that are fit, or are not."""
    cells = np.argwhere(ground.cells == fits)
    chosen = cells[np.random.default_rng(1).choice(len(cells), count, replace=False)]
    return (ground.west_m, ground.south_m) + (chosen + 0.5) * ground.cell_m


def test_fit_ground_is_dry_open_and_level(place) -> None:
    landscape, ground = place
    at = some_cells(ground, fits=True)
    x, y = at.T
    assert not landscape.obstacles.blocked(x, y, CLEAR_M - 1.5 * ground.cell_m).any()
    assert not landscape.on_road(x, y).any()
    if landscape.surface.water_depth_m is not None:
        lattice = landscape.surface.lattice
        assert (lattice.interpolate(landscape.surface.water_depth_m, x, y) <= 0.02).all()
    families = prop_families()
    for props in landscape.props:
        levels = [shape for variant in families[props.kind].variants for shape in variant]
        reach = max(np.hypot(*shape.position[:, :2].T).max() for shape in levels)
        apart = np.hypot(*(at[:, None] - props.position[None, :, :2]).transpose(2, 0, 1))
        # Cells are told apart by their middles: up to a cell and a half of the margin may be gone.
        assert (apart > reach * props.scale + CLEAR_M - 1.5 * ground.cell_m).all()
    for mesh in landscape.solids:
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        assert not ((at > low[:2]) & (at < high[:2])).all(axis=1).any()


def test_ground_that_is_not_fit_has_a_reason(place) -> None:
    """No more is taken away than the rules say: something near, or a steep place near."""
    landscape, ground = place
    x, y = some_cells(ground, fits=False, count=150).T
    reach = CLEAR_M + 3.0
    around = np.stack(np.meshgrid(*[np.linspace(-reach, reach, 13)] * 2), axis=-1).reshape(-1, 2)
    px, py = (x[:, None] + around[:, 0]), (y[:, None] + around[:, 1])
    step = 0.5
    rise = [
        (landscape.height_m(px + dx, py + dy) - landscape.height_m(px - dx, py - dy)) / (2 * step)
        for dx, dy in ((step, 0.0), (0.0, step))
    ]
    steep = (np.degrees(np.arctan(np.hypot(*rise))) > MAX_SLOPE_DEG - 3.0).any(axis=1)
    taken = landscape.on_road(px, py).any(axis=1)
    if landscape.surface.water_depth_m is not None:
        depth = landscape.surface.lattice.interpolate(landscape.surface.water_depth_m, px, py)
        taken |= (depth > 0.0).any(axis=1)
    # Crowns and boats reach up to 8 m from their foot.
    near = landscape.blocked(x, y, reach + 8.0)
    assert (steep | taken | near).all()


def test_each_pixel_shows_the_cell_that_it_meets() -> None:
    # From 10 m straight above (0, 0), the top of the picture to the north: f = 8, so a pixel is 1.25 m.
    ground = LayerGround(np.ones((4, 4), np.bool_), 1.25, -2.5, -2.5, 0.0)
    values = np.arange(16.0).reshape(4, 4)
    camera = Camera.pinhole(6, 4, 8.0, 8.0, 3.0, 2.0)
    down = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 10], [0, 0, 0, 1]])
    depth = np.full((4, 6), 10.0, np.float32)
    depth[0, 2], depth[0, 3] = np.nan, np.inf  # nothing was drawn there; the sky
    with np.errstate(all="raise"):  # a warning would stand in the output of `simulate`
        seen = shown(ground, values, depth, camera, down)
    expected = np.zeros((4, 6))
    expected[:, 1:5] = values.T[::-1]
    expected[0, 2:4] = 0.0
    assert np.array_equal(seen, expected)


def test_the_stand_in_is_wrong_at_places_and_from_picture_to_picture() -> None:
    detector = LandingDetector()
    labels = np.zeros((64, 64), np.bool_)
    labels[:, 32:] = True
    nothing = np.zeros((64, 64))
    one, same, other = (detector.heatmap(labels, nothing, 1, 0, frame) for frame in (0, 0, 1))
    assert np.array_equal(one, same) and not np.array_equal(one, other)
    for seen in (one, other):
        assert seen[:, 9:].mean() > 170 and seen[:, :7].mean() < 85
    # A mistake of the place is in every picture.
    wrong = [detector.heatmap(labels, np.full((64, 64), -12.0), 1, 0, frame) for frame in range(3)]
    assert max(seen.max() for seen in wrong) < 60


def test_mistakes_of_places_are_as_large_as_stated() -> None:
    ground = LayerGround(np.ones((600, 500), np.bool_), 0.5, 0.0, 0.0, 0.0)
    detector = LandingDetector()
    mistakes = detector.mistakes(ground, 4)
    assert np.array_equal(mistakes, detector.mistakes(ground, 4))
    assert mistakes.std() == pytest.approx(detector.place_noise, rel=0.2)
