"""Layers: heatmaps of further classes, kept beside those of crowds and never taken for them."""

import json

import numpy as np
import pytest
from PIL import Image

from crowdfence import Camera, FrameError
from crowdfence.sources import open_recording
from crowdfence.sources.convert import convert
from crowdfence.sources.layers import LayerGround, checked_layer
from crowdfence.sources.mission import ros2_messages
from crowdfence.sources.mission.messages import LayerContent, decode_layer_ground, encode_layer_ground
from crowdfence.sources.mission.writer import MissionWriter
from support.small_recordings import EPOCH_NS

CAMERA = Camera.pinhole(32, 24, 19.0, 19.0, 16.0, 12.0)
IDENTITY = (1.0, 0.0, 0.0, 0.0)
CROWD_HEATMAP = np.full((6, 8), 10, np.uint8)
SITES = np.arange(48, dtype=np.uint8).reshape(6, 8)
LABELS = np.zeros((24, 32), np.bool_)
LABELS[:5, :7] = True
GROUND = LayerGround(np.arange(12).reshape(3, 4) % 5 == 0, 0.5, -10.0, 20.0, 1.25)
"""3 cells east, 4 north."""


@pytest.fixture
def mission(tmp_path):
    path = tmp_path / "flight.mcap"
    with MissionWriter(path) as writer:
        writer.add_camera("uav1", CAMERA)
        writer.add_layer_ground("landing-site", GROUND, EPOCH_NS)
        for number in range(3):
            stamp = EPOCH_NS + number * 100_000_000
            writer.add_pose("uav1", stamp, [number, 0, 10], IDENTITY)
            layers = {"landing-site": LayerContent(SITES, LABELS)} if number < 2 else {}
            writer.add_frame("uav1", stamp, heatmap=CROWD_HEATMAP, layers=layers)
    return path


@pytest.mark.parametrize("name", ["crowd", "landing-site", "a1-2b"])
def test_names_of_layers(name):
    assert checked_layer(name) == name


@pytest.mark.parametrize("name", ["", "Landing", "landing_site", "-site", "site-", "a--b", "../x", "1a"])
def test_what_is_no_name_of_a_layer(name):
    with pytest.raises(ValueError, match="no name of a layer"):
        checked_layer(name)


def test_people_take_ground_away():
    # 5 x 5 cells of 1 m, somebody in the middle of cell (1, 1): those whose middle is nearer than 1.2 m.
    ground = LayerGround(np.ones((5, 5), np.bool_), 1.0, 0.0, 0.0, 1.2)
    left = ground.without(np.array([[1.5, 1.5, 7.0]]))
    taken = {(1, 1), (0, 1), (2, 1), (1, 0), (1, 2)}
    assert {tuple(cell) for cell in np.argwhere(~left)} == taken
    assert ground.cells.all()


def test_people_beside_the_grid_take_what_reaches_into_it():
    ground = LayerGround(np.ones((2, 2), np.bool_), 1.0, 0.0, 0.0, 1.1)
    left = ground.without(np.array([[-0.5, 0.5], [100.0, 100.0]]))
    assert np.argwhere(~left).tolist() == [[0, 0]]
    assert ground.without(np.empty((0, 3))).all()


def test_people_on_a_fine_grid_are_those_of_the_distance():
    rng = np.random.default_rng(3)
    ground = LayerGround(rng.random((40, 30)) < 0.8, 0.5, -3.0, 2.0, 2.3)
    feet = rng.uniform((-5.0, 0.0), (20.0, 20.0), (25, 2))
    x, y = -3.0 + (np.arange(40) + 0.5) * 0.5, 2.0 + (np.arange(30) + 0.5) * 0.5
    apart = np.hypot(x[:, None, None] - feet[:, 0], y[None, :, None] - feet[:, 1]).min(axis=2)
    assert np.array_equal(ground.without(feet), ground.cells & (apart >= 2.3))


def test_values_at_points():
    values = np.arange(12.0).reshape(3, 4)
    points = np.array([(-9.9, 20.1), (-8.6, 21.9), (-10.1, 20.1), (-8.4, 20.1), (np.nan, 20.1)])
    assert GROUND.values_at(values, points).tolist() == [0.0, 11.0, 0.0, 0.0, 0.0]


def test_a_mission_file_keeps_layers_apart(mission):
    recording = open_recording(mission)
    assert recording.warnings == () and recording.layers == ("landing-site",) and recording.layer == "crowd"
    sites = recording.of_layer("landing-site")
    assert sites.layer == "landing-site" and len(sites.frames) == 3
    first = sites.frames[0]
    assert np.array_equal(recording.frames[0].heatmap(), CROWD_HEATMAP)
    assert np.array_equal(first.heatmap(), SITES)
    assert np.array_equal(first.regions() > 0, LABELS)
    ground = recording.layer_grounds["landing-site"]
    assert np.array_equal(ground.cells, GROUND.cells)
    assert (ground.cell_m, ground.west_m, ground.south_m, ground.people_m) == (0.5, -10.0, 20.0, 1.25)


