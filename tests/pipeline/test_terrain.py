"""How a recording and its map are related: by what they say, by what the caller says, or not at all.

One camera looks straight down from 10 m above level voxels of 1 m. Of its 10 x 10 heatmap cells the middle
4 x 4 are crowd: the ground from 8 to 12 m east and north of the recording's (0, 0, 0).
"""

import json
import pickle
import re
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj
import pytest
import rasterio
import shapely
from PIL import Image
from rasterio.transform import from_origin
from typer.testing import CliRunner

from crowdfence import OrConfig, RunConfig, Terrain, _core, open_recording, run
from crowdfence.cli.app import app
from crowdfence.exports.octomap import write_terrain_octomap
from crowdfence.georeference import Georeference
from crowdfence.octomap_frame import annotated, described
from crowdfence.pipeline import open_terrain
from crowdfence.sources.recording import GroundContact
from support.onnx_models import contract, write_map_model, write_pixel_people_model
from support.small_recordings import EPOCH_NS
from support.wgs84_by_hand import ground_point

ORIGIN = (46.5, 8.0, 1200.0)
ORIGIN_OPTION = ("--origin", "46.5,8.0,1200")
# 60 x 60 pixels of 1e-5 degrees around this place, 15 m east and 22 m north of ORIGIN, half a metre higher.
MIDDLE = (46.5002, 8.0002, 1200.0)
CORNERS = [(8, 8), (12, 8), (12, 12), (8, 12)]
REFUSAL = r"dem\.tif: has a place on Earth, but the recording .*--origin .*--assume-local"


def write_dem(path: Path, crs: str | None = "EPSG:4326") -> Path:
    path.parent.mkdir(exist_ok=True)
    transform = from_origin(MIDDLE[1] - 30e-5, MIDDLE[0] + 30e-5, 1e-5, 1e-5)
    if crs is None:
        transform = from_origin(-30.0, 30.0, 1.0, 1.0)
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": crs, "transform": transform}
    with rasterio.open(path, "w", width=60, height=60, **profile) as raster:
        raster.write(np.full((60, 60), 1200.5 if crs else 0.5, np.float32), 1)
    return path


