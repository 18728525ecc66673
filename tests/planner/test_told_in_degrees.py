"""What a way keeps from zones where both are told in degrees."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from crowdfence import Georeference
from crowdfence.exports.geographic_outline import geographic_outline
from crowdfence.planner.told_in_degrees import at_one_height
from crowdfence.zones import Zone
from support.small_zones import DrawnZones

ANCHOR = Georeference(46.5, 8.0, 0.0)


def at(outline: shapely.Polygon, lower_m: float, upper_m: float) -> Zone:
    (crowd,) = DrawnZones((1, 1)).drawn("#")
    return replace(crowd, polygon=outline, lower_m=lower_m, upper_m=upper_m)


def test_a_zone_far_away_makes_none_near_by_larger() -> None:
    """As in a national file of zones, of which nobody knows the ground: 300 km away and 500 m lower verticals
    have moved 24 m, here 1 cm. Nor is the way told at another height for it."""
    here, far = shapely.box(0, 0, 100, 100), shapely.box(3e5, 0, 3.01e5, 1e3)
    height_m, (near, other) = at_one_height([at(here, 490.0, 500.0), at(far, 0.0, 0.0)])
    assert height_m == 495.0
    assert near.polygon.covers(here) and near.polygon.within(here.buffer(0.02, join_style="mitre"))
    assert other.polygon.covers(far.buffer(23.0, join_style="mitre"))


@pytest.mark.parametrize("far_m", [300.0, 3e3, 2e4, 1e5])
def test_what_a_way_passes_covers_what_is_written_of_a_zone_of_unknown_ground(far_m: float) -> None:
    zone = at(shapely.box(far_m, 0.0, far_m + 100.0, 100.0), 0.0, 0.0)
    height_m, (passed, _) = at_one_height([zone, at(shapely.box(0, 0, 9, 9), 700.0, 710.0)])
    latitude, longitude = (shapely.get_coordinates(geographic_outline(zone, ANCHOR)).T)[::-1]
    # The way lies at one local height: its places are those where the verticals pass that.
    place = np.column_stack([np.zeros((len(latitude), 2)), np.full(len(latitude), height_m)])
    for _ in range(9):
        found = ANCHOR.geodetic_from_local(place)
        back = ANCHOR.local_from_geodetic(latitude, longitude, found[2])
        place[:, :2] = back[:, :2]
    assert shapely.covers(passed.polygon, shapely.points(place[:, :2])).all()
