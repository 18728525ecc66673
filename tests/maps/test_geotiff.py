"""Height models: the surface must come back at the right place, whatever the file's frame and units are."""

import math
from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
from rasterio.transform import Affine, from_origin

from crowdfence import Terrain
from crowdfence.georeference import Georeference
from crowdfence.maps import MapError, open_terrain, read_map
from crowdfence.maps.tangent_grid import LocalGrid, resample
from crowdfence.maps.voxel_size import chosen_voxel_size

pytestmark = pytest.mark.filterwarnings(
    "ignore::PendingDeprecationWarning", "ignore::rasterio.errors.NotGeoreferencedWarning"
)

FOOT_M = 0.3048
ALPS = Georeference(46.5, 8.0, 1200.0)


def write_tif(path, heights, crs, transform, **profile):
    """`heights` [rows, columns]."""
    bands = np.atleast_3d(heights.T).T if heights.ndim == 2 else heights
    profile = {"dtype": "float32", "nodata": -9999.0} | profile
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=bands.shape[1],
        width=bands.shape[2],
        count=bands.shape[0],
        crs=crs,
        transform=transform,
        **profile,
    ) as dataset:
        dataset.write(bands.astype(profile["dtype"]))
    return path


def applied(affine, column, row):
    return affine.a * column + affine.b * row + affine.c, affine.d * column + affine.e * row + affine.f


def plane_heights(shape, transform, plane):
    rows, columns = np.mgrid[: shape[0], : shape[1]] + 0.5
    return plane(*applied(transform, columns, rows))


def columns_of(terrain):
    """Top voxel of every column: (east, north) of the column's middle [N, 2], z of the voxel's middle [N]."""
    indices = terrain.voxel_indices(np.arange(terrain.voxel_count))
    columns, place = np.unique(indices[:, :2], axis=0, return_inverse=True)
    top = np.full(len(columns), -(2**60))
    np.maximum.at(top, place, indices[:, 2])
    origin, size = np.array(terrain.origin), terrain.voxel_size_m
    return origin[:2] + (columns + 0.5) * size, origin[2] + (top + 0.5) * size


def assert_is_plane(terrain, crs, transform, shape, plane, metres_per_height, tolerance_m):
    """Back from the voxels to the file's coordinates by PROJ's own steps, then against the plane."""
    plan, z = columns_of(terrain)
    latitude, longitude, height_m = terrain.georeference.geodetic_from_local(np.column_stack([plan, z]))
    x, y = pyproj.Transformer.from_crs(4326, crs, always_xy=True).transform(longitude, latitude)
    column, row = applied(~transform, x, y)
    # Between the outermost pixel centres; beyond them heights continue level.
    known = (column > 0.5) & (column < shape[1] - 0.5) & (row > 0.5) & (row < shape[0] - 0.5)
    assert known.sum() > 1000
    error_m = height_m - plane(x, y) * metres_per_height
    assert np.abs(error_m[known]).max() < tolerance_m
    pixel_area_m2 = known.sum() * terrain.voxel_size_m**2 / ((shape[0] - 1) * (shape[1] - 1))
    return pixel_area_m2


SHAPE = (24, 30)
COS_25, SIN_25 = math.cos(math.radians(25)), math.sin(math.radians(25))
UTM = ("EPSG:32632", 423_250.0, 5_150_020.0)
UTM_ANCHOR = Georeference.from_projected("EPSG:32632", 423_250.0, 5_150_020.0, 90.0)
FAR_ANCHOR = Georeference.from_projected("EPSG:32632", 405_250.0, 5_140_020.0, 300.0)
OREGON_ANCHOR = Georeference.from_projected("EPSG:2994", 636_000.0, 849_000.0, 100.0)


