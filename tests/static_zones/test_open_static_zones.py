"""Zones that somebody else drew, in the dialects of real files."""

import json
import time
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
import shapely

from crowdfence import Georeference, Terrain
from crowdfence.config import ZoneConfig
from crowdfence.exports.geographic_outline import geographic_outline
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.sites_geojson import write_sites
from crowdfence.fence_sync.zone_file import placed_geojson
from crowdfence.static_zones import StaticZoneError, open_static_zones, read_static_zones
from crowdfence.zones import AltitudeBand, Zone, ZoneEngine
from crowdfence.zones.given_ground import on_ground
from crowdfence.zones.history import zone_of_record, zone_record
from crowdfence.zones.sites import find_sites
from support.small_crowd_maps import flat_crowd_map

ANCHOR = Georeference(46.5, 8.0, 1200.0)
DEGREE_NORTH_M = 111_180.0  # at 46.5 degrees and 1200 m: M = 6368.9 km, + 1.2 km, times pi / 180
SQUARE = [[8.0, 46.5], [8.001, 46.5], [8.001, 46.501], [8.0, 46.501], [8.0, 46.5]]


def opened(tmp_path: Path, content: Any, anchor: Georeference = ANCHOR) -> tuple[Zone, ...]:
    path = tmp_path / "zones"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return open_static_zones(path, anchor).zones


def ed269(**geometry: Any) -> dict[str, Any]:
    limits = {"uomDimensions": "M", "lowerLimit": 0, "upperLimit": 120}
    data = {"lowerVerticalReference": "AGL", "upperVerticalReference": "AGL"}
    shape = {"horizontalProjection": {"type": "Polygon", "coordinates": [SQUARE]}}
    zone = {
        "identifier": "ABC1234",
        "country": "CHE",
        "type": "COMMON",
        "restriction": "PROHIBITED",
        "geometry": [{**limits, **data, **shape, **geometry}],
    }
    return {"features": [zone]}


def ed318(geometry: dict[str, Any] | None, **properties: Any) -> dict[str, Any]:
    told = {"identifier": "ABC1234", "country": "CHE", "type": "PROHIBITED", "variant": "COMMON"}
    return {
        "type": "FeatureCollection",
        "features": [{"type": "Feature", "properties": {**told, **properties}, "geometry": geometry}],
    }


def test_a_square_lies_where_it_lies(tmp_path: Path) -> None:
    (zone,) = opened(tmp_path, ed269())
    west, south, _, north = zone.polygon.bounds
    assert (west, south) == pytest.approx((0.0, 0.0), abs=0.01)
    assert north == pytest.approx(0.001 * DEGREE_NORTH_M, abs=0.05)
    assert (zone.id, zone.kind, zone.reason) == ("ABC1234", "static", "given")
    assert zone.band == AltitudeBand(0.0, 120.0, "AGL")


def test_a_long_edge_is_straight_in_longitude_and_latitude_to_a_millimetre(tmp_path: Path) -> None:
    """A parallel over 100 km bows by 210 m in the local plane."""
    corners = [[7.34, 47.0], [8.66, 47.0], [8.66, 47.1], [7.34, 47.1], [7.34, 47.0]]
    content = ed318({"type": "Polygon", "coordinates": [corners]})
    path = tmp_path / "zones.json"
    path.write_text(json.dumps(content))
    anchor = Georeference(47.0, 8.0, 400.0)
    (zone,) = open_static_zones(path, anchor).zones
    longitudes = np.linspace(7.34, 8.66, 777)
    edge = anchor.local_from_geodetic(np.full(777, 47.0), longitudes, np.full(777, 400.0))[:, :2]
    assert shapely.distance(zone.polygon.exterior, shapely.points(edge)).max() < 1e-3


def test_a_hole_may_touch_the_edge_of_its_zone_between_two_corners(tmp_path: Path) -> None:
    """The edge bows beside it, by less than a millimetre: the outline crossed itself, and where it was joined
    with another area that ended the program."""
    shell = [[8.0, 46.5], [8.02, 46.5], [8.02, 46.51], [8.0, 46.51], [8.0, 46.5]]
    hole = [[8.0103, 46.5], [8.009, 46.503], [8.0116, 46.503], [8.0103, 46.5]]
    other = [[8.015, 46.505], [8.03, 46.505], [8.03, 46.52], [8.015, 46.52], [8.015, 46.505]]
    (whole,) = opened(tmp_path, ed318({"type": "Polygon", "coordinates": [shell]}))
    (alone,) = opened(tmp_path, ed318({"type": "Polygon", "coordinates": [shell, hole]}))
    (both,) = opened(tmp_path, ed318({"type": "MultiPolygon", "coordinates": [[shell, hole], [other]]}))
    assert alone.polygon.is_valid and both.polygon.is_valid
    # Of 200 parts the hole is 0.0026 * 0.003 / 2 * 10^6 = 3.9; the other area has 225, 25 of them shared.
    assert alone.polygon.area / whole.polygon.area == pytest.approx(196.1 / 200, abs=1e-4)
    assert both.polygon.area / whole.polygon.area == pytest.approx((196.1 + 200.0) / 200, abs=1e-3)


@pytest.mark.parametrize("latitude", [0.0, 46.5, 70.0, -85.0])
def test_a_national_file_is_written_as_small_as_it_was_read(tmp_path: Path, latitude: float) -> None:
    """Edges of tens of kilometres came back with a corner every 25 m, a hundred times the file."""
    anchor = Georeference(latitude, 8.0, 400.0)
    corners = np.array([[0.0, 0.0], [0.4, 0.1], [0.5, 0.4], [0.1, 0.3], [0.0, 0.0]])
    hole = np.array([[0.1, 0.1], [0.2, 0.2], [0.3, 0.2], [0.1, 0.1]])
    rings = [(ring + np.array([7.9, latitude - 0.2])).tolist() for ring in (corners, hole)]
    path = tmp_path / "zones.json"
    path.write_text(json.dumps(ed318({"type": "Polygon", "coordinates": rings})))
    (zone,) = open_static_zones(path, anchor).zones
    written = geographic_outline(zone, anchor)
    assert len(shapely.get_coordinates(written)) <= 16
    path.write_text(json.dumps(ed318(shapely.geometry.mapping(written))))
    (again,) = open_static_zones(path, anchor).zones
    assert zone.polygon.difference(again.polygon).area == 0.0
    assert again.polygon.area - zone.polygon.area < 0.003 * zone.polygon.length


