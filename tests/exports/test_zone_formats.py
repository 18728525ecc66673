"""Zones in the formats of others, read back by their parsers: nothing that is closed may be lost."""

import csv
import io
import json
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fastkml
import jsonschema
import numpy as np
import pytest
import rasterio
import referencing
import shapely
from geojson_pydantic import FeatureCollection
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from implicitdict import ImplicitDict
from numpy.typing import NDArray
from pyproj import datadir
from rasterio.transform import from_origin
from uas_standards import eurocae_ed269, eurocae_ed318
from uas_standards.astm.f3548.v21 import api as f3548_api
from uas_standards.astm.f3548.v21 import constants as f3548_constants

from crowdfence import Georeference
from crowdfence.datum import wgs84_from
from crowdfence.exports.geojson import zones_geojson
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.zone_formats import ZONE_FORMATS, ZoneExport, geoid, qgc_plan
from crowdfence.exports.zone_formats.geoid import geoid_heights_m
from crowdfence.exports.zone_formats.over_coverage import over_coverage_m2
from crowdfence.exports.zone_formats.times import rfc3339
from crowdfence.great_circle import great_circle_m
from crowdfence.static_zones import open_static_zones
from crowdfence.zones import AltitudeBand, Zone, ZoneSet
from crowdfence.zones.zone_id import zone_id
from support.small_zones import DrawnZones
from support.wgs84_by_hand import ground_point

ANCHOR = (46.5, 8.0, 1200.0)
STAMP_NS = 1_760_000_009_500_000_001
RING = """
    ####..
    #..#..
    ####..
    ......
    ......
    ##..##"""
PICTURES = [RING, "#", ".#\n#.", "#.##"]


def zones_of(picture: str = RING, **options: object) -> ZoneSet:
    rows = picture.split()
    zones = DrawnZones((len(rows[0]), len(rows)), **options).drawn(picture)
    return replace(zones, zones=tuple(replace(zone, valid_until_ns=STAMP_NS + 10**12) for zone in zones))


def exported(zones: ZoneSet | None = None, anchor: tuple[float, ...] = ANCHOR, **options: Any) -> ZoneExport:
    zones = zones_of() if zones is None else zones
    return ZoneExport(zones.closed, STAMP_NS, Georeference(*anchor), "race", country="GRC", **options)


def local(corners: Any, anchor: tuple[float, ...]) -> NDArray[np.float64]:
    """Longitude and latitude -> local metres on the ground of the plain, by closed-form geodesy."""
    return np.array([ground_point(anchor, corner[1], corner[0], 0.5)[:2] for corner in corners])


def polygon(rings: Any, anchor: tuple[float, ...]) -> shapely.Polygon:
    return shapely.Polygon(local(rings[0], anchor), [local(ring, anchor) for ring in rings[1:]])


def parsed_ed318(feature: dict[str, Any]) -> eurocae_ed318.UASZone:
    """Its properties by the package's types. These take an e-mail address for a text with a language, cannot
    hold extended properties and know no geometry but points; the published schema is in another test."""
    properties = json.loads(json.dumps(feature["properties"]))
    properties.pop("extendedProperties")
    properties["zoneAuthority"][0].pop("email", None)
    return ImplicitDict.parse(properties, eurocae_ed318.UASZone)


def ed318_polygons(text: str, anchor: tuple[float, ...]) -> Iterator[shapely.Polygon]:
    for feature in json.loads(text)["features"]:
        assert len(parsed_ed318(feature).identifier) <= 7
        shape = shapely.geometry.shape(feature["geometry"])
        for part in getattr(shape, "geoms", [shape]):
            yield polygon([ring.coords for ring in (part.exterior, *part.interiors)], anchor)


def ed269_polygons(text: str, anchor: tuple[float, ...]) -> Iterator[shapely.Polygon]:
    document = json.loads(text)
    for zone in eurocae_ed269.ED269Schema.from_dict(document).features:
        for geometry in zone.geometry:
            yield polygon(geometry.horizontalProjection.coordinates, anchor)


def f3548_polygons(text: str, anchor: tuple[float, ...]) -> Iterator[shapely.Polygon]:
    for constraint in json.loads(text)["constraints"]:
        ImplicitDict.parse(constraint["reference"], f3548_api.ConstraintReference)
        details = ImplicitDict.parse(constraint["details"], f3548_api.ConstraintDetails)
        for volume in details.volumes:
            vertices = volume.volume.outline_polygon.vertices
            assert 3 <= len(vertices) <= f3548_constants.CstrMaxVertices
            yield polygon([[(vertex.lng, vertex.lat) for vertex in vertices]], anchor)


def undeclared(text: str) -> str:
    """fastkml reads with lxml where that is installed, which takes no declared encoding in a str."""
    declaration, _, document = text.partition("?>")
    assert declaration == '<?xml version="1.0" encoding="UTF-8"'
    return document


def kml_polygons(text: str, anchor: tuple[float, ...]) -> Iterator[shapely.Polygon]:
    (document,) = fastkml.KML.from_string(undeclared(text), strict=True).features
    for placemark in document.features:
        shape = placemark.geometry
        for part in getattr(shape, "geoms", [shape]):
            yield polygon([part.exterior.coords, *(ring.coords for ring in part.interiors)], anchor)


def multidrone_polygons(text: str, anchor: tuple[float, ...]) -> Iterator[shapely.Polygon]:
    """As multidrone_kml_parser.cpp of grvcTeam/multidrone_planning does: in folders alone, of each placemark
    the first polygon and of that the outer boundary. One without any ends it, and nothing of the file
    counts."""
    kml = "{http://www.opengis.net/kml/2.2}"
    for folder in ElementTree.fromstring(text).find(f"{kml}Document") or []:
        for placemark in folder:
            if placemark.findtext(f"{kml}name") == "2":
                path = "/".join(f"{kml}{tag}" for tag in ("Polygon", "outerBoundaryIs", "LinearRing"))
                corners = placemark.find(path).findtext(f"{kml}coordinates").split()
                yield polygon([[tuple(map(float, corner.split(","))) for corner in corners]], anchor)


def csv_polygons(text: str, anchor: tuple[float, ...]) -> Iterator[shapely.Polygon]:
    for row in csv.DictReader(io.StringIO(text)):
        shape = shapely.from_wkt(row["wkt"])
        for part in getattr(shape, "geoms", [shape]):
            yield polygon([ring.coords for ring in (part.exterior, *part.interiors)], anchor)