@pytest.mark.parametrize(
    ("crs", "transform", "slope", "anchor", "metres_per_height", "pixel_area_m2"),
    [
        pytest.param(UTM[0], from_origin(*UTM[1:], 0.1, 0.1), (0.3, -0.2), UTM_ANCHOR, 1, 0.01, id="utm"),
        pytest.param(
            UTM[0], from_origin(*UTM[1:], 0.1, 0.1), (0.3, -0.2), FAR_ANCHOR, 1, 0.01, id="20-km-away"
        ),
        pytest.param(
            UTM[0],
            # Columns run 25 degrees north of east, rows to their left.
            Affine(0.1 * COS_25, -0.12 * SIN_25, UTM[1], 0.1 * SIN_25, 0.12 * COS_25, UTM[2]),
            (0.1, 0.4),
            UTM_ANCHOR,
            1,
            0.012,
            id="rotated-and-south-up",
        ),
        pytest.param(
            "EPSG:4326",
            from_origin(8.0, 46.5, 1.3e-6, 9e-7),
            (2e4, 3e4),
            Georeference(46.5, 8.0, 90.0),
            1,
            # A degree is 111.16 km along this meridian and 76.76 km along this parallel (WGS84 radii of
            # curvature 6369.2 and 6389.3 km).
            1.3e-6 * 76_760 * 9e-7 * 111_160,
            id="degrees",
        ),
        pytest.param(
            "EPSG:2994",
            from_origin(636_000.0, 849_000.0, 0.35, 0.35),
            (0.2, 0.1),
            OREGON_ANCHOR,
            FOOT_M,
            (0.35 * FOOT_M) ** 2,
            id="feet",
        ),
    ],
)
def test_a_sloping_plane_comes_back_to_a_centimetre(
    tmp_path, crs, transform, slope, anchor, metres_per_height, pixel_area_m2
):
    def plane(x, y):
        return 100 + slope[0] * (x - transform.c) + slope[1] * (y - transform.f)

    path = write_tif(tmp_path / "plane.tif", plane_heights(SHAPE, transform, plane), crs, transform)
    unit = "ft" if metres_per_height == FOOT_M else "auto"
    terrain = open_terrain(path, voxel_size_m=0.01, georeference=anchor, height_unit=unit)
    assert terrain.georeference == anchor
    # The surface passes through the top voxel, whose middle is thus within half a voxel (plus rounding).
    area_m2 = assert_is_plane(terrain, crs, transform, SHAPE, plane, metres_per_height, tolerance_m=0.0075)
    assert area_m2 == pytest.approx(pixel_area_m2, rel=0.02)


def test_the_earth_curves_away_from_the_tangent_plane(tmp_path):
    # Level ground 200 m above the ellipsoid, 30 km north of an anchor at 200 m. With the radius of curvature
    # of the meridian at 46.5 degrees, 6369 km, it lies 30000^2 / (2 * 6369200) = 70.65 m below the plane.
    anchor = Georeference(46.5, 9.0, 200.0)
    x, y, _ = anchor.projected_from_local("EPSG:32632", [[0.0, 30_000.0, -70.65]])[0]
    path = write_tif(
        tmp_path / "level.tif", np.full((9, 9), 200.0), UTM[0], from_origin(x - 4.5, y + 4.5, 1, 1)
    )
    plan, z = columns_of(open_terrain(path, voxel_size_m=0.1, georeference=anchor))
    np.testing.assert_allclose(plan.mean(axis=0), [0, 30_000], atol=0.2)
    # The plumb line leans by 30 / 6369, so level ground falls 2 cm from the middle to the rim of the raster.
    np.testing.assert_allclose(z, -70.65 - (plan[:, 1] - 30_000) * 30 / 6369, atol=0.06)


def test_without_georeference_the_anchor_is_the_middle_at_the_lowest_height(tmp_path):
    heights = np.full((10, 20), 412.7)
    heights[3, 4] = 407.9
    path = write_tif(tmp_path / "a.tif", heights, "EPSG:4326", from_origin(8.0, 46.5, 1e-4, 1e-4))
    terrain = Terrain.open(path)
    anchor = terrain.georeference
    assert (anchor.longitude_deg, anchor.latitude_deg) == pytest.approx((8.001, 46.4995), abs=1e-12)
    assert anchor.height_m == 407
    assert 0 <= terrain.bounds[0, 2] <= 0.9 <= terrain.bounds[1, 2]


@pytest.mark.parametrize(
    ("pixel_m", "side", "size_m", "why"),
    [
        (0.77, 20, 0.77, "as the file's pixels of 0.77 m"),
        (0.25, 4000, 0.25, "as the file's pixels of 0.25 m"),
        (0.05, 20, 0.25, "coarser than the file's pixels of 0.05 m, because every one costs"),
        (7.7, 20, 0.5, "finer than the file's pixels of 7.7 m, because people are"),
        # 10 million columns on 36 km2 are 1.9 m wide, on 2500 km2 15.8 m: wider than these pixels are.
        (60.0, 100, 2.0, "finer than the file's pixels of 60 m"),
        (10.0, 5000, 10.0, "as the file's pixels of 10 m; finer ones would be too many"),
    ],
)
def test_the_file_or_the_size_of_people_chooses_the_voxels(pixel_m, side, size_m, why):
    chosen = chosen_voxel_size(None, pixel_m, f"the file's pixels of {pixel_m:g} m", (side * pixel_m) ** 2)
    assert chosen.size_m == size_m and chosen.why.startswith(why)
    assert chosen_voxel_size(3.0, pixel_m, "", 1.0).size_m == 3.0


