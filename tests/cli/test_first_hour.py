"""The first hour of somebody new: what the command line says and leaves, seen from outside."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from crowdfence import Terrain, _core, open_recording
from support.command_line import crowdfence
from support.small_recordings import flight, ground, write_airsim

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
    done = crowdfence("run", moved, *RECORDED, "-o", elsewhere / "out", "--json")
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
