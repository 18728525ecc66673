"""Files of zones that are damaged, or lie: zones or one line about them, soon and in little memory."""

import json
from pathlib import Path

import pytest

from crowdfence import Georeference
from crowdfence.static_zones import open_static_zones
from support.damaged_files import damaged, outcome

ANCHOR = Georeference(46.5, 8.0, 1200.0)
SQUARE = [[8.0, 46.5], [8.001, 46.5], [8.001, 46.501], [8.0, 46.501], [8.0, 46.5]]
LIMITS = {"uomDimensions": "M", "lowerLimit": 0, "upperLimit": 120}
REFERENCES = {"lowerVerticalReference": "AGL", "upperVerticalReference": "AMSL"}
POLYGON = {"type": "Polygon", "coordinates": [SQUARE]}
CIRCLE = {"type": "Circle", "center": [8.0, 46.5], "radius": 300}
ED269 = {
    "features": [
        {
            "identifier": f"ABC{number}",
            "country": "CHE",
            "type": "COMMON",
            "restriction": "PROHIBITED",
            "geometry": [{**LIMITS, **REFERENCES, "horizontalProjection": shape}],
        }
        for number, shape in enumerate((POLYGON, CIRCLE))
    ]
}
ED318 = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {"identifier": "ABC1", "country": "CHE", "type": "PROHIBITED", "variant": "COMMON"},
            "geometry": {
                "type": "GeometryCollection",
                "geometries": [{**POLYGON, "layer": {"upper": 120, "upperReference": "AGL", "uom": "m"}}],
            },
        }
    ],
}
GEOJSON = {
    "type": "FeatureCollection",
    "features": [
        {"type": "Feature", "properties": {"name": "a", "upper_m": 120}, "geometry": POLYGON},
        {
            "type": "Feature",
            "properties": None,
            "geometry": {
                "type": "MultiPolygon",
                "coordinates": [[SQUARE], [[[lon + 0.01, lat] for lon, lat in SQUARE]]],
            },
        },
    ],
}
KML = (
    '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>'
    "<name>field</name><Polygon><altitudeMode>relativeToGround</altitudeMode><outerBoundaryIs><LinearRing>"
    f"<coordinates>{' '.join(f'{lon},{lat},120' for lon, lat in SQUARE)}</coordinates>"
    "</LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"
)


@pytest.mark.parametrize("content", [ED269, ED318, GEOJSON, KML], ids=["ED-269", "ED-318", "GeoJSON", "KML"])
def test_damaged_zones_are_read_or_refused_in_one_line(tmp_path: Path, content: object) -> None:
    path = tmp_path / "zones"
    intact = content if isinstance(content, str) else json.dumps(content)
    path.write_text(intact)
    assert outcome(lambda: open_static_zones(path, ANCHOR)) == ""
    refused = 0
    for data in damaged(intact.encode(), 400):
        path.write_bytes(data)
        said = outcome(lambda: open_static_zones(path, ANCHOR))
        assert not said or said.startswith(str(path))
        refused += bool(said)
    assert refused > 100


@pytest.mark.parametrize(
    "content",
    [
        "[" * 100_000,
        '{"a":' * 100_000,
        "<kml>" * 100_000,
        '<!DOCTYPE kml [<!ENTITY a "'
        + "x" * 1000
        + '">'
        + "".join(f'<!ENTITY {b} "{f"&{a};" * 30}">' for a, b in zip("abcdefg", "bcdefgh", strict=True))
        + "]><kml><name>&h;</name></kml>",
        json.dumps({**ED269, "features": ED269["features"] * 3}).replace("300", "1e308"),
        json.dumps(ED269).replace("8.001", "8e300"),
        "1" * 10_000,
        '{"features": ' + "9" * 10_000 + "}",
    ],
    ids=["brackets", "braces", "tags", "entities", "radius", "longitude", "digits", "number"],
)
def test_what_is_made_to_exhaust_a_reader_does_not(tmp_path: Path, content: str) -> None:
    path = tmp_path / "zones"
    path.write_text(content)
    assert outcome(lambda: open_static_zones(path, ANCHOR)).startswith(str(path))