def test_a_wall_of_a_photogrammetric_model_stands_in_its_coarser_voxels(tmp_path):
    heights = np.zeros((100, 100))  # 5 m of 5 cm
    heights[:, 54] = 2.0  # 5 cm thick, 2.70 m from the western edge: the middle of its column lies at 2.625 m
    path = write_tif(tmp_path / "dsm.tif", heights, "EPSG:32632", from_origin(500_000, 5_300_000, 0.05, 0.05))
    terrain = open_terrain(path)
    assert terrain.voxel_size_m == 0.25
    tops = terrain.voxel_centers(np.arange(terrain.voxel_count))[:, 2] + 0.125
    assert tops.max() == pytest.approx(2.0, abs=0.25)
    assert (tops > 1.0).sum() >= 20  # along all of its 5 m


def test_voxels_take_the_shorter_side_of_fine_pixels_and_people_s_size_of_coarse_ones(tmp_path):
    heights = np.full((10, 20), 412.7)
    fine = write_tif(tmp_path / "fine.tif", heights, "EPSG:4326", from_origin(8.0, 46.5, 1e-5, 1e-5))
    reading = read_map(fine)
    # Pixels of 0.77 m x 1.11 m.
    assert (reading.terrain.voxel_size_m, reading.voxel_size_why) == (0.77, "as the file's pixels of 0.77 m")
    coarse = write_tif(tmp_path / "coarse.tif", heights, "EPSG:4326", from_origin(8.0, 46.5, 1e-4, 1e-4))
    reading = read_map(coarse)
    assert reading.terrain.voxel_size_m == 0.5 and "because people are" in reading.voxel_size_why


def local_map(tmp_path, heights, **profile):
    """Pixels of 1 m in local metres, lower left corner at (10, 20)."""
    transform = from_origin(10, 20 + heights.shape[-2], 1, 1)
    return write_tif(tmp_path / "local.tif", heights, None, transform, **profile)


