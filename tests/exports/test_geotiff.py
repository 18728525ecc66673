"""The GeoTIFF, read back with rasterio and placed by closed-form geodesy."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
import shapely

from crowdfence.exports.geotiff import write_geotiff
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.state_raster import read_states
from crowdfence.georeference import Georeference
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone, ZoneSet
from support.damaged_files import damaged, outcome
from support.small_grids import flat_grid
from support.wgs84_by_hand import ground_point

DESCRIPTION = MapDescription(1_760_000_009_500_000_001, 0.7, "or", {"b_threshold": 0.5}, drones=("uav1",))
ANCHOR = (46.5, 8.0, 1200.0)


def test_bands_are_north_up_and_unseen_is_nodata(tmp_path: Path) -> None:
    # First axis east, second north: the north-east cell was never seen.
    grid = flat_grid(np.array([[0.1, 0.2], [0.0, np.nan], [0.7, 0.6]]), 0.5, (10.0, 20.0, 0.0))
    path = tmp_path / "crowd_map.tif"
    write_geotiff(path, grid, DESCRIPTION, None)
    with rasterio.open(path) as raster:
        probability, state, _ = raster.read()
        assert raster.crs is None
        assert np.isnan(raster.nodata)
        assert raster.transform @ (0, 0) == (10.0, 21.0)
        assert raster.transform @ (3, 2) == (11.5, 20.0)
        assert raster.read(1, masked=True).mask.tolist() == [[False, True, False], [False, False, False]]
        assert raster.compression.value == "DEFLATE" and raster.block_shapes[0] == (256, 256)
        tags = raster.tags()
    np.testing.assert_allclose(probability, [[0.2, np.nan, 0.6], [0.1, 0.0, 0.7]], atol=1e-7)
    assert state.tolist() == [[VoxelState.EMPTY, VoxelState.NEVER_SEEN, VoxelState.EMPTY], [2, 2, 2]]
    assert tags["METHOD"] == "or" and tags["THRESHOLD"] == "0.7"
    assert tags["STAMP_NS"] == "1760000009500000001"
    assert tags["STAMP_UTC"] == "2025-10-09T08:53:29.500000001Z"
    assert "not georeferenced" in tags["FRAME"]


def test_states_of_a_damaged_file_are_read_or_refused_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "crowd_map.tif"
    rng = np.random.default_rng(4)
    write_geotiff(path, flat_grid(rng.random((60, 50))), DESCRIPTION, None)
    intact = path.read_bytes()
    assert outcome(lambda: read_states(path)) == ""
    refused = 0
    for data in damaged(intact, 120):
        path.write_bytes(data)
        said = outcome(lambda: read_states(path))
        assert not said or (said.startswith(f"{path}: ") and "previous exception" not in said)
        refused += bool(said)
    assert refused > 30


def test_all_that_a_zone_set_closes_is_marked(tmp_path: Path) -> None:
    """The set is a sequence of its crowds, of which there are none; others closed the cell in the east."""
    static = Zone.of_no_look("CTR", shapely.box(1.0, 0.0, 2.0, 1.0), "static", "given")
    zones = ZoneSet((), 0.5, 0.0, 0, 0.0, static=(static,))
    path = tmp_path / "crowd_map.tif"
    write_geotiff(path, flat_grid(np.array([[0.1], [0.1]]), 1.0), DESCRIPTION, None, zones)
    with rasterio.open(path) as raster:
        assert raster.read(2).tolist() == [[VoxelState.EMPTY, 6]]


def test_rounding_to_float32_never_takes_a_cell_below_the_threshold(tmp_path: Path) -> None:
    path = tmp_path / "crowd_map.tif"
    write_geotiff(path, flat_grid(np.array([[0.7]])), DESCRIPTION, None)
    assert float(np.float32(0.7)) < 0.7  # what a plain cast would do
    with rasterio.open(path) as raster:
        assert float(raster.read(1)[0, 0]) >= 0.7


@pytest.mark.parametrize("anchor", [ANCHOR, (-33.9, 151.2, 20.0), (71.0, -179.999, 0.0)])
def test_corners_lie_within_a_centimetre_of_the_closed_form(
    tmp_path: Path, anchor: tuple[float, float, float]
) -> None:
    # 1200 m x 800 m, its far corner 1.7 km from the anchor, ground at 40-42 m.
    west, south, size = -300.0, 900.0, 2.0
    grid = flat_grid(np.zeros((600, 400)), size, (west, south, 40.0))
    path = tmp_path / "crowd_map.tif"
    write_geotiff(path, grid, DESCRIPTION, Georeference(*anchor))
    with rasterio.open(path) as raster:
        to_degrees = pyproj.Transformer.from_crs(raster.crs.to_wkt(), "EPSG:4326", always_xy=True)
        for column, row in ((0, 0), (600, 0), (0, 400), (600, 400), (300, 200)):
            longitude, latitude = to_degrees.transform(*(raster.transform @ (column, row)))
            place = ground_point(anchor, latitude, longitude, 42.0)
            expected = (west + column * size, south + (400 - row) * size)
            assert np.hypot(*(place[:2] - expected)) < 0.01
        assert 0.0 < float(raster.tags()["POSITION_ERROR_M"]) < 0.01


def test_the_stated_error_bounds_ground_on_a_slope(tmp_path: Path) -> None:
    # A cliff of 600 m, three kilometres away: verticals differ by 0.03 degrees, cells lean apart.
    indices = [(300, 0, 0), (301, 0, 60)]
    grid = SurfaceGrid.from_voxels(
        indices, 10.0, (0.0, 0.0, 0.0), [0.1, 0.1], [VoxelState.EMPTY, VoxelState.EMPTY]
    )
    path = tmp_path / "crowd_map.tif"
    write_geotiff(path, grid, DESCRIPTION, Georeference(*ANCHOR))
    with rasterio.open(path) as raster:
        to_degrees = pyproj.Transformer.from_crs(raster.crs.to_wkt(), "EPSG:4326", always_xy=True)
        longitude, latitude = to_degrees.transform(*(raster.transform @ (1, 0.5)))
        errors = [
            np.hypot(*(ground_point(ANCHOR, latitude, longitude, up_m)[:2] - (3010.0, 5.0)))
            for up_m in (10.0, 610.0)
        ]
        # 3010 m * 300 m / 6388 km = 14 cm at either end of the cliff.
        assert errors == pytest.approx([0.141, 0.141], abs=0.01)
        assert max(errors) <= float(raster.tags()["POSITION_ERROR_M"]) < 0.15
