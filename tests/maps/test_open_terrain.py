"""Which reader takes a file, and what is refused before any reader sees it."""

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from crowdfence import Terrain
from crowdfence.georeference import Georeference
from crowdfence.maps import MapError, open_terrain

# The root and 15 inner nodes, each with one child, and one occupied leaf: two bits a child, child 0 first, 11
# for an inner node and 10 for an occupied leaf (which the octomap reader's own tests settle). Child 7 of the
# root is the octant above the origin, child 0 from there on stays next to it.
ONE_VOXEL = (
    b"# Octomap OcTree binary file\n# a comment\nid OcTree\nsize 17\nres 0.5\ndata\n"
    + bytes([0, 0b11000000])
    + bytes([0b11, 0]) * 14
    + bytes([0b10, 0])
)


def test_octomap(tmp_path):
    path = tmp_path / "one.bt"
    path.write_bytes(ONE_VOXEL)
    anchor = Georeference(46.5, 8.0, 1200.0)
    terrain = Terrain.open(path, georeference=anchor, origin=(10, 20, 30))
    assert terrain.georeference == anchor
    assert terrain.voxel_size_m == 0.5 and terrain.voxel_count == 1
    np.testing.assert_allclose(terrain.bounds, [[10, 20, 30], [10.5, 20.5, 30.5]])
    assert open_terrain(path, voxel_size_m=0.5).voxel_count == 1
    with pytest.raises(MapError, match=r"voxels of 0\.5 m, but voxel_size_m is 1; .*leave voxel_size_m out"):
        open_terrain(path, voxel_size_m=1.0)
    path.write_bytes(ONE_VOXEL[:-20])
    with pytest.raises(MapError, match=r"one\.bt: "):
        open_terrain(path)


def test_stamps_of_pyoctomap_behind_the_nodes_are_passed_over(tmp_path):
    """A line and a zip of the stamps, which other readers of OctoMap never come to."""
    path = tmp_path / "stamped.bt"
    nodes = ONE_VOXEL.replace(b"id OcTree", b"id OcTreeStamped")
    path.write_bytes(nodes + b"\n#PYOC_TIME_V1\n\x01\x05\x00\x00PK\x03\x04")
    assert open_terrain(path).voxel_count == 1
    path.write_bytes(nodes + b"\n#stray")
    with pytest.raises(MapError, match="7 more bytes follow"):
        open_terrain(path)
    path.write_bytes(nodes[:-2] + b"\n#PYOC_TIME_V1\n")
    with pytest.raises(MapError, match=r"stamped\.bt: "):
        open_terrain(path)


def test_what_is_no_map_file_is_refused(tmp_path):
    (tmp_path / "folder.tif").mkdir()
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "dem.tif").touch()
    (tmp_path / "tiles").mkdir()
    (tmp_path / "tiles" / "1.tif").touch()
    (tmp_path / "tiles" / "2.TIF").touch()
    (tmp_path / "empty.laz").touch()
    (tmp_path / "dem.asc").write_text("ncols 2")
    (tmp_path / "notes.txt").write_text("hill")
    for name, reason in {
        "folder.tif": r"is a folder, not a map file; it holds no \.bt \.ot \.tif",
        "maps": r"is a folder, not a map file; name one of those in it: dem\.tif$",
        "tiles": r"name one of those in it: 1\.tif, 2\.TIF; tiles .* become one file with rio merge",
        "empty.laz": r"empty \(0 bytes\)",
        "missing.bt": "no such file",
        "notes.txt": r"suffix '\.txt' is not one of a map file: \.bt \.ot \.tif .* \.obj$",
        "dem.asc": r"suffix '\.asc' is not .*; make a \.tif of it: rio convert dem\.asc dem\.tif",
        "none": "suffix '' is not one",
    }.items():
        with pytest.raises(MapError, match=reason) as caught:
            Terrain.open(tmp_path / name)
        assert isinstance(caught.value, ValueError)
        assert str(tmp_path / name) in str(caught.value)