def test_circles_feet_texts_and_missing_limits(tmp_path: Path) -> None:
    """As the Swiss authority's samples write them."""
    circle = {"type": "Circle", "center": [8.0, 46.5], "radius": 3000}
    (zone,) = opened(tmp_path, ed269(horizontalProjection=circle, lowerLimit="0", upperLimit=None))
    assert zone.polygon.covers(shapely.Point(0.0, 0.0).buffer(3000.0, 4096))
    assert zone.polygon.area == pytest.approx(np.pi * 3000.0**2, rel=4e-3)
    assert zone.band == AltitudeBand(0.0, 99_999.0, "AGL")
    (feet,) = opened(tmp_path, ed269(uomDimensions="FT", lowerLimit=100, upperLimit=250))
    assert feet.band == AltitudeBand(30.48, 76.2, "AGL")
    listed = {"formatVersion": "1.0.0", "UASZoneList": ed269()["features"]}
    assert [one.id for one in opened(tmp_path, listed)] == ["ABC1234"]
    assert [one.id for one in opened(tmp_path, ed269()["features"])] == ["ABC1234"]  # as Austria's feed is


def test_a_radius_beside_heights_in_feet_is_metres(tmp_path: Path) -> None:
    """As in the national feed of Lithuania, whose circle of 5 NM has a radius of 9260 beside feet; read as
    feet it closed a tenth of that ground."""
    circle = {"type": "Circle", "center": [8.0, 46.5], "radius": 9260.0}
    (zone,) = opened(tmp_path, ed269(uomDimensions="FT", upperLimit=24_000, horizontalProjection=circle))
    assert zone.polygon.covers(shapely.Point(0.0, 0.0).buffer(5 * 1852.0, 1024))
    assert zone.polygon.area == pytest.approx(np.pi * 9260.0**2, rel=4e-3)
    assert zone.band.upper_m == pytest.approx(7315.2)


def test_further_rings_of_ed269_open_nothing(tmp_path: Path) -> None:
    """Some read them as holes, InterUSS as areas of their own: both the ring inside the square and the one
    beside it are closed."""
    inside = [[8.0004, 46.5004], [8.0006, 46.5004], [8.0006, 46.5006], [8.0004, 46.5006], [8.0004, 46.5004]]
    beside = (np.array(SQUARE) + np.array([0.002, 0.0])).tolist()
    rings = {"type": "Polygon", "coordinates": [SQUARE, inside, beside]}
    zones = opened(tmp_path, ed269(horizontalProjection=rings))
    closed = shapely.union_all([zone.polygon for zone in zones])
    square_m2 = 0.001 * DEGREE_NORTH_M * 0.001 * 76_750.0  # a degree eastward is 76.75 km there
    assert closed.area == pytest.approx(2 * square_m2, rel=1e-3)
    assert zones[0].id == "ABC1234" and len({zone.id for zone in zones}) == len(zones)
    with pytest.raises(StaticZoneError, match="has no outline"):
        opened(tmp_path, ed269(horizontalProjection={"type": "Polygon", "coordinates": []}))


def _of_parts(kind: str, parts: list[dict[str, Any]]) -> Any:
    """One zone "Town" of a file."""
    if kind == "ed269":
        zone = ed269()["features"][0] | {"identifier": "Town"}
        return {
            "features": [
                zone | {"geometry": [zone["geometry"][0] | {"horizontalProjection": one} for one in parts]}
            ]
        }
    if kind == "kml":
        text = "".join(
            "<Polygon><outerBoundaryIs><LinearRing><coordinates>"
            + " ".join(f"{east},{north}" for east, north in part["coordinates"][0])
            + "</coordinates></LinearRing></outerBoundaryIs></Polygon>"
            for part in parts
        )
        return f"<kml><Placemark><name>Town</name><MultiGeometry>{text}</MultiGeometry></Placemark></kml>"
    if kind == "MultiPolygon":
        geometry: dict[str, Any] = {"type": kind, "coordinates": [part["coordinates"] for part in parts]}
    else:
        geometry = {"type": "GeometryCollection", "geometries": parts}
    if kind == "ed318":
        return ed318(geometry, identifier="Town")
    return {"type": "Feature", "id": "Town", "properties": {}, "geometry": geometry}


@pytest.mark.parametrize("kind", ["ed269", "ed318", "kml", "MultiPolygon", "GeometryCollection"])
def test_what_a_file_gives_as_one_zone_is_one(tmp_path: Path, kind: str) -> None:
    """It was one of its name and, of every other part, one of a number. Parts that meet are one ground."""
    beside, apart = ((np.array(SQUARE) + np.array([east, 0.0])).tolist() for east in (0.001, 0.005))
    parts = [{"type": "Polygon", "coordinates": [ring]} for ring in (SQUARE, beside, apart)]
    (zone,) = opened(tmp_path, _of_parts(kind, parts))
    assert zone.id == "Town" and zone.name is None
    assert len(zone.polygon.geoms) == 2 and zone.polygon.is_valid
    square_m2 = 0.001 * DEGREE_NORTH_M * 0.001 * 76_750.0  # a degree eastward is 76.75 km there
    assert zone.polygon.area == pytest.approx(3 * square_m2, rel=1e-3)


def test_parts_at_other_heights_are_zones_of_their_own(tmp_path: Path) -> None:
    """Else the lower one would close what lies between, or the upper one open it."""
    zone = ed269()["features"][0]
    low, high = zone["geometry"][0], zone["geometry"][0] | {"lowerLimit": 300, "upperLimit": 900}
    zones = opened(tmp_path, {"features": [zone | {"geometry": [low, high, low]}]})
    assert [(one.id, one.name, one.band.upper_m) for one in zones] == [
        ("ABC1234", None, 120.0),
        ("S1", "ABC1234", 900.0),
    ]