def qgc_polygons(text: str, anchor: tuple[float, ...]) -> Iterator[shapely.Polygon]:
    plan = json.loads(text)
    jsonschema.validate(plan, PLAN)
    fence = plan["geoFence"]
    for one in fence["polygons"]:
        yield polygon([[(longitude, latitude) for latitude, longitude in one["polygon"]]], anchor)
    for one in fence["circles"]:
        latitude, longitude = one["circle"]["center"]
        yield shapely.Point(*local([(longitude, latitude)], anchor)[0]).buffer(one["circle"]["radius"], 256)


Reader = Callable[[str, tuple[float, ...]], Iterator[shapely.Polygon]]
READERS: dict[str, Reader] = {
    "ed318": ed318_polygons,
    "ed269": ed269_polygons,
    "f3548": f3548_polygons,
    "kml": kml_polygons,
    "multidrone": multidrone_polygons,
    "csv": csv_polygons,
    "qgc": qgc_polygons,
}
POINT = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
PLAN = {  # after QGroundControl's documentation of its plan files
    "type": "object",
    "required": ["fileType", "version", "groundStation", "mission", "geoFence", "rallyPoints"],
    "properties": {
        "fileType": {"const": "Plan"},
        "version": {"const": 1},
        "geoFence": {
            "type": "object",
            "required": ["version", "polygons", "circles"],
            "properties": {
                "version": {"const": 2},
                "polygons": {
                    "type": "array",
                    "items": {
                        "required": ["version", "inclusion", "polygon"],
                        "properties": {
                            "version": {"const": 1},
                            "inclusion": {"type": "boolean"},
                            "polygon": {"type": "array", "minItems": 3, "items": POINT},
                        },
                    },
                },
                "circles": {
                    "type": "array",
                    "items": {
                        "required": ["version", "inclusion", "circle"],
                        "properties": {
                            "version": {"const": 1},
                            "circle": {
                                "required": ["center", "radius"],
                                "properties": {"center": POINT, "radius": {"exclusiveMinimum": 0}},
                            },
                        },
                    },
                },
            },
        },
        "mission": {
            "required": ["version", "items", "plannedHomePosition", "firmwareType", "vehicleType"],
            "properties": {
                "version": {"const": 2},
                "plannedHomePosition": {"type": "array", "minItems": 3, "maxItems": 3},
            },
        },
        "rallyPoints": {"required": ["version", "points"], "properties": {"version": {"const": 2}}},
    },
}


def read_by(name: str, export: ZoneExport, anchor: tuple[float, ...] = ANCHOR) -> list[shapely.Polygon]:
    return list(READERS[name](ZONE_FORMATS[name](export), anchor))


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("picture", PICTURES)
def test_what_is_read_covers_what_is_closed_and_little_more(name: str, picture: str) -> None:
    zones = zones_of(picture)
    closed = shapely.union_all([zone.polygon for zone in zones])
    read = shapely.union_all(read_by(name, exported(zones)))
    assert read.covers(closed)
    # Formats without holes close them: in the ring 2 m2. A fence may use circles.
    holes_m2 = 0.0 if name in ("ed318", "kml", "csv") or picture is not RING else 2.0
    if name != "qgc":
        assert read.area == pytest.approx(closed.area + holes_m2, abs=0.2)


@pytest.mark.parametrize("name", READERS)
def test_of_a_zone_set_all_that_it_closes_is_written(name: str) -> None:
    """As a sequence it is its crowds alone: unseen ground and zones of others were missing."""
    crowd = zones_of("#")
    kinds = {"unseen": "UNSEEN", "static": "S1"}
    others = {
        kind: (replace(crowd[0], id=id, kind=kind, polygon=shapely.box(20 * place, 0, 20 * place + 4, 4)),)
        for place, (kind, id) in enumerate(kinds.items(), 1)
    }
    zones = replace(crowd, **others)
    export = ZoneExport(zones, STAMP_NS, Georeference(*ANCHOR), "race", country="GRC")
    read = shapely.union_all(read_by(name, export))
    assert all(read.covers(zone.polygon) for zone in zones.closed) and len(zones.closed) == 3


ANCHORS = [ANCHOR, (-33.9, 18.4, 5.0), (78.2, 15.6, 400.0), (10.0, 179.99999, 3.0), (-17.0, -179.99999, 0.0)]


@settings(max_examples=60)
@given(
    crowd=hnp.arrays(bool, (8, 7)).filter(np.any),
    anchor=st.sampled_from(ANCHORS),
    name=st.sampled_from([name for name in READERS if name != "qgc"]),
    buffer_m=st.sampled_from([0.0, 12.5]),
)
def test_nothing_is_uncovered_anywhere_on_earth(
    crowd: NDArray[np.bool_], anchor: tuple[float, ...], name: str, buffer_m: float
) -> None:
    zones = DrawnZones((8, 7), buffer_m=buffer_m).step(crowd.astype(float))
    read = shapely.union_all(
        [shapely.make_valid(one) for one in read_by(name, exported(zones, anchor), anchor)]
    )
    closed = shapely.union_all([zone.polygon for zone in zones])
    # Where the antimeridian cuts, the two edges lie on each other up to a tenth of a millimetre.
    assert closed.difference(read.buffer(1e-4)).area < 1e-9


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("anchor", [(90.0, 0.0, 0.0), (-89.99999, 179.9999, 5.0)])
def test_at_the_poles_every_format_refuses(name: str, anchor: tuple[float, ...]) -> None:
    zones = DrawnZones((1, 1)).drawn("#")
    with pytest.raises(ValueError, match="longitude loses its meaning at the poles"):
        ZONE_FORMATS[name](exported(zones, anchor))


@pytest.mark.parametrize("name", READERS)
def test_a_thousand_zones_are_all_there(name: str) -> None:
    side = 32
    outlines = [shapely.box(3 * i, 3 * j, 3 * i + 1, 3 * j + 1) for i in range(side) for j in range(side)]
    (one,) = DrawnZones((1, 1)).drawn("#")
    zones = [replace(one, id=zone_id(k + 1), polygon=outline) for k, outline in enumerate(outlines)]
    read = read_by(name, replace(exported(), zones=tuple(zones), max_items=63))
    if name == "qgc":
        assert len(read) <= 63
    else:
        assert len(read) == len(zones)
    uncovered = shapely.union_all(outlines).difference(shapely.union_all(read).buffer(1e-4))
    assert uncovered.area < 1e-9