def heights_by_column(terrain):
    plan, z = columns_of(terrain)
    return {(int(east // 1), int(north // 1)): float(up) for (east, north), up in zip(plan, z, strict=True)}


@pytest.mark.parametrize("missing", [-9999.0, math.nan, math.inf])
def test_missing_data_is_a_hole_of_its_own_size_and_never_height_zero(tmp_path, missing):
    heights = np.full((5, 6), 50.0)
    heights[1, 2] = heights[4, 5] = missing
    path = local_map(tmp_path, heights)
    columns = heights_by_column(open_terrain(path, assume_local=True, max_hole_m2=0))
    # Row 1 from the top is north 23, row 4 north 20; column 2 is east 12, column 5 east 15.
    everywhere = {(10 + i, 20 + j) for i in range(6) for j in range(5)}
    assert columns.keys() == everywhere - {(12, 23), (15, 20)}
    assert set(columns.values()) == {50.5}


@pytest.mark.parametrize("kind", ["alpha", "alpha beside a value", "mask beside a value"])
@pytest.mark.parametrize("dtype", ["float32", "int16", "uint16"])
def test_all_that_a_file_says_of_missing_data_counts(tmp_path, kind, dtype):
    """GDAL's mask holds one of mask, value and alpha, and of most types no alpha."""
    mark = None if kind == "alpha" else 9.0
    heights, valid = np.full((3, 5), 7.0), np.full((3, 5), 255.0)
    valid[1, 1] = 0.0
    if mark is not None:
        heights[1, 3] = mark
    transform, path = from_origin(10, 23, 1, 1), tmp_path / "a.tif"
    if kind.startswith("alpha"):
        write_tif(path, np.stack([heights, valid]), None, transform, dtype=dtype, nodata=mark, alpha="YES")
    else:
        write_tif(path, heights, None, transform, dtype=dtype, nodata=mark)
        with rasterio.open(path, "r+") as dataset:
            dataset.write_mask(valid.astype(np.uint8))
    columns = heights_by_column(open_terrain(path, assume_local=True, max_hole_m2=0))
    missing = {(11, 21)} | (set() if mark is None else {(13, 21)})
    assert columns.keys() == {(10 + i, 20 + j) for i in range(5) for j in range(3)} - missing
    assert set(columns.values()) == {7.5}


def test_nothing_is_interpolated_across_what_splits_the_map(tmp_path):
    heights = np.array([[10.0, 10.0, -9999.0, 90.0, 90.0]] * 3)
    terrain = open_terrain(local_map(tmp_path, heights), assume_local=True, voxel_size_m=0.25)
    plan, z = columns_of(terrain)
    west, east = plan[:, 0] < 12, plan[:, 0] > 13
    assert (west | east).all()
    assert set(z[west]) == {10.125} and set(z[east]) == {90.125}


@pytest.mark.parametrize("mark", [-32768, -999, 9999])
def test_an_undeclared_mark_of_missing_data_is_refused_with_its_place(tmp_path, mark):
    heights = np.full((5, 6), -430.0)  # the lowest land there is
    heights[3, 1] = mark
    path = local_map(tmp_path, heights, nodata=None)
    with pytest.raises(MapError, match=rf"height {mark}\.0 at row 3, column 1 .*pass nodata={mark}\.0"):
        open_terrain(path, assume_local=True)
    terrain = open_terrain(path, assume_local=True, nodata=mark, max_hole_m2=0)
    assert len(heights_by_column(terrain)) == 29


def test_heights_of_zero_far_below_all_others_are_doubted(tmp_path):
    """3 of 12 pixels; land from 20 m on is no shore of what lies at 0."""
    heights = np.full((3, 4), 60.0)
    heights[:, 0] = 0.0
    (doubt,) = read_map(local_map(tmp_path, heights, nodata=None), assume_local=True).doubts
    assert doubt.startswith("3 pixels (25.0%) have the height 0 and all others 60 and more")
    assert "pass nodata=0" in doubt
    path = local_map(tmp_path, heights, nodata=None)
    assert read_map(path, assume_local=True, nodata=0).doubts == ()
    assert read_map(path, assume_local=True, height_unit="ft").doubts == ()  # 18.3 m


@pytest.mark.parametrize(
    ("mark", "dtype", "unit"),
    [(255, "uint8", "m"), (999, "float32", "m"), (9999, "float32", "ft"), (9999, "int16", "ft")],
)
def test_marks_far_above_all_heights_are_doubted(tmp_path, mark, dtype, unit):
    """The largest number of a byte, and nines; not a tower of another height."""
    heights = np.full((3, 4), 120, dtype)
    heights[0, 0], heights[1, 1] = 115, mark
    path = local_map(tmp_path, heights, dtype=dtype, nodata=None)
    (doubt,) = read_map(path, assume_local=True, height_unit=unit).doubts
    assert doubt.startswith(f"1 pixels (8.3%) have the height {mark} and all others 120 and less")
    assert doubt.endswith(f"pass nodata={mark}")
    assert read_map(path, assume_local=True, height_unit=unit, nodata=mark).doubts == ()
    heights[1, 1] = mark - 5
    assert (
        read_map(
            local_map(tmp_path, heights, dtype=dtype, nodata=None), assume_local=True, height_unit=unit
        ).doubts
        == ()
    )
    heights[1, 1:3] = mark, mark - 5  # a slope that goes on
    assert (
        read_map(
            local_map(tmp_path, heights, dtype=dtype, nodata=None), assume_local=True, height_unit=unit
        ).doubts
        == ()
    )


@pytest.mark.parametrize("mark", [-99.0, -0.5, 1.0, 300.0])
def test_other_marks_far_below_all_heights_are_doubted(tmp_path, mark):
    heights = np.full((3, 4), 320.0)
    heights[1, 1] = heights[2, 2] = mark
    path = local_map(tmp_path, heights, nodata=None)
    (doubt,) = read_map(path, assume_local=True).doubts
    assert doubt.startswith(f"2 pixels (16.7%) have the height {mark:g} and all others 320 and more")
    assert doubt.endswith(f"pass nodata={mark:g}")
    assert read_map(path, assume_local=True, nodata=mark).doubts == ()
    heights[1, 1] += 19.9  # the shore of a lake
    assert read_map(local_map(tmp_path, heights, nodata=None), assume_local=True).doubts == ()


def test_a_mark_is_named_as_it_is_stored(tmp_path):
    stored = np.full((3, 4), 25_000)
    stored[1, 1] = -32_768
    path = local_map(tmp_path, stored, dtype="int16", nodata=None)
    with rasterio.open(path, "r+") as dataset:
        dataset.scales, dataset.offsets = [0.01], [0.0]
    (doubt,) = read_map(path, assume_local=True).doubts
    assert "the height -327.68 and all others 250" in doubt and doubt.endswith("pass nodata=-32768")
    assert read_map(path, assume_local=True, nodata=-32_768).doubts == ()


def test_a_picture_of_colours_is_no_height_model(tmp_path):
    path = local_map(tmp_path, np.full((3, 3), 5), dtype="uint8", nodata=None, photometric="palette")
    with rasterio.open(path, "r+") as dataset:
        dataset.write_colormap(1, {index: (index, 0, 0, 255) for index in range(256)})
    with pytest.raises(MapError, match="band 1 holds numbers of colours, .* pass band=1 if they are heights"):
        open_terrain(path, assume_local=True)
    assert set(heights_by_column(open_terrain(path, assume_local=True, band=1)).values()) == {5.5}


def test_whoever_takes_the_terrain_alone_is_warned(tmp_path):
    heights = np.array([[0.0, 60.0, 60.0]] * 3)
    path = local_map(tmp_path, heights, nodata=None)
    for opened in (open_terrain, Terrain.open):
        with pytest.warns(UserWarning, match="have the height 0 and all others 60 and more") as told:
            opened(path, assume_local=True)
        assert [Path(one.filename).name for one in told if one.category is UserWarning] == ["test_geotiff.py"]


@pytest.mark.parametrize("shore", [0.5, 19.0, -1.0])
def test_the_sea_is_no_doubt(tmp_path, shore):
    heights = np.array([[0.0, shore, 60.0]] * 3)
    assert read_map(local_map(tmp_path, heights, nodata=None), assume_local=True).doubts == ()
    assert read_map(local_map(tmp_path, np.zeros((3, 3))), assume_local=True).doubts == ()


@pytest.mark.parametrize(("scale", "offset"), [(0.0, 0.0), (math.nan, 0.0), (1.0, math.inf)])
def test_a_scale_that_makes_no_heights_is_one_line(tmp_path, scale, offset):
    path = write_tif(tmp_path / "a.tif", np.full((4, 4), 500.0), UTM[0], from_origin(*UTM[1:], 1, 1))
    with rasterio.open(path, "r+") as dataset:
        dataset.scales, dataset.offsets = (scale,), (offset,)
    with pytest.raises(MapError, match=f"heights are its values times {scale:g} plus {offset:g}"):
        open_terrain(path)


def test_integer_heights_with_scale_and_offset(tmp_path):
    path = local_map(tmp_path, np.full((3, 3), 125), dtype="int16", nodata=0)
    with rasterio.open(path, "r+") as dataset:
        dataset.scales, dataset.offsets = [0.1], [500.0]
    assert set(heights_by_column(open_terrain(path, assume_local=True)).values()) == {512.5}


def test_a_local_map_may_be_given_a_place_on_earth(tmp_path):
    path = local_map(tmp_path, np.full((3, 3), 5.0))
    terrain = open_terrain(path, assume_local=True, georeference=ALPS)
    assert terrain.georeference == ALPS
    np.testing.assert_array_equal(terrain.bounds, [[10, 20, 5], [13, 23, 6]])
    assert open_terrain(path, assume_local=True).georeference is None


def test_local_metres_are_never_guessed(tmp_path):
    path = local_map(tmp_path, np.full((3, 3), 5.0))
    with pytest.raises(MapError, match=r"no coordinate reference system; pass crs=.* or assume_local=True"):
        open_terrain(path)
    utm = write_tif(tmp_path / "utm.tif", np.full((3, 3), 5.0), UTM[0], from_origin(*UTM[1:], 1, 1))
    with pytest.raises(MapError, match=r"assume_local contradicts .*UTM zone 32N"):
        open_terrain(utm, assume_local=True)
    nowhere = write_tif(tmp_path / "nowhere.tif", np.full((3, 3), 5.0), UTM[0], Affine.identity())
    with pytest.raises(MapError, match="no geotransform"):
        open_terrain(nowhere)
    # Taken for metres, its rows would run to the north: the map mirrored.
    picture = write_tif(tmp_path / "picture.tif", np.full((3, 3), 5.0), None, Affine.identity())
    with pytest.raises(MapError, match="no geotransform"):
        open_terrain(picture, assume_local=True)


def test_a_stated_crs_stands_for_a_missing_one(tmp_path):
    heights = np.full((8, 8), 640.0)
    transform = from_origin(*UTM[1:], 1, 1)
    known = open_terrain(write_tif(tmp_path / "a.tif", heights, UTM[0], transform))
    stated = open_terrain(write_tif(tmp_path / "b.tif", heights, None, transform), crs=UTM[0])
    assert stated.georeference == known.georeference
    assert stated.fingerprint == known.fingerprint


@pytest.mark.parametrize(
    ("crs", "label", "unit", "metres"),
    [
        ("EPSG:2994", "ft", "auto", FOOT_M),
        ("EPSG:2994", None, "ft", FOOT_M),
        ("EPSG:2994", None, "m", 1.0),
        ("EPSG:2994", "metre", "auto", 1.0),
        ("EPSG:32632", None, "auto", 1.0),
        ("EPSG:32632", "US survey foot", "auto", 1200 / 3937),
        ("EPSG:32632", None, "us-ft", 1200 / 3937),
        ("EPSG:4326", None, "auto", 1.0),
        ("EPSG:4326", "ft", "auto", FOOT_M),
    ],
)
def test_units_of_heights(tmp_path, crs, label, unit, metres):
    # A pixel large enough to hold a few voxels in every system.
    x, y, size = {
        "EPSG:2994": (636_000, 849_000, 10),
        "EPSG:32632": (*UTM[1:], 5),
        "EPSG:4326": (8, 46.5, 1e-4),
    }[crs]
    path = write_tif(tmp_path / "a.tif", np.full((2, 2), 1000.0), crs, from_origin(x, y, size, size))
    if label:
        with rasterio.open(path, "r+") as dataset:
            dataset.units = [label]
    terrain = open_terrain(path, voxel_size_m=0.5, height_unit=unit)
    assert terrain.georeference.height_m == math.floor(1000 * metres)
    assert terrain.bounds[0, 2] <= 1000 * metres % 1 <= terrain.bounds[1, 2]


@pytest.mark.parametrize("crs", ["EPSG:2994", "EPSG:2263"])
def test_heights_over_coordinates_in_feet_are_not_guessed(tmp_path, crs):
    x, y = {"EPSG:2994": (636_000, 849_000), "EPSG:2263": (983_000, 194_000)}[crs]
    path = write_tif(tmp_path / "a.tif", np.full((2, 2), 20.0), crs, from_origin(x, y, 10, 10))
    unit = {"EPSG:2994": "foot", "EPSG:2263": "US survey foot"}[crs]
    said = (
        f"its coordinates are in {unit}, and nothing says what its heights are in; pass height_unit='m', 'ft'"
    )
    with pytest.raises(MapError, match=said):
        open_terrain(path)


def test_an_unknown_unit_is_refused(tmp_path):
    path = write_tif(tmp_path / "a.tif", np.full((2, 2), 10.0), UTM[0], from_origin(*UTM[1:], 1, 1))
    with rasterio.open(path, "r+") as dataset:
        dataset.units = ["fathom"]
    with pytest.raises(MapError, match="'fathom'; pass height_unit"):
        open_terrain(path)
    with pytest.raises(MapError, match="height_unit is 'yard', must be"):
        open_terrain(path, height_unit="yard")


def test_heights_above_a_geoid_need_its_grid_or_an_offset(tmp_path):
    path = write_tif(
        tmp_path / "a.tif", np.full((4, 4), 500.0), "EPSG:32632+5773", from_origin(*UTM[1:], 1, 1)
    )
    try:
        anchor = open_terrain(path).georeference
    except MapError as error:
        assert "geoid grid" in error.reason and "height_offset_m" in error.reason
    else:  # the EGM96 grid is installed: the geoid lies 45-55 m above the ellipsoid there
        assert 540 < anchor.height_m < 560
    assert open_terrain(path, height_offset_m=48.25).georeference.height_m == 548


def test_a_map_goes_on_across_the_date_line(tmp_path):
    # Fiji: 40 pixels of 1e-5 degrees, half of them beyond 180 degrees east.
    transform = from_origin(179.9998, -16.8, 1e-5, 1e-5)
    path = write_tif(tmp_path / "a.tif", np.full((30, 40), 20.0), "EPSG:4326", transform)
    terrain = open_terrain(path, voxel_size_m=1.0, georeference=Georeference(-16.80015, 180.0, 0.0))
    # 1e-5 degrees are 1.066 m along this parallel: 21.3 m on each side.
    np.testing.assert_allclose(terrain.bounds[:, 0], [-21, 21], atol=1.01)
    assert len(columns_of(terrain)[0]) == pytest.approx(42.6 * 33.2, rel=0.03)


@pytest.mark.parametrize(
    ("west", "longitude"), [(352.0, -8.0), (180.0, -180.0), (179.9999, -180.0), (-181.5, 178.5)]
)
def test_longitudes_that_go_on_beyond_the_date_line_place_the_map(tmp_path, west, longitude):
    transform = from_origin(west, -16.8, 1e-5, 1e-5)
    terrain = open_terrain(write_tif(tmp_path / "a.tif", np.full((30, 40), 20.0), "EPSG:4326", transform))
    anchor = terrain.georeference
    assert (anchor.latitude_deg, anchor.longitude_deg) == pytest.approx((-16.80015, longitude), abs=3e-4)
    np.testing.assert_allclose(terrain.bounds[:, 0], [-21.3, 21.3], atol=1.01)
    assert len(columns_of(terrain)[0]) * terrain.voxel_size_m**2 == pytest.approx(42.6 * 33.2, rel=0.03)


@pytest.mark.parametrize("options", [{}, {"height_offset_m": 48.25}])
def test_depths_are_not_taken_for_heights(tmp_path, options):
    """With an offset, which the refusal of their datum asked for, ground at 300 m lay 252 m below the sea."""
    path = write_tif(
        tmp_path / "a.tif", np.full((4, 4), -300.0), "EPSG:32632+5715", from_origin(*UTM[1:], 1, 1)
    )
    with pytest.raises(MapError, match="MSL depth' counts depths, downward"):
        open_terrain(path, **options)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("crs", ["EPSG:3857", "EPSG:3395"])
def test_a_projected_map_goes_on_across_the_date_line(tmp_path, crs, side):
    """The half beyond it was no part of the map, and nothing said so: crowds there were nowhere."""
    # x of the 180th meridian is pi times 6378137 m. A metre of Mercator is cos(16.8) = 0.957 m there.
    line = side * math.pi * 6_378_137.0
    _, y = pyproj.Transformer.from_crs(4326, crs, always_xy=True).transform(0.0, -16.8)
    transform = from_origin(line - 20.0, y, 1.0, 1.0)
    rise = np.tile(np.arange(40.0) * 0.5 + 20.0, (30, 1))
    terrain = open_terrain(write_tif(tmp_path / "a.tif", rise, crs, transform), voxel_size_m=1.0)
    assert abs(terrain.georeference.longitude_deg) == pytest.approx(180.0, abs=1e-6)
    np.testing.assert_allclose(terrain.bounds[:, 0], [-19.1, 19.1], atol=1.01)
    plan, z = columns_of(terrain)
    assert len(plan) == pytest.approx(38.3 * 28.6, rel=0.05)
    # From 19.75 m at its western edge half a metre a pixel; the anchor stands at 20 m.
    inner = np.abs(plan[:, 0]) < 18.0
    np.testing.assert_allclose(z[inner], 9.75 + plan[inner, 0] / 0.957 * 0.5, atol=0.6)


def test_a_map_beyond_the_edge_of_its_projection_is_refused(tmp_path):
    # In this one the 180th meridian is a curve, and beyond it x begins anew by another way in every row.
    x, y = pyproj.Transformer.from_crs(4326, "ESRI:54008", always_xy=True).transform(179.9999, -16.8)
    path = write_tif(tmp_path / "a.tif", np.full((30, 400), 20.0), "ESRI:54008", from_origin(x, y, 1.0, 1.0))
    with pytest.raises(MapError, match="beyond the edge of its reference system 'World_Sinusoidal'"):
        open_terrain(path, georeference=Georeference(-16.8, 180.0, 0.0))


def test_bands(tmp_path):
    two = write_tif(
        tmp_path / "two.tif",
        np.stack([np.full((3, 3), 7.0), np.full((3, 3), 8.0)]),
        None,
        from_origin(0, 3, 1, 1),
    )
    with pytest.raises(MapError, match="2 bands; say which"):
        open_terrain(two, assume_local=True)
    assert set(heights_by_column(open_terrain(two, assume_local=True, band=2)).values()) == {8.5}
    with pytest.raises(MapError, match="band is 3, the file has bands 1 to 2"):
        open_terrain(two, assume_local=True, band=3)
    waves = local_map(tmp_path, np.ones((3, 3)), dtype="complex64", nodata=None)
    with pytest.raises(MapError, match="complex64; heights are real"):
        open_terrain(waves, assume_local=True)


def test_sizes_that_do_not_fit_are_refused_with_a_size_that_does(tmp_path):
    path = local_map(tmp_path, np.full((100, 100), 5.0))
    with pytest.raises(MapError, match=r"100000 x 100000 columns of 0\.001 m .*voxel_size_m above 0\.01"):
        open_terrain(path, assume_local=True, voxel_size_m=0.001)
    huge = tmp_path / "huge.tif"
    with rasterio.open(
        huge,
        "w",
        driver="GTiff",
        width=200_000,
        height=200_000,
        count=1,
        dtype="uint8",
        tiled=True,
        sparse_ok=True,
    ):
        pass
    with pytest.raises(MapError, match="200000 x 200000 pixels, the bound is 1000000000"):
        open_terrain(huge, assume_local=True)


@pytest.mark.parametrize("size", [0.0, -1.0, math.nan, math.inf])
def test_impossible_voxel_sizes_are_refused(tmp_path, size):
    path = local_map(tmp_path, np.full((3, 3), 5.0))
    with pytest.raises(MapError, match=r"voxel_size_m is .*; it must be in \[0\.001, 100\], metres"):
        open_terrain(path, assume_local=True, voxel_size_m=size)


def test_damaged_files(tmp_path):
    path = write_tif(
        tmp_path / "a.tif",
        np.random.default_rng(1).uniform(0, 50, (200, 200)),
        UTM[0],
        from_origin(*UTM[1:], 1, 1),
        compress="deflate",
    )
    whole = path.read_bytes()
    for cut in (len(whole) // 2, len(whole) - 2000, 200, 7):
        path.write_bytes(whole[:cut])
        with pytest.raises(MapError, match=r"a\.tif: .*(truncated|not a readable)"):
            open_terrain(path)
    path.write_bytes(b"height above sea level: 12 m\n")
    with pytest.raises(MapError, match=r"not a readable GeoTIFF"):
        open_terrain(path)


def test_a_map_without_any_height_is_refused(tmp_path):
    path = local_map(tmp_path, np.full((4, 4), -9999.0))
    with pytest.raises(MapError, match="no pixel has a height"):
        open_terrain(path, assume_local=True)


def test_a_map_smaller_than_a_voxel_is_refused_for_that(tmp_path):
    path = write_tif(tmp_path / "a.tif", np.full((4, 4), 5.0), UTM[0], from_origin(*UTM[1:], 1, 1))
    with pytest.raises(MapError, match="no column of 100 m has its middle on .*pass a smaller voxel_size_m"):
        open_terrain(path, voxel_size_m=100.0)
    assert open_terrain(path, voxel_size_m=2.0).voxel_count == 4


def test_a_map_of_another_place_is_refused(tmp_path):
    path = write_tif(tmp_path / "a.tif", np.full((4, 4), 5.0), UTM[0], from_origin(*UTM[1:], 1, 1))
    with pytest.raises(MapError, match=r"\d{4} km away .* bound is 200 km"):
        open_terrain(path, georeference=Georeference(8.0, 46.5, 1200.0))


@pytest.mark.parametrize("origin", [(432_100.0, 5_150_000.0), (432_100.0, 40.0)])
def test_metres_that_are_declared_as_degrees_are_refused_for_what_they_are(tmp_path, origin):
    path = write_tif(tmp_path / "a.tif", np.full((4, 4), 5.0), "EPSG:4326", from_origin(*origin, 1, 1))
    for georeference in (None, ALPS):
        with pytest.raises(
            MapError, match=r"432102, .* which is no longitude and latitude .*'WGS 84'; pass crs"
        ):
            open_terrain(path, georeference=georeference)


@pytest.mark.parametrize("anchor", [FAR_ANCHOR, Georeference(46.5, 9.0, 0.0), Georeference(70.0, -30.0, 0.0)])
@pytest.mark.parametrize("distance_m", [0.0, 100_000.0])
def test_interpolating_the_projection_costs_less_than_a_millimetre(anchor, distance_m):
    """Against PROJ asked for every single cell, on hills with slopes up to 0.6."""
    zone = pyproj.CRS.from_user_input(f"EPSG:{32601 + int((anchor.longitude_deg + 180) // 6)}")
    middle = anchor.projected_from_local(zone, [[distance_m, 0.0, 0.0]])[0]

    def hills(x, y):
        return 300 + middle[2] + 120 * np.sin((x - middle[0]) / 200) * np.cos((y - middle[1]) / 300)

    def heights(node_spacing_m):
        return resample(
            LocalGrid(distance_m - 500, -500.0, 10.0, (100, 100)),
            lambda points: anchor.projected_from_local(zone, points),
            hills,
            up_range_m=(0.0, 600.0),
            base_up_m=0.0,
            node_spacing_m=node_spacing_m,
        )

    exact = heights(0.0)
    assert np.isfinite(exact).all() and np.ptp(exact) > 150
    np.testing.assert_allclose(heights(100.0), exact, rtol=0, atol=1e-3)
    # And the exact ones do lie on the surface.
    grid = LocalGrid(distance_m - 500, -500.0, 10.0, (100, 100))
    east, north = np.meshgrid(grid.east_centres_m(0, 100), grid.north_centres_m(0, 100), indexing="ij")
    x, y, height = anchor.projected_from_local(
        zone, np.stack([east, north, exact.astype(np.float64)], axis=-1).reshape(-1, 3)
    ).T
    np.testing.assert_allclose(height, hills(x, y), rtol=0, atol=2e-3)