def test_a_part_that_is_far_away_leaves_the_others(tmp_path: Path) -> None:
    far = [[60.0, 10.0], [60.1, 10.0], [60.1, 10.1], [60.0, 10.0]]
    path = tmp_path / "zones.json"
    path.write_text(json.dumps({"type": "MultiPolygon", "coordinates": [[SQUARE], [far], [far]]}))
    read = open_static_zones(path, ANCHOR)
    (zone,) = read.zones
    assert zone.polygon.bounds[0] == pytest.approx(0.0, abs=0.01)
    assert read.left_out == ("feature 1: lies more than 20 degrees away",)


def test_limits_above_different_data_close_everything(tmp_path: Path) -> None:
    (zone,) = opened(tmp_path, ed269(upperLimit=6259, upperVerticalReference="AMSL"))
    assert zone.band == AltitudeBand(0.0, 99_999.0, "AGL")
    (sea,) = opened(
        tmp_path, ed269(lowerVerticalReference="AMSL", upperLimit=900, upperVerticalReference="AMSL")
    )
    assert sea.band == AltitudeBand(0.0, 900.0, "AMSL")


def test_a_limit_that_is_missing_leaves_no_air_below_or_above(tmp_path: Path) -> None:
    """Land lies down to 440 m below the sea, and the sea itself down to 107 m below the ellipsoid."""
    amsl = {"lowerVerticalReference": "AMSL", "upperVerticalReference": "AMSL"}
    (down,) = opened(tmp_path, ed269(lowerLimit=None, upperLimit=900, **amsl))
    assert down.band == AltitudeBand(-500.0, 900.0, "AMSL")
    layer = {"lower": 30, "lowerReference": "WGS84", "upperReference": "WGS84"}
    (up,) = opened(tmp_path, ed318({"type": "Polygon", "coordinates": [SQUARE], "layer": layer}))
    assert up.band == AltitudeBand(30.0, 99_999.0, "WGS84")
    (named,) = opened(tmp_path, {**in_system("EPSG:4326")["features"][0], "properties": {"datum": "WGS84"}})
    assert named.band == AltitudeBand(-500.0, 99_999.0, "WGS84")


def test_layers_and_circles_of_ed318(tmp_path: Path) -> None:
    layer = {"upper": 150, "upperReference": "AGL", "lower": 50, "lowerReference": "AGL", "uom": "m"}
    circle = {
        "type": "Point",
        "coordinates": [8.0, 46.5],
        "extent": {"subType": "Circle", "radius": 3500},
        "layer": layer,
    }
    square = {"type": "Polygon", "coordinates": [SQUARE], "layer": {**layer, "upper": 492.126, "uom": "ft"}}
    both = opened(tmp_path, ed318({"type": "GeometryCollection", "geometries": [circle, square]}))
    # One id is used once: the second layer gets a number.
    assert [zone.id for zone in both] == ["ABC1234", "S1"]
    assert both[0].band == AltitudeBand(50.0, 150.0, "AGL")
    assert both[1].band.upper_m == pytest.approx(150.0, abs=1e-3)


def test_features_of_ed318_may_lack_properties_or_ground(tmp_path: Path) -> None:
    """By its schema. One without ground refused the file; where the first had no properties, circles were no
    zones."""
    circle = {"type": "Point", "coordinates": [8.0, 46.5], "extent": {"subType": "Circle", "radius": 100.0}}
    first, second, last = (
        ed318(geometry)["features"][0]
        for geometry in (None, circle, {"type": "Polygon", "coordinates": [SQUARE]})
    )
    no_parts = ed318({"type": "MultiPolygon", "coordinates": []})["features"][0]
    features = [{**first, "properties": None}, second, {**last, "properties": None}, first, no_parts]
    path = tmp_path / "zones.json"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    read = open_static_zones(path, ANCHOR)
    assert [(zone.id, zone.name) for zone in read.zones] == [("ABC1234", None), ("S1", "feature 3")]
    assert read.left_out == (
        "feature 1: no geometry, closes no ground",
        "ABC1234: no geometry, closes no ground",
        "ABC1234: no polygon, closes no ground",
    )


def test_zones_that_keep_nobody_out_are_told(tmp_path: Path) -> None:
    path = tmp_path / "zones.json"
    path.write_text(json.dumps(ed318({"type": "Polygon", "coordinates": [SQUARE]}, type="NO_RESTRICTION")))
    zones, left_out = read_static_zones([path], ANCHOR)
    assert zones == () and left_out == ["zones.json: ABC1234: NO_RESTRICTION keeps nobody out"]
    path.write_text(json.dumps(ed318({"type": "Polygon", "coordinates": [SQUARE]}, type="CONDITIONAL")))
    assert len(read_static_zones([path], ANCHOR)[0]) == 1  # nobody has checked the condition


def test_what_is_left_out_of_a_national_file_is_told_in_a_sentence_for_each_reason(tmp_path: Path) -> None:
    far = {"type": "Polygon", "coordinates": [[[x, y - 30.0] for x, y in SQUARE]]}
    here = {"type": "Polygon", "coordinates": [SQUARE]}
    features = [
        *(ed318(far, identifier=f"F{n}")["features"][0] for n in range(900)),
        *(ed318(here, identifier=f"N{n}", type="NO_RESTRICTION")["features"][0] for n in range(5)),
    ]
    path = tmp_path / "zones.json"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    assert len(open_static_zones(path, ANCHOR).left_out) == 905
    zones, left_out = read_static_zones([path], ANCHOR)
    assert zones == () and left_out == [
        *(f"zones.json: N{n}: NO_RESTRICTION keeps nobody out" for n in range(5)),
        "zones.json: F0, F1, F2, F3, F4 and 895 more: lies more than 20 degrees away",
    ]


