"""What the keys of GeoTIFF and LAS files say of heights: from where they count, and in which unit."""

import math

import numpy as np
import pyproj
import pytest
import rasterio
from rasterio.transform import from_origin

from crowdfence.maps import MapError, open_terrain, stated_place
from crowdfence.maps.geo_keys import tiff_vertical_unit
from support.geo_key_files import write_las, write_tiff

pytestmark = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")

EAST, NORTH, HEIGHT = 500_000.0, 5_150_000.0, 500.0
PROJECTED = {1024: 1, 1025: 1, 3072: 26910}  # NAD83 / UTM zone 10N
SURVEY_FOOT_M = 1200 / 3937

NAVD88 = 5103  # of GeoTIFF 1.0; EPSG:5703 since
ELLIPSOID = 5030


def written(tmp_path, kind, keys):
    """Level ground at `HEIGHT`, 20 x 20 units."""
    if kind == "tif":
        heights = np.full((20, 20), HEIGHT)
        return write_tiff(tmp_path / "a.tif", heights, keys, west=EAST, north=NORTH)
    east, north = np.mgrid[0:20, 0:20].reshape(2, -1) + 0.5
    points = np.column_stack([EAST + east, NORTH - north, np.full(east.shape, HEIGHT)])
    return write_las(tmp_path / "a.las", points, keys)


@pytest.mark.parametrize("kind", ["tif", "las"])
@pytest.mark.parametrize("vertical", [5703, NAVD88, 5773, 3855, 6360])
def test_heights_above_a_geoid_are_not_taken_for_the_ellipsoid_s(tmp_path, kind, vertical):
    path = written(tmp_path, kind, PROJECTED | {4096: vertical})
    unit_m = SURVEY_FOOT_M if vertical == 6360 else 1.0
    try:
        anchor = open_terrain(path, voxel_size_m=0.5).georeference
    except MapError as error:
        assert "geoid grid" in error.reason and "height_offset_m" in error.reason
    else:  # the grid is installed: the geoid lies some 20 m below the ellipsoid in Washington
        assert HEIGHT * unit_m - 30 < anchor.height_m < HEIGHT * unit_m - 10
    with_offset = open_terrain(path, voxel_size_m=0.5, height_offset_m=-20.0)
    assert with_offset.georeference.height_m == math.floor(HEIGHT * unit_m - 20.0)


@pytest.mark.parametrize("version", ["1.0", "1.1"])
def test_a_vertical_system_counts_in_files_of_both_versions(tmp_path, version):
    path = tmp_path / "a.tif"
    size = {"height": 4, "width": 4, "count": 1, "transform": from_origin(EAST, NORTH, 1, 1)}
    crs = pyproj.CRS("EPSG:6339+5703").to_wkt()
    with rasterio.open(
        path, "w", driver="GTiff", dtype="float32", crs=crs, GEOTIFF_VERSION=version, **size
    ) as dataset:
        dataset.write(np.full((1, 4, 4), HEIGHT, np.float32))
    try:
        height_m = open_terrain(path).georeference.height_m
    except MapError as error:
        assert "NAVD88 height" in error.reason
    else:
        assert height_m < HEIGHT - 10


@pytest.mark.parametrize("order", ["LITTLE", "BIG"])
@pytest.mark.parametrize("big", ["YES", "NO"])
def test_the_key_of_the_unit_is_found_in_every_form_of_tiff(tmp_path, order, big):
    path = tmp_path / "a.tif"
    size = {"height": 4, "width": 4, "count": 1, "transform": from_origin(EAST, NORTH, 1, 1)}
    form = {"GEOTIFF_VERSION": "1.0", "ENDIANNESS": order, "BIGTIFF": big}
    with rasterio.open(
        path, "w", driver="GTiff", dtype="float32", crs="EPSG:6339+6360", **form, **size
    ) as dataset:
        dataset.write(np.full((1, 4, 4), HEIGHT, np.float32))
    assert tiff_vertical_unit(path) == "US survey foot"
    with rasterio.open(path, "w", driver="GTiff", dtype="float32", **form, **size) as dataset:
        dataset.write(np.full((1, 4, 4), HEIGHT, np.float32))
    assert tiff_vertical_unit(path) is None


@pytest.mark.parametrize("kind", ["tif", "las"])
@pytest.mark.parametrize(
    ("keys", "metres"),
    [
        ({4099: 9001}, 1.0),
        ({4099: 9002}, 0.3048),
        ({4099: 9003}, SURVEY_FOOT_M),
        ({4096: 32767, 4099: 9003}, SURVEY_FOOT_M),
        ({4096: ELLIPSOID, 4099: 9003}, SURVEY_FOOT_M),
        ({4096: ELLIPSOID}, 1.0),
    ],
)
def test_a_unit_alone_and_the_ellipsoid_are_no_geoid(tmp_path, kind, keys, metres):
    path = written(tmp_path, kind, PROJECTED | keys)
    assert stated_place(path) == "earth"
    assert open_terrain(path, voxel_size_m=0.5).georeference.height_m == math.floor(HEIGHT * metres)


@pytest.mark.parametrize("kind", ["tif", "las"])
@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({4096: NAVD88, 4099: 9003}, "heights in US survey foot, .* counts in metre; pass height_unit="),
        ({4096: 6360, 4099: 9001}, "heights in metre, .* counts in US survey foot; pass height_unit="),
        ({4099: 9005}, "heights in 'EPSG unit 9005'; pass height_unit="),
    ],
)
def test_units_that_contradict_each_other_are_not_guessed(tmp_path, kind, keys, said):
    path = written(tmp_path, kind, PROJECTED | keys)
    with pytest.raises(MapError, match=said):
        open_terrain(path, height_offset_m=0.0)
    terrain = open_terrain(path, voxel_size_m=0.5, height_offset_m=-20.0, height_unit="us-ft")
    assert terrain.georeference.height_m == math.floor(HEIGHT * SURVEY_FOOT_M - 20.0)


def test_a_unit_beside_the_code_of_a_projection_counts_for_points_too(tmp_path):
    # Easting and northing of UTM in survey feet, as some states have written them.
    keys = PROJECTED | {3076: 9003, 4099: 9001}
    east, north = np.mgrid[0:20, 0:20].reshape(2, -1) + 0.5
    corner = np.array([EAST, NORTH]) / SURVEY_FOOT_M
    points = np.column_stack([corner[0] + east, corner[1] + north, np.full(east.shape, HEIGHT)])
    anchor = open_terrain(write_las(tmp_path / "a.las", points, keys), voxel_size_m=0.5).georeference
    longitude, latitude = pyproj.Transformer.from_crs(26910, 4326, always_xy=True).transform(
        EAST + 10 * SURVEY_FOOT_M, NORTH + 10 * SURVEY_FOOT_M
    )
    assert (anchor.longitude_deg, anchor.latitude_deg) == pytest.approx((longitude, latitude), abs=1e-6)
    assert anchor.height_m == HEIGHT
