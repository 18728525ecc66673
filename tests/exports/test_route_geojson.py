"""The file of a way, read again as others read GeoJSON: straight in degrees."""

import json
from datetime import datetime

import numpy as np
import pytest
import shapely
from numpy.typing import ArrayLike

from crowdfence import Georeference
from crowdfence.exports.route_geojson import route_geojson

SECOND_NS = 1_000_000_000
START_NS = 1_767_225_600 * SECOND_NS  # 2026-01-01


def written(
    waypoints: ArrayLike,
    anchor: Georeference | None,
    stamps_s: ArrayLike | None = None,
    height_m: float = 0.0,
) -> dict[str, object]:
    stamps_ns = None if stamps_s is None else START_NS + (np.asarray(stamps_s) * 1e9).astype(np.int64)
    feature = json.loads(route_geojson(waypoints, stamps_ns, anchor, height_m, {"length_m": 1.0}))
    assert feature["type"] == "Feature" and feature["properties"]["length_m"] == 1.0
    return feature  # type: ignore[no-any-return]


def seconds(times: list[str]) -> list[float]:
    return [
        datetime.fromisoformat(time[:26]).timestamp() - datetime(2026, 1, 1).timestamp() for time in times
    ]


@pytest.mark.parametrize(("latitude_deg", "height_m"), [(60.0, 0.0), (-60.0, 800.0), (85.0, 0.0), (0.0, 0.0)])
def test_a_long_leg_lies_where_it_is_flown(latitude_deg: float, height_m: float) -> None:
    """5 km to the east at 60 degrees: straight in degrees it bows by 5000^2 tan(60) / (8 * 6.4e6) = 85 cm."""
    anchor = Georeference(latitude_deg, 10.0, 0.0)
    feature = written([(-2500.0, 40.0), (2500.0, 40.0)], anchor, height_m=height_m)
    corners = np.array(feature["geometry"]["coordinates"])  # type: ignore[index]

    def off_m(ends: np.ndarray) -> float:
        line = shapely.get_coordinates(shapely.segmentize(shapely.LineString(ends), 1e-4))
        local = anchor.local_from_geodetic(line[:, 1], line[:, 0], np.zeros(len(line)))
        # Where the vertical through each passes the height of the way.
        heights = height_m + anchor.geodetic_from_local(np.column_stack([local[:, :2], local[:, 2] * 0]))[2]
        return float(np.abs(anchor.local_from_geodetic(line[:, 1], line[:, 0], heights)[:, 1] - 40.0).max())

    bow_m = 5000.0**2 * np.tan(np.deg2rad(abs(latitude_deg))) / (8 * 6.4e6)
    assert off_m(corners[[0, -1]]) == pytest.approx(bow_m, rel=0.02, abs=2e-3)
    assert off_m(corners) < 0.012
    assert len(corners) < 30


def test_short_legs_get_no_corners() -> None:
    way = [(0.0, 0.0), (300.0, 100.0), (0.0, 400.0)]
    feature = written(way, Georeference(46.5, 8.0, 1200.0))
    assert len(feature["geometry"]["coordinates"]) == 3 and "times" not in feature["properties"]  # type: ignore


def test_a_way_that_waits_says_until_when() -> None:
    """Who flies it without its times flies through the zone that it waits for."""
    way = [(0.0, 0.0), (0.0, 0.0), (100.0, 0.0)]
    feature = written(way, Georeference(46.5, 8.0, 0.0), [0.0, 57.5, 67.5])
    corners = feature["geometry"]["coordinates"]  # type: ignore[index]
    assert corners[0] == corners[1] != corners[2]
    assert seconds(feature["properties"]["times"]) == [0.0, 57.5, 67.5]  # type: ignore[index]
    assert written(way, None, [0.0, 57.5, 67.5])["properties"] == feature["properties"]


def test_corners_between_are_passed_evenly() -> None:
    feature = written([(0.0, 0.0), (4000.0, 0.0)], Georeference(60.0, 8.0, 0.0), [0.0, 400.0])
    corners = np.array(feature["geometry"]["coordinates"])  # type: ignore[index]
    assert len(corners) > 2
    east = (corners[:, 0] - corners[0, 0]) / np.ptp(corners[:, 0])
    np.testing.assert_allclose(seconds(feature["properties"]["times"]), 400.0 * east, atol=1e-3)  # type: ignore


def test_each_line_beside_the_antimeridian_has_its_times() -> None:
    """From 30 m west of it to 10 m east of it at 4 m/s: it is crossed after 7.5 s."""
    feature = written([(-30.0, 0.0), (10.0, 0.0)], Georeference(-17.0, 180.0, 0.0), [0.0, 10.0])
    west, east = feature["geometry"]["coordinates"]  # type: ignore[index]
    assert west[-1][0] == 180.0 and east[0][0] == -180.0 and west[-1][1] == east[0][1]
    before, after = map(seconds, feature["properties"]["times"])  # type: ignore[index]
    assert before == pytest.approx([0.0, 7.5], abs=1e-3) and after == pytest.approx([7.5, 10.0], abs=1e-3)


def test_without_a_place_on_earth_it_is_in_local_metres() -> None:
    feature = written([(0.0, 0.0), (5000.0, 0.5)], None)
    assert feature["crs"] is None
    assert feature["geometry"] == {"type": "LineString", "coordinates": [[0.0, 0.0], [5000.0, 0.5]]}


def test_beside_a_pole_degrees_hold_no_way() -> None:
    with pytest.raises(ValueError, match=r"the way reaches latitude 89\.99\d+; ways are written up to 89"):
        written([(0.0, -100.0), (0.0, 100.0)], Georeference(89.999, 8.0, 0.0))