def test_a_ring_that_is_not_closed_is_closed_as_any_polygon_is(tmp_path: Path) -> None:
    for corners in (3, 4):
        open_ring = SQUARE[:corners]
        (zone,) = opened(tmp_path, ed318({"type": "Polygon", "coordinates": [open_ring]}))
        (closed,) = opened(tmp_path, ed318({"type": "Polygon", "coordinates": [[*open_ring, open_ring[0]]]}))
        assert zone.polygon.equals(closed.polygon) and zone.polygon.area > 4000.0


def test_names_become_ids_that_are_short_and_used_once(tmp_path: Path) -> None:
    features = [
        {
            "type": "Feature",
            "id": name,
            "properties": {},
            "geometry": {"type": "Polygon", "coordinates": [SQUARE]},
        }
        for name in ("LSZB003", "LSZB003", "Montreux Concert Area", "Z1", "UNSEEN", "S3", "O1")
    ]
    zones = opened(tmp_path, {"type": "FeatureCollection", "features": features})
    assert [zone.id for zone in zones] == ["LSZB003", "S1", "S2", "S3", "S4", "S5", "S6"]
    names = [None, "LSZB003", "Montreux Concert Area", "Z1", "UNSEEN", "S3", "O1"]
    assert [zone.name for zone in zones] == names


def test_what_people_call_a_zone_goes_with_it(tmp_path: Path) -> None:
    coded = ed269()
    coded["features"][0]["name"] = "Heliport Bern <b>"
    square = {"type": "Polygon", "coordinates": [SQUARE]}
    told = ed318(square, name=[{"text": "Spital", "lang": "de-CH"}, {"text": "Hospital", "lang": "en-GB"}])
    plain = {"type": "Feature", "id": "A1", "properties": {"name": "Stadium"}, "geometry": square}
    for content, id, name in (
        (coded, "ABC1234", "Heliport Bern <b>"),
        (told, "ABC1234", "Spital"),
        (ed318(square, name=None), "ABC1234", None),
        (plain, "A1", "Stadium"),
    ):
        (zone,) = opened(tmp_path, content)
        assert (zone.id, zone.name) == (id, name)
        assert zone_of_record(json.loads(json.dumps(zone_record(zone)))).name == name


KML = """<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>
<Placemark><name>Flights</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
{corners}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
<Placemark><name>Pilot</name><Point><coordinates>8,46.5,0</coordinates></Point></Placemark>
</Document></kml>"""


def test_polygons_of_a_kml(tmp_path: Path) -> None:
    path = tmp_path / "zones.kml"
    path.write_text(KML.format(corners=" ".join(f"{x},{y},500" for x, y in SQUARE)))
    read = open_static_zones(path, ANCHOR)
    assert [zone.id for zone in read.zones] == ["Flights"]
    assert read.left_out == ("Pilot: no polygon, closes no ground",)


KML_RING = "<LinearRing><coordinates>{}</coordinates></LinearRing>"


def kml_ring(west: float, south: float, side: float) -> str:
    east, north = west + side, south + side
    return KML_RING.format(f"{west},{south} {east},{south} {east},{north} {west},{north} {west},{south}")


def test_polygons_of_a_kml_are_closed_wherever_they_stand(tmp_path: Path) -> None:
    """A Polygon beside the Placemark, and those in what some old files call theirs, vanished."""
    polygons = [
        f"<Polygon><outerBoundaryIs>{kml_ring(west, 46.5, 0.001)}</outerBoundaryIs></Polygon>"
        for west in (8.0, 8.01, 8.02)
    ]
    text = (
        f"<kml><Document><Placemark><name>A</name>{polygons[0]}</Placemark>"
        f"<Folder>{polygons[1]}</Folder><Zone><name>B</name>{polygons[2]}</Zone></Document></kml>"
    )
    assert len(opened(tmp_path, text)) == 3


def test_a_ring_beside_a_polygon_of_a_kml_is_told(tmp_path: Path) -> None:
    """It closes no ground, as that of a Placemark without a polygon, of which that was told."""
    polygon = f"<Polygon><outerBoundaryIs>{kml_ring(8.0, 46.5, 0.001)}</outerBoundaryIs></Polygon>"
    both = f"<MultiGeometry>{polygon}{kml_ring(8.1, 46.5, 0.001)}</MultiGeometry>"
    path = tmp_path / "zones.kml"
    path.write_text(f"<kml><Placemark><name>A</name>{both}</Placemark></kml>")
    read = open_static_zones(path, ANCHOR)
    assert len(read.zones) == 1 and read.left_out == ("A: a LinearRing closes no ground",)


@pytest.mark.parametrize("between", ["", "</outerBoundaryIs><outerBoundaryIs>"])
def test_a_second_outer_ring_of_a_kml_opens_nothing(tmp_path: Path, between: str) -> None:
    """It was left out, or a hole of the first."""
    rings = (kml_ring(8.0, 46.5, 0.01), kml_ring(8.002, 46.502, 0.001), kml_ring(8.1, 46.5, 0.001))
    polygon = f"<Polygon><outerBoundaryIs>{between.join(rings)}</outerBoundaryIs></Polygon>"
    zones = opened(tmp_path, f"<kml><Placemark><name>A</name>{polygon}</Placemark></kml>")
    closed = shapely.union_all([zone.polygon for zone in zones])
    for longitude, latitude in ((8.0025, 46.5025), (8.1005, 46.5005)):
        east, north, _ = ANCHOR.local_from_geodetic(latitude, longitude, 1200.0)[0]
        assert closed.covers(shapely.Point(east, north))


def test_files_that_a_kml_links_to_are_told(tmp_path: Path) -> None:
    link = "<NetworkLink><name>Town</name><Link><href>town.kml</href></Link></NetworkLink></Document>"
    path = tmp_path / "zones.kml"
    text = KML.format(corners=" ".join(f"{x},{y},500" for x, y in SQUARE))
    path.write_text(text.replace("</Document>", link))
    read = open_static_zones(path, ANCHOR)
    assert [zone.id for zone in read.zones] == ["Flights"]
    assert read.left_out[1:] == ("Town: links to another file, which is not read; give that too",)