def test_ed318_says_what_when_why_and_who() -> None:
    zones = zones_of(lower_m=10.0, upper_m=80.0)
    text = ZONE_FORMATS["ed318"](exported(zones, authority="Rescue", contact="ops@example.org"))
    document = json.loads(text)
    assert document["features"][0]["properties"]["zoneAuthority"][0]["email"] == "ops@example.org"
    first = parsed_ed318(document["features"][0])
    assert first.identifier == zones[0].id and first.country == "GRC"
    assert first.type == "PROHIBITED" and first.reason == ["POPULATION"]
    (period,) = first.limitedApplicability
    assert period.startDateTime == "2025-10-09T08:53:29.500Z"
    assert period.endDateTime == "2025-10-09T09:10:09.501Z"  # 1000 s later, rounded up
    (authority,) = first.zoneAuthority
    assert authority.name[0].text == "Rescue"
    layer = document["features"][0]["geometry"]["layer"]
    assert layer == {
        "upper": 80.0,
        "upperReference": "AGL",
        "lower": 10.0,
        "lowerReference": "AGL",
        "uom": "m",
    }


SCHEMA = os.environ.get("CROWDFENCE_ED318_SCHEMA")


@pytest.mark.skipif(SCHEMA is None, reason="CROWDFENCE_ED318_SCHEMA names no folder of the published schema")
def test_ed318_keeps_the_published_schema() -> None:
    assert SCHEMA is not None
    parts = {path.name: json.loads(path.read_text()) for path in Path(SCHEMA).glob("*.json")}
    named = [
        (f"{dot}{name}", referencing.Resource.from_contents(part))
        for name, part in parts.items()
        for dot in ("", "./")
    ]
    registry = referencing.Registry().with_resources(named)
    validator = jsonschema.Draft7Validator(
        parts["Schema_GeoZones.json"], registry=registry, format_checker=jsonschema.FormatChecker()
    )
    for options in ({}, {"restriction": "no_sustained_flight"}, {"close_unseen": True}, {"buffer_m": 3.0}):
        for picture in PICTURES:
            document = json.loads(ZONE_FORMATS["ed318"](exported(zones_of(picture, **options))))
            assert [error.message for error in validator.iter_errors(document)] == []
    broken = json.loads(ZONE_FORMATS["ed318"](exported()))
    broken["features"][0]["properties"]["identifier"] = "CROWD001"
    assert not validator.is_valid(broken)


@pytest.mark.parametrize("contact", ["", "nobody", "+41 44 123 45 67", "@example.org", "ops@", "a b@c.org"])
def test_a_contact_is_an_email_address(contact: str) -> None:
    """The published schema asks for one: such a file was written, and refused by whoever checks it."""
    with pytest.raises(ValueError, match="must be an e-mail address"):
        exported(contact=contact)
    assert exported(contact="ops+drones@example.org").contact


def test_no_sustained_flight_is_a_condition() -> None:
    export = exported(zones_of(restriction="no_sustained_flight"))
    ed318, ed269 = (json.loads(ZONE_FORMATS[name](export))["features"][0] for name in ("ed318", "ed269"))
    assert ed318["properties"]["type"] == "CONDITIONAL" and ed318["properties"]["restrictionConditions"]
    assert ed269["restriction"] == "CONDITIONAL"
    assert ed269["message"] == ed318["properties"]["restrictionConditions"], "or nobody knows the condition"


def test_ed269_has_longitude_first_and_both_outer_forms() -> None:
    export = exported()
    features = json.loads(ZONE_FORMATS["ed269"](export))["features"]
    assert features == json.loads(ZONE_FORMATS["ed269-list"](export))["UASZoneList"]
    longitude, latitude = features[0]["geometry"][0]["horizontalProjection"]["coordinates"][0][0]
    assert (int(longitude + 1e-4), int(latitude)) == (8, 46)  # as in the Swiss authority's files
    assert features[0]["geometry"][0]["upperLimit"] == 120


def test_ed269_keeps_the_200_characters_that_names_may_have() -> None:
    (zone, *_) = json.loads(ZONE_FORMATS["ed269"](exported(authority="A" * 300)))["features"]
    assert zone["zoneAuthority"][0]["name"] == "A" * 200


def test_f3548_keeps_the_limits_of_time_and_corners() -> None:
    zones = zones_of()
    soon, never = (
        replace(zones, zones=tuple(replace(zone, valid_until_ns=until) for zone in zones))
        for until in (STAMP_NS + 10**9, None)
    )
    for case, seconds in ((soon, 600), (zones, 1000), (never, 24 * 3600)):
        (first, *_) = json.loads(ZONE_FORMATS["f3548"](exported(case)))["constraints"]
        volume = first["details"]["volumes"][0]
        assert volume["time_start"]["value"] == rfc3339(STAMP_NS)
        # An end of its own is rounded up; a day is not, which would be a millisecond more than it may hold.
        ends = rfc3339(STAMP_NS + seconds * 10**9, up=case is zones)
        assert volume["time_end"]["value"] == ends
        assert volume["volume"]["altitude_lower"]["reference"] == "W84"
        # The ground is the voxel from 0 to 1 m above the anchor's 1200 m.
        assert volume["volume"]["altitude_lower"]["value"] == pytest.approx(1200.0, abs=1e-2)
        assert volume["volume"]["altitude_upper"]["value"] == pytest.approx(1321.0, abs=1e-2)
    comb = np.zeros((700, 3))
    comb[:, 0] = comb[::2] = 1.0  # 1402 corners and more
    many = DrawnZones((700, 3)).step(comb)
    (outline,) = read_by("f3548", exported(many))
    assert outline.covers(many[0].polygon)
    again = json.loads(ZONE_FORMATS["f3548"](exported()))["constraints"]
    assert [one["reference"]["id"] for one in again] == [
        one["reference"]["id"] for one in json.loads(ZONE_FORMATS["f3548"](exported()))["constraints"]
    ]


