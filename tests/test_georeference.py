"""Local frame against closed-form arithmetic on the ellipsoid, which shares no code with PROJ."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence.georeference import Georeference

ALPS = Georeference(46.5, 8.0, 1200.0)

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)


def ecef(latitude_deg, longitude_deg, height_m):
    """Earth-centred coordinates, EPSG guidance note 7-2, section 4.1.1."""
    latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
    normal = SEMI_MAJOR_M / math.sqrt(1 - ECCENTRICITY_SQUARED * math.sin(latitude) ** 2)
    return np.array(
        [
            (normal + height_m) * math.cos(latitude) * math.cos(longitude),
            (normal + height_m) * math.cos(latitude) * math.sin(longitude),
            (normal * (1 - ECCENTRICITY_SQUARED) + height_m) * math.sin(latitude),
        ]
    )


def enu(anchor, latitude_deg, longitude_deg, height_m):
    """East, north and up components of the vector from the anchor."""
    latitude, longitude = math.radians(anchor.latitude_deg), math.radians(anchor.longitude_deg)
    sin_lat, cos_lat, sin_lon, cos_lon = (
        math.sin(latitude),
        math.cos(latitude),
        math.sin(longitude),
        math.cos(longitude),
    )
    enu_from_ecef = np.array(
        [
            [-sin_lon, cos_lon, 0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )
    offset = ecef(latitude_deg, longitude_deg, height_m)
    return enu_from_ecef @ (offset - ecef(anchor.latitude_deg, anchor.longitude_deg, anchor.height_m))


anchors = st.builds(Georeference, st.floats(-89, 89), st.floats(-180, 180), st.floats(-100, 5000))


@settings(max_examples=200)
@given(anchors, st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-100, 5000))
def test_local_agrees_with_the_closed_form_to_a_micrometre(anchor, north_deg, east_deg, height_m):
    latitude = anchor.latitude_deg + north_deg
    longitude = anchor.longitude_deg + east_deg
    local = anchor.local_from_geodetic(latitude, longitude, height_m)
    assert local.shape == (1, 3)
    np.testing.assert_allclose(local[0], enu(anchor, latitude, longitude, height_m), rtol=0, atol=1e-6)


@settings(max_examples=100)
@given(anchors, st.tuples(st.floats(-2e4, 2e4), st.floats(-2e4, 2e4), st.floats(-3e3, 3e3)))
def test_geodetic_is_the_inverse_of_local(anchor, point):
    latitude, longitude, height_m = anchor.geodetic_from_local([point])
    back = enu(anchor, latitude[0], longitude[0], height_m[0])
    np.testing.assert_allclose(back, point, rtol=0, atol=1e-6)


def test_the_anchor_is_the_origin_and_the_axes_are_east_north_up():
    np.testing.assert_allclose(ALPS.local_from_geodetic(46.5, 8.0, 1200.0), [[0, 0, 0]], atol=1e-8)
    east, north, up = ALPS.local_from_geodetic([46.5, 46.501, 46.5], [8.001, 8.0, 8.0], [1200, 1200, 1201])
    assert east[0] > 70 and abs(east[1]) < 0.01
    assert north[1] > 110 and abs(north[0]) < 1e-8
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-8)


def test_the_ground_falls_away_with_distance():
    # A sphere of the earth's radius drops d^2 / 2R = 7.85 m below the tangent plane at d = 10 km.
    _, _, height_m = ALPS.geodetic_from_local([[10_000.0, 0.0, 0.0]])
    assert height_m[0] - 1200 == pytest.approx(10_000.0**2 / (2 * 6.39e6), abs=0.02)


def test_utm_easting_comes_before_northing():
    # On the central meridian (9 degrees east) the easting of zone 32 is 500 km by definition and the scale is
    # 0.9996, so two points 100 m apart in the grid are 100 / 0.9996 m apart on the ellipsoid.
    anchor = Georeference.from_projected("EPSG:32632", 500_000.0, 5_150_000.0, 0.0)
    assert anchor.longitude_deg == pytest.approx(9.0, abs=1e-12)
    assert 46 < anchor.latitude_deg < 47
    local = anchor.local_from_projected("EPSG:32632", [500_000, 500_100], [5_150_100, 5_150_000], [0, 0])
    np.testing.assert_allclose(local[:, :2], [[0, 100 / 0.9996], [100 / 0.9996, 0]], atol=2e-3)


def test_longitude_is_x_even_where_the_authority_puts_latitude_first():
    local = ALPS.local_from_projected("EPSG:4326", x=8.0, y=46.501, z=1200.0)
    np.testing.assert_allclose(local[0], enu(ALPS, 46.501, 8.0, 1200.0), atol=1e-6)


def test_feet_of_a_projected_crs_are_converted():
    oregon = Georeference(44.05, -123.07, 100.0)
    in_metres = oregon.projected_from_local("EPSG:2991", [[20.0, 30.0, 0.0]])
    in_feet = oregon.projected_from_local("EPSG:2992", [[20.0, 30.0, 0.0]])
    np.testing.assert_allclose(in_feet[0, :2] * 0.3048, in_metres[0, :2], rtol=1e-9)


@pytest.mark.parametrize("crs", ["EPSG:32632", "EPSG:4326", "EPSG:2056", "EPSG:3857"])
def test_projected_and_local_are_inverse(crs):
    points = np.array([[0, 0, 0], [900, -700, 40], [-5000, 5000, -100]], float)
    projected = ALPS.projected_from_local(crs, points)
    # The national datum of EPSG:2056 is reached by a two-dimensional shift, good to about a millimetre.
    np.testing.assert_allclose(ALPS.local_from_projected(crs, *projected.T), points, atol=2e-3)


def test_heights_above_a_geoid_are_never_taken_as_ellipsoidal_without_its_grid():
    try:
        local = ALPS.local_from_projected("EPSG:32632+5773", 500_000.0, 5_150_000.0, 1200.0)
    except ValueError as error:
        assert "geoid grid for them is not installed" in str(error)
        assert "pyproj sync --file us_nga_egm96_15.tif" in str(error)
    else:  # the EGM96 grid is installed: the geoid lies 45-55 m above the ellipsoid in the Alps
        ellipsoidal = ALPS.local_from_projected("EPSG:32632", 500_000.0, 5_150_000.0, 1200.0)
        assert 40 < local[0, 2] - ellipsoidal[0, 2] < 60


@pytest.mark.parametrize("projection", ["longlat", "utm +zone=32"])
def test_a_place_beyond_a_vertical_grid_is_told(tmp_path, projection):
    """A geoid 48 m high from 45 to 48 degrees north and 10 to 12 east: (latitude, longitude) of its first
    point, steps, rows, columns."""
    grid = tmp_path / "small.gtx"
    values = np.full(35, 48.0, ">f4").tobytes()
    grid.write_bytes(struct.pack(">4d2i", 45.0, 10.0, 0.5, 0.5, 7, 5) + values)
    crs = f"+proj={projection} +datum=WGS84 +geoidgrids={grid} +vunits=m +no_defs +type=crs"
    inside = Georeference(46.0, 11.0, 548.0)
    flat = f"+proj={projection} +datum=WGS84 +no_defs +type=crs"
    x, y, _ = inside.projected_from_local(flat, [[0.0, 0.0, 0.0]])[0]
    np.testing.assert_allclose(inside.local_from_projected(crs, x, y, 500.0), [[0, 0, 0]], atol=1e-6)
    told = r"vertical grid .*small.gtx\) does not cover latitude 52, longitude 7.*height_offset_m"
    outside = Georeference(52.0, 7.0, 0.0)
    x, y, _ = outside.projected_from_local(flat, [[0.0, 0.0, 0.0]])[0]
    with pytest.raises(ValueError, match=told):
        Georeference.from_projected(crs, x, y, 500.0)
    with pytest.raises(ValueError, match=told):
        outside.projected_from_local(crs, [[0.0, 0.0, 0.0]])
    with pytest.raises(ValueError, match="entry 0, .*nan.* is not finite"):
        Georeference.from_projected(crs, math.nan, y, 500.0)
    with pytest.raises(ValueError, match="entry 0, .*nan.* is not finite"):
        Georeference.from_projected(crs, x, y, math.nan)


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ((90.1, 8, 0), "latitude_deg"),
        ((math.nan, 8, 0), "latitude_deg"),
        ((46, 180.5, 0), "longitude_deg"),
        ((46, 8, math.inf), "height_m"),
        ((46, 8, 2e5), "height_m"),
    ],
)
def test_an_impossible_anchor_names_the_value_and_its_bound(values, name):
    with pytest.raises(ValueError, match=rf"{name} is .*, must lie in \[") as caught:
        Georeference(*values)
    assert str(values[("latitude_deg", "longitude_deg", "height_m").index(name)]) in str(caught.value)


def test_bad_coordinates_are_refused_by_entry():
    with pytest.raises(ValueError, match=r"entry 1, .*nan"):
        ALPS.local_from_geodetic([46, math.nan], [8, 8], [0, 0])
    with pytest.raises(ValueError, match="entry 0"):
        ALPS.local_from_geodetic(91, 8, 0)
    with pytest.raises(ValueError, match=r"shape \[N, 3\]"):
        ALPS.geodetic_from_local([[1.0, 2.0]])
    with pytest.raises(ValueError, match="coordinates are masked; leave out what nobody knows"):
        ALPS.local_from_geodetic(np.ma.masked_equal([46.5, 0.0], 0.0), 8.0, 1200.0)
    with pytest.raises(ValueError, match="points are masked"):
        ALPS.geodetic_from_local(np.ma.masked_equal([[1.0, 2.0, -1.0]], -1.0))
    with pytest.raises(ValueError, match="EPSG:999999"):
        ALPS.local_from_projected("EPSG:999999", 0, 0, 0)


def test_no_points_give_no_points():
    assert ALPS.local_from_geodetic([], [], []).shape == (0, 3)
    assert ALPS.projected_from_local("EPSG:32632", np.empty((0, 3))).shape == (0, 3)
