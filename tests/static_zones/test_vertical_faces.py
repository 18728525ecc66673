"""Airspace that a KML draws as a body: roof, floor and walls. A wall has no ground of its own."""

from pathlib import Path

import pytest

from crowdfence import Georeference
from crowdfence.static_zones import StaticZoneError, StaticZones, open_static_zones

ANCHOR = Georeference(46.5, 8.0, 1200.0)
WEST, SOUTH, SIDE = 8.0, 46.5, 0.01
DEGREE_NORTH_M, DEGREE_EAST_M = 111_180.0, 76_750.0  # there
CORNERS = [(WEST, SOUTH), (WEST + SIDE, SOUTH), (WEST + SIDE, SOUTH + SIDE), (WEST, SOUTH + SIDE)]


def polygon(corners: list[tuple[float, float, float]]) -> str:
    text = " ".join(f"{longitude:.6f},{latitude:.6f},{height:g}" for longitude, latitude, height in corners)
    ring = f"<LinearRing><coordinates>{text}</coordinates></LinearRing>"
    return f"<Polygon><outerBoundaryIs>{ring}</outerBoundaryIs></Polygon>"


def level(height_m: float) -> str:
    return polygon([(*corner, height_m) for corner in [*CORNERS, CORNERS[0]]])


def wall(begin: tuple[float, float], end: tuple[float, float]) -> str:
    return polygon([(*begin, 500), (*end, 500), (*end, 900), (*begin, 900), (*begin, 500)])


WALLS = [wall(begin, end) for begin, end in zip(CORNERS, [*CORNERS[1:], CORNERS[0]], strict=True)]


def opened(folder: Path, *faces: str) -> StaticZones:
    path = folder / "airspace.kml"
    several = f"<MultiGeometry>{''.join(faces)}</MultiGeometry>"
    path.write_text(f"<kml><Placemark><name>CTR</name>{several}</Placemark></kml>")
    return open_static_zones(path, ANCHOR)


@pytest.mark.parametrize("level_faces", [[level(900)], [level(500), level(900)], []])
def test_the_ground_of_a_body_is_closed_once(tmp_path: Path, level_faces: list[str]) -> None:
    """Also that of a body of walls alone, whose roof is left to who looks at it: they stand around it."""
    read = opened(tmp_path, *WALLS, *level_faces)
    (zone,) = read.zones
    assert zone.id == "CTR"
    assert zone.polygon.geom_type == "Polygon"
    # To a part in 1000: the square narrows towards the north by 2e-4.
    assert zone.polygon.area == pytest.approx(SIDE * DEGREE_NORTH_M * SIDE * DEGREE_EAST_M, rel=1e-3)
    assert read.left_out == ()


def test_walls_around_more_than_the_level_faces_close_that_too(tmp_path: Path) -> None:
    """A roof over the western half: what the walls enclose beside it is of the body too."""
    middle = WEST + SIDE / 2
    half = [CORNERS[0], (middle, SOUTH), (middle, SOUTH + SIDE), CORNERS[3], CORNERS[0]]
    (zone,) = opened(tmp_path, *WALLS, polygon([(*corner, 900) for corner in half])).zones
    assert zone.polygon.area == pytest.approx(SIDE * DEGREE_NORTH_M * SIDE * DEGREE_EAST_M, rel=1e-3)


def test_a_body_with_a_hole_keeps_it(tmp_path: Path) -> None:
    """Walls around the hole lie on its edge, so they tell of no ground that the roof does not have."""
    third = SIDE / 3
    inner = [(WEST + x * third, SOUTH + y * third) for x, y in [(1, 1), (2, 1), (2, 2), (1, 2)]]
    hole = " ".join(f"{longitude:.6f},{latitude:.6f},900" for longitude, latitude in [*inner, inner[0]])
    inside = f"<innerBoundaryIs><LinearRing><coordinates>{hole}</coordinates></LinearRing></innerBoundaryIs>"
    roof = level(900).replace("</Polygon>", f"{inside}</Polygon>")
    walls = [wall(begin, end) for begin, end in zip(inner, [*inner[1:], inner[0]], strict=True)]
    (zone,) = opened(tmp_path, roof, *WALLS, *walls).zones
    whole_m2 = SIDE * DEGREE_NORTH_M * SIDE * DEGREE_EAST_M
    assert zone.polygon.area == pytest.approx(whole_m2 * 8 / 9, rel=1e-3)


@pytest.mark.parametrize("faces", [WALLS[:3], [level(900), wall((8.1, 46.5), (8.2, 46.5))]])
def test_walls_that_stand_around_no_ground_are_refused(tmp_path: Path, faces: list[str]) -> None:
    """Of a body of which a side is missing, or beside it: nobody knows what ground is meant."""
    with pytest.raises(StaticZoneError, match=r"airspace\.kml: zone 'CTR': .*; mend its outline"):
        opened(tmp_path, *faces)


def test_walls_far_away_do_not_take_a_national_file_with_them(tmp_path: Path) -> None:
    path = tmp_path / "airspace.kml"
    near = f"<Placemark><name>CTR</name><MultiGeometry>{level(900)}</MultiGeometry></Placemark>"
    far = f"<Placemark><name>TMA</name>{wall((12.0, 46.5), (12.1, 46.5))}</Placemark>"
    path.write_text(f"<kml><Document>{near}{far}</Document></kml>")
    read = open_static_zones(path, ANCHOR)
    assert [zone.id for zone in read.zones] == ["CTR"]
    assert "TMA" in read.left_out[0]


def test_an_outline_that_crosses_itself_is_no_wall(tmp_path: Path) -> None:
    """The two halves of a bow tie are as large as each other: its area, with its signs, is nothing."""
    crossing = [CORNERS[0], CORNERS[2], CORNERS[1], CORNERS[3], CORNERS[0]]
    with pytest.raises(StaticZoneError, match="Self-intersection"):
        opened(tmp_path, polygon([(*corner, 900) for corner in crossing]))