def test_f3548_is_a_newer_version_at_a_later_moment() -> None:
    """Whoever has read a version keeps its outline, and does not read the one that the zone has grown to."""
    then, now = exported(), replace(exported(), stamp_ns=STAMP_NS + 10**9)
    (before, after) = (
        [one["reference"] for one in json.loads(ZONE_FORMATS["f3548"](export))["constraints"]]
        for export in (then, now)
    )
    assert [one["id"] for one in before] == [one["id"] for one in after]
    assert all(old["version"] < new["version"] < 2**31 for old, new in zip(before, after, strict=True))
    long_ago = replace(exported(), stamp_ns=0)
    assert json.loads(ZONE_FORMATS["f3548"](long_ago))["constraints"][0]["reference"]["version"] == 1


def test_f3548_has_other_ids_for_a_mission_of_the_same_name_elsewhere() -> None:
    """One of an operator's two services, both called "live", replaced the constraints of the other."""
    here, there = (
        {
            one["reference"]["id"]
            for one in json.loads(ZONE_FORMATS["f3548"](exported(anchor=anchor)))["constraints"]
        }
        for anchor in (ANCHOR, (-33.9, 18.4, 5.0))
    )
    assert here and not here & there


def test_f3548_closes_many_parts_each_by_itself() -> None:
    # Cells that touch at corners, in the shape of a V: one zone of 300 squares, 1200 corners. A hull around
    # all of them closes half of the rectangle, 75 times the zone.
    vee = np.zeros((300, 151))
    for column in range(300):
        vee[column, abs(column - 150)] = 1.0
    (zone,) = zones = DrawnZones((300, 151)).step(vee)
    assert zone.polygon.area == 300.0 and len(shapely.get_parts(zone.polygon)) == 300
    parts = read_by("f3548", exported(zones))
    assert sum(len(part.exterior.coords) - 1 for part in parts) <= f3548_constants.CstrMaxVertices
    closed = shapely.union_all(parts)
    assert closed.covers(zone.polygon) and closed.area < 2 * zone.polygon.area


def test_f3548_counts_no_corners_of_holes_which_it_closes() -> None:
    walled = np.ones((81, 81))
    walled[1::2, 1::2] = 0.0  # 1600 holes of 4 corners in a square of 4
    zones = DrawnZones((81, 81)).step(walled)
    (part,) = read_by("f3548", exported(zones))
    assert len(part.exterior.coords) == 5
    assert part.covers(zones[0].polygon) and part.area == pytest.approx(81.0**2, rel=1e-3)


@pytest.mark.parametrize("name", ["ed269", "f3548"])
def test_what_a_format_without_holes_closes_beside_the_zones_is_known(name: str) -> None:
    ring = replace(zones_of("#").zones[0], polygon=shapely.box(0, 0, 9, 9) - shapely.box(2, 2, 4, 5))
    inside = replace(ring, id="Z2", polygon=shapely.box(2, 2, 3, 5))
    export = replace(exported(), zones=[ring, inside])
    assert over_coverage_m2(name, export) == pytest.approx(3.0)
    assert over_coverage_m2(name, replace(export, zones=[])) == 0.0
    closed = shapely.union_all(read_by(name, export)).area
    assert closed == pytest.approx(sum(zone.polygon.area for zone in export.zones) + 3.0, abs=0.1)


def test_f3548_has_room_for_a_large_zone_that_the_antimeridian_cuts() -> None:
    """A comb of 1200 teeth, 4800 corners, every tooth cut. What the whole comb has too many was taken off the
    room for what was left of it, and no file was written."""
    teeth = [shapely.box(-30.0 - k % 7, 2.0 * k, 40.0, 2.0 * k + 1.0) for k in range(-600, 600)]
    comb = shapely.union_all([shapely.box(40.0, -1200.0, 45.0, 1200.0), *teeth])
    (zone,) = zones_of("#")
    zones = replace(zones_of("#"), zones=(replace(zone, polygon=comb),))
    anchor = (-17.0, 180.0, 0.0)
    (constraint,) = json.loads(ZONE_FORMATS["f3548"](exported(zones, anchor)))["constraints"]
    outlines = [one["volume"]["outline_polygon"]["vertices"] for one in constraint["details"]["volumes"]]
    assert len(outlines) > 1 and sum(map(len, outlines)) <= 1000
    corners = [[(one["lng"], one["lat"]) for one in outline] for outline in outlines]
    closed = shapely.union_all([shapely.Polygon(local(outline, anchor)) for outline in corners])
    assert closed.buffer(1e-4).covers(comb)


def test_corners_that_a_constraint_has_no_room_for_close_ground() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 4001)[:-1]
    corners = np.column_stack([np.cos(angle), np.sin(angle)]) * (50.0 + (np.arange(4000) % 2))[:, None]
    star = replace(zones_of("#").zones[0], polygon=shapely.Polygon(corners))
    export = replace(exported(), zones=[star])
    (closed,) = read_by("f3548", export)
    assert over_coverage_m2("f3548", export) == pytest.approx(closed.area - star.polygon.area, abs=1.0)
    assert over_coverage_m2("f3548", export) > 10.0


def test_a_kml_opens_whatever_drones_are_called() -> None:
    zones = zones_of("#")
    odd = replace(zones, zones=(replace(zones[0], seen_by=("uav\x0b1", "<b>&", "\ud800", "無人機")),))
    text = ZONE_FORMATS["kml"](exported(odd))
    (place,) = ElementTree.fromstring(text.encode()).iter("{http://www.opengis.net/kml/2.2}Placemark")
    seen_by = [
        data[0].text
        for data in place.iter("{http://www.opengis.net/kml/2.2}Data")
        if data.get("name") == "seen_by"
    ]
    assert seen_by == ["uav\ufffd1 <b>& \ufffd 無人機"]


@pytest.mark.parametrize("kind", sorted(ZONE_FORMATS))
def test_numbers_of_numpy_are_numbers(kind: str) -> None:
    """Zones of a live process hold them; files hold neither their names nor other digits."""
    plain = zones_of()
    of_numpy = replace(
        plain,
        zones=tuple(
            replace(
                zone,
                area_m2=np.float64(zone.area_m2),
                probability_max=np.float64(zone.probability_max),
                probability_mean=np.float64(zone.probability_mean),
                lower_m=np.float64(zone.lower_m),
                upper_m=np.float64(zone.upper_m),
                band=replace(
                    zone.band, lower_m=np.float64(zone.band.lower_m), upper_m=np.float64(zone.band.upper_m)
                ),
            )
            for zone in plain
        ),
    )
    text = ZONE_FORMATS[kind](exported(of_numpy))
    assert "float64" not in text and text == ZONE_FORMATS[kind](exported(plain))


