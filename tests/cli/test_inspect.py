"""`crowdfence inspect`, the real command: figures worked out by hand on small flights and maps."""

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from PIL import Image

from crowdfence import Camera, CrowdMap, Paper, Rates, Terrain, View, _core, landing_prior
from crowdfence.inspection.camera import CameraReport
from crowdfence.inspection.depth_agreement import depth_agreement
from crowdfence.inspection.recording import group_trouble
from crowdfence.inspection.timing import Timing
from crowdfence.inspection.view_overlap import share_of_smaller
from crowdfence.sources.recording import Frame, PixelSources, RefusedFrame
from support.command_line import crowdfence
from support.geo_key_files import write_las, write_tiff
from support.small_recordings import flight, write_airsim

EPOCH_NS = 1_760_000_000_000_000_000
MS = 1_000_000
GROUND_M = -0.5  # half way up the voxels, where an OctoMap does not say more
HEIGHT_M = 10.0  # above the ground
# Straight down from 10 m with 90 degrees: 20 x 20 m of ground, 20 x 20 pixels of one metre.
SIDE_PX = 20
LOOKING_DOWN = (0.0, 1.0, 0.0, 0.0)  # quaternion w x y z: x stays east, y becomes south, z down

# Side by side: alpha and bravo see the same ground, charlie half of it, delta another part, echo none.
EAST_M = {"alpha": 0.0, "bravo": 0.0, "charlie": 10.0, "delta": 40.0, "echo": 100.0}
# Frames 0, 100, 200, 500, 600 ms: median gap 100 ms, longest 300 ms, one above 150 ms, 4 gaps in 0.6 s.
FRAME_MS = (0, 100, 200, 500, 600)
DELAY_MS = {"alpha": 0, "bravo": 20, "charlie": 50, "delta": 0, "echo": 0}
SPEED_M_PER_S = 10.0


def inspect(*arguments: object) -> subprocess.CompletedProcess[str]:
    return crowdfence("inspect", *arguments, columns=100)


def report(*arguments: object) -> dict[str, Any]:
    done = inspect(*arguments, "--json")
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert isinstance(content, dict)
    return content


def error_line(*arguments: object) -> str:
    done = inspect(*arguments)
    assert done.returncode == 1
    assert done.stdout == ""
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("error: ")
    return lines[0]


def write_octomap(path: Path, terrain: Terrain) -> Path:
    path.write_bytes(_core.write_octomap_binary(terrain, np.arange(terrain.voxel_count)))
    return path


def plain() -> Terrain:
    """Level ground, voxels of 1 m from z = -1 to 0, from -60 to 60 m; echo flies beside it."""
    side = np.arange(-59.5, 60.0)
    east, north = (grid.ravel() for grid in np.meshgrid(side, side))
    return Terrain.from_points(np.stack([east, north, np.full(east.shape, GROUND_M)], axis=-1), 1.0)


def write_flight(folder: Path) -> Path:
    """Five drones fly north side by side. Telemetry of delta has a hole of 300 ms, with two frames in it."""
    heatmaps = folder / "heatmaps"
    heatmaps.mkdir(parents=True)
    lines = ["drone,stamp_ns,x,y,z,qw,qx,qy,qz"]
    for drone, east_m in EAST_M.items():
        for time_ms in range(-100, 801, 20):
            if drone == "delta" and 60 < time_ms < 360:
                continue
            north_m = SPEED_M_PER_S * (time_ms - DELAY_MS[drone]) / 1e3
            cells = [drone, EPOCH_NS + time_ms * MS, east_m, north_m, GROUND_M + HEIGHT_M, *LOOKING_DOWN]
            lines.append(",".join(map(str, cells)))
        for frame_ms in FRAME_MS:
            stamp_ns = EPOCH_NS + (frame_ms + DELAY_MS[drone]) * MS
            picture = Image.fromarray(np.zeros((5, 5), dtype=np.uint8))
            picture.save(heatmaps / f"{drone}_{stamp_ns}.png")
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    half = SIDE_PX / 2
    camera = {"width": SIDE_PX, "height": SIDE_PX, "fx": half, "fy": half, "cx": half, "cy": half}
    description = {"cameras": {"*": camera}, "terrain": "terrain/terrain.bt"}
    (folder / "recording.json").write_text(json.dumps(description))
    return folder


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_flight(tmp_path_factory.mktemp("inspect") / "flight")


@pytest.fixture(scope="module")
def with_terrain(recording: Path) -> dict[str, Any]:
    terrain = write_octomap(recording.parent / "plain.bt", plain())
    return report(recording, "--terrain", terrain, "--max-range-m", 50)


