"""Contact sheets: what is on them, for recordings that hold much and little."""

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import label

from crowdfence import Camera, Terrain
from crowdfence.exports.contact_sheet import write_contact_sheet
from crowdfence.exports.contact_sheet.frame_tile import CLASS_COLOURS, REGION_COLOUR, labelled, photograph
from crowdfence.exports.contact_sheet.ground_panel import panel_extent
from crowdfence.exports.contact_sheet.sheet import legend_title
from crowdfence.sources import open_recording
from crowdfence.sources.mission.writer import MissionWriter
from crowdfence.sources.recorded_truth import RecordedPeople

CAMERA = Camera.pinhole(64, 48, 40.0, 40.0, 32.0, 24.0)
DOWN = (0.0, 1.0, 0.0, 0.0)  # looks straight down, image top to the north
MS = 1_000_000


def mission(path, drones=("a", "b"), frames=4, **content):
    """Drones 30 m above the plain, flying east; `content` is in every frame."""
    with MissionWriter(path) as writer:
        for number in range(frames):
            for drone in drones:
                stamp_ns = 10**18 + number * 100 * MS
                position = [5.0 * number, 10.0 * drones.index(drone), 30.0]
                writer.add_camera(drone, CAMERA)
                writer.add_pose(drone, stamp_ns, position, DOWN)
                writer.add_frame(drone, stamp_ns, **content)
            position = np.array([[0, 0, 0], [3, 3, 0]], np.float32)
            stamp_ns = 10**18 + number * 100 * MS
            writer.add_people(RecordedPeople(stamp_ns, position, np.array([1, 2]), np.array([0, 1])))
    return open_recording(path)


def plain():
    side = np.arange(-60.0, 60.0, 1.0) + 0.5
    x, y = np.meshgrid(side, side)
    return Terrain.from_points(np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -0.5)]), 1.0)


def classes():
    segmentation = np.full((48, 64), 1, np.uint8)
    segmentation[:10], segmentation[20:28, 30:40] = 0, 3
    return segmentation


def test_labels_are_painted_in_the_colours_of_the_legend(tmp_path):
    regions = np.zeros((48, 64), np.uint8)
    regions[18:30, 28:42] = 1
    (frame, *_) = mission(tmp_path / "m.mcap", segmentation=classes(), regions=regions).frames
    assert photograph(frame) is None
    pixels, what = labelled(frame)
    assert what.startswith("true classes")
    # 72 % of the class's colour over the grey (214) of a missing picture.
    for place, name in (((5, 5), "sky"), ((40, 5), "ground"), ((24, 35), "crowd")):
        expected = 0.28 * 214 + 0.72 * np.array(CLASS_COLOURS[name])
        np.testing.assert_allclose(pixels[place], expected, atol=1)
    assert tuple(pixels[17, 35]) == REGION_COLOUR and tuple(pixels[18, 35]) != REGION_COLOUR


def test_heatmaps_are_shown_where_there_are_no_labels(tmp_path):
    heatmap = np.zeros((12, 16), np.uint8)
    heatmap[3, 4] = 255
    (frame, *_) = mission(tmp_path / "m.mcap", heatmap=heatmap).frames
    pixels, what = labelled(frame)
    assert what == "heatmap"
    changed = np.argwhere((pixels != 214).any(axis=-1))
    assert (changed.min(axis=0) == [12, 16]).all() and (changed.max(axis=0) == [15, 19]).all()


@pytest.mark.parametrize("with_terrain", [True, False])
def test_a_sheet_shows_every_tile_and_the_people(tmp_path, with_terrain):
    recording = mission(tmp_path / "m.mcap", drones=("a", "b", "c", "d"), segmentation=classes())
    write_contact_sheet(tmp_path / "sheet.png", recording, plain() if with_terrain else None)
    with Image.open(tmp_path / "sheet.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    assert 1200 < pixels.shape[1] < 3000
    # Three drones at three instants: nine skies in the tiles, none elsewhere.
    sky = np.abs(pixels - (0.28 * 214 + 0.72 * np.array(CLASS_COLOURS["sky"]))).max(axis=-1) < 3
    _, areas = np.unique(label(sky)[0], return_counts=True)
    assert (areas[1:] > 10_000).sum() == 9
    crowd_dot = np.abs(pixels - (200, 30, 58)).max(axis=-1) < 12
    assert crowd_dot[:, pixels.shape[1] // 2 :].any()


def test_people_are_named_where_a_recording_says_where_they_are():
    assert legend_title(2.5, with_people=False) == "flights, and footprints (150 m) at 2.5 s"
    assert legend_title(2.5, with_people=True) == "flights, and footprints (150 m) and people at 2.5 s"


def test_a_recording_without_pixels_has_no_sheet(tmp_path):
    recording = mission(tmp_path / "m.mcap", exposure_ns=5)
    with pytest.raises(ValueError, match="m holds no picture, label or heatmap"):
        write_contact_sheet(tmp_path / "sheet.png", recording, None)
    assert not (tmp_path / "sheet.png").exists()


def test_the_map_holds_flights_and_footprints(tmp_path):
    recording = mission(tmp_path / "m.mcap")
    outline = np.array([[-20.0, -5.0], [40.0, 0.0], [0.0, 30.0]])
    extent = panel_extent(recording, [outline], aspect=1.0)
    assert extent.west < -20 and extent.east > 40 and extent.south < -5 and extent.north > 30
    assert extent.height_m == pytest.approx(extent.width_m)
    assert extent.width_m == pytest.approx(60 * 1.12)