def test_kml_is_named_and_dated() -> None:
    text = ZONE_FORMATS["kml"](exported())
    (document,) = fastkml.KML.from_string(undeclared(text)).features
    first = document.features[0]
    assert first.name == "Crowd Z1" and first.begin.dt.isoformat() == "2025-10-09T08:53:29.500000+00:00"
    assert next(iter(first.geometry.exterior.coords))[2] == 120.0
    text = ZONE_FORMATS["multidrone"](exported(zones_of("#.##")))
    ((folder,),) = (document.features for document in fastkml.KML.from_string(undeclared(text)).features)
    assert [(placemark.id, placemark.name) for placemark in folder.features] == [("Z1", "2"), ("Z1.2", "2")]


def test_geojson_is_rfc_7946_and_holds_unseen_ground() -> None:
    zones = zones_of(RING, close_unseen=True)
    description = MapDescription(STAMP_NS, 0.5, "paper")
    text = zones_geojson(zones, description, Georeference(*ANCHOR))
    collection = FeatureCollection.model_validate_json(text)
    assert [feature.properties["kind"] for feature in collection.features] == ["crowd"] * 3
    unseen = DrawnZones((3, 1), close_unseen=True).step(np.array([[1.0], [0.0], [np.nan]]))
    collection = FeatureCollection.model_validate_json(
        zones_geojson(unseen, description, Georeference(*ANCHOR))
    )
    kinds = {feature.id: feature.properties["kind"] for feature in collection.features}
    assert kinds == {"Z1": "crowd", "UNSEEN": "unseen"}


@pytest.mark.parametrize("name", ["ed318", "ed269"])
@pytest.mark.parametrize("country", [None, "GR", "grc", "GRCE", "12A"])
def test_a_country_is_never_guessed(name: str, country: str | None) -> None:
    told = "no country is given" if country is None else f"country is '{country}'"
    with pytest.raises(
        ValueError, match=f"{told}; this format needs three letters of ISO 3166, such as country=GRC"
    ):
        ZONE_FORMATS[name](replace(exported(), country=country))


def test_heights_above_the_ellipsoid_hold_the_band_above_every_place() -> None:
    export = exported(datum="WGS84")
    band = export.band(export.zones[0])
    assert band.datum == "WGS84" and band.lower_m <= 1200.0 and band.upper_m >= 1321.0


@pytest.mark.parametrize("datum", ["AGL", "AMSL", "WGS84"])
@pytest.mark.parametrize("bounded", ["AMSL", "WGS84"])
@pytest.mark.parametrize("kind", sorted(ZONE_FORMATS))
def test_a_zone_of_others_above_the_sea_takes_no_crowd_out_of_the_file(
    kind: str, bounded: str, datum: str
) -> None:
    """Every control zone of a national file has such heights. Where the file can say so they stay what they
    are; else they reach up and down by all heights of the sea, -107 to 86 m above the ellipsoid."""
    plain = zones_of("#")
    control_zone = Zone.of_no_look(
        "CTR", shapely.box(0.0, 0.0, 9.0, 9.0), "static", "given", band=AltitudeBand(600.0, 1500.0, bounded)
    )
    both = exported(replace(plain, static=(control_zone,)), datum=datum)
    if datum == "AMSL" and kind in ("ed318", "ed269", "ed269-list", "csv"):
        both = replace(both, zones=[control_zone])  # of the crowd's ground the grid of the geoid is needed
    if kind in ("ed269", "ed269-list") and datum == "WGS84":
        return  # it has no such heights
    text = ZONE_FORMATS[kind](both)
    if kind in ("kml", "multidrone"):
        (document,) = fastkml.KML.from_string(undeclared(text)).features
        document = document if kind == "kml" else document.features[0]
        tops = [next(iter(place.geometry.exterior.coords))[2] for place in document.features]
        assert tops == [120.0, {"AMSL": 1500.0, "WGS84": 1500.0 + 107.0}[bounded]]
        modes = [
            mode.text
            for mode in ElementTree.fromstring(text).iter("{http://www.opengis.net/kml/2.2}altitudeMode")
        ]
        assert modes == ["relativeToGround", "absolute"]
    elif kind != "qgc":
        lower_m, upper_m, above = limits_of_the_last(kind, text)
        in_file = "AMSL" if kind in ("ed269", "ed269-list") else bounded
        asked = "WGS84" if kind == "f3548" else in_file if datum == "AGL" else datum
        wider = {"AMSL WGS84": (-107.0, 86.0), "WGS84 AMSL": (-86.0, 107.0)}.get(
            f"{bounded} {asked}", (0.0, 0.0)
        )
        assert (lower_m, upper_m, above) == (600.0 + wider[0], 1500.0 + wider[1], asked)


@pytest.mark.parametrize("kind", ["ed269", "ed269-list"])
def test_ed269_has_no_heights_above_the_ellipsoid(kind: str) -> None:
    """A reader that goes by its data types refuses the whole file for one of them."""
    with pytest.raises(ValueError, match="ED-269 knows no heights above the ellipsoid"):
        ZONE_FORMATS[kind](exported(datum="WGS84"))
    control_zone = Zone.of_no_look(
        "CTR", shapely.box(0.0, 0.0, 9.0, 9.0), "static", "given", band=AltitudeBand(600.0, 1500.0, "WGS84")
    )
    document = json.loads(ZONE_FORMATS[kind](exported(replace(zones_of("#"), static=(control_zone,)))))
    zones = eurocae_ed269.ED269Schema.from_dict(
        {"features": document.get("UASZoneList") or document["features"]}
    )
    assert [zone.geometry[0].upperVerticalReference for zone in zones.features] == ["AGL", "AMSL"]


