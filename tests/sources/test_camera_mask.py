"""Parts of a drone in its own pictures hide ground: it was not looked at, and is never called empty."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image
from typer.testing import CliRunner

import crowdfence as cf
from crowdfence import VoxelState
from crowdfence.cli.app import app
from crowdfence.evaluation.replay import CellCounter
from crowdfence.exports.octomap import write_terrain_octomap
from crowdfence.sources.camera_mask import CameraMask
from crowdfence.sources.masked_drones import camera_masks, with_camera_masks
from crowdfence.sources.recording import Frame, Instant, InstantViews
from support.small_recordings import EPOCH_NS
from support.small_service import CONFIG, plain, recording, views

LEFT = np.arange(16)[None, :].repeat(12, axis=0) < 8
"""Of the pictures of the small fleet, 16 x 12."""


def write_flight(folder: Path) -> Path:
    """A camera 10 m above (10, 10) that looks straight down at 10 x 10 m and shows nobody."""
    (folder / "heatmaps").mkdir(parents=True)
    Image.fromarray(np.zeros((10, 10), np.uint8)).save(folder / "heatmaps" / f"uav1_{EPOCH_NS}.png")
    pose = f"uav1,{EPOCH_NS},10,10,10,0,1,0,0"
    (folder / "poses.csv").write_text(f"drone,stamp_ns,x,y,z,qw,qx,qy,qz\n{pose}\n")
    camera = {"width": 100, "height": 100, "fx": 100, "fy": 100, "cx": 50, "cy": 50}
    (folder / "recording.json").write_text(json.dumps({"cameras": {"uav1": camera}}))
    return folder


def write_mask(path: Path, hidden: NDArray[np.bool_]) -> Path:
    Image.fromarray(np.where(hidden, 0, 255).astype(np.uint8)).save(path)
    return path


def test_a_cell_that_reaches_into_what_is_hidden_is_hidden() -> None:
    hidden = np.zeros((4, 6), bool)
    hidden[1, 3] = True
    mask = CameraMask(hidden)
    assert np.argwhere(mask.cells(2, 3)).tolist() == [[0, 1]]
    assert np.argwhere(mask.cells(8, 12)).tolist() == [[2, 6], [2, 7], [3, 6], [3, 7]]
    # Rows of 4/3 pixels: the first two touch row 1.
    assert np.argwhere(mask.cells(3, 6)).tolist() == [[0, 3], [1, 3]]
    assert mask.cells(1, 1).tolist() == [[True]]
    assert mask.share == pytest.approx(1 / 24)


@given(
    arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))),
    st.integers(1, 30),
    st.integers(1, 30),
)
def test_cells_are_hidden_as_counted_pixel_by_pixel(
    hidden: NDArray[np.bool_], rows: int, columns: int
) -> None:
    hidden[0, 0], hidden[-1, -1] = True, hidden.size == 1
    if not 0 < hidden.mean() <= 0.6:
        return
    height, width = hidden.shape
    expected = np.zeros((rows, columns), bool)
    for y, x in np.argwhere(hidden):
        for r in range(rows):
            for c in range(columns):
                # Half-open intervals in units of 1 / (rows * height) overlap.
                down = r * height < (y + 1) * rows and y * rows < (r + 1) * height
                across = c * width < (x + 1) * columns and x * columns < (c + 1) * width
                expected[r, c] |= down and across
    np.testing.assert_array_equal(CameraMask(hidden).cells(rows, columns), expected)


def test_what_was_masked_before_stays_masked() -> None:
    mask = CameraMask(LEFT)
    before = np.ma.masked_array(np.full((12, 16), 0.5), np.zeros((12, 16), bool))
    before[3, 12] = np.ma.masked
    found = np.ma.getmaskarray(mask.over(before, 640, 480))
    assert found[:, :8].all() and np.argwhere(found[:, 8:]).tolist() == [[3, 4]]
    assert np.ma.getmaskarray(before).sum() == 1  # what the caller gave is his


def test_hidden_ground_is_not_seen_and_never_empty() -> None:
    """Left is west: of 10 x 10 m below a camera that is 10 m up half were looked at."""
    terrain = cf.Terrain.from_height_map(np.zeros((20, 20)), cell_size_m=1.0)
    camera = cf.Camera.pinhole(width=100, height=100, fx=100, fy=100, cx=50, cy=50)
    pose = np.array([[1.0, 0, 0, 10], [0, -1, 0, 10], [0, 0, -1, 10], [0, 0, 0, 1]])
    hidden = np.zeros((50, 50), bool)
    hidden[:, :25] = True
    frame = Frame("uav1", EPOCH_NS, camera, pose, mask=CameraMask(hidden))
    method = cf.EvidenceConfig().fusion_method(terrain, drones=1)
    crowd_map = cf.CrowdMap(terrain, method, max_range_m=50.0)
    for k in range(20):
        crowd_map.integrate([frame.view(np.zeros((10, 10), np.float32))], EPOCH_NS + k)
    state = crowd_map.state(EPOCH_NS + 19)
    seen = terrain.voxel_indices(np.flatnonzero(state != VoxelState.NEVER_SEEN))
    assert sorted(map(tuple, seen[:, :2])) == [(x, y) for x in range(10, 15) for y in range(5, 15)]


def test_the_command_line_masks_a_drone(tmp_path: Path) -> None:
    flight, out = write_flight(tmp_path / "flight"), tmp_path / "out"
    ground = cf.Terrain.from_height_map(np.zeros((20, 20)), cell_size_m=1.0)
    write_terrain_octomap(tmp_path / "plain.bt", ground)
    hidden = np.zeros((100, 100), bool)
    hidden[80:] = True  # the lowest fifth
    file = write_mask(tmp_path / "legs.png", hidden)
    words = ["run", str(flight), "-t", str(tmp_path / "plain.bt"), "-o", str(out), "--detector", "recorded"]
    done = CliRunner().invoke(app, [*words, "--method", "or", "--camera-mask", f"uav1={file}"])
    assert done.exit_code == 0, done.exception
    summary = json.loads((out / "summary.json").read_text())
    assert summary["hidden_by_camera_mask"] == {"uav1": 0.2}
    assert (summary["terrain"]["seen_voxels"], summary["area_m2"]["empty"]) == (80, 80.0)
    for wrong, told in (
        ("legs.png", "must be DRONE=FILE, such as uav1=legs.png"),
        (f"uav9={file}", "'uav9'; flight holds uav1"),
        (f"uav1={tmp_path / 'none.png'}", "none.png"),
        (f"uav1={tmp_path / 'plain.bt'}", "plain.bt"),
    ):
        failed = CliRunner().invoke(app, [*words, "--force", "--camera-mask", wrong])
        assert failed.exit_code != 0 and told in str(failed.exception), wrong
    twice = [*words, "--force", "--camera-mask", f"uav1={file}", "--camera-mask", f"uav1={file}"]
    assert "gives uav1 two masks" in str(CliRunner().invoke(app, twice).exception)


def test_masks_that_cannot_be_meant_are_refused(tmp_path: Path) -> None:
    flight = write_flight(tmp_path / "flight")
    whole = np.zeros((10, 10), bool)
    for hidden, told in (
        (whole, "hides 0.0%"),
        (~whole, "hides 100.0% .* black hides, white shows"),
        (np.arange(200).reshape(10, 20) < 20, "20 x 10, and pictures of 100 x 100 have other proportions"),
        (np.ones((2, 2, 3), bool), r"shape \(2, 2, 3\)"),
        (np.ones((2, 2)), "float64"),
    ):
        with pytest.raises(ValueError, match=told):
            cf.open_recording(flight, camera_masks={"uav1": hidden})
    colours = Image.fromarray(np.where(LEFT, 1, 0).astype(np.uint8), mode="P")
    colours.putpalette([255, 255, 255, 0, 0, 0])  # white is number 0
    colours.save(tmp_path / "palette.png")
    np.testing.assert_array_equal(CameraMask.open(tmp_path / "palette.png").hidden, LEFT)


def test_rates_are_of_the_cells_that_were_looked_at() -> None:
    flown = with_camera_masks(recording(views(1, ["uav1"])), camera_masks({"uav1": LEFT}))
    labels = np.zeros((12, 16), np.uint8)
    labels[:, 6:10] = 1  # half of them in the hidden part
    (frame,) = flown.frames
    labelled = replace(frame, pixels=replace(frame.pixels, regions=lambda: labels))
    heatmap = np.zeros((12, 16))
    heatmap[:, 7:9] = 1.0
    counter = CellCounter()
    counter.add(Instant(frame.stamp_ns, (labelled,)), InstantViews([labelled.view(heatmap)], []))
    assert (counter.counts.positives, counter.counts.true_positives) == (2 * 12, 12)
    assert (counter.counts.negatives, counter.counts.false_positives) == (6 * 12, 0)


def test_two_drones_see_for_each_other() -> None:
    """The masked one adds nothing to what the other sees of the ground behind its leg."""
    flown = recording(views(5))
    masked = with_camera_masks(flown, camera_masks({"uav1": LEFT}))
    whole, part = (cf.run(one, plain(), CONFIG) for one in (flown, masked))
    others = cf.run(recording([one for one in views(5) if one.drone != "uav1"]), plain(), CONFIG)
    assert (part.crowd_map.seen() <= whole.crowd_map.seen()).all()
    assert (part.crowd_map.seen() >= others.crowd_map.seen()).all()
    assert others.crowd_map.seen().sum() < part.crowd_map.seen().sum() < whole.crowd_map.seen().sum()
