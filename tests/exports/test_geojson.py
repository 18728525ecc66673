"""Zones as GeoJSON, read back with `json` and shapely and compared with closed-form geodesy."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from crowdfence import CrowdMap, Zone
from crowdfence.exports.geographic_outline import geographic_outline, geojson_geometry
from crowdfence.exports.geojson import write_geojson
from crowdfence.exports.map_description import MapDescription
from crowdfence.georeference import Georeference
from crowdfence.zones import find_zones
from support.small_crowd_maps import flat_crowd_map
from support.wgs84_by_hand import ground_point

STAMP_NS = 1_760_000_009_500_000_001
DESCRIPTION = MapDescription(
    STAMP_NS, 0.5, "paper", {"alpha": 0.1}, STAMP_NS - 9_000_000_000, ("uav1", "uav2"), "race"
)


def written(
    tmp_path: Path, crowd_map: CrowdMap, anchor: Georeference | None, min_area_m2: float = 0.0
) -> dict[str, Any]:
    path = tmp_path / "zones.geojson"
    zones = find_zones(crowd_map, STAMP_NS, threshold=0.5, min_area_m2=min_area_m2)
    write_geojson(path, zones, DESCRIPTION, anchor)
    document = json.loads(path.read_text(encoding="utf-8"))
    assert isinstance(document, dict)
    return document


def ring_area(ring: list[list[float]]) -> float:
    """Shoelace formula: positive = counter-clockwise."""
    x, y = np.array(ring).T
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2)


def polygons(geometry: dict[str, Any]) -> list[list[list[list[float]]]]:
    return [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]


def test_corners_lie_within_a_centimetre_of_the_closed_form(tmp_path: Path) -> None:
    anchor = (46.5, 8.0, 1200.0)
    # One 2 m cell, 1 km east and 500 m north of the anchor, ground between 30 and 32 m local height.
    crowd_map = flat_crowd_map(np.array([[0.9]]), 2.0, (1000.0, 500.0, 30.0))
    (feature,) = written(tmp_path, crowd_map, Georeference(*anchor))["features"]
    (ring,) = feature["geometry"]["coordinates"]
    corners = [ground_point(anchor, latitude, longitude, 31.0) for longitude, latitude in ring]
    expected = np.array([(1000, 500), (1002, 500), (1002, 502), (1000, 502)])
    assert len(corners) == 5 and ring[0] == ring[-1]
    for corner in expected:
        assert min(np.hypot(*(point[:2] - corner)) for point in corners) < 0.01


@settings(max_examples=40)
@given(
    crowd=hnp.arrays(bool, st.tuples(st.integers(1, 7), st.integers(1, 7))).filter(np.any),
    anchor=st.tuples(st.floats(-80, 80), st.floats(-180, 180), st.floats(-100, 4000)),
    cell_size_m=st.sampled_from([0.1, 1.0, 60.0]),
    corner=st.tuples(st.floats(-3000, 3000), st.floats(-3000, 3000), st.floats(-50, 50)),
)
def test_no_part_of_a_crowd_cell_is_cut_away(
    tmp_path_factory: pytest.TempPathFactory,
    crowd: NDArray[np.bool_],
    anchor: tuple[float, float, float],
    cell_size_m: float,
    corner: tuple[float, float, float],
) -> None:
    crowd_map = flat_crowd_map(crowd.astype(float), cell_size_m, corner)
    document = written(tmp_path_factory.mktemp("zones"), crowd_map, Georeference(*anchor))
    # Back to local metres at the lowest and highest ground, edges cut fine because they bow.
    for up_m in (corner[2], corner[2] + cell_size_m):
        local = shapely.union_all(
            [
                _to_local(polygon, anchor, up_m)
                for feature in document["features"]
                for polygon in polygons(feature["geometry"])
            ]
        )
        for i, j in np.argwhere(crowd):
            west, east = corner[0] + np.array([i, i + 1]) * cell_size_m
            south, north = corner[1] + np.array([j, j + 1]) * cell_size_m
            assert shapely.box(west, south, east, north).difference(local).area < 1e-6
        assert local.area < crowd.sum() * (cell_size_m + 0.05) ** 2


@pytest.mark.parametrize("seed", [49, 57, 0])
def test_a_zone_of_needles_is_written_too(seed: int) -> None:
    """Rounded corners of the first two passed the edges beside them, and not one zone was written."""
    generator = np.random.default_rng(seed)
    turn, reach_m = np.sort(generator.uniform(0, 2 * np.pi, 700)), 5 * np.exp(generator.normal(0, 2, 700))
    star = shapely.Polygon(np.column_stack([reach_m * np.cos(turn), reach_m * np.sin(turn)]))
    anchor = (46.5, 8.0, 1200.0)
    outline = geographic_outline(Zone.of_no_look("Z1", star, "static", "no fly"), Georeference(*anchor))
    assert (
        outline.is_valid
        and (shapely.get_coordinates(outline).round(9) == shapely.get_coordinates(outline)).all()
    )
    local = shapely.union_all([_to_local(one, anchor, 0.0) for one in polygons(geojson_geometry(outline))])
    assert local.buffer(1e-6).covers(star) and star.buffer(0.01, join_style="mitre").covers(local)


def _to_local(
    rings: list[list[list[float]]], anchor: tuple[float, float, float], up_m: float
) -> shapely.Polygon:
    geographic = shapely.Polygon(rings[0], rings[1:])
    fine = shapely.segmentize(geographic, 5.0 / 111_000)
    return shapely.transform(
        fine,
        lambda points: ground_point(anchor, points[:, 1], points[:, 0], up_m)[:, :2],
    )


def test_rings_follow_the_right_hand_rule(tmp_path: Path) -> None:
    crowd = np.ones((3, 3))
    crowd[1, 1] = 0.0
    document = written(tmp_path, flat_crowd_map(crowd), Georeference(46.5, 8.0, 0.0))
    outer, hole = document["features"][0]["geometry"]["coordinates"]
    assert ring_area(outer) > 0 > ring_area(hole)


def test_a_zone_across_the_antimeridian_is_cut_there(tmp_path: Path) -> None:
    crowd_map = flat_crowd_map(np.full((10, 4), 0.9), 1.0, (-5.0, 0.0, 0.0))
    document = written(tmp_path, crowd_map, Georeference(-17.0, 180.0, 0.0))
    geometry = document["features"][0]["geometry"]
    assert geometry["type"] == "MultiPolygon"
    spans = sorted((min(p[0]), max(p[0])) for p in (np.array(r[0]).T for r in geometry["coordinates"]))
    assert spans[0][0] >= -180 and spans[0][1] < -179.99
    assert spans[1][0] > 179.99 and spans[1][1] <= 180
    areas = [abs(ring_area(rings[0])) for rings in geometry["coordinates"]]
    assert areas[0] == pytest.approx(areas[1], rel=1e-3)


def test_a_feature_explains_itself(tmp_path: Path) -> None:
    probability = np.array([[0.6, 0.9, 0.0, 0.7]])
    stamps = STAMP_NS - np.array([[4_000_000_000, 500_000_000, 0, 0]])
    crowd_map = flat_crowd_map(probability, 2.0, (0.0, 0.0, 10.0), stamps)
    document = written(tmp_path, crowd_map, Georeference(46.5, 8.0, 1200.0), min_area_m2=5.0)
    assert document["type"] == "FeatureCollection" and "crs" not in document
    assert document["crowdfence"]["dropped_regions"] == 1
    assert document["crowdfence"]["dropped_area_m2"] == 4.0
    assert document["crowdfence"]["parameters"] == {"alpha": 0.1}
    (feature,) = document["features"]
    properties = feature["properties"]
    assert feature["id"] == properties["id"] == "Z1"
    assert properties["stamp_utc"] == "2025-10-09T08:53:29.500000001Z"
    assert properties["stamp_ns"] == STAMP_NS
    assert properties["area_m2"] == 8.0
    assert (properties["probability_max"], properties["probability_mean"]) == pytest.approx((0.9, 0.75))
    assert properties["seen_by"] == ["uav1"]
    assert (properties["last_seen_age_s"], properties["oldest_look_age_s"]) == (0.5, 4.0)
    assert (properties["ground_lower_m"], properties["ground_upper_m"]) == (10.0, 12.0)
    # Ten metres above the anchor's plane, at the anchor.
    assert properties["ground_lower_wgs84_m"] == pytest.approx(1210.0, abs=0.0011)
    assert properties["ground_upper_wgs84_m"] == pytest.approx(1212.0, abs=0.0011)


def test_without_a_georeference_the_file_says_so_and_holds_exact_metres(tmp_path: Path) -> None:
    document = written(tmp_path, flat_crowd_map(np.array([[0.9]]), 0.3, (500.0, -7.0, 0.0)), None)
    assert document["crs"] is None
    assert document["coordinate_frame"]["georeferenced"] is False
    (ring,) = document["features"][0]["geometry"]["coordinates"]
    assert {tuple(corner) for corner in ring} == {(500.0, -7.0), (500.3, -7.0), (500.3, -6.7), (500.0, -6.7)}
    assert ring_area(ring) > 0


def test_no_zones_is_a_valid_file_that_warns(tmp_path: Path) -> None:
    document = written(tmp_path, flat_crowd_map(np.full((2, 2), np.nan)), Georeference(0.0, 0.0, 0.0))
    assert document["features"] == []
    assert "not known to be free" in document["crowdfence"]["outside"]


def test_a_pole_is_refused_and_the_old_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "zones.geojson"
    path.write_text("old")
    zones = find_zones(flat_crowd_map(np.array([[0.9]])), STAMP_NS, threshold=0.5)
    with pytest.raises(ValueError, match=r"zone Z1 reaches latitude 89\.99"):
        write_geojson(path, zones, DESCRIPTION, Georeference(89.995, 8.0, 0.0))
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