@pytest.mark.parametrize("kind", ["ed318", "ed269", "kml", "csv"])
def test_zones_have_the_names_that_others_gave_them(kind: str) -> None:
    control_zone = Zone.of_no_look(
        "LSR51", shapely.box(0.0, 0.0, 9.0, 9.0), "static", "given", name="Höhe & Tal"
    )
    text = ZONE_FORMATS[kind](exported(replace(zones_of("#"), static=(control_zone,))))
    if kind == "kml":
        (document,) = fastkml.KML.from_string(undeclared(text)).features
        names = [place.name for place in document.features]
    elif kind == "csv":
        names = [row["name"] or "Crowd Z1" for row in csv.DictReader(io.StringIO(text))]
    else:
        zones = json.loads(text)["features"]
        told = [zone.get("properties", zone)["name"] for zone in zones]
        names = [one if isinstance(one, str) else one[0]["text"] for one in told]
    assert names == ["Crowd Z1", "Höhe & Tal"]


def test_no_ceiling_of_a_kml_is_rounded_down() -> None:
    """Six digits made 12345.6 of 12345.648 m."""
    band = AltitudeBand(0.0, 12345.648, "AGL")
    high = Zone.of_no_look("Z9", shapely.box(0.0, 0.0, 9.0, 9.0), "static", "given", band=band)
    text = ZONE_FORMATS["kml"](exported(replace(zones_of("#"), static=(high,))))
    heights = {corner.split(",")[2] for corner in re.findall(r"[-.\d]+,[-.\d]+,[-.\d]+", text)}
    assert heights == {"120", "12345.648"}


def limits_of_the_last(kind: str, text: str) -> tuple[float, float, str]:
    """Of the last zone of a file, and what they are above."""
    if kind == "csv":
        row = list(csv.DictReader(io.StringIO(text)))[-1]
        return float(row["lower_m"]), float(row["upper_m"]), row["datum"]
    document = json.loads(text)
    if kind == "ed318":
        layer = document["features"][-1]["geometry"]["layer"]
        assert layer["lowerReference"] == layer["upperReference"]
        return layer["lower"], layer["upper"], layer["upperReference"]
    if kind == "f3548":
        volume = document["constraints"][-1]["details"]["volumes"][0]["volume"]
        lower, upper = volume["altitude_lower"], volume["altitude_upper"]
        assert lower["reference"] == upper["reference"] == "W84"
        return lower["value"], upper["value"], "WGS84"
    geometry = document["UASZoneList" if kind == "ed269-list" else "features"][-1]["geometry"][0]
    assert geometry["lowerVerticalReference"] == geometry["upperVerticalReference"]
    return geometry["lowerLimit"], geometry["upperLimit"], geometry["upperVerticalReference"]


@settings(max_examples=100)
@given(
    west=st.floats(-2e4, 2e4),
    south=st.floats(-2e4, 2e4),
    width_m=st.floats(1.0, 2e4),
    depth_m=st.floats(1.0, 2e4),
    anchor=st.sampled_from(ANCHORS),
)
def test_no_ground_of_a_wide_zone_lies_below_or_above_what_is_written(
    west: float, south: float, width_m: float, depth_m: float, anchor: tuple[float, ...]
) -> None:
    """The local plane leaves the ellipsoid to all sides: the lowest place may be inside, or on an edge."""
    outline = shapely.box(west, south, west + width_m, south + depth_m)
    wide = replace(zones_of("#")[0], polygon=outline, lower_m=300.0, upper_m=340.0)
    band = exported(replace(zones_of("#"), zones=(wide,)), anchor).band(wide, "WGS84")
    x, y = np.meshgrid(np.linspace(west, west + width_m, 9), np.linspace(south, south + depth_m, 9))
    nearest = shapely.get_coordinates(shapely.shortest_line(outline, shapely.Point(0, 0)))[:1]
    places = np.vstack([np.column_stack([x.ravel(), y.ravel()]), nearest])
    for height_m, limit in ((300.0, band.lower_m), (340.0, band.upper_m - 120.0)):
        _, _, above_m = Georeference(*anchor).geodetic_from_local(
            np.column_stack([places, np.full(len(places), height_m)])
        )
        # Heights are differences of distances from the centre of Earth, which doubles round to 1e-9 m.
        assert (above_m >= limit - 1e-8).all() if height_m == 300.0 else (above_m <= limit + 1e-8).all()
        least_or_most = above_m.min() if height_m == 300.0 else above_m.max()
        assert limit == pytest.approx(least_or_most, abs=2.0)


def static_zone(lower_m: float, upper_m: float) -> ZoneSet:
    """A zone of others, closed up to 120 m above ground that lies between two local heights."""
    zones = zones_of("#")
    static = replace(
        zones[0], id="HOSP", kind="static", lower_m=lower_m, upper_m=upper_m, valid_until_ns=None
    )
    return replace(zones, zones=(), static=(static,))


@pytest.mark.parametrize(
    ("lower_m", "upper_m", "band_m"),
    [
        (300.0, 340.0, (1500.0, 1660.0)),  # the anchor lies at 1200 m
        # Nobody knows the ground: from the lowest on Earth to 120 m above the highest.
        (0.0, 0.0, (-500.0, 9120.0)),
    ],
)
def test_zones_of_others_are_closed_above_their_own_ground(
    lower_m: float, upper_m: float, band_m: tuple[float, float]
) -> None:
    export = exported(static_zone(lower_m, upper_m), datum="WGS84")
    (constraint,) = json.loads(ZONE_FORMATS["f3548"](export))["constraints"]
    volume = constraint["details"]["volumes"][0]["volume"]
    assert (volume["altitude_lower"]["value"], volume["altitude_upper"]["value"]) == pytest.approx(
        band_m, abs=2e-3
    )
    lowest_m, highest_m, _ = limits_of_the_last("ed318", ZONE_FORMATS["ed318"](export))
    assert lowest_m <= band_m[0] and band_m[1] <= highest_m <= band_m[1] + 1
    band = exported(static_zone(lower_m, upper_m)).band(export.zones[0])
    assert band == AltitudeBand(0.0, 120.0, "AGL")


def test_crowd_whose_buffer_leaves_the_map_is_closed_above_every_ground() -> None:
    zones = zones_of("#")
    beyond = replace(zones, zones=(replace(zones[0], leaves_map=True),))
    (constraint,) = json.loads(ZONE_FORMATS["f3548"](exported(beyond)))["constraints"]
    volume = constraint["details"]["volumes"][0]["volume"]
    assert (volume["altitude_lower"]["value"], volume["altitude_upper"]["value"]) == (-500.0, 9120.0)
    export = exported(beyond, datum="AGL")
    assert export.band(export.zones[0]) == AltitudeBand(0.0, 120.0, "AGL")


