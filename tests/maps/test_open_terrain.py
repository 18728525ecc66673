"""Which reader takes a file, and what is refused before any reader sees it."""

import subprocess
import sys

import numpy as np
import pytest

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


def test_what_is_no_map_file_is_refused(tmp_path):
    (tmp_path / "folder.tif").mkdir()
    (tmp_path / "empty.laz").touch()
    (tmp_path / "notes.txt").write_text("hill")
    for name, reason in {
        "folder.tif": "is a directory",
        "empty.laz": r"empty \(0 bytes\)",
        "missing.bt": "no such file",
        "notes.txt": r"suffix '\.txt' is not one of a map file: \.bt \.ot \.tif",
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


def test_importing_the_readers_imports_no_heavy_package():
    code = (
        "import sys, crowdfence.maps, crowdfence.georeference;"
        "print(sorted({'pyproj', 'rasterio', 'laspy', 'trimesh', 'scipy'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