def test_an_option_of_another_kind_of_file_is_a_type_error(tmp_path):
    path = tmp_path / "one.bt"
    path.write_bytes(ONE_VOXEL)
    with pytest.raises(TypeError, match="band"):
        open_terrain(path, band=1)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("height_offset_m", "48 m", "height_offset_m is '48 m'; it must be a number"),
        ("height_offset_m", True, "height_offset_m is True; it must be a number"),
        ("max_hole_m2", "x", "max_hole_m2 is 'x'; it must be a number"),
        ("max_hole_m2", None, "max_hole_m2 is None; it must be a number"),
        ("nodata", "abc", "nodata is 'abc'; it must be a number"),
        ("band", "x", "band is 'x'; it must be a number"),
        ("band", 1.5, "band is 1.5; it must be a whole number"),
        ("band", float("nan"), "band is nan; it must be a whole number"),
    ],
)
def test_an_option_that_is_no_number_is_refused_by_its_name(tmp_path, name, value, said):
    with rasterio.open(
        tmp_path / "dem.tif", "w", driver="GTiff", width=4, height=4, count=1, dtype="float32",
        transform=rasterio.Affine(1.0, 0.0, 0.0, 0.0, -1.0, 4.0),
    ) as raster:  # fmt: skip
        raster.write(np.zeros((4, 4), np.float32), 1)
    with pytest.raises(MapError, match=rf"dem\.tif: {said}"):
        open_terrain(tmp_path / "dem.tif", assume_local=True, **{name: value})
    taken = {"height_offset_m": np.float32(2.0), "band": 1, "nodata": None}
    assert open_terrain(tmp_path / "dem.tif", assume_local=True, **taken).bounds[1, 2] == pytest.approx(
        2.0, abs=1
    )


@pytest.mark.parametrize(
    ("origin", "shown"),
    [
        (5, "5"),
        ([5], r"\[5\]"),
        ("1,2,3", "'1,2,3'"),
        ([1, 2, None], r"\[1, 2, None\]"),
        ([0, 0, math.inf], ".*"),
    ],
)
@pytest.mark.parametrize("name", ["one.bt", "one.obj"])
def test_an_origin_that_is_not_three_numbers_is_refused(tmp_path, name, origin, shown):
    """A single number moved a mesh to the east, to the north and up."""
    path = tmp_path / name
    path.write_bytes(ONE_VOXEL if name == "one.bt" else b"v 0 0 0\nv 4 0 0\nv 4 4 0\nf 1 2 3\n")
    with pytest.raises(MapError, match=rf"origin is {shown}; it must be three numbers"):
        open_terrain(path, origin=origin)
    moved = open_terrain(path, origin=np.array([10.0, 20.0, 30.0]))
    np.testing.assert_allclose(moved.bounds[0], [10, 20, 30], atol=0.3)


def test_importing_the_readers_imports_no_heavy_package():
    code = (
        "import sys, crowdfence.maps, crowdfence.georeference;"
        "print(sorted({'pyproj', 'rasterio', 'laspy', 'trimesh', 'scipy'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


@pytest.mark.parametrize("size_m", [math.nan, math.inf, -1.0, 0.0, 1e-300, 0.0009, 101.0, 1e300, "fine"])
@pytest.mark.parametrize("name", ["plain.bt", "plain.ply", "plain.tif"])
def test_a_voxel_size_that_makes_no_map_is_refused_before_the_file_is_read(
    tmp_path: Path, name: str, size_m: Any
) -> None:
    """One line, whatever the file: 1e-300 was told in 300 digits, 1e300 made a map of one voxel."""
    path = tmp_path / name
    path.write_bytes(b"not looked at")
    bound = r"voxel_size_m is .{1,7}; it must be (in \[0\.001, 100\], metres|a number)$"
    with pytest.raises(MapError, match=bound):
        open_terrain(path, voxel_size_m=size_m)
