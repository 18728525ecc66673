"""What is said about crowd that met no ground."""

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import crowdfence as cf
from crowdfence import CrowdMass
from crowdfence.config import EvidenceConfig, MethodConfig, OrConfig, PaperConfig, RunConfig, ZoneConfig
from crowdfence.exports.frames_csv import FrameRow
from crowdfence.pipeline.lost_crowd import LOST, lost_crowd_warning, lost_crowd_warnings, shares


def test_every_fate_but_ground_has_advice_and_a_column() -> None:
    assert ["ground", *LOST] == list(CrowdMass().by_fate())
    columns = {field.name for field in fields(FrameRow)}
    assert {f"crowd_{fate}" for fate in LOST} <= columns


def test_shares_add_up_to_one_where_there_is_crowd() -> None:
    told = shares(CrowdMass(ground=3.0, hole=1.0))
    assert told == {**dict.fromkeys(LOST, 0.0), "ground": 0.75, "hole": 0.25}
    assert shares(CrowdMass()) == dict.fromkeys(["ground", *LOST])


def test_drones_that_lose_more_than_a_hundredth_are_named_largest_loss_first() -> None:
    masses = {
        "uav1": CrowdMass(ground=99.0, sky=1.0),
        "uav2": CrowdMass(ground=98.0, out_of_range=0.5, sky=1.46, hole=0.04),
        "uav3": CrowdMass(),
        "uav4": CrowdMass(unusable=7.0),
    }
    two, four = lost_crowd_warnings(masses)
    assert two == (
        "uav2: 2.0% of the crowd it shows is not on the map: 1.5% lies above the horizon (false alarms of "
        "the detector, or a wrong attitude), 0.5% meets ground beyond the range (raise --max-range-m)"
    )
    assert lost_crowd_warning("uav2", masses["uav2"]) == two
    assert lost_crowd_warning("uav1", masses["uav1"]) is None
    assert four.startswith("uav4: 100.0% of the crowd it shows is not on the map: 100.0% has no ray")


def hovering(folder: Path, heatmap: int, *, frames: int = 3, every_ns: int = 10**8) -> cf.Recording:
    """Frames of one drone 20 m above a plain, with a crowd in the middle of each."""
    (folder / "heatmaps").mkdir()
    pixels = np.zeros((48, 64), np.uint8)
    pixels[10:30, 20:40] = heatmap
    rows = ["drone,stamp_ns,x,y,z,qw,qx,qy,qz"]
    for stamp_ns in range(10**18, 10**18 + frames * every_ns, every_ns):
        rows.append(f"a,{stamp_ns},30,30,20,0,1,0,0")
        Image.fromarray(pixels).save(folder / "heatmaps" / f"a_{stamp_ns}.png")
    (folder / "poses.csv").write_text("\n".join(rows) + "\n")
    intrinsics = {"width": 640, "height": 480, "fx": 400, "fy": 400, "cx": 320, "cy": 240}
    (folder / "recording.json").write_text(json.dumps({"cameras": {"*": intrinsics}}))
    return cf.open_recording(folder)


@pytest.mark.parametrize(
    "config",
    [
        RunConfig(zones=ZoneConfig(threshold=1.0)),
        RunConfig(EvidenceConfig(doubt=1e300)),
        RunConfig(EvidenceConfig(sharp_gsd_m=1e-300)),
        RunConfig(EvidenceConfig(zone_log_odds=12.0)),
        RunConfig(PaperConfig(prior=0.2, alpha=1e-300)),
    ],
)
def test_crowd_that_no_setting_lets_become_one_is_told(tmp_path: Path, config: RunConfig) -> None:
    """Nothing is closed, and the files look like those of a flight over empty ground."""
    plain = cf.Terrain.from_height_map(np.zeros((60, 60)), cell_size_m=1.0)
    found = cf.run(hovering(tmp_path, 255), plain, config)
    assert not found.zones
    (warning,) = (one for one in found.warnings if "no ground ever reached" in one)
    assert f"no ground ever reached P >= {found.threshold:.3g}" in warning


@pytest.mark.parametrize(
    ("config", "heatmap"),
    [(RunConfig(), 255), (RunConfig(), 0), (RunConfig(zones=ZoneConfig(min_area_m2=1e9)), 255)],
)
def test_crowd_that_became_one_or_was_not_there_is_not(
    tmp_path: Path, config: RunConfig, heatmap: int
) -> None:
    """Regions that are too small for a zone are told by their area."""
    plain = cf.Terrain.from_height_map(np.zeros((60, 60)), cell_size_m=1.0)
    warnings = cf.run(hovering(tmp_path, heatmap), plain, config).warnings
    assert not any("no ground ever reached" in one for one in warnings)


