"""Reference systems whose datum PROJ does not know: refused, or taken as WGS84 and said so."""

import numpy as np
import pyproj
import pytest

from crowdfence.datum import datum_doubt
from crowdfence.georeference import Georeference

BERLIN = Georeference(52.5, 13.4, 0.0)
# The national grid of Germany with the ellipsoid but without its datum, as many tools write it.
BESSEL = "+proj=tmerc +lat_0=0 +lon_0=12 +k=1 +x_0=4500000 +ellps=bessel +units=m"
GRS80 = "+proj=utm +zone=33 +ellps=GRS80 +units=m"
POTSDAM = "+towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7"  # DHDN to WGS84 (2), EPSG:1777


def doubt(crs):
    return datum_doubt(pyproj.CRS.from_user_input(crs))


@pytest.mark.parametrize(
    "crs",
    [
        BESSEL,
        "+proj=utm +zone=33 +ellps=intl",
        "EPSG:4610",  # Xian 1980
        "EPSG:6984",  # a step on the way to the Israeli grid, though on GRS80
        "+proj=merc +a=6378137 +b=6378137",
    ],
)
def test_a_datum_that_lies_anywhere_is_refused_with_what_to_do(crs):
    with pytest.raises(ValueError, match=r"how the datum .* lies to WGS84.*pass crs='EPSG:...'"):
        Georeference.from_projected(crs, 500_000.0, 5_150_000.0, 0.0)
    with pytest.raises(ValueError, match="does not know how the datum"):
        BERLIN.projected_from_local(crs, [[0.0, 0.0, 0.0]])


def test_the_same_grid_with_its_datum_is_placed_to_some_metres():
    # Both ways to say the datum agree; degrees on Bessel's ellipsoid taken as WGS84 are 197 m off here.
    named = BERLIN.projected_from_local("EPSG:31468", [[0.0, 0.0, 0.0]])[0]
    local = BERLIN.local_from_projected(f"{BESSEL} {POTSDAM}", *named)[0]
    assert np.linalg.norm(local[:2]) < 5.0
    assert doubt("EPSG:31468") is None and doubt(f"{BESSEL} {POTSDAM}") is None


@pytest.mark.parametrize("crs", [GRS80, "+proj=utm +zone=33 +ellps=WGS84", "EPSG:4490", "EPSG:8244"])
def test_a_datum_on_the_ellipsoid_of_satellites_is_taken_as_wgs84_and_doubted(crs):
    assert "is taken as WGS84, and places may be a metre or two off" in doubt(crs)
    projected = pyproj.CRS.from_user_input(crs).is_projected
    same = "EPSG:32633" if projected else "EPSG:4326"  # GRS80 is 0.1 mm flatter than WGS84
    there = BERLIN.projected_from_local(crs, [[30.0, -20.0, 0.0]])
    np.testing.assert_allclose(
        BERLIN.local_from_projected(same, *there.T), [[30.0, -20.0, 0.0]], rtol=0, atol=2e-3
    )


@pytest.mark.parametrize(
    "crs",
    [f"EPSG:{code}" for code in (4326, 32633, 25833, 4979, 3857, 2056, 6318, 27700)],
)
def test_known_datums_are_not_doubted(crs):
    assert doubt(crs) is None
    BERLIN.projected_from_local(crs, [[0.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("crs", "place", "metres"),
    [
        ("EPSG:26714", (40.0, -100.0), 7),  # NAD27 in the middle of the United States, without its grids
        ("EPSG:4301", (35.7, 139.7), 9),  # Tokyo
        ("EPSG:26914", (40.0, -100.0), None),  # NAD83: 4 m by the register, less in truth
        ("EPSG:5514", (50.0, 14.4), None),  # S-JTSK is known to a metre there, and to 6 m over all
        ("EPSG:23032", (47.0, 9.0), None),
    ],
)
def test_a_datum_that_is_known_to_some_metres_only_is_doubted(crs, place, metres):
    found = datum_doubt(pyproj.CRS.from_user_input(crs), place)
    if metres is None:
        assert found is None
    elif found is not None:  # None where the register's grids are installed, which are exact
        assert f"lies to WGS84 only within {metres} m: " in found


def test_a_grid_that_would_help_is_named():
    # NAD27(76) of Ontario is reached by a grid only.
    try:
        Georeference.from_projected("EPSG:4608", -79.0, 44.0, 0.0)
    except ValueError as error:
        assert "Its grid ca_nrc_MAY76V20.tif is not installed" in str(error)
    else:
        assert doubt("EPSG:4608") is None


def test_heights_above_a_geoid_do_not_hide_an_unknown_datum():
    with pytest.raises(ValueError, match="does not know how the datum of 'Xian 1980'"):
        Georeference.from_projected("EPSG:4610+5773", 116.0, 40.0, 0.0)
    with pytest.raises(ValueError, match="does not know how its datum lies.*height_offset_m"):
        Georeference.from_projected("EPSG:4490+5773", 116.0, 40.0, 0.0)