def test_a_zone_across_the_antimeridian_is_one(tmp_path: Path) -> None:
    anchor = Georeference(-17.0, -179.9999, 0.0)
    ring = [[179.999, -17.0], [-179.999, -17.0], [-179.999, -16.999], [179.999, -16.999], [179.999, -17.0]]
    (zone,) = opened(tmp_path, {"type": "Polygon", "coordinates": [ring]}, anchor)
    # 0.002 degrees at 17 degrees south: 0.002 * 111.32 km * cos 17 = 213 m.
    west, _, east, _ = zone.polygon.bounds
    assert east - west == pytest.approx(213.0, abs=0.5)


def test_a_zone_across_the_antimeridian_is_far_from_the_other_side_of_the_earth(tmp_path: Path) -> None:
    """At the anchor's latitude, 2 degrees wide: it was taken for one of 358 degrees around the Earth, and
    the file with it was refused."""
    ring = [[179.0, 46.0], [-179.0, 46.0], [-179.0, 47.0], [179.0, 47.0], [179.0, 46.0]]
    square = {"type": "Polygon", "coordinates": [[[east - 8.0, north] for east, north in SQUARE]]}
    features = [
        {"type": "Feature", "id": name, "geometry": geometry}
        for name, geometry in (("here", square), ("there", {"type": "Polygon", "coordinates": [ring]}))
    ]
    path = tmp_path / "zones.json"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    read = open_static_zones(path, Georeference(46.5, 0.0, 1200.0))
    assert [zone.id for zone in read.zones] == ["here"]
    assert read.left_out == ("there: lies more than 20 degrees away",)


@pytest.mark.parametrize("hole", [[179.9, -179.9], [-180.1, -179.9], [179.9, 180.1]])
def test_a_hole_across_the_antimeridian_is_in_its_zone(tmp_path: Path, hole: list[float]) -> None:
    """However its longitudes are written: it is closed where nobody has said otherwise."""
    west, east = hole
    rings = [
        [[179.0, 46.0], [-179.0, 46.0], [-179.0, 47.0], [179.0, 47.0], [179.0, 46.0]],
        [[west, 46.4], [east, 46.4], [east, 46.6], [west, 46.6], [west, 46.4]],
    ]
    content = {"type": "Polygon", "coordinates": rings}
    (zone,) = opened(tmp_path, content, Georeference(46.5, 180.0, 0.0))
    (ring,) = zone.polygon.interiors
    # 0.2 of 2 degrees wide, 0.2 of 1 degree high: 1/50 of the whole.
    filled = shapely.Polygon(zone.polygon.exterior)
    assert shapely.Polygon(ring).area / filled.area == pytest.approx(0.02, rel=0.01)


def test_many_zones_are_read_at_the_cost_of_each(tmp_path: Path) -> None:
    """Ids of ours are not theirs: each of the zones needs a free number."""

    def seconds(number: int) -> float:
        corners = np.array(SQUARE)
        features = [
            {
                "type": "Feature",
                "properties": {"name": f"Z{k}"},
                "geometry": {
                    "type": "Polygon",
                    "coordinates": [(corners + np.array([0.002 * k, 0.0])).tolist()],
                },
            }
            for k in range(number)
        ]
        started = time.process_time()
        zones = opened(tmp_path, {"type": "FeatureCollection", "features": features})
        assert len({zone.id for zone in zones}) == number
        return time.process_time() - started

    seconds(10)
    few, many = (min(seconds(number) for _ in range(3)) for number in (400, 2000))
    assert many < 12 * few  # five times as many; quadratic would be 25 times


def test_a_zone_at_the_pole_is_refused(tmp_path: Path) -> None:
    anchor = Georeference(89.99, 0.0, 0.0)
    ring = [[0.0, 89.999], [120.0, 89.999], [-120.0, 89.999], [0.0, 89.999]]
    with pytest.raises(StaticZoneError, match="reaches beyond 89 degrees of latitude"):
        opened(tmp_path, {"type": "Polygon", "coordinates": [ring]}, anchor)