def drones_of(content: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {drone["drone"]: drone for drone in content["drones"]}


def test_time_span_and_instants(with_terrain: dict[str, Any]) -> None:
    assert with_terrain["kind"] == "folder"
    assert with_terrain["first_frame"] == "2025-10-09T08:53:20.000000000Z"
    assert with_terrain["duration_s"] == pytest.approx(0.650)  # alpha's first frame to charlie's last
    assert with_terrain["frames"] == 23
    instants = with_terrain["instants"]
    assert instants["count"] == 5
    # Delta's two refused frames are missing from two instants.
    assert instants["with_drones"] == {"1": 0, "2": 0, "3": 0, "4": 2, "5": 3}
    offsets = {tuple(offset["drones"]): offset for offset in instants["offsets"]}
    assert len(offsets) == 10
    assert offsets["alpha", "bravo"]["median_ms"] == 20.0
    assert offsets["bravo", "charlie"]["median_ms"] == 30.0
    assert offsets["charlie", "delta"] == {"drones": ["charlie", "delta"], "instants": 3, "median_ms": -50.0}


def test_rates_and_gaps(with_terrain: dict[str, Any]) -> None:
    drones = drones_of(with_terrain)
    alpha = drones["alpha"]["frames"]
    assert (alpha["count"], alpha["long_gaps"]) == (5, 1)
    assert (alpha["median_period_ms"], alpha["longest_gap_ms"]) == (100.0, 300.0)
    assert alpha["rate_hz"] == pytest.approx(4 / 0.6)
    telemetry = drones["alpha"]["telemetry"]
    assert (telemetry["count"], telemetry["longest_gap_ms"], telemetry["long_gaps"]) == (46, 20.0, 0)
    assert telemetry["rate_hz"] == pytest.approx(50.0)
    # Rows at 80, 100 .. 340 ms are missing: 14 of 46, and one gap from 60 to 360 ms.
    delta = drones["delta"]["telemetry"]
    assert (delta["count"], delta["longest_gap_ms"], delta["long_gaps"]) == (32, 300.0, 1)


def test_refused_frames_are_counted_by_reason(with_terrain: dict[str, Any]) -> None:
    (reason,) = with_terrain["refused"]
    assert (reason["count"], reason["drones"]) == (2, ["delta"])
    assert "gap of 0.300 s" in reason["first"]
    assert {name: drone["refused"] for name, drone in drones_of(with_terrain).items()} == {
        "alpha": 0, "bravo": 0, "charlie": 0, "delta": 2, "echo": 0,
    }  # fmt: skip


def test_flight_over_level_ground(with_terrain: dict[str, Any]) -> None:
    drones = drones_of(with_terrain)
    flown = drones["alpha"]["flight"]
    assert flown["tilt_below_horizon_deg"] == {"low": pytest.approx(90.0), "high": pytest.approx(90.0)}
    assert flown["speed_m_per_s"] == {"low": pytest.approx(10.0), "high": pytest.approx(10.0)}
    assert flown["height_above_terrain_m"] == {"low": pytest.approx(10.0), "high": pytest.approx(10.0)}
    assert flown["frames_beside_terrain"] == 0
    assert drones["echo"]["flight"]["height_above_terrain_m"] is None
    assert drones["echo"]["flight"]["frames_beside_terrain"] == 5


def test_camera_and_heatmap(with_terrain: dict[str, Any]) -> None:
    alpha = drones_of(with_terrain)["alpha"]
    (camera,) = alpha["cameras"]
    assert (camera["width"], camera["fx"], camera["model"], camera["distortion"]) == (20, 10.0, "pinhole", [])
    assert camera["hfov_deg"] == pytest.approx(90.0)
    assert camera["blind_pixels"] == 0
    assert alpha["heatmap"] == {"width": 5, "height": 5, "dtype": "uint8", "stride": 4.0}
    assert alpha["pixels"] == {"heatmaps": 5, "images": 0, "regions": 0, "silhouettes": 0, "depth": 0}


def test_overlap_of_views_by_hand(with_terrain: dict[str, Any]) -> None:
    overlap = with_terrain["overlap"]
    assert (overlap["max_range_m"], overlap["instants"]) == (50.0, 5)
    assert (overlap["overlapping_instants"], overlap["overlapping_share"]) == (5, 1.0)
    pairs = {tuple(pair["drones"]): pair for pair in overlap["pairs"]}
    assert pairs["alpha", "bravo"]["mean_share"] == 1.0
    assert pairs["alpha", "charlie"]["mean_share"] == 0.5  # 10 of 20 columns
    assert pairs["alpha", "delta"] == {"drones": ["alpha", "delta"], "instants": 3, "mean_share": 0.0}
    assert pairs["alpha", "echo"] == {"drones": ["alpha", "echo"], "instants": 0, "mean_share": None}


def test_of_a_large_fleet_the_pairs_that_share_most_are_shown(tmp_path: Path) -> None:
    """Seven drones in a row, 1 m apart, each of which sees 16 x 12 m: neighbours share 15 of 16 columns."""
    folder = tmp_path / "flight"
    (folder / "heatmaps").mkdir(parents=True)
    camera = {"width": 16, "height": 12, "fx": 10.0, "fy": 10.0, "cx": 8.0, "cy": 6.0}
    (folder / "recording.json").write_text(json.dumps({"cameras": {"*": camera}}))
    down = "0,1,0,0"  # half a turn about x: the camera's z axis points down
    drones = [f"uav{number}" for number in range(1, 8)]
    rows = [f"{drone},1000000000,{10 + at},20,10,{down}" for at, drone in enumerate(drones)]
    (folder / "poses.csv").write_text("\n".join(["drone,stamp_ns,x,y,z,qw,qx,qy,qz", *rows]))
    for drone in drones:
        Image.new("L", (16, 12)).save(folder / "heatmaps" / f"{drone}_1000000000.png")
    terrain = write_octomap(tmp_path / "plain.bt", plain())
    done = inspect(folder, "--terrain", terrain, "--assume-local")
    assert done.returncode == 0, done.stderr
    shown = [line for line in done.stdout.splitlines() if " and uav" in line]
    told = " ".join(done.stdout.split())
    assert len(shown) == 15 and "6 pairs that share less: --json" in told
    assert "instants 1 within 100 ms: 1 with 7 drones offsets" in told  # and none with fewer
    assert told.count(" +0.0 ms") == 15 and "(median within instants; 6 pairs closer: --json)" in told
    assert not [line for line in shown if "uav1 and uav7" in line or "uav1 and uav6" in line]
    assert len(report(folder, "--terrain", terrain, "--assume-local")["overlap"]["pairs"]) == 21


def test_drones_that_no_instant_holds_together_have_no_offset(tmp_path: Path) -> None:
    """Within 5 ms alpha, delta and echo belong together, bravo (20 ms later) and charlie (50 ms) to none."""
    folder = write_flight(tmp_path / "flight")
    told = " ".join(inspect(folder, "--tolerance-ms", 5).stdout.split())
    assert "alpha to delta +0.0 ms" in told and "bravo to" not in told and "to charlie" not in told
    for picture in (folder / "heatmaps").iterdir():
        if not picture.name.startswith(("alpha", "bravo")):
            picture.unlink()
    alone = " ".join(inspect(folder, "--tolerance-ms", 5).stdout.split())
    assert "instants 10 within 5 ms: 10 with 1 drone offsets none: no instant holds" in alone


def test_the_origin_that_is_given_is_where_the_recording_lies(recording: Path) -> None:
    """As `run` publishes it; the flight says nothing of it itself."""
    assert report(recording)["georeference"] is None
    place = {"latitude_deg": 46.5, "longitude_deg": 8.0, "height_m": 1200.0, "of_map": False}
    told = report(recording, "--origin", "46.5,8.0,1200")
    assert told["terrain"] is None and told["georeference"] == place
    terrain = write_octomap(recording.parent / "plain.bt", plain())
    assert report(recording, "-t", terrain, "--origin", "46.5,8.0,1200")["georeference"] == place


def test_overlap_is_a_share_of_the_smaller_view() -> None:
    small, large = np.array([3, 5]), np.array([1, 2, 3, 4])
    assert share_of_smaller(small, large) == share_of_smaller(large, small) == 0.5
    assert share_of_smaller(small, np.array([], dtype=np.int64)) is None


def test_fewer_samples_still_hold_the_first_and_the_last_instant(recording: Path) -> None:
    terrain = write_octomap(recording.parent / "plain.bt", plain())
    content = report(recording, "-t", terrain, "--max-range-m", 50, "--samples", 2)
    pairs = {tuple(pair["drones"]): pair["instants"] for pair in content["overlap"]["pairs"]}
    assert content["overlap"]["instants"] == 2
    assert pairs["alpha", "delta"] == 2  # delta is missing from the second and third of five


def test_the_flights_fit_a_terminal_of_80_columns(recording: Path) -> None:
    terrain = write_octomap(recording.parent / "plain.bt", plain())
    done = crowdfence("inspect", recording, "-t", terrain, columns=80)
    assert re.search(
        r"^ alpha +\S+ to \S+ +\S+ to \S+ +\S+ to \S+ +\d+ +\d+ +- *$", done.stdout, re.MULTILINE
    )


def test_the_text_names_every_drone_and_fits_the_page(recording: Path) -> None:
    terrain = write_octomap(recording.parent / "plain.bt", plain())
    done = inspect(recording, "-t", terrain, "--max-range-m", 50)
    assert done.returncode == 0, done.stderr
    assert max(map(len, done.stdout.splitlines())) <= 100
    assert all(done.stdout.count(drone) >= 5 for drone in EAST_M)
    assert "alpha and charlie         5                      50.0%" in done.stdout
    assert "3 with 5 drones" in done.stdout
    assert "refused 2 frames (delta), the first: delta at" in done.stderr


def test_a_named_map_that_is_not_there_is_a_warning(recording: Path) -> None:
    content = report(recording)
    assert content["terrain"] is None
    assert content["overlap"] is None
    assert drones_of(content)["alpha"]["flight"]["height_above_terrain_m"] is None
    assert any("terrain/terrain.bt" in warning for warning in content["warnings"])


@pytest.mark.parametrize("size", ["nan", "0.5"])
def test_what_was_asked_of_a_named_map_is_not_dropped(tmp_path: Path, size: str) -> None:
    """An OctoMap cannot be resampled; told what to do with it, `inspect` went on without the map."""
    flown = write_flight(tmp_path / "flight")
    (flown / "terrain").mkdir()
    write_octomap(flown / "terrain" / "terrain.bt", plain())
    assert report(flown, "--quick")["terrain"]["report"]["voxel_size_m"] == 1.0
    line = error_line(flown, "--quick", "--voxel-size-m", size)
    assert f"--voxel-size-m is {size}" in line


def test_drones_that_lie_hours_apart_are_told(tmp_path: Path) -> None:
    """As a run tells it, which refuses them; no zone of time is two and a half hours off another."""
    folder = write_flight(tmp_path / "flight")
    assert not [line for line in report(folder)["warnings"] if "clock" in line]
    poses = (folder / "poses.csv").read_text()
    late_ns = EPOCH_NS + 9_000_000 * MS
    for picture in (folder / "heatmaps").glob("echo_*.png"):
        stamp_ns = int(picture.stem.split("_")[1])
        picture.rename(picture.with_name(f"echo_{stamp_ns - EPOCH_NS + late_ns}.png"))
    lines = [line.split(",", 2) for line in poses.splitlines()]
    (folder / "poses.csv").write_text(
        "".join(
            f"{drone},{int(stamp) - EPOCH_NS + late_ns if drone == 'echo' else stamp},{rest}\n"
            for drone, stamp, rest in lines
        )
    )
    # charlie's last frame is 650 ms after the epoch, echo's first two and a half hours.
    (told,) = [line for line in report(folder)["warnings"] if "clock" in line]
    assert "echo" in told and "8999 s after charlie" in told
    shown = " ".join(inspect(folder).stderr.split())
    assert "warning: " in shown and "the bound --max-jump-s is 3600 s. Is a clock wrong?" in shown


def test_cameras_below_the_ground_are_told(recording: Path, tmp_path: Path) -> None:
    """The plain is straight above them. Two of 25 frames have no pose, five lie beside the plain."""
    side = np.arange(-59.5, 60.0)
    east, north = (grid.ravel() for grid in np.meshgrid(side, side))
    high = np.stack([east, north, np.full(east.shape, GROUND_M + HEIGHT_M + 30.5)], axis=-1)
    terrain = write_octomap(tmp_path / "high.bt", Terrain.from_points(high, 1.0))
    told = report(recording, "--terrain", terrain)["warnings"]
    assert any("the camera is below the map's ground in 18 of 23 frames" in line for line in told), told


@pytest.mark.parametrize(("size_m", "coarse"), [(2.0, False), (4.0, True)])
def test_a_map_too_coarse_for_people_is_told_below_a_recording(
    recording: Path, tmp_path: Path, size_m: float, coarse: bool
) -> None:
    """A run said it, after the flight had been found in order."""
    side = np.arange(-58.0, 60.0, size_m)
    east, north = (grid.ravel() for grid in np.meshgrid(side, side))
    level = np.stack([east, north, np.full(east.shape, GROUND_M)], axis=-1)
    terrain = write_octomap(tmp_path / "plain.bt", Terrain.from_points(level, size_m))
    told = report(recording, "--terrain", terrain, "--quick")["warnings"]
    assert any("voxels of 4 m are coarse for people" in line for line in told) is coarse, told


def test_a_map_somewhere_else_is_reported(recording: Path) -> None:
    terrain = write_octomap(recording.parent / "away.bt", Terrain.from_points([[5000.5, 0.5, 0.5]], 1.0))
    content = report(recording, "--terrain", terrain)
    assert "do not overlap" in content["terrain"]["problem"]
    assert content["overlap"]["overlapping_share"] == 0.0
    assert drones_of(content)["alpha"]["flight"]["frames_beside_terrain"] == 5


def test_damaged_pixels_are_found_when_asked_for(tmp_path: Path) -> None:
    folder = write_flight(tmp_path / "flight")
    heatmap = folder / "heatmaps" / f"bravo_{EPOCH_NS + 20 * MS}.png"
    heatmap.write_bytes(heatmap.read_bytes()[:40])
    assert report(folder, "--quick")["damaged"] is None
    content = report(folder, "--quick", "--check-pixels")
    (trouble,) = content["damaged"]
    assert (trouble["count"], trouble["drones"]) == (1, ["bravo"])
    assert content["frames"] == 23  # the frame is usable until its pixels are wanted


def test_pictures_that_show_nothing_are_found_when_asked_for(tmp_path: Path) -> None:
    """A run refuses them, after every pixel had been read and found in order."""
    folder = write_flight(tmp_path / "flight")
    (folder / "images").mkdir()
    for heatmap in sorted((folder / "heatmaps").iterdir()):
        drone, seed = heatmap.stem.split("_")[0], int(heatmap.stem[-9:])
        pixels = np.random.default_rng(seed).integers(0, 256, (SIDE_PX, SIDE_PX, 3), np.uint8)
        if drone == "bravo":
            pixels[:] = 7
        Image.fromarray(pixels).save(folder / "images" / heatmap.name)
    (trouble,) = report(folder, "--quick", "--check-pixels")["damaged"]
    assert (trouble["count"], trouble["drones"]) == (5, ["bravo"])
    assert "shows nothing but one tone (red 7, green 7, blue 7)" in trouble["first"]
    said = inspect(folder, "--quick", "--check-pixels").stderr
    assert "unusable 5 frames (bravo)" in " ".join(said.split())


def test_heatmaps_in_the_wrong_units_are_found_when_asked_for(tmp_path: Path) -> None:
    """Masks of 0 and 1, of which a run says that its crowds are probabilities of 0.4 %."""
    folder = write_flight(tmp_path / "flight")
    for heatmap in (folder / "heatmaps").glob("charlie_*.png"):
        mask = np.zeros((5, 5), np.uint8)
        mask[1:3, 1:4] = 1
        Image.fromarray(mask).save(heatmap)
    told = report(folder, "--quick", "--check-pixels")["warnings"]
    (line,) = [line for line in told if "masks of 0 and 1" in line]
    assert line.startswith("charlie: its 5 heatmaps") and "multiply them by 255" in line


def test_airsim_and_its_mission_file_agree(tmp_path: Path) -> None:
    from crowdfence.sources import open_recording
    from crowdfence.sources.convert import convert

    airsim = write_airsim(tmp_path / "airsim", flight())
    convert(open_recording(airsim), tmp_path / "flight.mcap")
    first, second = report(airsim), report(tmp_path / "flight.mcap")
    assert (first["kind"], second["kind"]) == ("airsim", "mission")
    assert first["terrain"]["given"] is False
    assert "dem.tif" in first["terrain"]["problem"]  # it holds no GeoTIFF
    for same in ("drones", "instants", "georeference", "first_frame", "last_frame", "refused"):
        assert first[same] == second[same]
    place = {"latitude_deg": 46.5, "longitude_deg": 8.0, "height_m": 1200.0, "of_map": False}
    assert first["georeference"] == place
    (camera,) = first["drones"][0]["cameras"]
    assert camera["hfov_deg"] == pytest.approx(80.0)
    assert first["drones"][0]["pixels"]["depth"] == 6


def test_field_of_view_beyond_half_a_turn() -> None:
    # Equidistant: angle = distance from the centre / f, 32 px / 20 px = 1.6 rad to either side.
    fisheye = CameraReport.of(Camera.fisheye(64, 48, 20.0, 20.0, 32.0, 24.0))
    assert fisheye.hfov_deg == pytest.approx(np.degrees(3.2))
    off_centre = CameraReport.of(Camera.pinhole(40, 20, 10.0, 10.0, 10.0, 10.0))
    assert off_centre.hfov_deg == pytest.approx(45.0 + np.degrees(np.arctan(3.0)))
    folded = CameraReport.of(Camera.pinhole(640, 480, 400.0, 400.0, 320.0, 240.0, [-0.9, 0, 0, 0]))
    assert folded.hfov_deg is None
    assert folded.blind_pixels > 0


def test_timing_of_too_few_stamps() -> None:
    assert Timing.of([]) == Timing(0, None, None, None, 0)
    assert Timing.of([5]) == Timing(1, None, None, None, 0)


def test_reasons_that_differ_in_numbers_are_one() -> None:
    reasons = ["stamp 12 repeats", "no camera", "stamp 345.5 repeats"]
    groups = group_trouble(RefusedFrame("a", 0, reason) for reason in reasons)
    assert [(group.count, group.first) for group in groups] == [
        (2, "a at 0: stamp 12 repeats"), (1, "a at 0: no camera"),
    ]  # fmt: skip


@pytest.mark.parametrize("error_m", [0.0, 0.5, -2.0])
def test_recorded_depth_against_terrain(error_m: float) -> None:
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = GROUND_M + HEIGHT_M
    camera = Camera.pinhole(20, 20, 10.0, 10.0, 10.0, 10.0)
    # Seen from above, every point of the plane has the same depth along the optical axis.
    depth_m = np.full((20, 20), HEIGHT_M + error_m, dtype=np.float32)
    depth_m[0] = np.nan
    frame = Frame("alpha", 0, camera, pose, PixelSources(depth_m=lambda: depth_m))
    agreement = depth_agreement([frame], plain(), 50.0)
    assert agreement is not None
    assert agreement.median_m == pytest.approx(error_m)
    assert agreement.median_absolute_m == pytest.approx(abs(error_m))
    assert agreement.rays == 19 * 20
    assert depth_agreement([frame], plain(), 5.0) is None  # nothing in range


def test_pixels_without_a_ray_leave_the_depth_of_the_others() -> None:
    """A barrel whose model ends before the corners: the frame is compared by the rest of it."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = GROUND_M + HEIGHT_M
    camera = Camera.pinhole(20, 20, 10.0, 10.0, 10.0, 10.0, [-0.2, 0.0, 0.0, 0.0])
    blind = camera.blind_pixel_count()
    assert 0 < blind < 200
    depth_m = np.full((20, 20), HEIGHT_M + 0.5, dtype=np.float32)
    frame = Frame("alpha", 0, camera, pose, PixelSources(depth_m=lambda: depth_m))
    agreement = depth_agreement([frame], plain(), 50.0)
    assert agreement is not None
    assert (agreement.frames, agreement.rays) == (1, 20 * 20 - blind)
    assert agreement.median_m == pytest.approx(0.5)


def test_octomap_with_a_roof(tmp_path: Path) -> None:
    occupied = np.zeros((30, 20, 6), dtype=np.bool_)
    occupied[:, :, 0] = True
    occupied[5:10, 4:8, 5] = True  # 20 columns have air between ground and roof
    occupied[0, 0, 1] = True  # a step is no overhang
    path = write_octomap(tmp_path / "house.bt", Terrain.from_occupancy(occupied, 0.5))
    content = report(path)
    assert content["kind"] == "OctoMap, occupancy only (.bt)"
    assert content["bytes"] == path.stat().st_size
    assert content["file"]["tree_type"] == "OcTree"
    terrain = content["terrain"]
    assert (terrain["voxels"], terrain["voxel_size_m"]) == (30 * 20 + 20 + 1, 0.5)
    assert (terrain["low_m"], terrain["high_m"]) == ([0.0, 0.0, 0.0], [15.0, 10.0, 3.0])
    assert terrain["georeference"] is None
    assert content["columns"] == {"columns": 600, "overhangs": 20, "overhang_share": pytest.approx(20 / 600)}
    assert content["tree_bytes_per_voxel"] == pytest.approx(content["tree_bytes"] / 621)
    text = inspect(path).stdout
    assert "600, 3.3% with overhangs" in text
    assert "15.0 x 10.0 x 3.0 m" in text


def test_landing_prior_or_the_reason_for_none(tmp_path: Path) -> None:
    flat = report(write_octomap(tmp_path / "flat.bt", plain()))
    assert flat["landing_prior"] is None
    assert "14400 of 14400 columns are suitable" in flat["no_landing_prior"]
    height_m = np.zeros((60, 60))
    height_m[40:] = 2.0 * np.arange(1, 21)[:, None]  # a third is a slope of 63 degrees
    terrain = Terrain.from_height_map(height_m, 1.0)
    content = report(write_octomap(tmp_path / "slope.bt", terrain))
    assert content["landing_prior"] == pytest.approx(landing_prior(terrain))
    assert 0.5 < content["landing_prior"] < 2 / 3  # the foot of the slope is no place to land either
    assert content["no_landing_prior"] is None
    assert report(tmp_path / "slope.bt", "--quick")["landing_prior"] is None


def test_geotiff_in_feet(tmp_path: Path) -> None:
    path = tmp_path / "feet.tif"
    profile = {
        "driver": "GTiff", "width": 4, "height": 3, "count": 1, "dtype": "float32", "nodata": -9999,
        "crs": "EPSG:2264", "transform": rasterio.transform.from_origin(2_000_000.0, 600_000.0, 10.0, 10.0),
    }  # fmt: skip
    with rasterio.open(path, "w", **profile) as dataset:
        dataset.write(np.full((3, 4), 1000.0, dtype=np.float32), 1)
    done = crowdfence("inspect", path, "--quick")
    assert done.returncode == 1 and done.stderr.strip() == (
        f"error: {path}: its coordinates are in US survey foot, and nothing says what its heights are in; "
        "pass --terrain-option height_unit=m, 'ft' or 'us-ft'"
    )
    with rasterio.open(path, "r+") as dataset:
        dataset.units = ("US survey foot",)
    content = report(path, "--quick")
    header = content["file"]
    assert (header["width_px"], header["height_px"], header["nodata"]) == (4, 3, "-9999")
    assert "EPSG:2264" in header["reference_system"]  # North Carolina in US survey feet
    assert header["metres_per_height"] == pytest.approx(1200 / 3937)
    assert content["terrain"]["georeference"]["height_m"] == 304.0  # 304.8 m, rounded down
    assert content["voxel_size_why"].startswith("finer than the file's pixels of 3 m")  # 10 ft, two digits
    assert content["terrain"]["voxel_size_m"] == 0.5


@pytest.mark.parametrize("suffix", ["tif", "las"])
def test_heights_whose_unit_the_file_leaves_unclear(tmp_path: Path, suffix: str) -> None:
    """It names NAVD88, which counts in metres, and survey feet beside it; who says which may look at it."""
    keys: dict[int, int | str] = {1024: 1, 1025: 1, 3072: 26910, 4096: 5103, 4099: 9003}
    path = tmp_path / f"a.{suffix}"
    if suffix == "tif":
        write_tiff(path, np.full((20, 20), 500.0), keys, west=500_000.0, north=5_150_000.0)
    else:
        east, north = np.mgrid[0:20, 0:20].reshape(2, -1) + 0.5
        points = np.column_stack([500_000.0 + east, 5_150_000.0 - north, np.full(east.shape, 500.0)])
        write_las(path, points, keys)
    assert "pass --terrain-option height_unit=m" in error_line(path)
    said = ("--terrain-option", "height_unit=us-ft", "--terrain-option", "height_offset_m=-20")
    content = report(path, "--quick", *said)
    assert content["terrain"]["georeference"]["height_m"] == 132.0  # 152.4 - 20, rounded down
    assert content["file"]["metres_per_height"] == "not clear"
    assert "NAVD88" in content["file"]["reference_system"] and "vertical_datum" not in content["file"]


def test_options_of_the_map_reader(tmp_path: Path) -> None:
    path = tmp_path / "local.tif"
    transform = rasterio.Affine(1.0, 0.0, 0.0, 0.0, -1.0, 30.0)
    profile = {"driver": "GTiff", "width": 40, "height": 30, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", **profile, transform=transform) as dataset:
        dataset.write(np.full((30, 40), 5.0, dtype=np.float32), 1)
    assert "no coordinate reference system" in error_line(path)
    content = report(path, "--quick", "--terrain-option", "assume_local=true", "--voxel-size-m", 2)
    assert content["file"]["reference_system"] == "none"
    assert (content["terrain"]["voxel_size_m"], content["terrain"]["voxels"]) == (2.0, 20 * 15)
    assert "up" in error_line(path, "--terrain-option", "up=y")  # an option of meshes


def write_holed(path: Path) -> Path:
    """A raster of 40 x 30 m in local metres, pixels of 1 m, with a hole of 3 x 2 m."""
    heights = np.full((30, 40), 5.0, dtype=np.float32)
    heights[10:12, 20:23] = -9999.0
    profile = {"driver": "GTiff", "width": 40, "height": 30, "count": 1, "dtype": "float32"}
    transform = rasterio.Affine(1.0, 0.0, 0.0, 0.0, -1.0, 30.0)
    with rasterio.open(path, "w", **profile, nodata=-9999.0, transform=transform) as dataset:
        dataset.write(heights, 1)
    return path


def test_what_only_recordings_can_use_is_refused_for_maps(tmp_path: Path) -> None:
    """It was passed over, so that a map seemed to be looked at as it was asked."""
    bt = write_octomap(tmp_path / "plain.bt", plain())
    assert "plain.bt is no recording: --alignment does not apply" in error_line(bt, "--alignment", "a.json")
    assert "plain.bt is no recording: --pose-noise does not apply" in error_line(bt, "--pose-noise", "1,1")


def test_ground_that_nobody_measured_is_told(tmp_path: Path, recording: Path) -> None:
    """Six pixels of 1200 were bridged."""
    path = write_holed(tmp_path / "holed.tif")
    local = ("--quick", "--assume-local", "--voxel-size-m", 1)
    terrain = report(path, *local)["terrain"]
    assert (terrain["unmeasured_m2"], terrain["unmeasured_share"]) == (6.0, 6 / 1200)
    assert "6 m2 (0.50%) that nobody measured" in " ".join(inspect(path, *local).stdout.split())
    below = report(recording, "--terrain", path, *local)["terrain"]["report"]
    assert (below["unmeasured_m2"], below["unmeasured_share"]) == (6.0, 6 / 1200)
    told = inspect(recording, "--terrain", path, *local).stdout
    assert "6 m2 (0.50%) that nobody measured" in " ".join(told.split())
    # What was left a hole is no ground.
    open_hole = report(path, *local, "--terrain-option", "max_hole_m2=0")["terrain"]
    assert (open_hole["unmeasured_m2"], open_hole["unmeasured_share"]) == (0.0, 0.0)
    whole = " ".join(inspect(path, *local, "--terrain-option", "max_hole_m2=0").stdout.split())
    assert "that nobody measured" not in whole


def test_lidar_and_mesh_headers(tmp_path: Path) -> None:
    import laspy
    from pyproj import CRS

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.01, 0.01, 0.01], [500_000.0, 0.0, 0.0]
    header.add_crs(CRS("EPSG:32632"))
    cloud = laspy.LasData(header)
    east, north = (grid.ravel() for grid in np.meshgrid(np.arange(20.0), np.arange(20.0)))
    cloud.x, cloud.y, cloud.z = 500_000 + east, 5_000_000 + north, np.full(400, 100.0)
    cloud.classification = np.full(400, 2, dtype=np.uint8)
    cloud.write(tmp_path / "ground.laz")
    facts = report(tmp_path / "ground.laz", "--quick")["file"]
    assert (facts["las_version"], facts["point_format"], facts["points"]) == ("1.4", 6, 400)
    assert "EPSG:32632" in facts["reference_system"]

    ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    ply += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "roof.ply").write_text(ply + "0 0 1\n4 0 1\n0 4 1\n3 0 1 2\n")
    facts = report(tmp_path / "roof.ply", "--quick")["file"]
    assert facts == {"format": "ascii", "vertex_count": 3, "face_count": 1}


@pytest.fixture
def crowd_map(tmp_path: Path) -> Path:
    """One look from 10 m at 400 of the plain's 14400 voxels, all crowd, and its map beside it."""
    terrain = Terrain.open(write_octomap(tmp_path / "plain.bt", plain()))
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = GROUND_M + HEIGHT_M
    camera = Camera.pinhole(20, 20, 10.0, 10.0, 10.0, 10.0)
    method = Paper(Rates(0.9, 0.05), 0.2, alpha=1.0, fleet_size=1)
    fused = CrowdMap(terrain, method)
    for stamp_ns in (EPOCH_NS, EPOCH_NS + 500 * MS):
        fused.integrate([View("alpha", stamp_ns, camera, pose, np.ones((20, 20)))], stamp_ns)
    fused.save(tmp_path / "state.crowdmap")
    return tmp_path / "state.crowdmap"


def test_crowd_map_without_and_with_its_terrain(crowd_map: Path) -> None:
    head = report(crowd_map)
    terrain = report(crowd_map.with_name("plain.bt"), "--quick")["terrain"]
    assert (head["version"], head["terrain_voxels"], head["content"]) == (8, 14_400, None)
    assert head["terrain_fingerprint"] == terrain["fingerprint"]
    assert "--terrain" in inspect(crowd_map).stdout
    content = report(crowd_map, "--terrain", crowd_map.with_name("plain.bt"))["content"]
    assert (content["instants"], content["duration_s"], content["fleet_size"]) == (2, 0.5, 1)
    assert content["first_instant"] == "2025-10-09T08:53:20.000000000Z"
    others = dict.fromkeys(("occluded", "empty", "stale", "not_cleared"), 0)
    assert content["states"] == {"never_seen": 14_000, "crowd": 400, **others}
    # One drone, m = 1, weight 1: P(A = 1 | b = 1) = 0.9 * 0.2 / (0.9 * 0.2 + 0.05 * 0.8).
    assert content["highest_probability"] == pytest.approx(0.18 / 0.22)


def test_crowd_map_on_another_terrain(crowd_map: Path) -> None:
    other = write_octomap(crowd_map.with_name("other.bt"), Terrain.from_points([[0.5, 0.5, 0.5]], 1.0))
    assert "other.bt" in error_line(crowd_map, "--terrain", other)


def test_what_cannot_be_inspected_is_one_line(tmp_path: Path, recording: Path) -> None:
    assert "nowhere.bt: No such file" in error_line(tmp_path / "nowhere.bt")
    (tmp_path / "notes.txt").write_text("hello")
    assert "notes.txt is none of" in error_line(tmp_path / "notes.txt")
    (tmp_path / "film.SRT").write_text("1\n")
    assert "it is the log of a film, which is named instead" in error_line(tmp_path / "film.SRT")
    (tmp_path / "empty").mkdir()
    assert "holds no recording" in error_line(tmp_path / "empty")
    (tmp_path / "empty" / "zone_history.jsonl").write_text("{}")
    assert "results of a run: `crowdfence explain`" in error_line(tmp_path / "empty")
    (tmp_path / "short.crowdmap").write_bytes(b"CROWDMAP")
    assert "short.crowdmap" in error_line(tmp_path / "short.crowdmap")
    path = write_octomap(tmp_path / "plain.bt", plain())
    path.write_bytes(path.read_bytes()[:-20])
    assert "plain.bt" in error_line(path)
    assert "plain.bt" in error_line(recording, "--terrain", path)


def test_usage_errors_have_their_own_code(recording: Path) -> None:
    assert inspect(recording, "--samples", 0).returncode == 2
    assert inspect().returncode == 2