def write_recording(folder: Path, **description: Any) -> Path:
    crowd = np.zeros((10, 10), np.uint8)
    crowd[3:7, 3:7] = 255
    for name in ("heatmaps", "truth/regions"):
        (folder / name).mkdir(parents=True)
    Image.fromarray(crowd).save(folder / "heatmaps" / f"uav1_{EPOCH_NS}.png")
    regions = np.kron(crowd // 255, np.ones((10, 10), np.uint8))
    Image.fromarray(regions).save(folder / "truth" / "regions" / f"uav1_{EPOCH_NS}.png")
    pose = f"uav1,{EPOCH_NS},10,10,11,0,1,0,0"  # half a turn about east: down
    (folder / "poses.csv").write_text(f"drone,stamp_ns,x,y,z,qw,qx,qy,qz\n{pose}\n")
    camera = {"width": 100, "height": 100, "fx": 100, "fy": 100, "cx": 50, "cy": 50}
    (folder / "recording.json").write_text(json.dumps({"cameras": {"uav1": camera}} | description))
    return folder


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """It does not say where on Earth it is; the map beside it does."""
    folder = write_recording(tmp_path / "recording")
    write_dem(folder / "terrain" / "dem.tif")
    return folder


def fused(recording: Path, output: Path, *options: str) -> list[tuple[float, float]]:
    """Corners (longitude, latitude) of the only zone."""
    arguments = ["run", str(recording), "-o", str(output), "--method", "or", "--voxel-size-m", "1"]
    done = CliRunner().invoke(app, [*arguments, "--min-area-m2", "1", "--detector", "recorded", *options])
    assert done.exit_code == 0, done.exception
    (zone,) = json.loads((output / "zones.geojson").read_text())["features"]
    return [tuple(corner) for corner in zone["geometry"]["coordinates"][0][:-1]]


@pytest.mark.parametrize(
    ("options", "anchor"), [(ORIGIN_OPTION, ORIGIN), (("--assume-local",), MIDDLE)], ids=["origin", "local"]
)
def test_zones_lie_where_the_chosen_way_puts_them(
    recording: Path, tmp_path: Path, options: tuple[str, ...], anchor: tuple[float, float, float]
) -> None:
    corners = fused(recording, tmp_path / "out", *options)
    places = [ground_point(anchor, latitude, longitude, 0.5)[:2] for longitude, latitude in corners]
    assert len(places) == 4
    for corner in CORNERS:
        assert min(np.hypot(*(place - corner)) for place in places) < 0.01


def test_a_map_that_was_opened_by_itself_is_not_put_below_a_flight_elsewhere(tmp_path: Path) -> None:
    """Its metres count from its own middle, those of the flight from the flight's origin: zones were as far
    off as these are apart."""
    georeference = {"latitude_deg": ORIGIN[0], "longitude_deg": ORIGIN[1], "height_m": ORIGIN[2]}
    recording = open_recording(write_recording(tmp_path / "recording", georeference=georeference))
    dem = write_dem(tmp_path / "dem.tif")
    config = RunConfig(OrConfig())
    # 2e-4 degrees are 22.24 m to the north and 15.36 m to the east at 46.5 degrees: 27.0 m.
    with pytest.raises(ValueError, match=r"two local frames, 27\.0 m apart: .* open the map for the rec"):
        run(recording, Terrain.open(dem, voxel_size_m=1.0), config)
    own = Georeference(*ORIGIN)
    rounded = replace(own, latitude_deg=own.latitude_deg + 1e-8)  # a millimetre
    for terrain in (
        open_terrain(recording, dem, voxel_size_m=1.0),
        Terrain.open(dem, voxel_size_m=1.0, georeference=rounded),
    ):
        (zone,) = run(recording, terrain, config).zones
        assert zone.polygon.bounds == pytest.approx((8.0, 8.0, 12.0, 12.0), abs=1.01)


def test_a_map_that_was_opened_by_itself_is_not_taken_for_the_frame_of_a_flight_without_a_place(
    recording: Path, tmp_path: Path
) -> None:
    """Like the command line, the library puts a flight that nobody placed nowhere."""
    flight, dem = open_recording(recording), recording / "terrain" / "dem.tif"
    alone = Terrain.open(dem, voxel_size_m=1.0)
    assert alone.georeference == Georeference(*MIDDLE)
    for terrain in (alone, pickle.loads(pickle.dumps(alone)), alone.with_origin(alone.origin)):
        with pytest.raises(
            ValueError, match=r"does not say where on Earth its \(0, 0, 0\) lies: .* assume_local"
        ):
            run(flight, terrain, RunConfig(OrConfig()))
    for said in ({"assume_local": True}, {"georeference": alone.georeference}):
        run_of = run(flight, open_terrain(flight, dem, voxel_size_m=1.0, **said), RunConfig(OrConfig()))
        assert run_of.georeference == Georeference(*MIDDLE) and run_of.zones
    alone.georeference = Georeference(*ORIGIN)  # says so as well
    run(flight, alone, RunConfig(OrConfig()))


def test_an_origin_says_what_a_georeference_in_the_recording_says(recording: Path, tmp_path: Path) -> None:
    keys = ("latitude_deg", "longitude_deg", "height_m")
    knowing = write_recording(tmp_path / "knowing", georeference=dict(zip(keys, ORIGIN, strict=True)))
    dem = str(recording / "terrain" / "dem.tif")
    assert fused(knowing, tmp_path / "a", "-t", dem) == fused(recording, tmp_path / "b", *ORIGIN_OPTION)


GROUND = ("--target", "ground")
COMMANDS = {
    "run": ["run", "{recording}", "-o", "{out}"],
    "evaluate": ["evaluate", "{recording}"],
    "inspect": ["inspect", "{recording}", "-t", "{recording}/terrain/dem.tif"],
    "detect": ["detect", "{recording}", "-o", "{out}.mcap", "--model", "{people}"],
    "calibrate": [
        "calibrate",
        "{heatmap}",
        "--data",
        "{recording}",
        "-o",
        "{out}.onnx",
        "--target",
        "ground",
    ],
    "model evaluate": ["model", "evaluate", "{heatmap}", "--data", "{recording}", "--target", "ground"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_refuses_to_guess(recording: Path, tmp_path: Path, command: str) -> None:
    places = {
        "recording": recording,
        "out": tmp_path / "out",
        "people": write_pixel_people_model(tmp_path / "people.onnx", contract(kind="points")),
        "heatmap": write_map_model(tmp_path / "heatmap.onnx", contract("logits")),
    }
    arguments = [argument.format(**places) for argument in COMMANDS[command]]
    with pytest.raises(ValueError, match=REFUSAL) as refused:
        CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert "\n" not in str(refused.value)
    for way_out in (["--assume-local"], ORIGIN_OPTION):
        done = CliRunner().invoke(app, [*arguments, *way_out])
        # Without pictures and people, some find other reasons.
        assert done.exit_code == 0 or "place on Earth" not in str(done.exception)


def test_training_refuses_to_guess_before_it_decodes(recording: Path, tmp_path: Path) -> None:
    """In a process of its own, because decoding forks and this one has threads."""
    for options, reason in (("{}", REFUSAL), ("{'assume_local': True}", "no frame of .* can be used")):
        code = (
            "import sys; from pathlib import Path\n"
            "from crowdfence.detector_training.frame_store import store_missions\n"
            f"store_missions([Path(sys.argv[1])], ['ground'], Path(sys.argv[2]), terrain_options={options})"
        )
        command = [sys.executable, "-c", code, recording, tmp_path / "store"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert re.search(reason, done.stderr), done.stderr


def test_inspect_shows_why_the_recordings_own_map_cannot_be_used(recording: Path) -> None:
    done = CliRunner().invoke(app, ["inspect", str(recording), "--json"])
    assert done.exit_code == 0, done.exception
    assert "--assume-local" in json.loads(done.stdout)["terrain"]["problem"]
    alone = CliRunner().invoke(app, ["inspect", str(recording / "terrain" / "dem.tif"), "--json"])
    assert alone.exit_code == 0
    there = json.loads(alone.stdout)["terrain"]["georeference"]
    assert (there["latitude_deg"], there["longitude_deg"]) == pytest.approx(MIDDLE[:2], abs=1e-12)


def test_a_crowd_over_a_bridged_hole_is_on_the_map(tmp_path: Path) -> None:
    """The height model has no height right below the crowd, 16 m2; 400 m2 of it elsewhere are a lake."""
    recording, dem = write_recording(tmp_path / "recording"), write_dem(tmp_path / "dem.tif", None)
    with rasterio.open(dem, "r+") as raster:
        heights = raster.read(1)
        heights[18:22, 38:42] = heights[38:58, 2:22] = np.nan
        raster.write(heights, 1)
    arguments = ["run", str(recording), "-t", str(dem), "--assume-local", "--method", "or"]
    arguments += ["--min-area-m2", "1", "--detector", "recorded", "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.exception
    assert "1 bridged (16.0 m2), 1 left open (400.0 m2), limit 25 m2" in done.stdout
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["area_m2"]["crowd"] == 16.0
    assert summary["terrain"]["holes"] == {
        "max_hole_m2": 25.0,
        "bridged": 1,
        "bridged_m2": 16.0,
        "open": 1,
        "open_m2": 400.0,
    }
    done = CliRunner().invoke(app, [*arguments, "--force", "--terrain-option", "max_hole_m2=0", "--json"])
    assert json.loads(done.stdout)["area_m2"]["crowd"] == 0.0


def test_no_landing_site_lies_on_a_bridged_hole(tmp_path: Path) -> None:
    """4 x 4 m without height in the middle of a meadow may be a water tank or a pit. An OctoMap of the map
    knows it too."""
    recording, dem = write_recording(tmp_path / "recording"), write_dem(tmp_path / "dem.tif", None)
    layer = recording / "layers" / "landing-site"
    layer.mkdir(parents=True)
    Image.fromarray(np.full((10, 10), 255, np.uint8)).save(layer / f"uav1_{EPOCH_NS}.png")
    pose = f"uav1,{EPOCH_NS},10,10,20.5,0,1,0,0"
    (recording / "poses.csv").write_text(f"drone,stamp_ns,x,y,z,qw,qx,qy,qz\n{pose}\n")
    tank = shapely.box(8.0, 8.0, 12.0, 12.0)

    def sites(terrain: Path, name: str) -> shapely.MultiPolygon:
        arguments = ["run", str(recording), "-t", str(terrain), "--assume-local", "--layer", "landing-site"]
        done = CliRunner().invoke(app, [*arguments, "-o", str(tmp_path / name)])
        assert done.exit_code == 0, done.exception
        found = json.loads((tmp_path / name / "sites.geojson").read_text())["features"]
        return shapely.union_all([shapely.geometry.shape(feature["geometry"]) for feature in found])

    whole = sites(dem, "whole")
    assert whole.covers(tank)
    with rasterio.open(dem, "r+") as raster:
        heights = raster.read(1)
        heights[18:22, 38:42] = np.nan
        raster.write(heights, 1)
    found = sites(dem, "holed")
    assert found.intersection(tank).area == 0.0 and whole.covers(found)
    assert whole.difference(tank).difference(found).area < 0.2  # outlines are rounded inwards by 1 cm
    write_terrain_octomap(tmp_path / "again.bt", Terrain.open(dem, assume_local=True))
    assert sites(tmp_path / "again.bt", "again").equals(found)


def write_las(path: Path, crs: int | None) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.offsets, header.scales = np.array([423_000.0, 5_150_000.0, 0.0]), np.full(3, 0.001)
    if crs is not None:
        header.add_crs(pyproj.CRS.from_epsg(crs))
    cloud = laspy.LasData(header)
    east, north = np.mgrid[0:20, 0:20].reshape(2, -1)
    cloud.x, cloud.y, cloud.z = east + 423_250.0, north + 5_150_020.0, np.full(400, 1200.5)
    cloud.classification = np.full(400, 2)
    cloud.write(path)
    return path


def write_octomap(path: Path, anchor: Georeference | None) -> Path:
    terrain = Terrain.from_points([[10.5, 10.5, 0.5]], 1.0)
    terrain.georeference = anchor
    path.write_bytes(annotated(_core.write_octomap_binary(terrain, [0]), described(terrain)))
    return path


def test_points_and_octomaps_with_a_place_are_refused_too(recording: Path, tmp_path: Path) -> None:
    source = open_recording(recording)
    anchored = write_octomap(tmp_path / "anchored.bt", Georeference(*ORIGIN))
    for path in (write_las(tmp_path / "utm.las", 32632), anchored):
        with pytest.raises(ValueError, match="has a place on Earth, but the recording"):
            open_terrain(source, path)
        assert open_terrain(source, path, assume_local=True).georeference is not None
    assert open_terrain(source, anchored, georeference=Georeference(*ORIGIN)).voxel_count == 1
    with pytest.raises(ValueError, match="has a place on Earth"):
        open_terrain(source, write_las(tmp_path / "stated.las", None), crs=32632)


def test_maps_without_a_place_need_no_relation(recording: Path, tmp_path: Path) -> None:
    source = open_recording(recording)
    mesh = tmp_path / "plain.obj"
    mesh.write_text("v 0 0 0\nv 20 0 0\nv 20 20 0\nf 1 2 3\n")
    for path in (mesh, write_octomap(tmp_path / "local.bt", None)):
        for local in (False, True):
            assert open_terrain(source, path, assume_local=local).georeference is None
        placed = open_terrain(source, path, georeference=Georeference(*ORIGIN))
        assert placed.georeference == Georeference(*ORIGIN)


def test_a_map_without_a_place_below_a_flight_that_has_one_is_told(tmp_path: Path) -> None:
    """A photogrammetric mesh counts from somewhere in its model, a film or bag from its first position: by
    the zero of the one taken for that of the other, crowds were put anywhere, and nothing said so."""
    keys = ("latitude_deg", "longitude_deg", "height_m")
    knowing = write_recording(tmp_path / "knowing", georeference=dict(zip(keys, ORIGIN, strict=True)))
    mesh, local = tmp_path / "plain.obj", write_octomap(tmp_path / "local.bt", None)
    mesh.write_text("v 0 0 0\nv 20 0 0\nv 20 20 0\nf 1 2 3\n")
    source = open_recording(knowing)
    for path in (mesh, local):
        with pytest.warns(UserWarning, match=rf"{path.name} does not say where on Earth .*46.5000000, 8.0"):
            open_terrain(source, path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        open_terrain(source, mesh, origin=(0.0, 0.0, 0.0))  # who says so knows
        open_terrain(source, write_dem(tmp_path / "dem.tif"), height_offset_m=0.0)
        came_along = replace(source, terrain=local)
        open_terrain(came_along)
        open_terrain(came_along, local)


@pytest.mark.parametrize(
    ("sea_m", "said"),
    [
        (47.3, r"sea, 47 m above there, .*: say height_offset_m=47\.3, or 0 where"),
        (-60.0, r"sea, 60 m below there, .*: say height_offset_m=-60\.0, or 0 where"),
        (None, "sea, up to 100 m off there, .*: say height_offset_m=METRES, how high the sea"),
    ],
)
def test_a_map_that_names_no_geoid_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sea_m: float | None, said: str
) -> None:
    """Most count from the sea without saying so: cameras 50 m above the ground were taken to be 97 m above it
    where the sea lies 47 m above the ellipsoid, and no word was said. Cameras whose heights count from its
    ground stand right, and then a file with heights above the ellipsoid closed the air 47 m too low."""

    def geoid_height_m(*place: float) -> float:
        assert place == ORIGIN[:2]
        if sea_m is None:
            raise ValueError("no grid")
        return sea_m

    monkeypatch.setattr("crowdfence.pipeline.terrain.geoid_height_m", geoid_height_m)
    keys = ("latitude_deg", "longitude_deg", "height_m")
    folder = write_recording(tmp_path / "knowing", georeference=dict(zip(keys, ORIGIN, strict=True)))
    source, dem = open_recording(folder), write_dem(tmp_path / "dem.tif")
    with pytest.warns(UserWarning, match=rf"dem\.tif names no geoid .* the ellipsoid\. .*{said}"):
        open_terrain(source, dem)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        open_terrain(source, dem, height_offset_m=0.0)
        open_terrain(source, dem, crs="EPSG:4979")  # heights above the ellipsoid
        open_terrain(replace(source, terrain=dem))  # who put it there knew
    contacts = {"uav1": GroundContact((10.0, 10.0, 0.0), "as stated")}
    on_its_ground = replace(source, ground_contacts=contacts)
    with pytest.warns(UserWarning, match="though poses count from its ground, zones are too high or too low"):
        open_terrain(on_its_ground, dem)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        open_terrain(on_its_ground, dem, height_offset_m=48.0)


def test_a_map_without_a_place_that_was_put_into_the_file_is_still_told(tmp_path: Path) -> None:
    """It comes with the recording then, as a map does that belongs to it."""
    keys = ("latitude_deg", "longitude_deg", "height_m")
    knowing = write_recording(tmp_path / "knowing", georeference=dict(zip(keys, ORIGIN, strict=True)))
    mesh = tmp_path / "plain.obj"
    mesh.write_text("v 0 0 0\nv 20 0 0\nv 20 20 0\nf 1 2 3\n")
    arguments = ["convert", str(knowing), "-t", str(mesh), "-o", str(tmp_path / "a.mcap"), "--json"]
    told = CliRunner().invoke(app, arguments)
    assert told.exit_code == 0, told.output
    for said in (json.loads(told.stdout)["warnings"], open_recording(tmp_path / "a.mcap").warnings):
        assert sum("plain.obj does not say where on Earth it lies" in warning for warning in said) == 1


def test_local_metres_of_a_map_without_reference_system_are_stated_not_guessed(
    recording: Path, tmp_path: Path
) -> None:
    source, dem = open_recording(recording), write_dem(tmp_path / "local.tif", None)
    with pytest.raises(ValueError, match="no coordinate reference system; .* assume_local=True"):
        open_terrain(source, dem)
    terrain = open_terrain(source, dem, assume_local=True, georeference=Georeference(*ORIGIN))
    assert terrain.georeference == Georeference(*ORIGIN)
    np.testing.assert_array_equal(terrain.bounds, [[-30, -30, 0], [30, 30, 1]])


def test_two_relations_are_one_too_many(recording: Path, tmp_path: Path) -> None:
    keys = ("latitude_deg", "longitude_deg", "height_m")
    knowing = open_recording(
        write_recording(tmp_path / "knowing", georeference=dict(zip(keys, ORIGIN, strict=True)))
    )
    dem = recording / "terrain" / "dem.tif"
    with pytest.raises(ValueError, match="assume_local contradicts"):
        open_terrain(knowing, dem, assume_local=True)
    with pytest.raises(ValueError, match="says itself where its local frame lies"):
        open_terrain(knowing, dem, georeference=Georeference(46.5, 8.0, 1300.0))
    same = open_terrain(knowing, dem, georeference=Georeference(*ORIGIN))
    assert same.fingerprint == open_terrain(knowing, dem).fingerprint


@pytest.mark.parametrize("origin", ["46.5,8.0", "here", "46.5;8.0;1200", "1,2,3,4"])
def test_an_origin_is_three_numbers(recording: Path, tmp_path: Path, origin: str) -> None:
    arguments = ["run", str(recording), "-o", str(tmp_path / "out"), "--origin", origin]
    with pytest.raises(ValueError, match="must be LAT,LON,HEIGHT, such as"):
        CliRunner().invoke(app, arguments, catch_exceptions=False)
    with pytest.raises(ValueError, match="latitude_deg is -97"):
        CliRunner().invoke(app, [*arguments[:-1], "-97,8,0"], catch_exceptions=False)