BOW_TIE = [[8.0, 46.5], [8.001, 46.501], [8.001, 46.5], [8.0, 46.501], [8.0, 46.5]]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"type": "Polygon", "coordinates": [BOW_TIE]}, "zone 'feature 1': Self-intersection"),
        ({"type": "Polygon", "coordinates": [SQUARE[:2]]}, "has no outline of at least three corners"),
        ({"type": "Polygon", "coordinates": []}, "has no outline"),
        (
            {"type": "Polygon", "coordinates": [[[8.0, 95.0], [9.0, 95.0], [8.0, 96.0], [8.0, 95.0]]]},
            "reaches beyond 89 degrees",
        ),
        # Web Mercator in a file that does not say so.
        (
            {
                "type": "Polygon",
                "coordinates": [[[890555, 5862000], [890655, 5862000], [890555, 5862100]] * 2],
            },
            "has a corner at 890555, 5862000: no degrees, as in a file of metres",
        ),
        ({"type": "Polygon"}, "'coordinates' is missing"),
        ({"crs": None, "type": "FeatureCollection", "features": []}, "local metres"),
        (ed269(uomDimensions="M", upperLimit="high"), "could not convert"),
        (ed269(horizontalProjection={"type": "Circle", "center": [8, 46], "radius": 0}), "circle of 0 m"),
        (ed318({"type": "LineString", "coordinates": SQUARE}), "LineString, which closes no ground"),
        ("{", "Expecting property name"),
        ("[]", "it is neither KML nor a JSON object with zones"),
        ([{"type": "Feature", "geometry": None, "properties": {}}], "nor a JSON object with zones"),
        ("[" * 100_000, "nested too deeply"),
        ('{"type": "FeatureCollection", "features": [' * 5_000, "nested too deeply"),
        ({"type": "Polygon", "coordinates": [SQUARE[0]]}, "subscriptable"),
        ({"type": "Polygon", "coordinates": [[SQUARE]]}, "a corner is no longitude and latitude"),
        # Twelve numbers that would make six corners.
        (
            {"type": "Polygon", "coordinates": [[[8], [46], [9], [46], [9], [47], [8], [47], [8], [46]]]},
            "a corner is no longitude and latitude",
        ),
        ({"type": "Polygon", "coordinates": [[[8.0, 46.5], [1e308, 46.5], *SQUARE]]}, "longitude of 1e+308"),
        ({"type": "Polygon", "coordinates": [[[8.0, 10**400], *SQUARE]]}, "too large"),
        ({"type": "Polygon", "coordinates": [[[8.0, float("nan")], *SQUARE]]}, "has no outline"),
        ({"type": "Polygon", "coordinates": [[[-60, 0], [80, 0], [80, 80], [-60, 0]]]}, "60 degrees away"),
        (
            ed269(
                uomDimensions="KM", horizontalProjection={"type": "Circle", "center": [8, 46.5], "radius": 3}
            ),
            "a length in 'KM'",
        ),
        (ed269(horizontalProjection={"type": "Circle", "center": [8, 95], "radius": 1}), "beyond 89 degrees"),
        (
            ed269(horizontalProjection={"type": "Circle", "center": [8, 46], "radius": 1e308}),
            "circle of 1e+308",
        ),
        (
            ed269(horizontalProjection={"type": "Circle", "center": [8], "radius": 9}),
            "ABC1234': a corner is no longitude",
        ),
        ("<gpx><trk/></gpx>", "it is no KML: it begins with 'gpx'"),
        ("<kml><Placemark><Polygon/></Placemark></kml>", "has no outline"),
        ("<kml>", "it is no XML"),
        ('<!DOCTYPE kml [<!ENTITY a "b">]><kml/>', "declares entities"),
        (KML.format(corners="8,46.5 here"), "a corner that cannot be read"),
        (
            KML.format(corners="8, 46.5 8.1, 46.5 8.1, 46.6 8, 46.5"),
            "a corner that cannot be read: a corner is no longitude and latitude",
        ),
        # The second of two corners without a space between them was lost, and half of the ground with it.
        (
            KML.format(corners="8,46.5,0 8.1,46.5,0,8.1,46.6,0 8,46.6,0 8,46.5,0"),
            "is a space missing?",
        ),
        (ed269(upperLimit=0), "zone 'ABC1234': band 0 to 0 m"),
        (
            ed318({"type": "Polygon", "coordinates": [SQUARE], "layer": {"upper": 10, "lower": 20}}),
            "zone 'ABC1234': band 20 to 10 m",
        ),
    ],
)
def test_what_cannot_be_used_is_one_line_with_the_file(tmp_path: Path, content: Any, message: str) -> None:
    with pytest.raises(StaticZoneError, match=r"zones: ") as refused:
        opened(tmp_path, content)
    assert message in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("on_point", "properties"),
    [
        # What would be ED-318 if it had "variant", by which that is told.
        ({"extent": {"subType": "Circle", "radius": 500}}, {"identifier": "LEXX", "type": "PROHIBITED"}),
        ({}, {"subType": "Circle", "radius": 500}),
    ],
)
def test_circles_in_any_geojson_are_closed(
    tmp_path: Path, on_point: dict[str, Any], properties: dict[str, Any]
) -> None:
    """They were told to close no ground, and the file went on without them."""
    point = {"type": "Point", "coordinates": [8.0, 46.5], **on_point}
    (zone,) = opened(tmp_path, {"type": "Feature", "properties": properties, "geometry": point})
    assert zone.polygon.covers(shapely.Point(0.0, 0.0).buffer(500.0, 1024))
    assert zone.polygon.area == pytest.approx(np.pi * 500.0**2, rel=4e-3)


def test_a_wide_circle_in_the_north_is_not_called_far_away_where_it_holds_the_mission(tmp_path: Path) -> None:
    """At 70 degrees of latitude 21 of longitude are 796 km: of a sphere of 6371 km, by hand,
    2 asin(cos 70 sin 10.5) = 7.15 degrees."""
    anchor, beside = Georeference(70.0, 8.0, 0.0), [29.0, 70.0]
    content = ed269(horizontalProjection={"type": "Circle", "center": beside, "radius": 850_000})
    (zone,) = opened(tmp_path, content, anchor)
    assert zone.polygon.contains(shapely.Point(0.0, 0.0))
    antipode = ed269(horizontalProjection={"type": "Circle", "center": [-172.0, -70.0], "radius": 850_000})
    assert opened(tmp_path, antipode, anchor) == ()


LACKING = {"identifier": "LACKS", "restriction": "PROHIBITED", "geometry": [{}]}


@pytest.mark.parametrize(
    "content",
    [
        {"features": [*ed269()["features"], LACKING]},
        ed318({"type": "Point", "coordinates": [8.0, 46.5]}, identifier="LACKS"),
        {"type": "Feature", "id": "LACKS", "geometry": {"type": "Polygon", "coordinates": [[5.0]]}},
    ],
)
def test_what_is_wrong_with_a_zone_is_told_with_its_name(tmp_path: Path, content: Any) -> None:
    """In a national file nobody finds which of thousands lacks its unit."""
    with pytest.raises(StaticZoneError, match=r"zones: zone 'LACKS': [^:]*$"):
        opened(tmp_path, content)


def test_an_outline_that_crosses_itself_far_away_does_not_take_a_national_file_with_it(
    tmp_path: Path,
) -> None:
    """A degree is 111 km. Within it nobody knows what ground is meant, and the file is refused."""

    def file(north: float) -> dict[str, Any]:
        crossed = [[east, latitude + north] for east, latitude in BOW_TIE]
        outlines = {"sound": SQUARE, "crossed": crossed}
        features = [
            {"type": "Feature", "id": name, "geometry": {"type": "Polygon", "coordinates": [ring]}}
            for name, ring in outlines.items()
        ]
        return {"type": "FeatureCollection", "features": features}

    path = tmp_path / "national.json"
    path.write_text(json.dumps(file(1.01)))
    read = open_static_zones(path, ANCHOR)
    assert [zone.id for zone in read.zones] == ["sound"]
    (told,) = read.left_out
    assert told.startswith("crossed: Self-intersection") and "lies more than 1 degree away" in told
    with pytest.raises(StaticZoneError, match=r"'crossed': Self-intersection.*take it out of the file"):
        opened(tmp_path, file(0.99))
    # All of the Earth, whose sides fall together where longitude goes round: it does not lie at 180 degrees.
    world = [[-180.0, -80.0], [180.0, -80.0], [180.0, 80.0], [-180.0, 80.0], [-180.0, -80.0]]
    with pytest.raises(StaticZoneError, match="take it out of the file"):
        opened(tmp_path, {"type": "Polygon", "coordinates": [world]})


