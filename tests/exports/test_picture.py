"""The picture, decoded again: its size and, coarsely, which colours are where."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from crowdfence import Camera, Georeference, Terrain, View, VoxelState
from crowdfence.exports.drawn_name import drawn
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.picture import DroneTrack, ground_footprint, interesting_extent, write_picture
from crowdfence.exports.picture.legend import draw_legend
from crowdfence.exports.picture.relief import OFF_MAP, Extent, shaded_ground
from crowdfence.exports.picture.scale_bar import emptiest_corner, scale_length_m
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.zones import Zone, ZoneSet, find_zones
from support.small_crowd_maps import flat_crowd_map
from support.small_grids import flat_grid

DESCRIPTION = MapDescription(
    1_760_000_009_500_000_000, 0.5, "paper", first_stamp_ns=1_760_000_000_000_000_000, drones=("uav1",)
)


def seen_square(size: int = 100) -> NDArray[np.float64]:
    """Never seen, except a square of empty ground in the middle with crowd in its south-west corner."""
    probability = np.full((size, size), np.nan)
    probability[20:80, 20:80] = 0.0
    probability[24:34, 24:34] = 1.0
    return probability


def crowd_grid(probability: NDArray[np.float64], cell_size_m: float = 1.0) -> SurfaceGrid:
    grid = flat_grid(probability, cell_size_m)
    grid.state[grid.probability >= 0.5] = VoxelState.CROWD
    return grid


def crowd_zones(probability: NDArray[np.float64]) -> ZoneSet:
    return find_zones(flat_crowd_map(probability), 0, threshold=0.5)


def is_crowd_red(pixels: NDArray[np.uint8]) -> NDArray[np.bool_]:
    red, green, blue = np.moveaxis(pixels[..., :3].astype(int), -1, 0)
    return (red > 80) & (red > green + 60) & (red > blue + 40)


def is_green(pixels: NDArray[np.uint8]) -> NDArray[np.bool_]:
    red, green, _ = np.moveaxis(pixels[..., :3].astype(int), -1, 0)
    return green > red + 20


def is_grey(pixels: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.ptp(pixels[..., :3].astype(int), axis=-1) < 12


def test_ground_pixels_have_the_colour_of_their_state() -> None:
    grid = crowd_grid(seen_square())
    image = shaded_ground(grid, 0.5, Extent(0.0, 0.0, 100.0, 100.0), 400).image
    assert image.shape == (400, 400, 3)
    # Row 0 is north: cell (i, j) covers columns 4 i .. 4 i + 3 and rows 396 - 4 j .. 399 - 4 j.
    np.testing.assert_array_equal(is_crowd_red(image)[::-1].T[2::4, 2::4], grid.state == VoxelState.CROWD)
    np.testing.assert_array_equal(is_green(image)[::-1].T[2::4, 2::4], grid.state == VoxelState.EMPTY)
    unseen = image[:60]
    assert is_grey(unseen).all()
    assert len(np.unique(unseen.reshape(-1, 3), axis=0)) > 1  # hatched, not flat


def test_on_a_print_without_colours_ground_that_was_not_cleared_is_not_taken_for_empty() -> None:
    """Both are as light: of level ground only what was seen empty is plain."""
    grid = crowd_grid(np.zeros((60, 60)))
    for west, state in ((0, VoxelState.EMPTY), (20, VoxelState.NOT_CLEARED), (40, VoxelState.STALE)):
        grid.state[west : west + 20] = state
    image = shaded_ground(grid, 0.5, Extent(0.0, 0.0, 60.0, 60.0), 240).image
    grey = image @ np.array([0.299, 0.587, 0.114])
    empty, not_cleared, stale = (grey[20:220, west : west + 40] for west in (20, 100, 180))
    assert np.ptp(empty) < 1.0
    assert np.ptp(not_cleared) > 20.0 and np.ptp(stale) > 15.0


def test_one_crowd_column_survives_any_reduction() -> None:
    probability = np.zeros((600, 600))
    probability[281, 133] = 0.9
    image = shaded_ground(crowd_grid(probability), 0.5, Extent(0.0, 0.0, 600.0, 600.0), 60).image
    rows, columns = np.nonzero(is_crowd_red(image))
    assert len(rows) >= 1
    assert np.abs(columns - 28).max() <= 1 and np.abs(59 - rows - 13).max() <= 1


def test_slopes_towards_the_light_are_brighter() -> None:
    # A ridge from north-east to south-west: its north-western side faces the light.
    i, j = np.indices((60, 60))
    indices = np.stack([i, j, 40 - np.abs(i - j)], axis=-1).reshape(-1, 3)
    grid = SurfaceGrid.from_voxels(
        indices, 1.0, (0.0, 0.0, 0.0), np.zeros(3600), np.full(3600, VoxelState.EMPTY)
    )
    image = shaded_ground(grid, 0.5, Extent(0.0, 0.0, 60.0, 60.0), 60).image.astype(float)
    assert image[10:20, 10:20].mean() > image[40:50, 40:50].mean() + 30


def test_outside_the_terrain_is_blank() -> None:
    image = shaded_ground(crowd_grid(np.zeros((10, 10))), 0.5, Extent(-10.0, 0.0, 10.0, 10.0), 40).image
    assert (image[:, :20] == OFF_MAP).all()
    assert is_green(image[:, 20:]).all()


def test_a_picture_decodes_and_shows_crowd_and_unseen_ground(tmp_path: Path) -> None:
    grid = crowd_grid(seen_square())
    track = DroneTrack(
        "uav1",
        np.array([(60.0, 60.0, 30.0), (70.0, 65.0, 30.0)]),
        np.array([(50.0, 50.0), (60.0, 50.0), (55.0, 60.0)]),
    )
    path = tmp_path / "map.png"
    write_picture(
        path,
        grid,
        crowd_zones(seen_square()),
        DESCRIPTION,
        tracks=[track],
        georeference=Georeference(46.5, 8.0, 1200.0),
    )
    with Image.open(path) as picture:
        pixels = np.asarray(picture)
    height, width = pixels.shape[:2]
    assert width == 1600 and 800 < height < 1500
    left, right = pixels[:, : width // 2], pixels[:, width // 2 : 1200]
    # The crowd lies in the south-west of the map: in the left half, below the middle.
    assert is_crowd_red(left[height // 2 :]).sum() > 10_000
    assert is_crowd_red(right[height // 4 :]).sum() < 1_000
    assert is_green(pixels).sum() > 100_000
    assert is_grey(pixels).sum() > 100_000
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("probability", [np.full((5, 5), np.nan), np.zeros((1, 1)), np.ones((3, 40))])
def test_unusual_maps_make_pictures_too(tmp_path: Path, probability: NDArray[np.float64]) -> None:
    grid = crowd_grid(probability)
    path = tmp_path / "map.png"
    write_picture(path, grid, crowd_zones(probability), DESCRIPTION, width_px=900)
    with Image.open(path) as picture:
        assert picture.width == 900


def test_zones_of_others_are_drawn_and_named(tmp_path: Path) -> None:
    """A line over empty ground, far from all crowd; most of the zone lies beyond the picture."""
    given = Zone.of_no_look("HOSP", shapely.box(50, 50, 5_000, 70), "static", "given")
    zones = replace(crowd_zones(seen_square()), static=(given,))
    pictures = []
    for number, one in enumerate((crowd_zones(seen_square()), zones)):
        write_picture(tmp_path / f"{number}.png", crowd_grid(seen_square()), one, DESCRIPTION)
        with Image.open(tmp_path / f"{number}.png") as picture:
            pictures.append(np.asarray(picture.convert("RGB")).astype(int))
    changed = np.abs(pictures[1] - pictures[0]).max(axis=-1)[:, :1100] > 30
    assert changed.any(axis=0).sum() > 300 and changed.sum() < 0.1 * changed.size
    axes = Figure(figsize=(4, 12), dpi=100).add_axes((0, 0, 1, 1))
    draw_legend(axes, crowd_grid(seen_square()), zones, DESCRIPTION, [], None)
    assert "1 zone of others" in [text.get_text() for text in axes.texts]


def test_crowd_that_is_too_small_for_a_zone_is_told_beside_the_picture_also_where_there_is_no_zone() -> None:
    probability = seen_square()
    for min_area_m2, told in ((50.0, False), (500.0, True)):  # one crowd, of 100 m2
        zones = find_zones(flat_crowd_map(probability), 0, threshold=0.5, min_area_m2=min_area_m2)
        axes = Figure(figsize=(4, 12), dpi=100).add_axes((0, 0, 1, 1))
        draw_legend(axes, crowd_grid(probability), zones, DESCRIPTION, [], None)
        texts = [text.get_text() for text in axes.texts]
        assert ("not drawn: 1 below 500 m², 100 m²" in texts) == told
        assert ("none; that does not mean free" in texts) == told


def test_ground_that_is_closed_because_nobody_cleared_it_is_told_beside_the_picture() -> None:
    """It has no outline there: who saw four zones alone took the rest for open."""
    unseen = Zone.of_no_look("UNSEEN", shapely.box(0, 0, 50, 30), "unseen", "never_cleared")
    for min_area_m2, dropped in ((50.0, []), (500.0, ["none of crowd", "with 1 below 500 m², 100 m²"])):
        zones = find_zones(flat_crowd_map(seen_square()), 0, threshold=0.5, min_area_m2=min_area_m2)
        axes = Figure(figsize=(4, 12), dpi=100).add_axes((0, 0, 1, 1))
        closed = replace(zones, unseen=(unseen,))
        draw_legend(axes, crowd_grid(seen_square()), closed, DESCRIPTION, [], None)
        texts = [text.get_text() for text in axes.texts]
        assert texts[texts.index("closed: not known empty") + 1] == "1 500 m²"
        assert [text for text in texts if text in dropped] == dropped
        assert not any("not drawn" in text for text in texts)


def test_the_crop_keeps_every_crowd_cell_and_track() -> None:
    probability = np.full((400, 400), np.nan)
    probability[100:200, 100:200] = 0.0
    probability[390, 5] = 1.0  # one far column
    grid = crowd_grid(probability)
    hover = DroneTrack("uav1", np.array([(-30.0, 150.0, 20.0)]))
    extent = interesting_extent(grid, [hover])
    assert extent.west < -30 and extent.east > 391
    assert extent.south < 5 and extent.north > 196


def test_the_crop_keeps_all_that_zones_of_crowd_close() -> None:
    """What is held since nobody looks any more is no crowd cell; it stood in the list and not on the map."""
    probability = np.full((400, 400), np.nan)
    probability[100:200, 100:200] = 0.0
    probability[390, 5] = 1.0
    zones = find_zones(flat_crowd_map(probability), 0, threshold=0.5, min_area_m2=0.0)
    grid = crowd_grid(np.where(probability == 1.0, 0.1, probability))  # crowd there is forgotten by now
    assert interesting_extent(grid, []).east < 300
    assert interesting_extent(grid, [], zones).east > 391
    far = replace(zones[0], polygon=zones[0].polygon.buffer(80.0, join_style="mitre"))
    extent = interesting_extent(grid, [], [far])
    assert extent.east > 471 and extent.south < -75  # a line that lies beside the picture closes nothing


def test_a_zone_of_others_that_holds_the_whole_picture_is_told_beside_it() -> None:
    """Its outline is beyond the rim, as of the zone of an airport: everything in it looked open."""
    zones = crowd_zones(seen_square())
    airport = Zone.of_no_look("CTR", shapely.box(-5_000, -5_000, 5_000, 5_000), "static", "given")
    beside = Zone.of_no_look("HOSP", shapely.box(50, 50, 5_000, 70), "static", "given")
    for static, told in (((airport, beside), True), ((beside,), False)):
        axes = Figure(figsize=(4, 12), dpi=100).add_axes((0, 0, 1, 1))
        shown = Extent(0.0, 0.0, 100.0, 100.0)
        closed = replace(zones, static=static)
        draw_legend(axes, crowd_grid(seen_square()), closed, DESCRIPTION, [], None, shown)
        assert ("all of this is closed by CTR" in [text.get_text() for text in axes.texts]) == told


def test_a_footprint_of_a_camera_that_looks_down() -> None:
    terrain = Terrain.from_height_map(np.zeros((100, 100)), 1.0, origin=(-50.0, -50.0, 0.0))
    camera = Camera.pinhole(200, 100, 100.0, 100.0, 100.0, 50.0)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])  # x right = east, y down = south, z forward = down
    pose[:3, 3] = (10.0, 5.0, 20.0)
    view = View("uav1", 0, camera, pose, np.zeros((100, 200), dtype=np.float32))
    outline = ground_footprint(view, terrain, 100.0)
    # 20 m up, half a picture is 1 x 0.5 of the height: 20 m to either side, 10 m ahead and behind.
    np.testing.assert_allclose(outline.min(axis=0), (-10.0, -5.0), atol=0.2)
    np.testing.assert_allclose(outline.max(axis=0), (30.0, 15.0), atol=0.2)
    pose[:3, :3] = np.diag([1.0, 1.0, 1.0])  # towards the sky
    assert ground_footprint(View("uav1", 0, camera, pose, view.heatmap), terrain, 100.0).shape == (0, 2)


def test_a_footprint_of_a_lens_whose_model_ends_before_the_picture() -> None:
    """Such a camera is used, its blind pixels as unseen: drawing it must not fail either."""
    terrain = Terrain.from_height_map(np.zeros((100, 100)), 1.0, origin=(-50.0, -50.0, 0.0))
    # r (1 - 0.4 r^2) rises up to r = 1 / sqrt(1.2) = 0.913: beyond 0.609 x 300 = 183 pixels off the middle
    # there is no ray, and from 20 m up the last one meets the ground 18.3 m from below the camera.
    camera = Camera.pinhole(640, 480, 300.0, 300.0, 320.0, 240.0, [-0.4, 0.0, 0.0, 0.0])
    assert camera.blind_pixel_count() > 640 * 480 / 2
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = (10.0, 5.0, 20.0)
    outline = ground_footprint(View("uav1", 0, camera, pose, np.zeros((48, 64), np.float32)), terrain, 100.0)
    radius_m = np.linalg.norm(outline - (10.0, 5.0), axis=1)
    assert len(outline) > 20 and 16.0 < radius_m.max() < 18.3


def test_scale_bar_length_and_place() -> None:
    assert [scale_length_m(width) for width in (10.0, 100.0, 249.0, 250.0, 6000.0)] == [2, 20, 20, 50, 1000]
    extent = Extent(0.0, 0.0, 100.0, 80.0)
    assert emptiest_corner(extent, np.array([(90.0, 10.0), (10.0, 10.0), (85.0, 70.0)])) == (0, 1)


def test_bad_arguments_are_refused(tmp_path: Path) -> None:
    grid = crowd_grid(np.zeros((2, 2)))
    with pytest.raises(ValueError, match="width_px must be at least 900"):
        write_picture(tmp_path / "map.png", grid, crowd_zones(np.zeros((2, 2))), DESCRIPTION, width_px=10)
    with pytest.raises(ValueError, match="the track of uav1 has no positions"):
        DroneTrack("uav1", np.empty((0, 3)))
    with pytest.raises(ValueError, match=r"positions of uav1 must be finite and of shape \[N, 3\]"):
        DroneTrack("uav1", np.array([(0.0, 0.0, np.nan)]))


@pytest.mark.filterwarnings("error")
def test_names_in_any_script_and_signs_of_formulas_are_drawn(tmp_path: Path) -> None:
    probability = np.zeros((40, 40))
    grid, zones = crowd_grid(probability), crowd_zones(probability)
    names = ("無人機", "$\\frac$", "rotor Ω é")
    tracks = [
        DroneTrack(name, np.array([[5.0, 5.0, 40.0], [9.0, 9.0, 40.0]]), np.empty((0, 2))) for name in names
    ]
    description = MapDescription(0, 0.5, "paper", drones=names, mission="$x 飛行")
    write_picture(tmp_path / "map.png", grid, zones, description, tracks=tracks)
    with Image.open(tmp_path / "map.png") as picture:
        assert picture.width > 100


def test_names_stay_apart_where_the_font_lacks_their_characters() -> None:
    assert [drawn(name) for name in ("機1", "人1", "é", "a$")] == ["U+6A5F1", "U+4EBA1", "é", "a\\$"]
