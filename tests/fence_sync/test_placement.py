"""Zones on Earth as the autopilot works them out: everything covered, whatever the place and the room."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from crowdfence import Georeference
from crowdfence.exports.geographic_circle import geographic_circle
from crowdfence.fence_sync import ItemCapacity, StorageCapacity
from crowdfence.fence_sync.autopilot_capacity import Capacity
from crowdfence.fence_sync.fence_item import FenceItem, FenceShape, items_of
from crowdfence.fence_sync.placement import float32_above, ground_of, placed
from crowdfence.static_zones.given_zone import GivenPolygon, GivenZone, local_zones
from crowdfence.zones.altitude_band import DEFAULT_BAND
from crowdfence.zones.capacity import Circle
from support.fence_zones import HERE, box, covers, zone
from support.vehicle_emulator import EmulatedVehicle, closes

PLACES = {
    "here": HERE,
    "equator": Georeference(0.0005, 30.0, 2500.0),
    "south": Georeference(-62.0, -58.0, 10.0),
    "antimeridian": Georeference(-17.0, 180.0, 0.0),
    "arctic": Georeference(88.9, 20.0, 0.0),
}


def held(shapes: tuple[FenceShape, ...]) -> EmulatedVehicle:
    items = items_of(shapes)
    return EmulatedVehicle(
        items=[(item.command, item.param1, item.latitude_e7, item.longitude_e7) for item in items]
    )


@pytest.mark.filterwarnings("ignore:.* encountered in buffer:RuntimeWarning")  # needles of 1e-300 m
@settings(max_examples=30)
@given(
    place=st.sampled_from(sorted(PLACES)),
    corners=st.lists(
        st.lists(st.tuples(st.floats(-200, 200), st.floats(-200, 200)), min_size=3, max_size=7),
        min_size=1,
        max_size=6,
    ),
    capacity=st.sampled_from(
        [ItemCapacity(n) for n in (1, 3, 5, 16, 63)] + [StorageCapacity(n) for n in (48, 160, 560)]
    ),
    ground_m=st.sampled_from([(0.0, 0.0), (-40.0, 300.0)]),
)
@example(  # a spike without width beside a triangle
    place="antimeridian",
    corners=[[(0, 0), (0, 0), (0, 0)], [(0, 0), (1, 0), (0, -1), (0, -1.7e-220), (-1, 1)]],
    capacity=ItemCapacity(1),
    ground_m=(0.0, 0.0),
)
def test_every_zone_is_covered_and_the_fence_fits(
    place: str,
    corners: list[list[tuple[float, float]]],
    capacity: Capacity,
    ground_m: tuple[float, float],
) -> None:
    """Outlines that cross themselves, with corners on one line, on any ground, anywhere."""
    zones = [zone(shapely.Polygon(ring), f"Z{i}", ground_m) for i, ring in enumerate(corners)]
    fence = placed(zones, PLACES[place], capacity)
    assert capacity.holds(fence.shapes)
    assert covers(held(fence.shapes), zones, PLACES[place])


def test_a_star_is_closed_in_its_middle_too() -> None:
    angles = np.radians(90.0 + 144.0 * np.arange(5))
    star = shapely.Polygon(40.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    assert not star.is_valid
    fence = placed([zone(star)], HERE, ItemCapacity(63))
    assert covers(held(fence.shapes), [box(-5.0, -5.0, 10.0)])


def test_a_zone_across_the_antimeridian_is_closed_on_both_sides() -> None:
    """The autopilot compares longitudes as they are: a ring across would close the other way round."""
    place = PLACES["antimeridian"]
    zones = [box(-30.0, 0.0, 60.0)]
    vehicle = held(placed(zones, place, ItemCapacity(63)).shapes)
    assert covers(vehicle, zones, place)
    longitudes = [east / 1e7 for _, _, _, east in vehicle.items]
    assert sorted({round(east) for east in longitudes}) == [-180, 180] and len(vehicle.items) == 8
    # In seven items there is no room for both halves.
    tight = held(placed(zones, place, ItemCapacity(7)).shapes)
    assert covers(tight, zones, place) and len(tight.items) <= 7
    assert not covers(vehicle, [box(100.0, 0.0)], place)


@pytest.mark.parametrize("place", sorted(set(PLACES) - {"arctic"}))
@pytest.mark.parametrize("radius_m", [5.0, 300.0, 3000.0])
def test_a_circle_covers_by_the_distance_of_every_autopilot(place: str, radius_m: float) -> None:
    """PX4: haversine on 6371 km. ArduPilot: 0.011131884502145034 m a 1e-7 degree of latitude, and longitude
    by the cosine of the latitude at either end."""
    anchor = PLACES[place]
    east, north, stored_m = geographic_circle(Circle(50.0, -20.0, radius_m), anchor, 0.0, 100.0, 7)
    angle = np.linspace(0.0, 2 * np.pi, 720)
    rim = np.stack([50.0 + radius_m * np.cos(angle), -20.0 + radius_m * np.sin(angle), 0 * angle], axis=1)
    for height_m in (0.0, 100.0):
        latitude, longitude, _ = anchor.geodetic_from_local(np.add(rim, (0.0, 0.0, height_m)))
        dx = (longitude - east + 180.0) % 360.0 - 180.0
        dy = latitude - north
        for at in (latitude, np.full_like(latitude, north)):
            flat_m = np.hypot(dy, dx * np.cos(np.radians(at))) * 1e7 * 0.011131884502145034
            assert flat_m.max() <= stored_m
        half = np.sin(np.radians(dy) / 2) ** 2
        half += np.cos(np.radians(latitude)) * math.cos(math.radians(north)) * np.sin(np.radians(dx) / 2) ** 2
        assert (2 * 6_371_000.0 * np.arcsin(np.sqrt(half))).max() <= stored_m
    assert stored_m <= radius_m * 1.009 + 0.1 + radius_m**2 * 2 / 6.4e6


def test_a_circle_near_the_pole_is_refused() -> None:
    with pytest.raises(ValueError, match=r"reaches latitude 89\.\d+; zones are written up to 89.0 degrees"):
        geographic_circle(Circle(0.0, 0.0, 100.0), Georeference(89.0, 0.0, 0.0), 0.0, 0.0, 7)


@pytest.mark.parametrize("latitude_deg", [-47.0, 47.0, 70.0, 88.5])
@pytest.mark.parametrize(("long_m", "wide_m"), [(8000.0, 40.0), (3000.0, 26.0), (8000.0, 4000.0)])
def test_long_edges_with_sharp_corners_are_covered(latitude_deg: float, long_m: float, wide_m: float) -> None:
    """What is added because edges bow in degrees moves a sharp corner far out, and its edges bow more then:
    a quarter of a metre of a parade 8 km long lay beside its fence at 47 degrees, 1.5 m at 70, 13 m at 88."""
    anchor = Georeference(latitude_deg, 10.0, 0.0)
    for azimuth_deg in range(0, 180, 11):
        corners = np.array([[0.0, 0.0], [wide_m / 2, long_m], [-wide_m / 2, long_m]])
        turn = np.radians(azimuth_deg)
        around = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        parade = zone(shapely.Polygon(corners @ around), ground_m=(0.0, 1.0))
        vehicle = held(placed([parade], anchor, ItemCapacity(63)).shapes)
        assert covers(vehicle, [parade], anchor), azimuth_deg
        if abs(latitude_deg) < 60.0:
            assert ground_m2(vehicle, anchor) <= 1.2 * parade.polygon.area + 8.0 * long_m


def ground_m2(vehicle: EmulatedVehicle, anchor: Georeference) -> float:
    latitude, longitude = ([one[at] / 1e7 for one in vehicle.items] for at in (2, 3))
    return float(shapely.Polygon(anchor.local_from_geodetic(latitude, longitude, 0.0)[:, :2]).area)


def test_a_radius_is_never_rounded_down() -> None:
    """What travels as a float32 is not below what was worked out."""
    for value in (0.1, 25.0, 33.33, 1234.57, 98765.43):
        assert value <= float32_above(value) <= value * (1 + 2e-7)


@pytest.mark.parametrize("items", [2, 63])
@pytest.mark.parametrize("east_deg", [0.5, 2.0, 10.0])
def test_a_zone_of_others_far_away_is_covered_beside_one_of_ours(items: int, east_deg: float) -> None:
    """It was read at the ellipsoid, 1.8 km below the local plane at 2 degrees of longitude: a fence that
    stood on the ground of the crowd lay 64 m beside it."""
    corners = np.array([[8.0, 46.5], [8.01, 46.5], [8.01, 46.51], [8.0, 46.51]])
    corners[:, 0] += east_deg
    given = GivenZone("far", [GivenPolygon([corners[[0, 1, 2, 3, 0]]])], DEFAULT_BAND)
    here = Georeference(46.5, 8.0, 1200.0)
    (far,) = local_zones([given], here, set(), [])
    near = zone(shapely.box(-10.0, -10.0, 10.0, 10.0), "Z1", (-30.0, 40.0))
    vehicle = held(placed([near, far], here, ItemCapacity(items)).shapes)
    assert all(closes(vehicle.items, latitude, longitude) for longitude, latitude in corners.tolist())
    assert covers(vehicle, [near], here)


def test_an_outline_too_fine_for_the_decimals_is_closed_by_a_convex_one() -> None:
    """Two needles a tenth of a millimetre apart: the rounded ring would cross itself."""
    comb = shapely.Polygon([(0, 0), (30, 0), (30, 1e-4), (1e-4, 2e-4), (30, 3e-4), (30, 30), (0, 30)])
    fence = placed([zone(comb)], HERE, ItemCapacity(63))
    assert covers(held(fence.shapes), [zone(comb)])


def test_ten_thousand_zones_fit() -> None:
    rng = np.random.default_rng(1)
    zones = [box(x, y, 3.0, f"Z{i}") for i, (x, y) in enumerate(rng.uniform(-2000, 2000, (10_000, 2)))]
    fence = placed(zones, HERE, ItemCapacity(63))
    vehicle = held(fence.shapes)
    assert len(vehicle.items) <= 63
    assert covers(vehicle, zones[::97])
    closed = shapely.union_all([ground_of(shape, HERE) for shape in fence.shapes])
    shapely.prepare(closed)
    assert shapely.covers(closed, [one.polygon for one in zones]).all()


def test_what_storage_holds_is_counted_in_bytes() -> None:
    """5 of a head and an end; 2 and 8 a corner; 13 a circle."""
    square: FenceShape = tuple(FenceItem(5002, 4.0, i, i) for i in range(4))
    circle: FenceShape = (FenceItem(5004, 10.0, 0, 0),)
    assert StorageCapacity(5 + 34 + 13).holds([square, circle])
    assert not StorageCapacity(5 + 34 + 12).holds([square, circle])
    assert StorageCapacity(5 + 34 + 16).free_items([square]) == 2
    many: FenceShape = tuple(FenceItem(5002, 256.0, i, i) for i in range(256))
    assert not StorageCapacity(10_000).holds([many])
    assert StorageCapacity(10_000).free_items([square]) == 251
    assert StorageCapacity(560).after_refusal([square]).bytes == (5 + 34) * 3 // 4
    assert ItemCapacity(63).after_refusal([circle, circle]).items == 1