def test_what_no_mission_comes_to_is_told_and_so_is_a_file_without_zones(tmp_path: Path) -> None:
    """As the overseas territories of a national file, one of them at our antipode, which the local plane
    would put beside us."""
    square = np.array(SQUARE)
    beside, overseas, antipode = (square + shift for shift in ([0.5, 0.0], [-60.0, -42.0], [-180.0, -93.0]))
    features = [
        {
            "type": "Feature",
            "id": name,
            "properties": {},
            "geometry": {"type": "Polygon", "coordinates": [ring.tolist()]},
        }
        for name, ring in (("here", square), ("near", beside), ("far", overseas), ("below", antipode))
    ]
    path = tmp_path / "zones.json"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    read = open_static_zones(path, ANCHOR)
    assert [zone.id for zone in read.zones] == ["here", "near"]
    assert read.left_out == tuple(f"{name}: lies more than 20 degrees away" for name in ("far", "below"))
    path.write_text('{"type": "FeatureCollection", "features": []}')
    assert open_static_zones(path, ANCHOR).left_out == ("it holds no zone",)


def test_polygons_in_collections_are_closed_and_the_rest_is_told(tmp_path: Path) -> None:
    polygon, point = {"type": "Polygon", "coordinates": [SQUARE]}, {"type": "Point", "coordinates": [8, 46]}
    beside = {"type": "Polygon", "coordinates": [(np.array(SQUARE) + np.array([0.002, 0.0])).tolist()]}
    inner = {"type": "GeometryCollection", "geometries": [polygon, point]}
    path = tmp_path / "zones.json"
    path.write_text(json.dumps({"type": "GeometryCollection", "geometries": [inner, polygon, beside]}))
    read = open_static_zones(path, ANCHOR)
    (zone,) = read.zones
    assert len(zone.polygon.geoms) == 2 and read.left_out == ("feature 1: a Point closes no ground",)


def test_landing_sites_of_ours_close_nothing(tmp_path: Path) -> None:
    """Their file beside that of the zones is the one of where to land: as zones it would close just that."""
    sites = find_sites(flat_crowd_map(np.full((9, 9), 0.9)), 0, threshold=0.5)
    path = tmp_path / "sites.geojson"
    write_sites(path, sites, MapDescription(0, 0.5, "evidence", layer="landing-site"), ANCHOR)
    read = open_static_zones(path, ANCHOR)
    assert read.zones == () and read.left_out == ("L1: a landing site of ours, which closes nothing",)
    with pytest.raises(StaticZoneError, match="L1: a landing site of ours, which closes nothing"):
        placed_geojson(path.read_bytes(), path.name)


def test_a_mark_of_the_byte_order_before_a_kml_is_no_part_of_it(tmp_path: Path) -> None:
    path = tmp_path / "zones.kml"
    text = KML.format(corners=" ".join(f"{x},{y},500" for x, y in SQUARE))
    path.write_text(text, encoding="utf-8-sig")
    assert [zone.id for zone in open_static_zones(path, ANCHOR).zones] == ["Flights"]


def test_an_archive_and_text_of_two_bytes_are_told_with_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "zones.kmz"
    with ZipFile(path, "w") as archive:
        archive.writestr("doc.kml", KML.format(corners="8,46.5 8.1,46.5 8.1,46.6 8,46.5"))
    with pytest.raises(StaticZoneError, match=r"zip archive, as a \.kmz is; unpack it"):
        open_static_zones(path, ANCHOR)
    path.write_text(KML.format(corners=""), encoding="utf-16")
    with pytest.raises(StaticZoneError, match="UTF-16; save it in UTF-8"):
        open_static_zones(path, ANCHOR)


@pytest.mark.parametrize("place", [(35.34, 25.14), (46.5, 8.0)])
@pytest.mark.parametrize("kind", ["polygon", "circle"])
def test_latitude_before_longitude_is_told(tmp_path: Path, place: tuple[float, float], kind: str) -> None:
    """Exchanged, Crete lies 14 degrees from itself: not so far that its zones would be told for that. They
    closed ground in Egypt, and nothing said so."""
    latitude, longitude = place
    path = tmp_path / "zones.json"

    def told(*shift: float, exchange: bool) -> tuple[str, ...]:
        ring = np.array(SQUARE) + np.array([longitude - 8.0, latitude - 46.5]) + np.array(shift)
        ring = ring[:, ::-1] if exchange else ring
        circle = {"type": "Circle", "center": ring[0].tolist(), "radius": 100.0}
        shape = {"type": "Polygon", "coordinates": [ring.tolist()]} if kind == "polygon" else circle
        path.write_text(json.dumps(ed269(horizontalProjection=shape)))
        return open_static_zones(path, Georeference(latitude, longitude, 0.0)).left_out

    assert told(0.2, 0.1, exchange=False) == () == told(3.0, 1.0, exchange=False)
    assert told(0.2, 0.1, exchange=True)[-1] == (
        "no zone is within 1 degree, and 1 would be if latitude and longitude were exchanged; longitude "
        "comes first"
    )


