"""The real command line on small recordings: results, messages and exit codes."""

import csv
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image
from shapely.geometry import shape

from crowdfence import CrowdMap, Terrain, VoxelState, _core, open_recording
from crowdfence.cli.demo import RECORDING, serve_command
from crowdfence.cli.evaluate import _label, _rates
from crowdfence.cli.made_by import method_line
from crowdfence.config import PaperConfig, RunConfig
from crowdfence.evaluation.cells.rates import Confusion
from support.command_line import FEW_FILES, commands, crowdfence
from support.small_recordings import EPOCH_NS, STARTS, flight, ground, write_airsim, write_folder

FAILED, USAGE, GATE_NOT_MET = 1, 2, 3
RECORDED = ("--detector", "recorded")
"""The recordings here have pictures and heatmaps; their pictures show nothing."""


@pytest.fixture(scope="module")
def airsim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_airsim(tmp_path_factory.mktemp("flight") / "recording", flight())
    terrain = Terrain.from_points(ground(), 2.0)
    bt = _core.write_octomap_binary(terrain, np.arange(terrain.voxel_count))
    (folder / "terrain" / "terrain.bt").write_bytes(bt)
    return folder


@pytest.fixture(scope="module")
def mission(airsim: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mission") / "flight.mcap"
    done = crowdfence("convert", airsim, "-o", path, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["frames"] == dict.fromkeys(STARTS, 6)
    return path


def error_line(done: subprocess.CompletedProcess[str], code: int = FAILED) -> str:
    """The one line that a failed command prints."""
    assert done.returncode == code, done.stderr
    assert done.stdout == ""
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    return lines[0]


def test_both_forms_of_a_recording_give_the_same_map(airsim: Path, mission: Path, tmp_path: Path) -> None:
    terrain_path = airsim / "terrain" / "terrain.bt"
    for recording, output in ((airsim, "airsim"), (mission, "mission")):
        done = crowdfence(
            "run", recording, "-t", terrain_path, "-o", tmp_path / output, "--prior", 0.2, *RECORDED,
            *FEW_FILES, "--files", "crowd_map.crowdmap",
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    terrain = Terrain.open(terrain_path)
    maps = [
        CrowdMap.load(tmp_path / output / "crowd_map.crowdmap", terrain) for output in ("airsim", "mission")
    ]
    assert maps[0].seen().sum() > 100
    assert maps[0].to_bytes() == maps[1].to_bytes()
    rows = [(tmp_path / output / "frames.csv").read_bytes() for output in ("airsim", "mission")]
    assert rows[0] == rows[1]


def test_convert_replaces_a_file_only_by_force(airsim: Path, mission: Path, tmp_path: Path) -> None:
    output = tmp_path / "old.mcap"
    output.write_text("mine")
    assert "old.mcap exists; --force replaces it" in error_line(crowdfence("convert", airsim, "-o", output))
    assert output.read_text() == "mine"
    assert crowdfence("convert", airsim, "-o", output, "--force").returncode == 0
    assert output.read_bytes() == mission.read_bytes()
    before = output.read_bytes()
    line = error_line(crowdfence("convert", output, "-o", output, "--force"))
    assert "is read for this" in line and output.read_bytes() == before


def test_a_run_writes_what_it_says(airsim: Path, tmp_path: Path) -> None:
    output = tmp_path / "new" / "folder"
    done = crowdfence("run", airsim, *RECORDED, "-o", output, "--method", "or", "--json")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    summary = json.loads(done.stdout)
    assert summary == json.loads((output / "summary.json").read_text())
    assert summary["frames"] == dict.fromkeys(STARTS, 6)
    assert summary["method"] == "or"
    assert summary["threshold"] == 0.5

    rows = list(csv.DictReader((output / "frames.csv").open()))
    assert len(rows) == summary["instants"] == 6
    assert int(rows[-1]["voxels_seen_so_far"]) == summary["terrain"]["seen_voxels"]
    zones = json.loads((output / "zones.geojson").read_text())
    assert len(zones["features"]) == len(summary["zones"]) == int(rows[-1]["zones"])
    # Who saw the crowd is written with each zone, by name.
    seen_by = [zone["properties"]["seen_by"] for zone in zones["features"]]
    assert all(drones == sorted(drones) and drones for drones in seen_by)
    assert {drone for drones in seen_by for drone in drones} <= set(STARTS)
    # Crowd area in the table, the raster and the zones is one and the same.
    with rasterio.open(output / "crowd_map.tif") as raster:
        crowd_cells = int((raster.read(2) == VoxelState.CROWD).sum())
    assert (
        float(rows[-1]["crowd_area_m2"]) == crowd_cells * 4.0 == sum(z["area_m2"] for z in summary["zones"])
    )
    for name in ("crowd_map.png", "terrain.bt", "crowd_map.ot", "crowd_map.crowdmap"):
        assert (output / name).stat().st_size > 100


def test_an_exported_file_tells_the_same_of_the_run_as_its_own_files(airsim: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    common = ("run", airsim, *RECORDED, *FEW_FILES)
    assert crowdfence(*common, "-o", out, "--off-threshold", 0.02).returncode == 0
    assert crowdfence("export", out, "-f", "geojson", "-o", tmp_path / "zones.geojson").returncode == 0
    exported, written = (
        json.loads((folder / "zones.geojson").read_text())["crowdfence"] for folder in (tmp_path, out)
    )
    assert exported == written
    header = json.loads((out / "zone_history.jsonl").read_text().splitlines()[0])
    rules = header["zone_rules"]
    assert (rules["threshold"], rules["off_threshold"]) == (exported["threshold"], 0.02)


def test_the_summary_and_the_report_tell_all_that_shaped_the_zones(airsim: Path, tmp_path: Path) -> None:
    """Zones from 50 m up and ground around the crowd stood in neither, nor that the poses were smoothed."""
    out = tmp_path / "out"
    shape = ("--buffer", "fixed:distance_m=7", "--lower-m", 50, "--restriction", "no_sustained_flight")
    assert crowdfence("run", airsim, *RECORDED, "-o", out, *shape, "--pose-noise", "2,3").returncode == 0
    summary = json.loads((out / "summary.json").read_text())
    header = json.loads((out / "zone_history.jsonl").read_text().splitlines()[0])
    assert summary["zone_rules"] == header["zone_rules"]
    assert summary["zone_rules"]["buffer_m"] == 7.0
    noise = {"position_m": 2.0, "attitude_deg": 3.0}
    assert summary["pose_noise"] == dict.fromkeys(STARTS, noise)
    report = (out / "report.html").read_text()
    rows = dict(re.findall(r"<tr><td>([^<]*)</td><td>([^<]*)</td></tr>", report))
    assert (rows["buffer_m"], rows["lower_m"], rows["upper_m"]) == ("7", "50", "120")
    assert rows["restriction"] == "no_sustained_flight" and rows["max_vertices"] == "no limit"
    drone = min(STARTS)
    assert f"{drone} smoothed by 2 m and 3 deg" in rows["poses"]


def test_the_report_tells_the_threshold_that_was_given(airsim: Path, tmp_path: Path) -> None:
    """Not the method's own, which stood there under the same name."""
    out = tmp_path / "out"
    assert crowdfence("run", airsim, *RECORDED, "-o", out, "--threshold", 0.4).returncode == 0
    report = (out / "report.html").read_text()
    assert re.findall(r"<tr><td>threshold</td><td>([^<]*)</td></tr>", report) == ["0.4"]


def test_what_zones_of_others_left_out_is_told_in_the_files_too(tmp_path: Path) -> None:
    """Who reads the report did not see the terminal: a fence drawn as a line closes nothing."""
    given = tmp_path / "given.geojson"
    ring = [[8.0, 46.5], [8.001, 46.5], [8.001, 46.501], [8.0, 46.5]]
    shapes = ("LineString", ring[:2]), ("Polygon", [ring])
    features = [
        {"type": "Feature", "id": id, "properties": {}, "geometry": {"type": kind, "coordinates": places}}
        for id, (kind, places) in zip(("wall", "Stadium <i>of the town"), shapes, strict=True)
    ]
    given.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    recording, dem, out = write_folder(tmp_path / "plain", flight()), tmp_path / "dem.tif", tmp_path / "out"
    transform = rasterio.transform.from_origin(-600.0, 600.0, 4.0, 4.0)
    crs = "+proj=aeqd +lat_0=46.5 +lon_0=8 +datum=WGS84"
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": crs, "transform": transform}
    with rasterio.open(dem, "w", width=300, height=300, **profile) as raster:
        raster.write(np.full((300, 300), 1175.0, np.float32), 1)
    words = ("run", recording, "-t", dem, "-o", out, "--prior", 0.2, "--voxel-size-m", 2, *RECORDED)
    done = crowdfence(*words, "--static-zones", given, "--files", "report.html")
    assert done.returncode == 0, done.stderr
    said = "given.geojson: wall: a LineString closes no ground"
    assert " ".join(done.stderr.split()).count(said) == 1
    assert said in json.loads((out / "summary.json").read_text())["warnings"]
    report = (out / "report.html").read_text()
    assert said in report and "<b>S1</b><br>Stadium &lt;i&gt;of the town<" in report
    done = crowdfence("explain", out, "--zone", "S1")
    assert "called      Stadium <i>of the town" in done.stdout, done.stdout + done.stderr


def test_what_or_calls_crowd_is_not_said_to_be_opened_by_a_look(airsim: Path, tmp_path: Path) -> None:
    """It keeps for good what was called crowd once: nobody needs to fly there again."""
    out = tmp_path / "out"
    assert crowdfence("run", airsim, *RECORDED, "-o", out, "--method", "or").returncode == 0
    zone = json.loads((out / "summary.json").read_text())["zones"][0]["id"]
    told = crowdfence("explain", out, "--zone", zone, columns=200).stdout
    assert "never: the method or opens nothing" in told and "only a look" not in told
    report = (out / "report.html").read_text()
    assert "by a look only" not in report and ">never</td>" in report


def test_a_switch_chooses_the_files(airsim: Path, tmp_path: Path) -> None:
    common = ("run", airsim, *RECORDED, "--prior", 0.2, "-o", tmp_path / "out")
    done = crowdfence(*common, "--files", "crowd_map.tif,frames.csv", "--files", "terrain.bt")
    assert done.returncode == 0, done.stderr
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "zones.geojson",
        "zone_history.jsonl",
        "summary.json",
        "crowd_map.tif",
        "frames.csv",
        "terrain.bt",
    }
    line = error_line(crowdfence(*common, "--force", "--files", "picture"))
    assert "'picture' is no file of a run; there are zones.geojson, zone_history.jsonl" in line


def test_unseen_ground_is_never_written_as_empty(airsim: Path, tmp_path: Path) -> None:
    files = ("--files", "crowd_map.tif")
    assert crowdfence("run", airsim, *RECORDED, "-o", tmp_path, *files, "--prior", 0.2).returncode == 0
    with rasterio.open(tmp_path / "crowd_map.tif") as raster:
        probability, state = raster.read(1), raster.read(2)
        assert np.isnan(raster.nodata)
    unseen = (state == VoxelState.NEVER_SEEN) | (state == VoxelState.OCCLUDED)
    assert unseen.any()
    assert np.isnan(probability[unseen]).all()
    assert not np.isnan(probability[~unseen]).any()


def test_a_plain_folder_runs_with_a_georeferenced_height_model(tmp_path: Path) -> None:
    recording = write_folder(tmp_path / "plain", flight())
    dem = tmp_path / "dem.tif"
    crs = "+proj=aeqd +lat_0=46.5 +lon_0=8 +datum=WGS84"
    transform = rasterio.transform.from_origin(-500.0, 400.0, 4.0, 4.0)
    with rasterio.open(
        dem,
        "w",
        driver="GTiff",
        width=150,
        height=150,
        count=1,
        dtype="float32",
        crs=crs,
        transform=transform,
    ) as raster:
        raster.write(np.full((150, 150), 1175.0, np.float32), 1)
    done = crowdfence(
        "run", recording, "-t", dem, *FEW_FILES, "-o", tmp_path / "out", "--prior", 0.2, "--json"
    )
    assert done.returncode == 0, done.stderr
    terrain = json.loads(done.stdout)["terrain"]
    assert terrain["seen_voxels"] > 100
    # Finer than the pixels of 4 m: 1.4 million columns.
    assert terrain["voxel_size_m"] == 0.5


def test_the_map_that_a_run_leaves_is_the_terrain_of_its_crowd_map(tmp_path: Path) -> None:
    """The height model's grid starts far from zero, where an OctoMap's always starts."""
    recording = write_folder(tmp_path / "plain", flight())
    dem = tmp_path / "dem.tif"
    transform = rasterio.transform.from_origin(-600.0, 600.0, 4.0, 4.0)
    crs = "+proj=aeqd +lat_0=46.5 +lon_0=8 +datum=WGS84"
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": crs, "transform": transform}
    with rasterio.open(dem, "w", width=300, height=300, **profile) as raster:
        raster.write(np.full((300, 300), 1175.0, np.float32), 1)
    files = ("--files", "terrain.bt", "--files", "crowd_map.crowdmap")
    done = crowdfence(
        "run", recording, "-t", dem, *files, "-o", tmp_path / "out", "--prior", 0.2, "--voxel-size-m", 2
    )
    assert done.returncode == 0, done.stderr
    terrain = Terrain.open(tmp_path / "out" / "terrain.bt")
    assert terrain.origin[0] < -500.0
    assert CrowdMap.load(tmp_path / "out" / "crowd_map.crowdmap", terrain).seen().sum() > 100


def test_options_of_the_map_reader_reach_it(tmp_path: Path) -> None:
    recording = write_folder(tmp_path / "plain", flight())
    mesh = tmp_path / "plain.obj"
    corners = [(-600, -600), (600, -600), (600, 600), (-600, 600)]
    mesh.write_text("".join(f"v {x / 10} {y / 10} -2.5\n" for x, y in corners) + "f 1 2 3\nf 1 3 4\n")
    common = ("run", recording, "-t", mesh, *FEW_FILES, "--prior", 0.2, "--json", "--voxel-size-m", 5)
    done = crowdfence(*common, "-o", tmp_path / "out", "--terrain-option", "unit_m=10")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["terrain"]["voxel_size_m"] == 5.0
    for option, message in (("units=10", "units"), ("unit_m", "must be NAME=VALUE")):
        assert message in error_line(crowdfence(*common, "-o", tmp_path / "no", "--terrain-option", option))
    for options, name in (
        # The last counted, and the map lay 48 m lower without a word.
        (("height_offset_m=48", "height_offset_m=0"), "height_offset_m"),
        (("voxel_size_m=2",), "--voxel-size-m"),
    ):
        twice = [word for option in options for word in ("--terrain-option", option)]
        done = crowdfence(*common, "-o", tmp_path / "no", *twice)
        assert f"the map is told {name} twice" in error_line(done)


def test_evaluate_scores_every_method_and_keeps_the_gate(airsim: Path) -> None:
    arguments = ("evaluate", airsim, *RECORDED, "--prior", 0.2, "--alpha", 0.1, "--alpha", 1, "--json")
    done = crowdfence(*arguments)
    assert done.returncode == 0, done.stderr
    scores = json.loads(done.stdout)["scores"]
    assert [(row["config"]["method"], row["config"].get("alpha")) for row in scores] == [
        ("evidence", None),
        ("or", None),
        ("paper", 0.1),
        ("paper", 1.0),
        ("linear-pool", 0.1),
        ("linear-pool", 1.0),
        ("log-pool", 0.1),
        ("log-pool", 1.0),
        ("log-odds", None),
        ("moving-average", None),
    ]
    missed = crowdfence(*arguments, "--min-iou", 1.0)
    assert missed.returncode == GATE_NOT_MET
    assert "a mean IoU is below --min-iou 1" in missed.stderr


def test_what_is_run_can_be_evaluated(airsim: Path, tmp_path: Path) -> None:
    """Every option of `run` that says what ground a zone holds; `evaluate` counts outlines and margins by
    itself, and people on ground that was seen alone."""
    drawn = "max-hole-m2 buffer simplify-m max-vertices lower-m upper-m restriction close-unseen static-zones"
    written = "output files open"
    taken = commands()
    missing = {name for name in taken["run"] - taken["evaluate"] if name.startswith("--")}
    assert missing == {f"--{name}" for name in f"{drawn} {written}".split()}
    method = ("--method", "paper", "--prior", 0.2, "--decay-unit", "frame", "--fleet-size", 7)
    zones = ("--off-threshold", 0.05, "--stale-after-s", 9)
    (scored,) = json.loads(crowdfence("evaluate", airsim, *RECORDED, *method, *zones, "--json").stdout)[
        "scores"
    ]
    counted = [
        scored["config"][name] for name in ("decay_unit", "fleet_size", "off_threshold", "stale_after_s")
    ]
    assert counted == ["frame", 7, 0.05, 9.0]


def test_evaluate_prints_the_same_figures_on_a_narrow_terminal(airsim: Path) -> None:
    arguments = ("evaluate", airsim, *RECORDED, "--prior", 0.2, "-m", "or", "-m", "linear-pool")
    wide, narrow = (crowdfence(*arguments, columns=columns).stdout for columns in (120, 80))
    assert "linear-pool, alpha 0.1" in narrow and "…" not in narrow
    figures = [re.findall(r"\d+\.\d+", printed) for printed in (wide, narrow)]
    assert figures[0] == figures[1] != []


def test_evaluate_by_hand(tmp_path: Path) -> None:
    """A camera 10 m above a plain of 1 m voxels sees 10 x 10 of them, one heatmap cell each. 20 are crowd.
    The first heatmap marks 16 of these and 4 others, the second all 20 and nothing else.

    or: 16 of 24, then 20 of 24, because a voxel once called crowd stays so.
    paper: Bayes' rule gives 0.9 and 0.1 (prior 1/2), so its threshold is 0.1 + 0.8 / 4. With alpha 1 only the
    newest heatmap counts: 16 of 24, then 20 of 20. With alpha 0.1 nothing rises above 0.171 in two instants;
    from 0.02 to 0.08 the threshold gives what `or` does.
    """
    stamps = [EPOCH_NS, EPOCH_NS + 10**9]
    crowd, first = np.zeros((2, 10, 10), np.uint8)
    crowd[2:6, 2:7], first[2:6, 3:8] = 255, 255
    for folder in ("heatmaps", "truth/regions"):
        (tmp_path / folder).mkdir(parents=True)
    for stamp, heatmap in zip(stamps, (first, crowd), strict=True):
        Image.fromarray(heatmap).save(tmp_path / "heatmaps" / f"uav1_{stamp}.png")
        regions = np.kron(crowd // 255, np.ones((10, 10), np.uint8))
        Image.fromarray(regions).save(tmp_path / "truth" / "regions" / f"uav1_{stamp}.png")
    rows = "".join(f"uav1,{stamp},10,10,9.5,0,1,0,0\n" for stamp in stamps)  # half a turn about east: down
    (tmp_path / "poses.csv").write_text(f"drone,stamp_ns,x,y,z,qw,qx,qy,qz\n{rows}")
    camera = {"width": 100, "height": 100, "fx": 100, "fy": 100, "cx": 50, "cy": 50}
    (tmp_path / "recording.json").write_text(json.dumps({"cameras": {"uav1": camera}}))
    mesh = tmp_path / "plain.obj"
    mesh.write_text("v 0 0 -0.5\nv 20 0 -0.5\nv 20 20 -0.5\nv 0 20 -0.5\nf 1 2 3\nf 1 3 4\n")

    bayes = (
        "-m",
        "or",
        "-m",
        "paper",
        "--prior",
        0.5,
        "--tpr",
        0.9,
        "--fpr",
        0.1,
        "--decay",
        0,
        "--alpha",
        1,
        "--alpha",
        0.1,
        "--alpha",  # judged once
        0.1,
    )
    done = crowdfence("evaluate", tmp_path, "-t", mesh, "--voxel-size-m", 1, *RECORDED, *bayes, "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    either, newest, slow = report["scores"]
    assert report["stamps_ns"] == stamps
    assert either["per_frame"] == pytest.approx([16 / 24, 20 / 24])
    assert newest["per_frame"] == pytest.approx([16 / 24, 1.0])
    assert slow["per_frame"] == [0.0, 0.0]
    assert newest["threshold"] == slow["threshold"] == pytest.approx(0.3)
    assert [row["mean_iou"] for row in report["scores"]] == pytest.approx([18 / 24, 20 / 24, 0.0])
    assert [row["best_mean_iou"] for row in report["scores"]] == pytest.approx([18 / 24, 20 / 24, 18 / 24])
    assert [row["best_knob"] for row in report["scores"]] == ["b_threshold", "threshold", "threshold"]
    assert [row["safety"] for row in report["scores"]] == [None] * 3  # nobody recorded where people are
    assert report["detector"]["true_positive_rate"]["rate"] == pytest.approx(36 / 40)
    assert report["detector"]["false_positive_rate"]["rate"] == pytest.approx(4 / 160)
    (slow_one,) = report["warnings"]
    assert slow_one.startswith("paper, alpha 0.1: pictures of uav1 show crowd on the map, and no ground ever")

    # Measured rates are those of what the method calls crowd.
    asked = ("evaluate", tmp_path, "-t", mesh, "--voxel-size-m", 1, *RECORDED, "-m", "paper", "--json")
    for number, (stamp, heatmap) in enumerate(zip(stamps, (first, crowd), strict=True)):
        lower = heatmap // 255 * np.uint8(120 if number else 200)  # 0.47, and 0.78 where some of it is wrong
        Image.fromarray(lower).save(tmp_path / "heatmaps" / f"uav1_{stamp}.png")
    for above, found, alarms in ((0.3, 36 / 40, 4 / 160), (0.5, 16 / 40, 4 / 160)):
        measured = json.loads(crowdfence(*asked, "--measured-rates", "--b-threshold", above).stdout)
        assert measured["detector"]["rates_above"] == above
        config = measured["scores"][0]["config"]
        assert config["true_positive_rate"] == pytest.approx(found)
        assert config["false_positive_rate"] == pytest.approx(alarms)
    for stamp, heatmap in zip(stamps, (first, crowd), strict=True):
        Image.fromarray(heatmap).save(tmp_path / "heatmaps" / f"uav1_{stamp}.png")

    # Without its label the first heatmap's 20 voxels are all false alarms, and that is said.
    (tmp_path / "truth" / "regions" / f"uav1_{stamps[0]}.png").unlink()
    asked = ("evaluate", tmp_path, "-t", mesh, "--voxel-size-m", 1, *RECORDED, "-m", "or", "--json")
    half = json.loads(crowdfence(*asked).stdout)
    assert half["scores"][0]["per_frame"] == pytest.approx([0.0, 20 / 24])
    (warning,) = half["warnings"]
    assert warning.startswith("1 of 2 frames have no label (uav1 1 of 2): crowd that is labelled in no other")

    # Labels of other numbers or colours than those of crowd: 0 is the score of every method.
    for stamp in stamps:
        nothing = Image.fromarray(np.zeros((100, 100), np.uint8))
        nothing.save(tmp_path / "truth" / "regions" / f"uav1_{stamp}.png")
    empty = json.loads(crowdfence(*asked).stdout)
    assert empty["scores"][0]["per_frame"] == [0.0, 0.0]
    (warning,) = empty["warnings"]
    assert warning.startswith("no label shows crowd on more than half of a heatmap cell: the IoU is 0")


def test_a_recording_of_nobody_has_no_mean_iou(tmp_path: Path) -> None:
    """A detector that marks nothing where nobody is: 0 / 0 at every instant, which is no number and no NaN,
    that many readers of JSON refuse."""
    for folder in ("heatmaps", "truth/regions"):
        (tmp_path / folder).mkdir(parents=True)
        Image.fromarray(np.zeros((10, 10), np.uint8)).save(tmp_path / folder / f"uav1_{EPOCH_NS}.png")
    row = f"uav1,{EPOCH_NS},10,10,9.5,0,1,0,0"  # half a turn about east: down
    (tmp_path / "poses.csv").write_text(f"drone,stamp_ns,x,y,z,qw,qx,qy,qz\n{row}\n")
    camera = {"width": 10, "height": 10, "fx": 10, "fy": 10, "cx": 5, "cy": 5}
    (tmp_path / "recording.json").write_text(json.dumps({"cameras": {"uav1": camera}}))
    mesh = tmp_path / "plain.obj"
    mesh.write_text("v 0 0 -0.5\nv 20 0 -0.5\nv 20 20 -0.5\nv 0 20 -0.5\nf 1 2 3\nf 1 3 4\n")
    asked = (tmp_path, "-t", mesh, "--voxel-size-m", 1, *RECORDED, "-m", "or", "--min-iou", 0.5, "--json")
    done = crowdfence("evaluate", *asked)
    assert done.returncode == 3 and "no crowd was in view, so there is no mean IoU for" in done.stderr

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    (score,) = json.loads(done.stdout, parse_constant=refuse)["scores"]
    assert score["mean_iou"] is score["std_iou"] is score["best_mean_iou"] is None
    assert score["best_threshold"] is None  # of nothing none is best
    assert score["per_frame"] == [None]


def test_why_no_heatmap_could_be_used_is_told(tmp_path: Path) -> None:
    folder = write_crowd_over_plain(tmp_path / "flight", set())
    (picture,) = (folder / "heatmaps").iterdir()
    picture.write_bytes(b"cut off")
    done = crowdfence("evaluate", folder, "-t", folder / "plain.bt", *RECORDED, "--method", "or")
    assert done.returncode == 1
    assert "no frame of flight can be used; the first of 1 refusals: uav1 at " in done.stderr
    assert "heatmap cannot be read" in done.stderr


def write_crowd_over_plain(folder: Path, hole: set[tuple[int, int]]) -> Path:
    """A drone 30 m above the middle of a plain of 40 x 40 voxels of 1 m sees 30 x 30 of them, a pixel each,
    and 12 x 12 m of crowd in the middle. In the map the columns `hole` are missing. An OctoMap does not say
    where in its voxels the ground is: half way up, at z = -0.5."""
    crowd = np.zeros((30, 30), np.uint8)
    crowd[9:21, 9:21] = 255
    for name, picture in (("heatmaps", crowd), ("truth/regions", crowd // 255)):
        (folder / name).mkdir(parents=True)
        Image.fromarray(picture).save(folder / name / f"uav1_{EPOCH_NS}.png")
    row = f"uav1,{EPOCH_NS},20,20,29.5,0,1,0,0"  # half a turn about east: down
    (folder / "poses.csv").write_text(f"drone,stamp_ns,x,y,z,qw,qx,qy,qz\n{row}\n")
    camera = {"width": 30, "height": 30, "fx": 30, "fy": 30, "cx": 15, "cy": 15}
    (folder / "recording.json").write_text(json.dumps({"cameras": {"uav1": camera}}))
    plain = [(x, y, -1) for x in range(40) for y in range(40) if (x, y) not in hole]
    terrain = Terrain.from_indices(plain, 1.0)
    bt = _core.write_octomap_binary(terrain, np.arange(terrain.voxel_count))
    (folder / "plain.bt").write_bytes(bt)
    return folder


MIDDLE = {(x, y) for x in range(14, 26) for y in range(14, 26)}
CORNER = {(x, y) for x in range(14, 17) for y in range(14, 17)}


@pytest.mark.parametrize(
    ("hole", "options", "area_m2", "lost", "message"),
    [
        (set(), [], 144.0, {}, None),
        (MIDDLE - CORNER, [], 9.0, {"hole": 135 / 144}, "93.8% falls through holes of the map (fill them"),
        # Up to 30.5 m are the pixels up to 5.5 m from the middle: of a quarter's rows 5, 5, 5, 4, 3 and none.
        (set(), ["--max-range-m", 30.5], 88.0, {"out_of_range": 56 / 144}, "(raise --max-range-m)"),
    ],
)
def test_crowd_that_meets_no_ground_is_not_lost_without_a_word(
    tmp_path: Path,
    hole: set[tuple[int, int]],
    options: list[object],
    area_m2: float,
    lost: dict[str, float],
    message: str | None,
) -> None:
    folder = write_crowd_over_plain(tmp_path / "flight", hole)
    common = (folder, "-t", folder / "plain.bt", *RECORDED, *options, "--method", "or")
    done = crowdfence("run", *common, *FEW_FILES, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["area_m2"]["crowd"] == area_m2
    of_run, of_drone = summary["crowd_mass"], summary["crowd_mass"]["drones"]["uav1"]
    shares = {name: lost.get(name, 0.0) for name in of_run["shares"]} | {"ground": area_m2 / 144}
    assert of_run["shares"] == of_drone["shares"] == pytest.approx(shares)
    assert of_run["total"] == of_drone["total"] == 144.0
    (row,) = csv.DictReader((tmp_path / "out" / "frames.csv").open())
    assert {name: float(row[f"crowd_{name}"]) for name in shares if name != "ground"} == pytest.approx(
        {name: share for name, share in shares.items() if name != "ground"}
    )
    evaluated = json.loads(crowdfence("evaluate", *common, "--json").stdout)
    assert evaluated["warnings"] == summary["warnings"]
    if message is None:
        assert summary["warnings"] == [] and done.stderr == ""
    else:
        (warning,) = summary["warnings"]
        assert warning.startswith(f"uav1: {1 - area_m2 / 144:.1%} of the crowd it shows is not on the map: ")
        assert message in warning and warning in done.stderr


def test_rates_that_nobody_could_count_are_null() -> None:
    rates = json.loads(json.dumps(_rates(Confusion(0, 1, 9, 0)), allow_nan=False))
    assert rates["true_positive_rate"]["rate"] is None
    assert rates["false_positive_rate"]["rate"] == 0.1


def test_evaluate_needs_the_truth_that_is_asked_for(airsim: Path) -> None:
    done = crowdfence("evaluate", airsim, *RECORDED, "--prior", 0.2, "--truth", "world")
    assert "does not record where people are" in error_line(done)


def test_a_frame_that_cannot_be_read_is_reported_and_the_rest_is_fused(airsim: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged"
    subprocess.run(["cp", "-r", airsim, damaged], check=True)
    heatmap = sorted((damaged / "heatmaps").iterdir())[2]
    heatmap.write_bytes(heatmap.read_bytes()[:40])
    done = crowdfence("run", damaged, *RECORDED, *FEW_FILES, "-o", tmp_path / "out", "--prior", 0.2)
    assert done.returncode == 0
    # The heatmaps are noise up to the sky: each drone is warned of for that, and that no ground is crowd.
    noise = ("is not on the map", "no ground ever reached")
    warnings = [line for line in done.stderr.splitlines() if not any(words in line for words in noise)]
    assert len(warnings) == 1 and "heatmap cannot be read" in warnings[0]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert sum(summary["frames"].values()) == 17
    assert len(summary["refused"]) == 1


def test_frames_refused_for_one_reason_are_one_line_and_all_in_the_summary(
    airsim: Path, tmp_path: Path
) -> None:
    """Four heatmaps end early, one is of the wrong kind: without counting, four lines hide the fifth."""
    damaged = tmp_path / "damaged"
    subprocess.run(["cp", "-r", airsim, damaged], check=True)
    ended, colour = (
        sorted((damaged / "heatmaps").glob("*uav1*"))[:4],
        next((damaged / "heatmaps").glob("*uav3*")),
    )
    for heatmap in ended:
        heatmap.write_bytes(heatmap.read_bytes()[:40])
    Image.new("RGB", (16, 12)).save(colour)
    for command, output in (("run", "out"), ("convert", "copy.mcap")):
        given = (*RECORDED, *FEW_FILES, "--prior", 0.2) if command == "run" else ()
        done = crowdfence(command, damaged, *given, "-o", tmp_path / output)
        assert done.returncode == 0
        told = [line for line in done.stderr.splitlines() if "heatmap" in line and "on the map" not in line]
        assert len(told) == 2
        assert "refused 4 frames (uav1), the first: uav1 at" in told[0] and "has mode RGB" in told[1]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert len(summary["refused"]) == 5 and sum(summary["frames"].values()) == 13


def test_a_recording_without_a_usable_frame_is_not_converted(tmp_path: Path) -> None:
    """As run says it; what --force would have replaced stays."""
    folder = tmp_path / "flight"
    (folder / "heatmaps").mkdir(parents=True)
    camera = {"width": 16, "height": 12, "fx": 10.0, "fy": 10.0, "cx": 8.0, "cy": 6.0}
    (folder / "recording.json").write_text(json.dumps({"cameras": {"*": camera}}))
    rows = ["drone,stamp_ns,x,y,z,qw,qx,qy,qz", "uav1,1000000000,0,0,10,1,0,0,0"]
    (folder / "poses.csv").write_text("\n".join(rows))
    Image.new("L", (16, 12)).save(folder / "heatmaps" / "uav1_90000000000.png")
    output = tmp_path / "flight.mcap"
    output.write_bytes(b"an earlier one")
    done = crowdfence("convert", folder, "-o", output, "--force")
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "no frame of flight can be used" in line and "uav1 at 90000000000" in line
    assert output.read_bytes() == b"an earlier one"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--alpha", 0], "error: --alpha is 0; it must be in (0, 1]"),
        (["--decay", -1], "error: --decay is -1; it must be finite and >= 0"),
        (["--tpr", 1], "error: --tpr is 1; it must be strictly between 0 and 1"),
        (["--prior", 0], "error: --prior is 0; it must be strictly between 0 and 1"),
        (["--fleet-size", 2], "makes the fleet 3 drones large; --fleet-size is 2: give the number of all"),
        (["--threshold", 0], "error: --threshold is 0; it must be in (0, 1]"),
        (["--min-area-m2", -1], "error: --min-area-m2 is -1; it must be finite and >= 0"),
        (["--stale-after-s", "nan"], "error: --stale-after-s is nan; it must be finite and >= 0"),
        (["--tolerance-ms", -1], "error: --tolerance-ms is -1; it must be finite and not negative"),
        (["--terrain", "nowhere.bt"], "nowhere.bt"),
    ],
)
def test_what_cannot_be_run_is_one_line_with_the_value(
    airsim: Path, tmp_path: Path, options: list[object], message: str
) -> None:
    paper = ("-m", "paper", "--prior", 0.2, *options)
    done = crowdfence("run", airsim, *RECORDED, "-o", tmp_path / "out", *paper)
    assert message in error_line(done)
    assert not (tmp_path / "out").exists()


def test_a_threshold_at_or_below_the_prior_is_refused_in_one_line(airsim: Path, tmp_path: Path) -> None:
    done = crowdfence("run", airsim, *RECORDED, "-o", tmp_path / "out", "--threshold", 0.01)
    line = error_line(done)
    assert "threshold is 0.01; it must be above the prior, 0.015" in line and "--close-unseen" in line
    assert not (tmp_path / "out").exists()


def test_terrain_and_poses_that_do_not_overlap_are_refused(airsim: Path, tmp_path: Path) -> None:
    terrain = Terrain.from_points(np.array([[5000.0, 5000.0, 0.0]]), 1.0)
    (tmp_path / "far.bt").write_bytes(_core.write_octomap_binary(terrain, [0]))
    line = error_line(
        crowdfence(
            "run", airsim, *RECORDED, "-t", tmp_path / "far.bt", "-o", tmp_path / "out", "--prior", 0.2
        )
    )
    assert "terrain and poses do not overlap" in line
    assert "x 5000 to 5001" in line


def test_a_path_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "notes.txt"
    text.write_text("hello")
    assert "is not a recording" in error_line(crowdfence("run", text, "-o", tmp_path / "out"))
    assert "No such file" in error_line(crowdfence("run", tmp_path / "none.mcap", "-o", tmp_path / "out"))


def test_wrong_usage_exits_with_two(tmp_path: Path) -> None:
    assert crowdfence("run").returncode == USAGE
    assert crowdfence("run", tmp_path, "-o", tmp_path, "--method", "magic").returncode == USAGE
    assert crowdfence("fly").returncode == USAGE


def test_version_and_help() -> None:
    assert crowdfence("--version").stdout.startswith("crowdfence 0.")
    assert "evaluate" in crowdfence("--help").stdout


def test_the_demo_says_how_to_see_it_on_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", [".venv/bin/crowdfence", "demo"])
    command, serve, recording = shlex.split(serve_command())
    assert (command, serve) == (".venv/bin/crowdfence", "serve")
    assert Path(recording).resolve() == RECORDING.resolve()


def test_the_demo_finds_the_crowds_of_the_bundled_recording(tmp_path: Path) -> None:
    """The recording knows where everybody stood: every zone that is likely to hold a crowd has one in or
    beside it. Zones of a few percent also close what only may be one."""
    done = crowdfence("demo", "-o", tmp_path / "demo", "--json")
    assert done.returncode == 0, done.stderr
    recording = open_recording(RECORDING)
    summary = json.loads(done.stdout)
    assert sum(summary["frames"].values()) == len(recording.frames) > 100
    people = recording.people_truth(recording.frames[-1].stamp_ns, max_gap_s=1.0)
    assert people is not None and recording.georeference is not None
    crowd = people.position[people.crowd > 0][:, :2]
    zones = json.loads((tmp_path / "demo" / "zones.geojson").read_text())["features"]
    for told, zone in zip(summary["zones"], zones, strict=True):
        # To the last digit: rounded twice, a table said 0.59 where the map says 0.60.
        assert told["probability_max"] == zone["properties"]["probability_max"]
    likely = [zone for zone in zones if zone["properties"]["probability_max"] > 0.25]
    assert len(likely) >= 3
    for zone in likely:
        longitude, latitude = np.array(shape(zone["geometry"]).centroid.coords[0])
        centre = recording.georeference.local_from_geodetic(latitude, longitude, 1200.0)
        assert np.linalg.norm(crowd - np.ravel(centre)[:2], axis=1).min() < 10.0


def test_labels_of_close_weights_differ():
    """Both rows were "paper, alpha 0.3"."""
    weights = (0.3, 0.30000001, 1.0)
    told = [_label(RunConfig(PaperConfig(alpha=alpha))) for alpha in weights]
    assert told == ["paper, alpha 0.3", "paper, alpha 0.30000001", "paper, alpha 1"]


@pytest.mark.parametrize("name", ["alpha", "decay", "true_positive_rate", "false_positive_rate", "prior"])
def test_what_made_a_run_is_told_with_all_digits_that_matter(name: str) -> None:
    """Runs of alpha 0.3 and 0.30000001 said the same, and a prior of 0.0004 was 0.000."""
    paper = {"true_positive_rate": 0.9, "false_positive_rate": 0.02, "prior": 0.5, "fleet_size": 2}
    paper |= {"alpha": 1.0, "decay": 0.0005, "decay_unit": "second"}
    line = method_line({"method": "paper", "parameters": paper})
    assert line == "paper, alpha 1, lambda 0.0005 per second, prior 0.5, TPR 0.9, FPR 0.02, N 2"
    shown = "0.0004" if name == "prior" else "0.30000001"
    assert f" {shown}" in method_line({"method": "paper", "parameters": paper | {name: float(shown)}})


@pytest.mark.parametrize(
    ("method", "name"),
    [("or", "b_threshold"), ("evidence", "memory_s"), ("linear-pool", "alpha"), ("log-odds", "clamp_high")],
)
def test_so_is_what_made_a_run_of_other_methods(method: str, name: str) -> None:
    told = {"b_threshold": 0.5, "memory_s": 5.0, "prior": 0.015, "cleared": 0.001} | {name: 0.30000001}
    assert " 0.30000001" in method_line({"method": method, "parameters": told})