def test_a_zone_without_a_ceiling_keeps_the_altitudes_of_f3548() -> None:
    zones = static_zone(300.0, 340.0)
    endless = replace(zones.static[0], band=AltitudeBand(0.0, 99_999.0, "AGL"))
    (constraint,) = json.loads(ZONE_FORMATS["f3548"](exported(replace(zones, static=(endless,)))))[
        "constraints"
    ]
    # Its schema allows -8000 to 100000; 1540 + 99999 is more.
    assert constraint["details"]["volumes"][0]["volume"]["altitude_upper"]["value"] == 100_000.0


@pytest.fixture
def geoid_grid(tmp_path: Path) -> Iterator[None]:
    """A geoid of our own under the name of EGM96's grid: a plane, 50 m above the ellipsoid at the anchor, 2 m
    more a degree northward and 3 m eastward. Bilinear interpolation of it is exact."""
    latitude, longitude = np.arange(47.5, 45.4, -0.25), np.arange(7.0, 9.1, 0.25)
    height_m = 50.0 + 2.0 * (latitude[:, None] - 46.5) + 3.0 * (longitude - 8.0)
    corner = from_origin(7.0 - 0.125, 47.5 + 0.125, 0.25, 0.25)
    shape = {"width": len(longitude), "height": len(latitude), "count": 1}
    with rasterio.open(
        tmp_path / "us_nga_egm96_15.tif", "w", "GTiff", dtype="float32", transform=corner, crs=4326, **shape
    ) as file:
        file.write(height_m.astype(np.float32), 1)
        file.update_tags(TYPE="VERTICAL_OFFSET_GEOGRAPHIC_TO_VERTICAL", AREA_OR_POINT="Point")
        file.set_band_description(1, "geoid_undulation")
    folders = datadir.get_data_dir()
    datadir.append_data_dir(str(tmp_path))
    yield
    datadir.set_data_dir(folders)
    wgs84_from.cache_clear()  # else tests after these know the grid, until another thread looks for it


@pytest.mark.usefixtures("geoid_grid")
def test_heights_above_the_sea_by_a_geoid_that_is_a_plane() -> None:
    lowest_m, highest_m = geoid_heights_m(np.array([7.9, 46.4, 8.0, 46.5]))
    # 50 - 2 x 0.1 - 3 x 0.1 in the south-west, 50 in the north-east, and half a metre to both sides.
    assert (lowest_m, highest_m) == pytest.approx((49.0, 50.5), abs=1e-4)
    band = (export := exported(datum="AMSL")).band(export.zones[0])
    # Ground of 1200 to 1201 m above the ellipsoid, closed 120 m up; the sea lies at 50 m give or take 0.5.
    assert band.datum == "AMSL"
    assert (band.lower_m, band.upper_m) == pytest.approx((1149.5, 1271.5), abs=1e-2)
    layer = json.loads(ZONE_FORMATS["ed318"](export))["features"][0]["geometry"]["layer"]
    assert layer["upperReference"] == layer["lowerReference"] == "AMSL"
    assert layer["lower"] <= band.lower_m and layer["upper"] >= band.upper_m


def test_the_sea_on_both_sides_of_the_antimeridian_is_that_of_the_zone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """56 m above the ellipsoid there, as at Fiji, and 16 m at Greenwich, half way between -180 and 180."""

    class Sea:
        def transform(self, longitude, latitude, height_m):
            return longitude, latitude, height_m - np.where(np.abs(longitude) > 179.0, 56.0, 16.0)

    monkeypatch.setattr(geoid, "_above_sea", Sea)
    anchor = (-17.0, 179.99999, 1200.0)
    export = exported(zones_of("######"), anchor, datum="AMSL")
    assert export.outline(export.zones[0]).bounds[0] == -180.0, "it lies on both sides"
    band = export.band(export.zones[0])
    assert (band.lower_m, band.upper_m) == pytest.approx((1143.5, 1265.5), abs=1e-2)


@pytest.mark.usefixtures("geoid_grid")
def test_the_home_of_a_plan_lies_above_the_sea() -> None:
    """The anchor, 1200 m above the ellipsoid, where the sea is at 50 m. Where the grid ends nobody knows."""
    home = json.loads(qgc_plan(exported()))["mission"]["plannedHomePosition"]
    assert home == [46.5, 8.0, pytest.approx(1150.0, abs=1e-4)]
    elsewhere = json.loads(qgc_plan(exported(anchor=(46.5, 20.0, 1200.0))))["mission"]
    assert elsewhere["plannedHomePosition"] == [46.5, 20.0, None]


@pytest.mark.usefixtures("geoid_grid")
def test_a_place_that_the_grid_does_not_hold_is_refused() -> None:
    with pytest.raises(ValueError, match=r"no height of the geoid at 46\.4, 20;"):
        geoid_heights_m(np.array([20.0, 46.4, 20.1, 46.5]))


def test_without_a_grid_the_error_says_where_it_belongs_and_how_it_gets_there() -> None:
    export = exported(datum="AMSL")
    try:
        band = export.band(export.zones[0])
    except ValueError as error:
        assert "pyproj sync --file us_nga_egm96_15" in str(error) and datadir.get_data_dir() in str(error)
    else:  # a machine that has it: the Alps' geoid is 50 m above the ellipsoid
        assert 1145.0 < band.lower_m < 1155.0 and band.upper_m - band.lower_m < 125.0


def test_no_zones_are_a_file_too() -> None:
    nothing = exported(DrawnZones((2, 2)).step(np.zeros((2, 2))))
    for name in READERS:
        assert read_by(name, nothing) == []


def plan(**changes: Any) -> dict[str, Any]:
    mission = {
        "version": 2,
        "items": [{"type": "SimpleItem", "command": 22}],
        "plannedHomePosition": [46.5, 8.0, 1200.0],
        "firmwareType": 12,
        "vehicleType": 2,
    }
    circle = {"version": 1, "inclusion": True, "circle": {"center": [46.5, 8.0], "radius": 500.0}}
    fence = {"version": 2, "polygons": [], "circles": [circle]}
    whole = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": mission,
        "geoFence": fence,
        "rallyPoints": {"version": 2, "points": []},
    }
    return {**whole, **changes}