@pytest.mark.parametrize(
    "content",
    [
        {"title": "as export --format ed269 writes a run without crowds", "features": []},
        ed318({"type": "GeometryCollection", "geometries": []}),
        {"type": "MultiPolygon", "coordinates": []},
        {"features": [{"identifier": "A", "restriction": "PROHIBITED", "geometry": []}]},
    ],
)
def test_what_closes_no_ground_because_it_holds_none_is_told(tmp_path: Path, content: Any) -> None:
    path = tmp_path / "zones.json"
    path.write_text(json.dumps(content))
    read = open_static_zones(path, ANCHOR)
    assert read.zones == () and len(read.left_out) == 1
    assert read.left_out[0] == "it holds no zone" or "closes no ground" in read.left_out[0]


def test_without_a_place_on_earth_nothing_is_placed(tmp_path: Path) -> None:
    (tmp_path / "zones").write_text(json.dumps(ed269()))
    with pytest.raises(StaticZoneError, match="no place on Earth"):
        open_static_zones(tmp_path / "zones", None)


@pytest.mark.parametrize(("north_deg", "moved_m"), [(0.05, 0.9), (0.2, 3.6)])
def test_a_zone_on_high_ground_is_written_where_it_was_read(
    tmp_path: Path, north_deg: float, moved_m: float
) -> None:
    """5.6 km from the anchor and 1000 m above it, verticals have moved 0.9 m from where the local plane has
    them; at 22.2 km 3.6 m, because the ellipsoid has fallen away from the plane by 39 m there."""
    corners = np.array(SQUARE) + np.array([0.0, north_deg])
    zones = opened(tmp_path, {"type": "Polygon", "coordinates": [corners.tolist()]})
    west, south, east, north = np.round(zones[0].polygon.bounds).astype(int)
    places = np.mgrid[west - 2 : east + 2, south - 2 : north + 2].reshape(2, -1).T
    terrain = Terrain.from_indices(np.column_stack([places, np.full(len(places), 1000)]), 1.0)
    (zone,) = on_ground(zones, terrain)
    assert (zone.lower_m, zone.upper_m) == (1000.0, 1001.0)
    written = geographic_outline(zone, ANCHOR)
    assert written.covers(shapely.Polygon(corners))
    assert written.buffer(-2.2 * moved_m / DEGREE_NORTH_M).within(shapely.Polygon(corners))


@pytest.mark.parametrize("north_deg", [0.0, 0.2, 1.0, 3.0, 19.9])
def test_a_zone_of_unknown_ground_is_written_where_it_was_read_however_far_away(
    tmp_path: Path, north_deg: float
) -> None:
    """As most of a national file lies. What was read at the ellipsoid and written at the local plane, 8.7 km
    above it at 3 degrees, was 456 m off."""
    corners = np.array(SQUARE) + np.array([0.0, north_deg])
    (zone,) = opened(tmp_path, {"type": "Polygon", "coordinates": [corners.tolist()]})
    written = geographic_outline(zone, ANCHOR)
    assert written.covers(shapely.Polygon(corners))
    assert written.within(shapely.Polygon(corners).buffer(0.005 / DEGREE_NORTH_M))


def test_they_stay_closed_beside_ours(tmp_path: Path) -> None:
    static = opened(tmp_path, ed269())
    engine = ZoneEngine(flat_crowd_map(np.ones((2, 2))), ZoneConfig(threshold=0.5).rules(0.5), static)
    for stamp_ns in (0, 10**12):
        zones = engine.step(stamp_ns)
        assert [zone.id for zone in zones.closed] == ["Z1", "ABC1234"]
        assert len(zones) == 1 and zones.area_m2 == 4.0  # crowd alone


def in_system(name: Any, corners: Any = SQUARE) -> dict[str, Any]:
    """A GeoJSON of before RFC 7946, as GIS programs still write it."""
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [corners]}}
    crs = {"type": "name", "properties": {"name": name}}
    return {"type": "FeatureCollection", "crs": crs, "features": [feature]}


@pytest.mark.parametrize("name", ["urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326", "urn:ogc:def:crs:EPSG::4326"])
def test_degrees_of_wgs84_by_any_name_are_taken_as_they_are(tmp_path: Path, name: str) -> None:
    (plain,) = opened(tmp_path, {"type": "Polygon", "coordinates": [SQUARE]})
    (named,) = opened(tmp_path, in_system(name))
    assert named.polygon.equals(plain.polygon)


def test_degrees_of_another_datum_are_not_those_of_wgs84(tmp_path: Path) -> None:
    """A zone round 52.5 N, 13.4 E of WGS 84, in the degrees of DHDN. By the shift, turns and scale of
    EPSG:1777 (598.1, 73.7, 418.2 m; 0.202, 0.045, -2.455"; 6.7 ppm) taken backwards, that place lies at
    52.50140 N, 13.40174 E there: 195 m away."""
    anchor = Georeference(52.5, 13.4, 0.0)
    ring = np.array(SQUARE) - np.mean(SQUARE[:4], axis=0) + np.array([13.40174, 52.50140])
    for content in (
        in_system("urn:ogc:def:crs:EPSG::4314", ring.tolist()),
        {"type": "Polygon", "coordinates": [ring.tolist()], "crs": in_system("EPSG:4314")["crs"]},
    ):
        (zone,) = opened(tmp_path, content, anchor)
        middle = zone.polygon.centroid
        assert np.hypot(middle.x, middle.y) < 5.0


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("EPSG:25832", "coordinates are in 'ETRS89 / UTM zone 32N', not in degrees; write it in WGS 84"),
        ("EPSG:nothing", "reference system 'EPSG:nothing' is none that PROJ knows"),
        (None, "reference system is not named"),
    ],
)
def test_coordinates_that_are_no_degrees_are_refused(tmp_path: Path, name: Any, message: str) -> None:
    with pytest.raises(StaticZoneError) as refused:
        opened(tmp_path, in_system(name))
    assert message in str(refused.value)


@pytest.mark.parametrize("data", [b"drone,stamp_ns,x,y,z\n", b"II*\x00\xbb\xff", b"PK\x03\x04 a .kmz"])
def test_a_file_of_something_else_is_told_as_such(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "zones.kml"
    path.write_bytes(data)
    with pytest.raises(StaticZoneError, match=r"zones\.kml: it is neither KML nor JSON \(ED-318"):
        open_static_zones(path, ANCHOR)
