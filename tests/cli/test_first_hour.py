"""The first hour of somebody new: what the command line says and leaves, seen from outside."""

import base64
import contextlib
import csv
import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import rasterio
from mcap.reader import make_reader
from PIL import Image

from crowdfence import Terrain, _core, open_recording
from crowdfence.cli.demo import RECORDING as DEMO
from crowdfence.cli.wording import counted
from support.command_line import FEW_FILES, crowdfence
from support.onnx_models import contract, write_endless_model, write_map_model
from support.small_recordings import flight, ground, write_airsim, write_folder

RECORDED = ("--detector", "recorded")


@pytest.fixture(scope="module")
def airsim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_airsim(tmp_path_factory.mktemp("flight") / "recording", flight())
    write_bt(folder / "terrain" / "terrain.bt", Terrain.from_points(ground(), 2.0))
    return folder


def write_bt(path: Path, terrain: Terrain) -> Path:
    path.write_bytes(_core.write_octomap_binary(terrain, np.arange(terrain.voxel_count)))
    return path


def test_a_converted_recording_is_one_file_that_opens_elsewhere(airsim: Path, tmp_path: Path) -> None:
    """The reader of the format's own library finds the map's very bytes in it."""
    (tmp_path / "here").mkdir()
    done = crowdfence("convert", airsim, "-o", tmp_path / "here" / "flight.mcap", "--json")
    assert done.returncode == 0 and json.loads(done.stdout)["map"] == "terrain.bt", done.stderr
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    moved = Path(shutil.move(tmp_path / "here" / "flight.mcap", elsewhere))
    original = (airsim / "terrain" / "terrain.bt").read_bytes()
    with moved.open("rb") as file:
        (attachment,) = make_reader(file).iter_attachments()
    assert (attachment.name, attachment.data) == ("terrain.bt", original)
    done = crowdfence("run", moved, *RECORDED, *FEW_FILES, "-o", elsewhere / "out", "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)["terrain"]
    assert (told["voxels"], told["voxel_size_m"]) == (len(np.unique(ground() // 2.0, axis=0)), 2.0)
    assert {path.name for path in elsewhere.iterdir()} == {"flight.mcap", "out"}


def test_a_map_of_another_place_can_go_into_the_file_or_stay_outside(airsim: Path, tmp_path: Path) -> None:
    other = write_bt(tmp_path / "other.bt", Terrain.from_points(ground(), 4.0))
    done = crowdfence("convert", airsim, "-o", tmp_path / "a.mcap", "-t", other)
    assert done.returncode == 0 and "other.bt, in the file" in done.stdout
    inside = open_recording(tmp_path / "a.mcap").terrain
    assert inside is not None and inside.read_bytes() == other.read_bytes()
    assert crowdfence("convert", airsim, "-o", tmp_path / "b.mcap", "--without-map").returncode == 0
    assert open_recording(tmp_path / "b.mcap").terrain == (airsim / "terrain" / "terrain.bt").resolve()
    # A map that was inside has no place of its own to be named.
    done = crowdfence("convert", tmp_path / "a.mcap", "-o", tmp_path / "c.mcap", "--without-map")
    assert "warning: the map inside the recording" in done.stderr
    assert open_recording(tmp_path / "c.mcap").terrain is None


def test_a_damaged_map_inside_is_told_and_the_recording_still_opens(airsim: Path, tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    assert crowdfence("convert", airsim, "-o", path).returncode == 0
    data = bytearray(path.read_bytes())
    place = data.index((airsim / "terrain" / "terrain.bt").read_bytes()) + 40
    data[place] ^= 0xFF
    path.write_bytes(data)
    recording = open_recording(path)
    assert recording.terrain is None and len(recording.frames) > 0
    assert any("checksum does not match; give a map with --terrain" in line for line in recording.warnings)


@pytest.mark.parametrize("name", ["x.bag", "x", "x.zip", "x.mcap.gz"])
def test_convert_refuses_to_write_what_it_cannot(airsim: Path, tmp_path: Path, name: str) -> None:
    done = crowdfence("convert", airsim, "-o", tmp_path / name)
    assert done.returncode == 1 and "whose name ends in .mcap" in done.stderr
    assert list(tmp_path.iterdir()) == []


def broken_folder(folder: Path, name: str) -> Path:
    """A plain recording over level ground with one thing wrong all through."""
    write_folder(folder, flight())
    write_bt(folder / "g.bt", Terrain.from_points(ground(), 2.0))
    header, *rows = list(csv.reader((folder / "poses.csv").open()))
    heatmaps = sorted((folder / "heatmaps").iterdir())
    if name == "quaternions":
        rows = [[*row[:5], "0", "0", "0", "0"] for row in rows]
    if name == "stamps":
        rows = [[row[0], str(int(row[1]) / 1e9), *row[2:]] for row in rows]
    if name in ("nan", "size"):
        shown = np.full((24, 32), np.nan, np.float32) if name == "nan" else np.zeros((15, 23), np.float32)
        for path in heatmaps:
            path.unlink()
            np.save(path.with_suffix(".npy"), shown)
    if name == "width":
        description = json.loads((folder / "recording.json").read_text())
        description["cameras"]["*"]["width"] = -64
        (folder / "recording.json").write_text(json.dumps(description))
    with (folder / "poses.csv").open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    return folder


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("nan", "heatmap value at row 0, column 0 is NaN"),
        ("size", "heatmap of 15 x 23 (rows x columns) is no reduction of an image of 24 x 32"),
        ("quaternions", "a quaternion not of length 1), first at row 0"),
        ("stamps", "line 2: stamp_ns is '1759999999.8"),
        ("width", "width is -64; it must be a whole number of at least 1"),
    ],
)
def test_the_real_reason_survives_when_nothing_can_be_used(tmp_path: Path, name: str, reason: str) -> None:
    folder = broken_folder(tmp_path / name, name)
    done = crowdfence("run", folder, "-t", folder / "g.bt", *FEW_FILES, *RECORDED, "-o", tmp_path / "out")
    assert done.returncode == 1 and len(done.stderr.strip().splitlines()) == 1
    assert reason in done.stderr
    assert "no view saw" not in done.stderr and "has no telemetry" not in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["run", "evaluate"])
def test_recorded_heatmaps_are_not_replaced_in_silence(airsim: Path, tmp_path: Path, command: str) -> None:
    """Who records heatmaps of a detector of their own means them. No renderer makes pictures as flat as
    these, which decides who looks."""
    where = (*FEW_FILES, "-o", tmp_path / "out", "--force") if command == "run" else ("-m", "or")
    told = "the recorded heatmaps are not used: crowdnet-s-wide looks at the pictures; --detector recorded"
    why = "most pictures are unlike those that crowdnet-s was tested on, as real cameras' are"
    for words, warned, told_by in (
        ((), True, "crowdnet-s-wide 0.3.0 on the pictures"),
        (("--detector", "crowdnet-s"), False, "crowdnet-s 0.1.0 on the pictures"),
        (RECORDED, False, "as recorded"),
    ):
        done = crowdfence(command, airsim, *words, *where)
        assert done.returncode == 0, done.stderr
        assert (told in done.stderr) == (why in done.stderr) == warned
        assert told_by in " ".join(done.stdout.split())


def test_a_model_that_gives_nan_is_the_reason(airsim: Path, tmp_path: Path) -> None:
    model = write_map_model(tmp_path / "nan.onnx", contract(), scale=float("nan"))
    done = crowdfence("run", airsim, "--detector", model, "-o", tmp_path / "out")
    assert done.returncode == 1 and "no frame of recording can be used" in done.stderr
    assert "output heatmap holds nan at [0, 0, 0]" in done.stderr


def test_a_model_that_never_ends_is_ended(tmp_path: Path) -> None:
    model = write_endless_model(tmp_path / "endless.onnx")
    done = crowdfence("model", "check", model, CROWDFENCE_MODEL_TIME_LIMIT_S="1")
    assert done.returncode == 1
    assert "the model did not end within 1 s on an input of shape" in done.stderr


@pytest.mark.parametrize("command", ["run", "inspect", "convert", "detect"])
def test_a_pipe_is_refused_at_once(tmp_path: Path, command: str) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    done = crowdfence(command, tmp_path / "pipe.mcap", "-o", tmp_path / "out.mcap")
    assert done.returncode == 1 and "is a pipe; save what it gives in a file" in done.stderr
    with pytest.raises(ValueError, match="is a pipe"):
        open_recording(tmp_path / "pipe.mcap")


def test_a_dash_is_no_file(airsim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exports were written into a file of that name."""
    monkeypatch.chdir(tmp_path)
    done = crowdfence("convert", airsim, "-o", "-")
    assert done.returncode == 1 and done.stderr.startswith("error: - stands for no file here: name one")
    assert list(tmp_path.iterdir()) == []


def test_a_path_that_is_no_utf8_fails_before_the_work(airsim: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "crowdfence", "run", airsim, "-o", os.fsencode(tmp_path) + b"/\xff\xfe"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1 and "is no UTF-8; rename the file or folder" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_while_modules_are_imported_is_one_line(tmp_path: Path) -> None:
    """A module that is imported early interrupts, as Ctrl-C would at that moment."""
    (tmp_path / "typer.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(60)\n"
    )
    done = crowdfence("--version", PYTHONPATH=str(tmp_path))
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "error: interrupted\n")


def test_told_to_end_a_command_leaves_nothing_half_written(tmp_path: Path) -> None:
    """A timeout or a system that shuts down: the hidden files of every such command stayed for good."""
    folder, temporary = tmp_path / "out", tmp_path / "tmp"
    folder.mkdir()
    temporary.mkdir()
    process = subprocess.Popen(
        [sys.executable, "-m", "crowdfence", "convert", DEMO, "-o", folder / "flight.mcap"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(temporary)},
    )
    while process.poll() is None and not list(folder.glob("*.part")):
        time.sleep(0.01)
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, b"Traceback" in said) == (143, False)
    assert [*folder.iterdir(), *temporary.iterdir()] == []


def test_told_to_end_where_python_ignores_what_is_raised_a_command_ends(tmp_path: Path) -> None:
    """Importing runs finalisers: the signal was lost in one, and the command went on for good."""
    (tmp_path / "laspy.py").write_text(
        "import os, signal, time\n"
        "class Finalised:\n"
        "    def __del__(self):\n"
        "        os.kill(os.getpid(), signal.SIGTERM)\n"
        "Finalised()\n"
        "time.sleep(60)\n"
    )
    (tmp_path / "cloud.las").write_bytes(b"LASF")
    done = crowdfence(
        "inspect", tmp_path / "cloud.las", PYTHONPATH=os.pathsep.join([str(tmp_path), *sys.path])
    )
    assert (done.returncode, done.stdout, done.stderr) == (143, "", "")


@pytest.mark.parametrize("closed", [0, 1, 2])
def test_a_command_works_with_a_closed_stream(tmp_path: Path, closed: int) -> None:
    """As a supervisor may start it, which closes what it does not read."""
    write_folder(tmp_path / "recording", flight())
    command = [sys.executable, "-m", "crowdfence", "convert", str(tmp_path / "recording"), "--without-map"]
    done = subprocess.run(
        [*command, "-o", str(tmp_path / "flight.mcap")], preexec_fn=lambda: os.close(closed), check=False
    )
    assert done.returncode == 0
    assert open_recording(tmp_path / "flight.mcap").frames


def test_a_library_that_cannot_be_loaded_is_one_line(tmp_path: Path) -> None:
    """For want of memory, or of a library of the system: here the one that reads every height model."""
    dem = write_dem(tmp_path / "dem.tif")
    (tmp_path / "rasterio.py").write_text("raise ImportError('libGL.so.1: cannot open shared object file')")
    done = crowdfence("inspect", dem, PYTHONPATH=os.pathsep.join([str(tmp_path), *sys.path]))
    (line,) = done.stderr.strip().splitlines()
    assert done.returncode == 1 and "a library cannot be loaded: libGL.so.1: cannot open" in line


def write_dem(path: Path, crs: str | None = "EPSG:32632") -> Path:
    """4 x 4 km, so that no flight misses it, level at 1175 m."""
    transform = rasterio.transform.from_origin(421000.0, 5152000.0, 40.0, 40.0)
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": crs, "transform": transform}
    with rasterio.open(path, "w", width=100, height=100, **profile) as raster:
        raster.write(np.full((100, 100), 1175.0, np.float32), 1)
    return path


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--terrain-option", "crs=EPSG:999999"], "crs is 'EPSG:999999', which is no coordinate reference"),
        (["--terrain-option", "colour=red"], "a .tif map has no option 'colour'; it has band, nodata,"),
        (["--terrain-option", "band=7"], "band is 7, the file has bands 1 to 1"),
        (["--voxel-size-m", "0.001"], "pass a --voxel-size-m above"),
        ([], "--terrain-option crs=EPSG:... if you know it, or --assume-local if its"),
    ],
)
def test_errors_name_options_and_no_python(tmp_path: Path, options: list[str], said: str) -> None:
    dem = write_dem(tmp_path / "dem.tif", None if options == [] else "EPSG:32632")
    done = crowdfence("inspect", dem, *options)
    assert done.returncode == 1 and len(done.stderr.strip().splitlines()) == 1
    assert said in done.stderr
    assert not re.search(r"Traceback|=True|\(\)|keyword|Error\b|assume_local|voxel_size_m", done.stderr)


def test_a_map_with_a_place_says_with_which_option_the_recording_gets_one(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "flight", flight())
    description = json.loads((folder / "recording.json").read_text())
    del description["georeference"]
    (folder / "recording.json").write_text(json.dumps(description))
    done = crowdfence(
        "run", folder, "-t", write_dem(tmp_path / "dem.tif"), *FEW_FILES, *RECORDED, "-o", tmp_path / "o"
    )
    assert "--origin LAT,LON,HEIGHT" in done.stderr and "--assume-local" in done.stderr
    assert "georeference=" not in done.stderr and "=True" not in done.stderr


def test_level_ground_has_a_stated_prior(tmp_path: Path) -> None:
    """All of it is fit for landing, which is no prior."""
    folder = write_folder(tmp_path / "flight", flight())
    flat = np.stack(np.meshgrid(np.arange(-600.0, 600.0, 2.0), np.arange(-600.0, 600.0, 2.0)), -1)
    points = np.concatenate([flat.reshape(-1, 2), np.full((flat.size // 2, 1), -25.0)], axis=1)
    level = write_bt(tmp_path / "level.bt", Terrain.from_points(points, 2.0))
    common = ("run", folder, "-t", level, *FEW_FILES, *RECORDED, "-m", "paper", "--json")
    done = crowdfence(*common, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["parameters"]["prior"] == 0.5
    (told,) = [line for line in summary["warnings"] if "prior" in line]
    assert told.startswith("prior 0.5, because the map gives none (set it with --prior): 360000 of 360000")
    given = json.loads(crowdfence(*common, "-o", tmp_path / "given", "--prior", 0.2).stdout)
    assert given["parameters"]["prior"] == 0.2
    assert not [line for line in given["warnings"] if "prior" in line]


def test_what_was_chosen_of_the_map_is_said_and_coarse_voxels_are_warned_of(tmp_path: Path) -> None:
    dem = write_dem(tmp_path / "dem.tif")
    # 16 km2 hold at most ten million columns of 1.3 m: the next round size is 2 m.
    done = crowdfence("inspect", "--quick", dem)
    assert "of 2 m, finer than the file's pixels of 40 m, because" in " ".join(done.stdout.split())
    assert done.stderr == ""
    done = crowdfence("inspect", "--quick", dem, "--voxel-size-m", 40)
    assert "of 40 m, as asked for" in done.stdout
    assert "warning: voxels of 40 m are coarse for people" in done.stderr


def one_look(folder: Path) -> Path:
    """One drone above a plain, one picture, one crowd."""
    (folder / "heatmaps").mkdir(parents=True)
    crowd = np.zeros((30, 30), np.uint8)
    crowd[9:21, 9:21] = 255
    Image.fromarray(crowd).save(folder / "heatmaps" / "uav1_1000000000.png")
    row = "uav1,1000000000,20,20,29.5,0,1,0,0"  # half a turn about east: down
    (folder / "poses.csv").write_text(f"drone,stamp_ns,x,y,z,qw,qx,qy,qz\n{row}\n")
    camera = {"width": 30, "height": 30, "fx": 30, "fy": 30, "cx": 15, "cy": 15}
    (folder / "recording.json").write_text(json.dumps({"cameras": {"uav1": camera}}))
    return folder


def test_one_is_no_plural(tmp_path: Path) -> None:
    folder = one_look(tmp_path / "flight")
    plain = Terrain.from_indices([(x, y, -1) for x in range(40) for y in range(40)], 1.0)
    done = crowdfence(
        "run",
        folder,
        "-t",
        write_bt(tmp_path / "p.bt", plain),
        "-m",
        "or",
        *FEW_FILES,
        "-o",
        tmp_path / "out",
    )
    assert done.returncode == 0, done.stderr
    assert "flight: 1 instant of 1 drone\n" in done.stdout
    assert re.search(r"^1 zone *$", done.stdout, re.MULTILINE)
    assert counted(0, "zone") == "0 zones" and counted(2, "zone") == "2 zones"


def test_a_map_whose_datum_is_not_known_is_refused_or_doubted(tmp_path: Path) -> None:
    folder, maps = one_look(tmp_path / "flight"), {}
    for ellipsoid in ("bessel", "GRS80"):
        maps[ellipsoid] = tmp_path / f"{ellipsoid}.tif"
        crs = f"+proj=tmerc +lon_0=12 +x_0=4500000 +ellps={ellipsoid} +units=m"
        corner = rasterio.transform.from_origin(4_594_996.0, 5_820_000.0, 1.0, 1.0)
        profile = {"driver": "GTiff", "width": 100, "height": 100, "count": 1, "dtype": "float32"}
        with rasterio.open(maps[ellipsoid], "w", **profile, crs=crs, transform=corner) as dataset:
            dataset.write(np.zeros((100, 100), np.float32), 1)
    for command in (("inspect", "--quick"), ("run", folder, "--assume-local", "-o", tmp_path / "a", "-t")):
        done = crowdfence(*command, maps["bessel"])
        assert done.returncode == 1 and "pass --terrain-option crs=EPSG:..." in done.stderr
    doubt = "is taken as WGS84, and places may be a metre or two off"
    assert doubt in crowdfence("inspect", "--quick", maps["GRS80"]).stderr
    common = (folder, "--assume-local", "-t", maps["GRS80"])
    assert doubt in crowdfence("inspect", "--quick", *common).stderr
    done = crowdfence("run", *common, "-m", "or", *FEW_FILES, "-o", tmp_path / "b", "--json")
    assert done.returncode == 0, done.stderr
    assert [doubt in line for line in json.loads(done.stdout)["warnings"]].count(True) == 1


def test_what_a_scene_is_built_of_is_shown_while_it_is_built(tmp_path: Path) -> None:
    """On a terminal, which a pseudo-terminal is."""
    command = [sys.executable, "-m", "crowdfence", "simulate", "empty", "--frames", "1", "--drones", "1"]
    command += ["--voxel", "4", "--size", "64x48", "--no-rgb", "--no-heatmaps", "--workers", "1"]
    screen, terminal = pty.openpty()
    with subprocess.Popen(
        [*command, "-o", tmp_path / "s.mcap"], stderr=terminal, stdout=subprocess.PIPE
    ) as run:
        os.close(terminal)
        shown = b""
        with contextlib.suppress(OSError):  # the end of a pseudo-terminal
            while data := os.read(screen, 4096):
                shown += data
    os.close(screen)
    assert run.returncode == 0
    assert b"building the scene" in shown and b"/6" in shown


class Page(HTMLParser):
    """What a browser would load, and what it would show as text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.tags: list[str] = []
        self.text = ""
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.loaded += [
            value or "" for name, value in attributes if name in ("src", "href", "data", "srcset")
        ]

    def handle_data(self, data: str) -> None:
        self.text += data


def test_a_run_leaves_one_page_that_needs_nothing_else(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "<b>flight", flight())
    terrain = write_bt(folder / "g.bt", Terrain.from_points(ground(), 2.0))
    first = sorted((folder / "heatmaps").iterdir())[0]
    first.write_bytes(b"")
    common = ("run", folder, "-t", terrain, *RECORDED, "-m", "or", "-o", tmp_path / "out")
    done = crowdfence(*common, "--files", "report.html")
    assert done.returncode == 0, done.stderr
    assert f"look first at {tmp_path / 'out' / 'report.html'} (--open shows it)" in done.stdout
    assert not (tmp_path / "out" / "crowd_map.png").exists()  # not asked for; it is in the page
    page = Page(tmp_path / "out" / "report.html")
    (picture,) = page.loaded
    data = base64.b64decode(picture.removeprefix("data:image/png;base64,"), validate=True)
    with Image.open(BytesIO(data)) as image:
        image.load()
        assert image.width > 600
    assert "script" not in page.tags and "link" not in page.tags and "b" in page.tags
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["zones"] and summary["warnings"] and len(summary["refused"]) == 1
    for told in (summary["recording"], *summary["warnings"], *summary["refused"]):
        assert told in page.text
    for zone in summary["zones"]:
        assert zone["id"] in page.text and f"{zone['closed_m2']:,.0f} m²" in page.text
    for state, area in summary["area_m2"].items():
        assert f"{area:,.0f} m²" in page.text, state
    for name in summary["parameters"]:
        assert name in page.text


def test_open_shows_the_report(airsim: Path, tmp_path: Path) -> None:
    """The desktop's own opener gets the page."""
    opener = tmp_path / "bin" / "xdg-open"
    opener.parent.mkdir()
    opener.write_text(f'#!/bin/sh\necho "$1" > {tmp_path}/opened\n')
    opener.chmod(0o755)
    done = crowdfence(
        "run",
        airsim,
        *RECORDED,
        "-o",
        tmp_path / "out",
        "--open",
        PATH=f"{opener.parent}:{os.environ['PATH']}",
    )
    assert done.returncode == 0, done.stderr
    for _ in range(200):  # the opener is not waited for
        if (tmp_path / "opened").exists() and (tmp_path / "opened").read_text():
            break
        time.sleep(0.1)
    assert (tmp_path / "opened").read_text().strip() == str(tmp_path / "out" / "report.html")