def test_crowd_that_one_look_by_itself_closes_is_not(tmp_path: Path) -> None:
    """The other drone sees nobody there, so that in the mean no ground is crowd: 4 m2 are closed all the
    same, and were called closed by nothing."""
    (tmp_path / "heatmaps").mkdir()
    shown = np.zeros((48, 64), np.uint8)
    shown[22:26, 30:34] = 242  # of half a metre each
    rows = ["drone,stamp_ns,x,y,z,qw,qx,qy,qz"]
    for stamp_ns in (10**18, 10**18 + 10**8):
        for drone, pixels in (("a", shown), ("b", np.zeros_like(shown))):
            rows.append(f"{drone},{stamp_ns},30,30,20,0,1,0,0")
            Image.fromarray(pixels).save(tmp_path / "heatmaps" / f"{drone}_{stamp_ns}.png")
    (tmp_path / "poses.csv").write_text("\n".join(rows) + "\n")
    intrinsics = {"width": 640, "height": 480, "fx": 400, "fy": 400, "cx": 320, "cy": 240}
    (tmp_path / "recording.json").write_text(json.dumps({"cameras": {"*": intrinsics}}))
    plain = cf.Terrain.from_height_map(np.zeros((60, 60)), cell_size_m=1.0)
    found = cf.run(cf.open_recording(tmp_path), plain)
    (zone,) = found.zones
    assert zone.area_m2 == 4.0 and zone.probability_max < found.threshold
    assert not any("nothing was closed" in one for one in found.warnings)


@pytest.mark.parametrize("method", [OrConfig(b_threshold=0.97), PaperConfig(prior=0.2, b_threshold=0.97)])
def test_crowd_below_the_threshold_of_the_methods_own_is_told(tmp_path: Path, method: MethodConfig) -> None:
    """242 of 255 is .949, at every look of a flight over 3.5 s."""
    plain = cf.Terrain.from_height_map(np.zeros((60, 60)), cell_size_m=1.0)
    run = cf.run(hovering(tmp_path, 242, frames=8, every_ns=5 * 10**8), plain, RunConfig(method))
    assert not run.zones.closed
    assert any("every look of a shows crowd on" in one and "nothing is closed" in one for one in run.warnings)


def test_crowd_beside_a_zone_that_no_look_brings_above_the_threshold_is_told(tmp_path: Path) -> None:
    """Two groups below one drone for 4 s, one shown at .95 and one at .6, and a threshold that only the first
    reaches."""
    plain = cf.Terrain.from_height_map(np.zeros((60, 60)), cell_size_m=1.0)
    (tmp_path / "heatmaps").mkdir()
    pixels = np.zeros((48, 64), np.uint8)
    pixels[10:20, 10:20], pixels[30:40, 44:54] = 242, 153
    rows = ["drone,stamp_ns,x,y,z,qw,qx,qy,qz"]
    for stamp_ns in range(10**18, 10**18 + 4 * 10**9, 5 * 10**8):
        rows.append(f"a,{stamp_ns},30,30,20,0,1,0,0")
        Image.fromarray(pixels).save(tmp_path / "heatmaps" / f"a_{stamp_ns}.png")
    (tmp_path / "poses.csv").write_text("\n".join(rows) + "\n")
    intrinsics = {"width": 640, "height": 480, "fx": 400, "fy": 400, "cx": 320, "cy": 240}
    (tmp_path / "recording.json").write_text(json.dumps({"cameras": {"*": intrinsics}}))
    # By the shipped calibration looks at .95 leave log odds of 5.5 above the prior, those at .6 of 3.7.
    found = cf.run(cf.open_recording(tmp_path), plain, RunConfig(EvidenceConfig(zone_log_odds=4.5)))
    (zone,) = found.zones
    assert zone.cell_count == 25
    (warning,) = (one for one in found.warnings if "shows crowd" in one)
    # 10 pixels of half a metre each way; the middle of the picture is 30 m east and north, and north is up.
    assert warning.startswith(
        "3.0 s after the first instant every look of a shows crowd on 25 m2 of the map, around 38 m east and "
        "24 m north, and none of it reaches P >= "
    ), warning


@pytest.mark.parametrize(("walks_cells", "is_told"), [(1, True), (6, False)])
def test_a_group_that_walks_away_from_every_zone_is_told(
    tmp_path: Path, walks_cells: int, is_told: bool
) -> None:
    """90 m up a cell of the heatmap is 2.25 m of ground, and one every .75 s are 3 m/s: what was seen empty
    before outweighs the three looks that a place of the group gets. Alarms that leap by 13 m are no group."""
    plain = cf.Terrain.from_height_map(np.zeros((200, 200)), cell_size_m=1.0)
    (tmp_path / "heatmaps").mkdir()
    rows = ["drone,stamp_ns,x,y,z,qw,qx,qy,qz"]
    for number in range(20):
        stamp_ns = 10**18 + number * 750_000_000
        pixels = np.zeros((48, 64), np.uint8)
        east = 5 + number * walks_cells % 50
        pixels[22:26, east : east + 3] = 153
        rows.append(f"a,{stamp_ns},100,100,90,0,1,0,0")
        Image.fromarray(pixels).save(tmp_path / "heatmaps" / f"a_{stamp_ns}.png")
    (tmp_path / "poses.csv").write_text("\n".join(rows) + "\n")
    intrinsics = {"width": 640, "height": 480, "fx": 400, "fy": 400, "cx": 320, "cy": 240}
    (tmp_path / "recording.json").write_text(json.dumps({"cameras": {"*": intrinsics}}))
    found = cf.run(cf.open_recording(tmp_path), plain)
    assert not found.zones, "it left the zone of the first looks"
    assert any("every look of a shows crowd on" in one for one in found.warnings) == is_told