@pytest.mark.parametrize(
    ("turn", "cell", "told"),
    [
        ((0.7071, 0.0, 0.0, 0.7071), 100, "the grid is turned (x 0, y 0, z 0.7071, w 0.7071)"),
        (IDENTITY, -1, "a cell of the grid is -1; allowed: 0, not of the class, or 100"),
        (IDENTITY, 60, "a cell of the grid is 60; allowed: 0"),
        ((-1.0, 0.0, 0.0, 0.0), 0, None),  # the same as no turn
    ],
)
def test_a_grid_that_says_something_else_is_not_read_as_ours(monkeypatch, turn, cell, told):
    """A turned grid of another writer lay elsewhere; what it does not know was not of the class."""
    encode = ros2_messages.encode
    w, x, y, z = turn

    def changed(kind, message):
        message["info"]["origin"]["orientation"] = {"x": x, "y": y, "z": z, "w": w}
        message["data"][3] = cell
        return encode(kind, message)

    monkeypatch.setattr(ros2_messages, "encode", changed)
    data = encode_layer_ground(GROUND, EPOCH_NS)
    if told is None:
        assert decode_layer_ground(data, 0.0).west_m == -10.0
    else:
        with pytest.raises(ValueError) as refused:
            decode_layer_ground(data, 0.0)
        assert str(refused.value).startswith(told)


def test_a_frame_without_the_layer_is_refused_and_never_shows_crowds_instead(mission):
    last = open_recording(mission).of_layer("landing-site").frames[2]
    with pytest.raises(FrameError, match="no heatmap"):
        last.heatmap()


def test_a_layer_that_is_not_there(mission):
    with pytest.raises(ValueError, match=r"no heatmaps of the layer 'smoke'; it holds crowd, landing-site"):
        open_recording(mission).of_layer("smoke")


def test_a_layer_without_a_proper_name_is_not_written(tmp_path):
    with MissionWriter(tmp_path / "m.mcap") as writer:
        writer.add_camera("uav1", CAMERA)
        with pytest.raises(ValueError, match="no name of a layer"):
            writer.add_frame("uav1", EPOCH_NS, layers={"Landing_Site": LayerContent(SITES)})


def test_what_was_not_looked_at_is_not_written_as_empty(tmp_path):
    with MissionWriter(tmp_path / "m.mcap") as writer:
        writer.add_camera("uav1", CAMERA)
        with pytest.raises(ValueError, match="cells of a heatmap are masked"):
            writer.add_frame("uav1", EPOCH_NS, heatmap=np.ma.masked_less(SITES, 9))


def test_conversion_keeps_layers(mission, tmp_path):
    done = convert(open_recording(mission), tmp_path / "copy.mcap")
    copy = open_recording(done.path)
    assert done.omitted == [] and copy.layers == ("landing-site",)
    assert np.array_equal(copy.layer_grounds["landing-site"].cells, GROUND.cells)
    sites = copy.of_layer("landing-site").frames[1]
    assert np.array_equal(sites.heatmap(), SITES) and np.array_equal(sites.regions() > 0, LABELS)


def test_a_folder_with_a_layer(tmp_path):
    folder = tmp_path / "flight"
    for inside in ("heatmaps", "layers/landing-site", "layers/Not A Layer", "truth/layers/landing-site"):
        (folder / inside).mkdir(parents=True)
    camera = {"width": 32, "height": 24, "fx": 19.0, "fy": 19.0, "cx": 16.0, "cy": 12.0}
    (folder / "recording.json").write_text(json.dumps({"cameras": {"*": camera}}))
    rows = [f"uav1,{EPOCH_NS + step * 100_000_000},{step},0,10,1,0,0,0" for step in range(3)]
    (folder / "poses.csv").write_text("\n".join(["drone,stamp_ns,x,y,z,qw,qx,qy,qz", *rows]))
    Image.fromarray(CROWD_HEATMAP).save(folder / "heatmaps" / f"uav1_{EPOCH_NS}.png")
    for step in range(2):
        Image.fromarray(SITES).save(
            folder / "layers" / "landing-site" / f"uav1_{EPOCH_NS + step * 100_000_000}.png"
        )
    label = LABELS.astype(np.uint8)
    Image.fromarray(label).save(folder / "truth" / "layers" / "landing-site" / f"uav1_{EPOCH_NS}.png")
    recording = open_recording(folder)
    assert len(recording.warnings) == 1 and "Not A Layer is not read" in recording.warnings[0]
    # A frame that has the layer alone is one too.
    assert len(recording.frames) == 2 and recording.layers == ("landing-site",)
    first, second = recording.of_layer("landing-site").frames
    assert np.array_equal(first.heatmap(), SITES) and np.array_equal(second.heatmap(), SITES)
    assert np.array_equal(first.regions() > 0, LABELS) and second.pixels.regions is None
    np.save(folder / "layers" / "landing-site" / f"uav1_{EPOCH_NS}.npy", np.zeros((6, 8), np.float32))
    with pytest.raises(FrameError, match=rf"2 heatmaps for one frame: uav1_{EPOCH_NS}.npy, .*png; remove"):
        open_recording(folder).of_layer("landing-site").frames[0].heatmap()
