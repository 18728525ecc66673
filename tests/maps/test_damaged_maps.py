"""Map files that are damaged, or lie: a terrain or one line about them, soon and in little memory."""

import struct
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
import rasterio
from rasterio.transform import from_origin

from crowdfence import Terrain
from crowdfence.exports.octomap import write_terrain_octomap
from crowdfence.maps import open_terrain, stated_place
from support.damaged_files import damaged, outcome

pytestmark = pytest.mark.filterwarnings(
    "ignore::PendingDeprecationWarning",
    "ignore::rasterio.errors.NotGeoreferencedWarning",
    "ignore::UserWarning",
)


def write_geotiff(path: Path) -> None:
    heights = np.add.outer(np.arange(12.0), np.arange(10.0)).astype(np.float32)
    heights[5, 5] = -9999.0
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "nodata": -9999.0, "compress": "deflate"}
    place = {"crs": "EPSG:32632", "transform": from_origin(500_000.0, 5_000_000.0, 1.0, 1.0)}
    with rasterio.open(path, "w", width=10, height=12, **profile, **place) as file:
        file.write(heights, 1)


def write_lidar(path: Path) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.offsets, header.scales = np.array([500_000.0, 5_000_000.0, 0.0]), np.full(3, 0.01)
    header.add_crs(pyproj.CRS.from_epsg(32632))
    cloud = laspy.LasData(header)
    east, north = np.mgrid[0:12, 0:12].reshape(2, -1)
    cloud.x, cloud.y, cloud.z = east + 500_000.0, north + 5_000_000.0, np.full(144, 300.0)
    cloud.classification = np.full(144, 2)
    cloud.write(path)


CORNERS = [(0.0, 0.0, 1.0), (9.0, 0.0, 1.0), (9.0, 9.0, 2.0), (0.0, 9.0, 2.0)]


def write_ascii_ply(path: Path) -> None:
    head = ["ply", "format ascii 1.0", "element vertex 4", *(f"property float {axis}" for axis in "xyz")]
    head += ["element face 2", "property list uchar int vertex_indices", "end_header"]
    rows = [*(" ".join(map(str, corner)) for corner in CORNERS), "3 0 1 2", "3 0 2 3"]
    path.write_text("\n".join([*head, *rows, ""]))


def write_binary_ply(path: Path) -> None:
    head = ["ply", "format binary_little_endian 1.0", "element vertex 4"]
    head += [*(f"property float {axis}" for axis in "xyz"), "element face 2"]
    head += ["property list uchar int vertex_indices", "end_header", ""]
    body = b"".join(struct.pack("<3f", *corner) for corner in CORNERS)
    path.write_bytes("\n".join(head).encode() + body + struct.pack("<B3iB3i", 3, 0, 1, 2, 3, 0, 2, 3))


def write_obj(path: Path) -> None:
    lines = [*("v {} {} {}".format(*corner) for corner in CORNERS), "f 1 2 3", "f 1/1/1 3/2/1 -1/3/1"]
    path.write_text("\n".join(lines))


def write_octomap(path: Path) -> None:
    ground = Terrain.from_indices([(i, j, i // 4) for i in range(9) for j in range(7)], 0.5, (3.0, 4.0, 5.0))
    write_terrain_octomap(path, ground.with_unmeasured([[2, 3], [2, 4]]))


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("a.tif", write_geotiff),
        ("a.las", write_lidar),
        ("a.laz", write_lidar),
        ("ascii.ply", write_ascii_ply),
        ("binary.ply", write_binary_ply),
        ("a.obj", write_obj),
        ("a.bt", write_octomap),
    ],
)
def test_a_damaged_map_is_read_or_refused_in_one_line(tmp_path: Path, name: str, write) -> None:
    path = tmp_path / name
    write(path)
    intact = path.read_bytes()
    assert outcome(lambda: open_terrain(path)) == ""
    refused = 0
    for data in damaged(intact, 120):
        path.write_bytes(data)
        said = outcome(lambda: open_terrain(path))
        assert not said or said.startswith(str(path))
        outcome(lambda: stated_place(path))
        refused += bool(said)
    assert refused > 30


@pytest.mark.parametrize("layer", range(9))
def test_a_layer_of_points_longer_than_its_chunk_is_refused_before_memory_is_taken(
    tmp_path: Path, layer: int
) -> None:
    """The decompressor would ask for 4 GB, and the process would end where there are none."""
    path = tmp_path / "a.laz"
    write_lidar(path)
    data = bytearray(path.read_bytes())
    (points_at,) = struct.unpack_from("<I", data, 96)
    struct.pack_into("<I", data, points_at + 8 + 30 + 4 + 4 * layer, 0xFFFF_0000)
    path.write_bytes(bytes(data))
    said = outcome(lambda: open_terrain(path))
    assert "as length of the layers of a chunk, at most" in said


@pytest.mark.parametrize("at", [179, 187, 195, 203, 211, 219])
@pytest.mark.parametrize("value", [1e300, -1e300, float("inf"), float("nan")])
def test_bounds_that_no_reference_system_has_are_refused(tmp_path: Path, at: int, value: float) -> None:
    path = tmp_path / "a.las"
    write_lidar(path)
    data = bytearray(path.read_bytes())
    struct.pack_into("<d", data, at, value)
    path.write_bytes(bytes(data))
    assert "its header gives the bounds" in outcome(lambda: open_terrain(path))


def test_a_projection_that_proj_does_not_know_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.las"
    write_lidar(path)
    data = path.read_bytes()
    assert data.count(b'METHOD["Transverse Mercator"') == 1
    unknown = data.replace(
        b'METHOD["Transverse Mercator",ID["EPSG",9807]]', b'METHOD["Transverse Merrator",ID["EPSX",9807]]'
    )
    path.write_bytes(unknown)
    said = outcome(lambda: open_terrain(path))
    assert "PROJ cannot tell where places in 'WGS 84 / UTM zone 32N' are" in said and "pass crs=" in said
