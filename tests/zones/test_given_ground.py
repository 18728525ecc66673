"""Heights of the ground below zones that somebody else drew."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from crowdfence import Terrain
from crowdfence.config import ZoneConfig
from crowdfence.pipeline.frame_loop import FrameLoop
from crowdfence.zones import Zone
from crowdfence.zones.given_ground import on_ground
from crowdfence.zones.ground_heights import GroundHeights
from support.small_crowd_maps import crowd_map_of
from support.small_zones import DrawnZones


def given(outline: shapely.Polygon) -> Zone:
    """As a file gives it: nobody knows the ground."""
    crowd = DrawnZones((1, 1)).drawn("#")[0]
    return replace(crowd, id="HOSP", kind="static", polygon=outline, lower_m=0.0, upper_m=0.0)


def hill(*missing: tuple[int, int]) -> Terrain:
    """10 x 10 columns of 1 m from (0, 0): at k = 300 west of x = 5, at 340 east of it."""
    places = [(i, j) for i in range(10) for j in range(10) if (i, j) not in missing]
    return Terrain.from_indices([(i, j, 300 if i < 5 else 340) for i, j in places], 1.0)


@pytest.mark.parametrize(
    ("outline", "heights"),
    [
        (shapely.box(1, 1, 4, 4), (300.0, 301.0)),
        (shapely.box(1, 1, 6, 4), (300.0, 341.0)),
        (shapely.box(0, 0, 10, 10), (300.0, 341.0)),
        (shapely.box(0, 0, 10, 10.01), None),  # reaches beyond the map
        (shapely.box(-50, -50, 50, 50), None),
        (shapely.box(20, 20, 30, 30), None),
    ],
)
def test_the_ground_is_known_where_the_map_holds_all_of_it(
    outline: shapely.Polygon, heights: tuple[float, float] | None
) -> None:
    assert GroundHeights(hill()).below(outline) == heights
    (zone,) = on_ground([given(outline)], hill())
    assert zone.ground_is_known == (heights is not None)
    assert (zone.lower_m, zone.upper_m) == (heights or (0.0, 0.0))


def test_a_hole_of_the_map_is_no_ground() -> None:
    heights = GroundHeights(hill((2, 2)))
    assert heights.below(shapely.box(1, 1, 4, 4)) is None
    assert heights.below(shapely.box(3, 1, 4, 4)) == (300.0, 301.0)


def test_an_outline_is_left_as_it_is() -> None:
    """A prepared one must not be asked by several threads, and those of zones are everybody's."""
    outline = shapely.box(1, 1, 4, 4)
    assert not GroundHeights(hill((2, 2))).hold(outline)
    assert not shapely.is_prepared(outline)


def test_an_outline_grows_as_the_verticals_lean() -> None:
    """At sqrt(32) m from the anchor and 301 m up they are 32^.5 * 301 / 6.335e6 = 0.27 mm off."""
    (zone,) = on_ground([given(shapely.box(1, 1, 4, 4))], hill())
    grown_m = 4**0.5 * 8**0.5 * 301 / 6.335e6
    assert np.array(zone.polygon.bounds) == pytest.approx(
        [1 - grown_m, 1 - grown_m, 4 + grown_m, 4 + grown_m], abs=1e-9
    )


def test_what_has_its_ground_keeps_it() -> None:
    known = replace(given(shapely.box(1, 1, 4, 4)), lower_m=7.0, upper_m=8.0)
    assert on_ground([known], hill()) == (known,)


def test_of_a_zone_set_all_that_it_closes_stays_closed() -> None:
    """As a sequence it is its crowds alone: what others drew would be open in the mission after."""
    drawn = DrawnZones((1, 1)).drawn("#")
    before = replace(drawn, static=(given(shapely.box(1, 1, 4, 4)),))
    crowd_map = crowd_map_of([(i, j, 300) for i in range(9) for j in range(9)], np.zeros(81))
    for second, closes in ((1, True), (2, False)):
        zones = FrameLoop(crowd_map, ZoneConfig(), before, closes=closes).step([], second * 10**9).zones
        assert [zone.id for zone in zones.static] == [drawn[0].id, "HOSP"]


def test_a_frame_loop_puts_them_on_its_ground() -> None:
    crowd_map = crowd_map_of([(i, j, 300) for i in range(9) for j in range(9)], np.zeros(81))
    for second, closes in ((1, True), (2, False)):
        loop = FrameLoop(crowd_map, ZoneConfig(), [given(shapely.box(1, 1, 4, 4))], closes=closes)
        (zone,) = loop.step([], second * 10**9).zones.static
        assert (zone.lower_m, zone.upper_m) == (300.0, 301.0)