def test_a_circle_covers_on_the_sphere_that_autopilots_take_the_earth_for() -> None:
    """By the equator a degree of latitude is 0.55 % longer on a sphere of 6371 km than on the ellipsoid: a
    crowd that reaches 700 m to the south lies 703.9 m away for PX4."""
    anchor = (0.0, 30.0, 0.0)
    export = exported(zones_of("#"), anchor, max_items=1)
    long = replace(export.zones[0], polygon=shapely.box(-1, -700, 1, 700), lower_m=0.0, upper_m=0.0)
    (circle,) = json.loads(qgc_plan(replace(export, zones=[long])))["geoFence"]["circles"]
    assert circle["circle"]["center"] == pytest.approx([0.0, 30.0], abs=1e-7)
    south, _, _ = Georeference(*anchor).geodetic_from_local([[0.0, -700.0, 0.0]])
    haversine_m = 6_371_000.0 * np.radians(abs(south[0]))
    assert haversine_m == pytest.approx(703.9, abs=0.1)
    assert haversine_m <= circle["circle"]["radius"] <= 1.008 * 700.0


@pytest.mark.parametrize("items", [2, 63])
def test_a_plan_covers_a_zone_of_others_far_away_beside_one_of_ours(tmp_path: Path, items: int) -> None:
    """153 km away it was read 1.8 km below the local plane, and the plan had it 64 m beside its place."""
    corners = [(10.0, 46.5), (10.01, 46.5), (10.01, 46.51), (10.0, 46.51)]
    path = tmp_path / "far.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [[*corners, corners[0]]]}))
    (far,) = open_static_zones(path, Georeference(*ANCHOR)).zones
    fence = json.loads(
        qgc_plan(replace(exported(zones_of("#")), zones=(*zones_of("#"), far), max_items=items))
    )["geoFence"]
    closed = np.zeros(4, dtype=bool)
    for one in fence["polygons"]:
        closed |= shapely.intersects_xy(shapely.Polygon(np.array(one["polygon"])[:, ::-1]), corners)
    for one in fence["circles"]:
        latitude, longitude = one["circle"]["center"]
        away_m = great_circle_m((longitude, latitude), *np.transpose(corners), 6_371_000.0)
        closed |= away_m <= one["circle"]["radius"]
    assert len(fence["polygons"]) + len(fence["circles"]) == 2 and closed.all()


def test_a_fence_is_added_to_a_plan_and_what_was_there_stays() -> None:
    before = plan()
    after = json.loads(qgc_plan(exported(), before))
    assert before == plan()
    assert after["mission"] == before["mission"]
    assert after["geoFence"]["circles"][0] == before["geoFence"]["circles"][0]
    items = sum(len(one["polygon"]) for one in after["geoFence"]["polygons"]) + len(
        after["geoFence"]["circles"]
    )
    assert 1 < items <= 63
    assert not any(one["inclusion"] for one in after["geoFence"]["polygons"])
    # The old form of an empty fence.
    old = json.loads(qgc_plan(exported(), plan(geoFence={"version": 1, "polygon": []})))
    assert old["geoFence"]["version"] == 2 and old["geoFence"]["polygons"]


def test_the_point_to_return_to_takes_an_item_of_the_fence() -> None:
    """QGroundControl sends it in the same list, and PX4 refuses one of 64 items whole."""
    fence = {**plan()["geoFence"], "breachReturn": [46.5, 8.0, 30.0]}
    crowds = zones_of("#...#...#...#\n.............\n" * 5)
    after = json.loads(qgc_plan(exported(crowds), plan(geoFence=fence)))["geoFence"]
    assert after["breachReturn"] == fence["breachReturn"]
    assert 40 < sum(len(one["polygon"]) for one in after["polygons"]) + len(after["circles"]) + 1 <= 63


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 42}, "the plan is of version 42; only 1 is known"),
        ({"mission": {"version": 7}}, "its mission is of version 7; only 2 is known"),
        ({"mission": None}, "no mission"),
        ({"fileType": "Mission"}, "not one of QGroundControl"),
        ({"geoFence": {"version": 1, "polygon": [[46.5, 8.0]]}}, "its fence is of version 1"),
        (
            {"geoFence": {"version": 2, "circles": [{}] * 63, "polygons": []}},
            "a fence of 0 items holds no zone",
        ),
        # These ended in a traceback.
        ({"geoFence": None}, "its geoFence is None"),
        (
            {"geoFence": {"version": 2, "polygons": None, "circles": []}},
            "the polygons of its geoFence are None",
        ),
        ({"geoFence": {"version": 2, "polygons": [], "circles": [3]}}, "the circles of its geoFence are"),
        ({"geoFence": {"version": 2, "polygons": [{}], "circles": []}}, "a polygon of its geoFence has no"),
    ],
)
def test_a_plan_that_is_not_known_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        qgc_plan(exported(), plan(**changes))


@pytest.mark.parametrize("name", ["ed318", "ed269", "ed269-list", "kml", "geojson"])
@pytest.mark.parametrize("anchor", ANCHORS)
def test_what_we_write_comes_back_as_zones_that_cover_it(
    tmp_path: Path, name: str, anchor: tuple[float, ...]
) -> None:
    zones, georeference = zones_of(), Georeference(*anchor)
    if name == "geojson":
        text = zones_geojson(zones, MapDescription(STAMP_NS, 0.5, "paper"), georeference)
    else:
        text = ZONE_FORMATS[name](exported(zones, anchor))
    (tmp_path / "zones").write_text(text)
    read = open_static_zones(tmp_path / "zones", georeference)
    assert read.left_out == ()
    again = shapely.union_all([zone.polygon for zone in read.zones]).buffer(1e-4)
    closed = shapely.union_all([zone.polygon for zone in zones])
    assert again.covers(closed) and again.area < closed.area + 2.5  # ED-269 has no holes
    assert all(zone.kind == "static" and zone.reason == "given" for zone in read.zones)
    if name != "kml":
        assert {(zone.band.lower_m, zone.band.upper_m) for zone in read.zones} == {(0.0, 120.0)}
