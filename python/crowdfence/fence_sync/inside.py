"""Is the vehicle, its home, or the way between them in what its fence closes?

Then the fence is taken and not kept: PX4 drops every shape that holds the vehicle or its home (v1.12 with a
line in its log only, newer ones with a text), and a vehicle in the middle of a zone stays there. ArduPilot
keeps it: a vehicle in it has breached it and does at once what FENCE_ACTION says, also above the crowd.

A return, as of an empty battery or a lost link, flies straight home, and in a fence that it crosses each does
what it does in any: PX4 holds on the edge, an ArduPilot that brakes above what was closed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.fence_sync.fence_event import FenceEvent
from crowdfence.fence_sync.fence_item import CIRCLE_EXCLUSION, POLYGON_EXCLUSION, FenceShape
from crowdfence.fence_sync.ground_station import Vehicle
from crowdfence.fence_sync.messages import Autopilot, Home, Position
from crowdfence.fence_sync.placement import ground_of
from crowdfence.georeference import Georeference
from crowdfence.planner.way_out import way_out
from crowdfence.zones import Zone

if TYPE_CHECKING:
    from shapely import LineString, Point

POSITION_ERROR_M = 2.0
"""A vehicle this near to a shape may be in it."""
CLEARANCE_M = 15.0
"""Of a place to go to: PX4 halts 11 m before a fence."""


def inside(
    vehicle: Vehicle,
    shapes: Sequence[FenceShape],
    zones: Sequence[Zone],
    georeference: Georeference,
    *,
    returns_round: bool = False,
) -> Iterator[FenceEvent]:
    """Alarms, for all exclusion shapes that the vehicle holds. Heights do not count: a fence has none.
    `returns_round`: its way home is not straight but round them."""
    import shapely

    closed = _closed(shapes, georeference)
    if not closed:
        return
    there = None if vehicle.position is None else _within(vehicle.position, closed, georeference)
    if vehicle.position is None:
        yield FenceEvent(
            "position_unknown",
            "the vehicle does not say where it is: if it is in the fence, "
            + ("that is a breach at once" if _keeps_it(vehicle) else "the fence is not kept"),
            alarm=True,
        )
    elif there is not None:
        yield _vehicle_inside(vehicle, there, closed, zones, georeference)
    if vehicle.home is None:
        yield FenceEvent(
            "home_unknown", "the vehicle does not say where its home is; it may lie in the fence"
        )
    elif (place := _within(vehicle.home, closed, georeference)) is not None:
        yield FenceEvent(
            "home_inside",
            f"home lies in the fence{_of_zone(shapely.Point(place), zones)}: "
            + ("" if _keeps_it(vehicle) else "PX4 drops that part of the fence, and ")
            + "a return leads into it; move home or land elsewhere",
            alarm=True,
        )
    elif vehicle.armed and not returns_round and vehicle.position is not None and there is None:
        yield from _way_home(vehicle.position, vehicle.home, closed, zones, georeference)


def _way_home(
    position: Position, home: Home, closed: Sequence[Any], zones: Sequence[Zone], georeference: Georeference
) -> Iterator[FenceEvent]:
    """From outside of it."""
    import shapely

    way = shapely.LineString([_local(position, georeference), _local(home, georeference)])
    if not _is_near(way, closed):
        return
    yield FenceEvent(
        "way_home_closed",
        f"the straight way home crosses the fence{_of_zone(way, zones)}: a return, as of an empty battery or "
        "a lost link, flies into it, and holds there or goes on through it; come back round it while you "
        "can, or set home or a rally point on this side",
        alarm=True,
    )


def is_closed(place: Position, shapes: Sequence[FenceShape], georeference: Georeference) -> bool:
    """Whether an exclusion shape holds a place, or is as near as positions are off."""
    closed = _closed(shapes, georeference)
    return bool(closed) and _within(place, closed, georeference) is not None


def _closed(shapes: Sequence[FenceShape], georeference: Georeference) -> list[Any]:
    exclusions = [one for one in shapes if one[0].command in (POLYGON_EXCLUSION, CIRCLE_EXCLUSION)]
    return [ground for one in exclusions if (ground := ground_of(one, georeference)) is not None]


def _within(
    where: Position | Home, closed: Sequence[Any], georeference: Georeference
) -> NDArray[np.float64] | None:
    """The place [2] in local metres where it is in something, else None."""
    import shapely

    place = _local(where, georeference)
    return place if _is_near(shapely.Point(place), closed) else None


def _is_near(shape: Point | LineString, closed: Sequence[Any]) -> bool:
    """As near as positions are off."""
    import shapely

    return bool(shapely.distance(np.array(closed, dtype=object), shape).min() <= POSITION_ERROR_M)


def _local(where: Position | Home, georeference: Georeference) -> NDArray[np.float64]:
    """[2], in metres."""
    local = georeference.local_from_geodetic(where.latitude_deg, where.longitude_deg, georeference.height_m)
    return local[0, :2]


def _vehicle_inside(
    vehicle: Vehicle,
    place: NDArray[np.float64],
    closed: Sequence[Any],
    zones: Sequence[Zone],
    georeference: Georeference,
) -> FenceEvent:
    import shapely

    clear = way_out(place, closed, CLEARANCE_M)
    latitude, longitude, _ = georeference.geodetic_from_local([[*clear, 0.0]])
    distance_m = float(np.hypot(*(clear - place)))
    bearing_deg = float(np.degrees(np.arctan2(*(clear - place)))) % 360.0
    advice = (
        f"fly {distance_m:.0f} m towards {bearing_deg:.0f} deg, to {latitude[0]:.7f}, {longitude[0]:.7f} "
        f"(nearest place {CLEARANCE_M:g} m clear), or hold if people are below the way"
        if vehicle.armed
        else "do not take off here"
    )
    becomes = "which is then taken and not kept"
    if _keeps_it(vehicle):
        becomes = "a breach: ArduPilot does at once what FENCE_ACTION says, which may be to land there"
    return FenceEvent(
        "vehicle_inside",
        f"the vehicle is in the fence{_of_zone(shapely.Point(place), zones)}, {becomes}; {advice}",
        alarm=True,
        details={
            "suggestion": "evacuate" if vehicle.armed else "stay_down",
            "clear_latitude": round(float(latitude[0]), 7),
            "clear_longitude": round(float(longitude[0]), 7),
            "distance_m": round(distance_m, 1),
            "bearing_deg": round(bearing_deg, 1),
        },
    )


def _keeps_it(vehicle: Vehicle) -> bool:
    """Whether a fence that it is in is one for the vehicle."""
    return vehicle.autopilot == Autopilot.ARDUPILOT


def _of_zone(place: Point | LineString, zones: Sequence[Zone]) -> str:
    """Which zone that is; a fence of few items also closes ground between zones."""
    names = [zone.id for zone in zones if zone.polygon.distance(place) <= POSITION_ERROR_M]
    return f" of zone {', '.join(names)}" if names else ", beside the zones"
