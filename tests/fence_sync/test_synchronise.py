"""A vehicle's fence made equal to zones: what stands on it afterwards, and what is said."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from crowdfence import Georeference, Zone
from crowdfence.fence_sync import (
    FenceError,
    FenceKeeper,
    FenceReport,
    ItemCapacity,
    fence_geojson,
    synchronise,
)
from crowdfence.fence_sync.placement import PlacedFence
from crowdfence.fence_sync.vehicle_memory import recall
from crowdfence.planner import ClearAir
from crowdfence.zones import ZoneSet
from support.fence_zones import HERE, box, covers, keeper, station, zone
from support.vehicle_emulator import (
    ARDUPILOT,
    CIRCLE,
    POLYGONS,
    Channel,
    EmulatedLink,
    EmulatedVehicle,
    RawItem,
    polygon,
)

FAR = [box(100.0, 100.0), box(200.0, -50.0, name="Z2")]
THEIRS = polygon((47.41, 8.55), (47.41, 8.56), (47.42, 8.56), command=POLYGONS[0])
KEPT = {"FENCE_ENABLE": 1, "FENCE_TYPE": 7, "FENCE_ACTION": 1}


def told(report: FenceReport) -> dict[str, str]:
    return {event.kind: event.text for event in report.events}


def alarms(report: FenceReport) -> list[str]:
    return [event.kind for event in report.alarms]


def test_zones_stand_on_the_vehicle(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle()
    report = keeper(vehicle, tmp_path).put(FAR, HERE)
    assert covers(vehicle, FAR) and len(vehicle.items) == 8
    assert report.written and alarms(report) == []
    assert told(report)["written"] == "2 zones in 8 items, read back and equal"
    assert "closed at every height" in told(report)["no_heights"]
    assert vehicle.kept == [0, 4]


def test_of_a_zone_set_all_that_it_closes_stands_on_the_vehicle(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle()
    zones = ZoneSet((FAR[0],), 0.5, 0.0, 0, 0.0, static=(FAR[1],))
    report = keeper(vehicle, tmp_path).put(zones, HERE)
    assert covers(vehicle, FAR) and told(report)["written"] == "2 zones in 8 items, read back and equal"


def test_what_stands_there_already_is_not_sent_again(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle()
    keep = keeper(vehicle, tmp_path)
    keep.put(FAR, HERE)
    report = keep.put(FAR, HERE)
    assert not report.written and len(vehicle.lists) == 1
    assert "unchanged" in told(report) and "changed_by_others" not in told(report)


def test_a_zone_that_opened_is_removed_and_the_last_one_clears_the_list(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle()
    keep = keeper(vehicle, tmp_path)
    keep.put(FAR, HERE)
    keep.put(FAR[:1], HERE)
    assert covers(vehicle, FAR[:1]) and not covers(vehicle, FAR[1:])
    keep.put([], HERE)
    assert vehicle.items == []


def test_shapes_of_others_stay(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle(items=list(THEIRS))
    keep = keeper(vehicle, tmp_path)
    for zones in (FAR, FAR[:1], []):
        report = keep.put(zones, HERE)
        assert vehicle.items[:3] == THEIRS and covers(vehicle, zones)
        assert told(report)["kept_others"] == "1 shapes (3 items) of others are kept"
        assert alarms(report) == [] and "changed_by_others" not in told(report)


def test_ours_are_known_again_by_another_process(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle(items=list(THEIRS))
    keeper(vehicle, tmp_path).put(FAR, HERE)
    keeper(vehicle, tmp_path).put(FAR[1:], HERE)
    assert len(vehicle.items) == 3 + 4
    # A vehicle with the same system id, but another one: nothing on it is ours.
    twin = EmulatedVehicle(items=list(vehicle.items), uid=0x9999)
    report = keeper(twin, tmp_path).put(FAR[:1], HERE)
    assert len(twin.items) == 3 + 4 + 4 and "changed_by_others" not in told(report)


def test_a_fence_that_somebody_else_changed_is_said_and_kept(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle()
    keep = keeper(vehicle, tmp_path)
    keep.put(FAR, HERE)
    vehicle.items = [*vehicle.items[:4], *THEIRS]  # our second zone is gone, a shape of theirs is new
    report = keep.put(FAR, HERE)
    assert "1 of our shapes changed or gone, 1 shapes new" in told(report)["changed_by_others"]
    assert alarms(report) == ["changed_by_others"]
    assert vehicle.items[:3] == THEIRS and covers(vehicle, FAR)
    vehicle.items = vehicle.items[3:]
    report = keep.put(FAR, HERE)
    assert "1 of theirs gone" in told(report)["changed_by_others"] and alarms(report) == []
    assert "changed_by_others" not in told(keep.put(FAR, HERE))


def test_a_shape_of_ours_that_somebody_moved_is_theirs_now(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle()
    keep = keeper(vehicle, tmp_path)
    keep.put(FAR[:1], HERE)
    moved = [(command, count, north + 9000, east) for command, count, north, east in vehicle.items]
    vehicle.items = list(moved)
    report = keep.put(FAR[:1], HERE)
    assert vehicle.items[:4] == moved and covers(vehicle, FAR[:1])
    assert "1 of our shapes changed or gone, 1 shapes new" in told(report)["changed_by_others"]


def test_somebody_who_writes_while_we_do_is_noticed(tmp_path: Path) -> None:
    """Another ground station replaces the list each time that ours was taken; we keep what it wrote."""
    vehicle = EmulatedVehicle()
    keep = keeper(vehicle, tmp_path)
    take = vehicle._take
    vehicle._take = lambda items: take(list(THEIRS))  # type: ignore[method-assign]
    with pytest.raises(FenceError, match="3 items instead of 11, 3 of them equal; did another ground"):
        keep.put(FAR, HERE)
    assert recall(keep.memory_path).is_first  # nothing of it counts as ours


NEW = polygon((47.43, 8.55), (47.43, 8.56), (47.44, 8.56), command=POLYGONS[0])


def adds_once(vehicle: EmulatedVehicle) -> None:
    """Another ground station adds a shape to the list that it reads when the next one is taken."""
    take = vehicle._take

    def take_and_add(items: list[RawItem]) -> None:
        take([*NEW, *items])
        vehicle._take = take  # type: ignore[method-assign]

    vehicle._take = take_and_add  # type: ignore[method-assign]


def test_what_another_station_adds_before_ours_is_read_back_stays(tmp_path: Path) -> None:
    """Our list was not what was read back and was sent again, over theirs; nothing was said of it."""
    vehicle = EmulatedVehicle(items=list(THEIRS))
    keep = keeper(vehicle, tmp_path)
    keep.put(FAR[:1], HERE)
    adds_once(vehicle)
    report = keep.put(FAR, HERE)
    assert covers(vehicle, FAR) and len(report.ours) == 2
    assert {*THEIRS, *NEW} <= set(vehicle.items) and len(vehicle.items) == 3 + 3 + 8
    assert "1 shapes new" in told(report)["changed_by_others"]
    assert report.written and "written" in told(report)
    adds_once(vehicle)
    vehicle.says = "Geofence invalid"
    report = keep.put(FAR[1:], HERE)
    assert report.written and alarms(report) == ["refused_by_text"], "said of the first list"
    vehicle.says = None
    keep.put(FAR, HERE)
    vehicle.items = [item for item in vehicle.items if item not in NEW]
    adds_once(vehicle)
    report = keep.clear()
    assert set(vehicle.items) == {*THEIRS, *NEW} and not report.ours and len(report.shapes) == 2
    assert report.written and told(report)["cleared"] == "2 shapes removed, 2 stay"


def test_what_another_station_adds_while_zones_are_fitted_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some thousands of corners take seconds, and the list was replaced by what had been read before."""
    vehicle = EmulatedVehicle(items=list(THEIRS))
    link = EmulatedLink(vehicle)
    keep = FenceKeeper(station(link), tmp_path)
    fit, left = synchronise.placed, [1]

    def slowly(*given: Any) -> PlacedFence:
        link.now_s += 4.0
        if left and left.pop():
            vehicle.items = [*vehicle.items, *NEW]
        return fit(*given)

    monkeypatch.setattr(synchronise, "placed", slowly)
    report = keep.put(FAR, HERE)
    assert report.written and covers(vehicle, FAR) and len(vehicle.lists) == 1
    assert {*THEIRS, *NEW} <= set(vehicle.items) and len(report.ours) == 2


def test_what_another_station_adds_between_two_refusals_stays(tmp_path: Path) -> None:
    zones = [box(100.0 + 60 * (i % 5), 60.0 * (i // 5), name=f"Z{i}") for i in range(15)]
    vehicle = EmulatedVehicle(capacity=20)
    keep = keeper(vehicle, tmp_path)
    said, vehicle._ack = vehicle._ack, lambda result: adds(result)  # type: ignore[method-assign]

    def adds(result: int) -> None:
        if result == mavlink.MAV_MISSION_NO_SPACE and not vehicle.items:
            vehicle.items = list(NEW)
        said(result)

    report = keep.put(zones, HERE)
    assert covers(vehicle, zones) and vehicle.items[:3] == NEW and "kept_others" in told(report)


OF_NO_NUMBER = [
    [(CIRCLE, math.nan, 473_000_000, 85_000_000)],
    [(CIRCLE, math.inf, 473_000_000, 85_000_000)],
    [(CIRCLE, -20.0, 473_000_000, 85_000_000)],
    [(CIRCLE, 30.0, 2**31 - 1, 2**31 - 1)],
    [(POLYGONS[1], 3.0, 473_000_000, 85_000_000)] * 3,
]


@pytest.mark.parametrize("theirs", OF_NO_NUMBER)
def test_shapes_of_others_that_are_no_shapes_stay_and_stop_nothing(
    tmp_path: Path, theirs: list[RawItem]
) -> None:
    """Of a radius that is no number the list was never equal to what was sent, and a latitude beyond the pole
    was refused after the list was replaced, as if nothing had been; `pull` showed neither."""
    vehicle = EmulatedVehicle(items=list(theirs))
    keep = keeper(vehicle, tmp_path)
    for zones in (FAR, FAR, FAR[:1]):
        report = keep.put(zones, HERE)
        assert covers(vehicle, zones) and len(report.shapes) == 1 + len(zones) == 1 + len(report.ours)
        assert "changed_by_others" not in told(report)
        shapes, ours = keep.read()
        drawn = json.loads(fence_geojson(shapes, ours, "vehicle 1"))["features"]
        assert [one["properties"]["drawn_by"] for one in drawn].count("others") == 1
    assert len(vehicle.lists) == 2
    keep.clear()
    assert list(map(repr, vehicle.items)) == list(map(repr, theirs))


@pytest.mark.parametrize("corners", [math.nan, math.inf, -3.0, 1e30])
def test_a_polygon_of_others_that_has_no_number_of_corners_can_be_removed(
    tmp_path: Path, corners: float
) -> None:
    """Neither pull nor clear --all worked: "cannot convert float NaN to integer"."""
    vehicle = EmulatedVehicle(items=[(POLYGONS[1], corners, 473_000_000, 85_000_000), *THEIRS])
    keep = keeper(vehicle, tmp_path)
    assert [len(shape) for shape in keep.read()[0]] == [1, 3]
    with pytest.raises(FenceError, match="corners of which 1 are there.*clear --all"):
        keep.put(FAR, HERE)
    keep.clear(everything=True)
    assert vehicle.items == []
    keep.put(FAR, HERE)
    assert covers(vehicle, FAR)


class LosesDigits(EmulatedVehicle):
    """Keeps degrees as float32."""

    def _take(self, items: list[RawItem]) -> None:
        def kept(degrees_e7: int) -> int:
            return round(float(np.float32(degrees_e7 / 1e7)) * 1e7)

        super()._take([(one[0], one[1], kept(one[2]), kept(one[3])) for one in items])


def test_a_vehicle_that_loses_digits_is_said_to_and_does_not_fill_up(tmp_path: Path) -> None:
    """It was asked whether another ground station wrote, and every push left one more copy for ever."""
    vehicle = LosesDigits()
    keep = keeper(vehicle, tmp_path)
    for _ in range(3):
        with pytest.raises(FenceError, match=r"keeps its corners elsewhere, up to 0\.\d+ m from where"):
            keep.put(FAR, HERE)
        assert len(vehicle.items) == 8
    keep.clear()
    assert vehicle.items == []


def test_a_list_that_was_not_kept_is_sent_again_however_little_it_differs(tmp_path: Path) -> None:
    """What stands there then is the one before, a metre beside it, and no list whose digits were lost."""
    vehicle = EmulatedVehicle()
    keep = keeper(vehicle, tmp_path)
    keep.put(FAR, HERE)
    take, vehicle._take = vehicle._take, lambda items: setattr(vehicle, "_take", take)  # type: ignore[method-assign]
    moved = [box(101.0, 100.0), box(201.0, -50.0, name="Z2")]
    assert keep.put(moved, HERE).written and covers(vehicle, moved) and len(vehicle.lists) == 2


def test_a_vehicle_with_less_room_is_learned_and_remembered(tmp_path: Path) -> None:
    zones = [box(100.0 + 60 * (i % 5), 60.0 * (i // 5), name=f"Z{i}") for i in range(15)]
    vehicle = EmulatedVehicle(capacity=15)
    keep = keeper(vehicle, tmp_path)
    report = keep.put(zones, HERE)
    assert covers(vehicle, zones) and len(vehicle.items) <= 15 and len(vehicle.lists) == 1
    assert "no space" in told(report)["capacity_learned"] and "over_coverage" in told(report)
    report = keep.put(zones[:14], HERE)
    assert "capacity_learned" not in told(report) and covers(vehicle, zones[:14])
    # A capacity that was given is not doubted: the refusal is said.
    with pytest.raises(FenceError, match="NO_SPACE; the one before stays; give a smaller --capacity"):
        keeper(vehicle, tmp_path, capacity=ItemCapacity(40)).put(zones, HERE)
    assert covers(vehicle, zones[:14])


def test_an_ardupilot_is_filled_by_bytes(tmp_path: Path) -> None:
    """560 bytes: 5 + n * (2 + 8 * 4) for n squares leaves room for 16 of them."""
    squares = [box(100.0 + 60 * (i % 5), 60.0 * (i // 5), name=f"Z{i}") for i in range(20)]
    parameters = {"FENCE_ENABLE": 1, "FENCE_TYPE": 7, "FENCE_ACTION": 1}
    vehicle = EmulatedVehicle(
        autopilot=ARDUPILOT, capacity=999, storage_bytes=560, parameters=parameters, home=(47.3, 8.5)
    )
    report = keeper(vehicle, tmp_path).put(squares[:16], HERE)
    assert len(vehicle.items) == 64 and alarms(report) == []
    report = keeper(vehicle, tmp_path).put(squares, HERE)
    assert covers(vehicle, squares) and len(vehicle.lists) == 2 and alarms(report) == []
    # A smaller board says so with a text and an error.
    small = EmulatedVehicle(
        system=2, uid=2, autopilot=ARDUPILOT, capacity=999, storage_bytes=160, parameters=parameters
    )
    report = keeper(small, tmp_path).put(squares, HERE)
    assert covers(small, squares) and "capacity_learned" in told(report)


def test_no_room_beside_others(tmp_path: Path) -> None:
    full = [(CIRCLE, 10.0, 473_000_000 + i * 9000, 85_000_000) for i in range(63)]
    vehicle = EmulatedVehicle(items=list(full))
    with pytest.raises(FenceError, match=r"of which others take 63 items: there is no room"):
        keeper(vehicle, tmp_path).put(FAR, HERE)
    assert vehicle.items == full


@pytest.mark.parametrize(
    ("vehicle", "message"),
    [
        (EmulatedVehicle(parameters={"GF_ACTION": 4}), r"GF_ACTION is 4 \(terminate\).*Set it to 2"),
        (EmulatedVehicle(parameters={}), "GF_ACTION could not be read"),
        (EmulatedVehicle(rejects=mavlink.MAV_MISSION_INVALID), "refused the fence: INVALID; the one before"),
        (EmulatedVehicle(rejects=mavlink.MAV_MISSION_DENIED), "DENIED; .*another ground station may"),
        (EmulatedVehicle(rejects=mavlink.MAV_MISSION_NO_SPACE), "refuses every fence for want of space|room"),
        (EmulatedVehicle(rejects=77), "refused the fence: result 77"),
    ],
)
def test_a_refusal_leaves_the_fence_as_it_was(tmp_path: Path, vehicle: EmulatedVehicle, message: str) -> None:
    vehicle.items = list(THEIRS)
    with pytest.raises(FenceError, match=message):
        keeper(vehicle, tmp_path).put(FAR, HERE)
    assert vehicle.items == THEIRS and vehicle.lists == []


class StartsAnew(EmulatedVehicle):
    """In the middle of a list, with an empty fence; what comes then belongs to no list that it knows of."""

    due = False

    def _on_mission_item_int(self, packet: object, now_s: float) -> None:
        if self.due and packet.seq == 3:  # type: ignore[attr-defined]
            self._expected, self.items = None, []
        if self._expected is None:
            return self._ack(mavlink.MAV_MISSION_ERROR)
        return super()._on_mission_item_int(packet, now_s)


def test_a_vehicle_that_starts_anew_meanwhile_is_not_said_to_hold_the_fence_before(tmp_path: Path) -> None:
    vehicle = StartsAnew()
    keep = keeper(vehicle, tmp_path)
    keep.put(FAR[:1], HERE)
    vehicle.due = True
    with pytest.raises(
        FenceError, match="ERROR; the one before is gone: 0 items stand there, 4 did.*Send again"
    ):
        keep.put(FAR, HERE)
    vehicle.due = False
    keep.put(FAR, HERE)
    assert covers(vehicle, FAR)


def test_a_vehicle_in_a_zone_is_an_alarm_with_a_way_out(tmp_path: Path) -> None:
    """It stands 10 m from the western edge of the zone: 10 + 15 m to the west it is clear."""
    vehicle = EmulatedVehicle()
    around = [box(-10.0, -50.0, 100.0)]
    report = keeper(vehicle, tmp_path).put(around, HERE)
    assert alarms(report) == ["vehicle_inside", "home_inside"]
    (event,) = [event for event in report.events if event.kind == "vehicle_inside"]
    assert "in the fence of zone Z1" in event.text and event.details["suggestion"] == "evacuate"
    assert event.details["distance_m"] == pytest.approx(25.0, abs=0.5)
    assert event.details["bearing_deg"] == pytest.approx(270.0, abs=1.0)
    place = (event.details["clear_latitude"], event.details["clear_longitude"])
    point = HERE.local_from_geodetic(*place, HERE.height_m)
    clearance_m = ClearAir(ZoneSet(tuple(around), 0.5, 0.0, 0, 0.0)).clearance_m(point, 0)
    assert 15.0 <= clearance_m[0] <= 15.5
    assert vehicle.kept == []  # this is why
    vehicle.armed = False
    report = keeper(vehicle, tmp_path).put([box(-11.0, -50.0, 100.0)], HERE)
    assert "do not take off here" in told(report)["vehicle_inside"]


def test_an_ardupilot_in_a_zone_is_said_to_have_breached_it(tmp_path: Path) -> None:
    """It was said of PX4's fence, which is not kept then: who heard it expected a vehicle that stays."""
    keeps = {"FENCE_ENABLE": 1, "FENCE_TYPE": 7, "FENCE_ACTION": 2}
    vehicle = EmulatedVehicle(autopilot=ARDUPILOT, parameters=keeps)
    report = keeper(vehicle, tmp_path).put([box(-10.0, -10.0)], HERE)
    assert "a breach: ArduPilot does at once what FENCE_ACTION says" in told(report)["vehicle_inside"]
    assert "PX4" not in told(report)["home_inside"] and "a return leads" in told(report)["home_inside"]
    vehicle.position = None
    report = keeper(vehicle, tmp_path).put([box(-10.0, -10.0)], HERE)
    assert "if it is in the fence, that is a breach" in told(report)["position_unknown"]


def test_a_vehicle_on_ground_that_is_closed_for_nothing_is_told_so(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle(home=(47.3, 8.5))
    beside = [box(-60.0, -10.0), box(40.0, -10.0, name="Z2")]
    report = keeper(vehicle, tmp_path, capacity=ItemCapacity(1)).put(beside, HERE)
    assert "in the fence, beside the zones" in told(report)["vehicle_inside"]


def behind(**more: Any) -> EmulatedVehicle:
    """One that flies 200 m north of its home."""
    return EmulatedVehicle(position=(47.3977 + 200.0 / 111_190, 8.5456), home=(47.3977, 8.5456), **more)


def test_a_vehicle_whose_way_home_crosses_a_zone_is_told(tmp_path: Path) -> None:
    """A return with an empty battery held above the crowd, in simulation."""
    between = [box(-10.0, 80.0, name="Z7")]
    report = keeper(behind(), tmp_path).put(between, HERE)
    assert alarms(report) == ["way_home_closed"]
    assert "crosses the fence of zone Z7" in told(report)["way_home_closed"]
    # As near as positions are off, and 3 m beside the way.
    assert alarms(keeper(behind(), tmp_path / "near").put([box(1.5, 80.0)], HERE)) == ["way_home_closed"]
    assert alarms(keeper(behind(), tmp_path / "beside").put([box(3.0, 80.0)], HERE)) == []
    # It stands, and home is set where it takes off; or it has no way home but out of the zone.
    assert alarms(keeper(behind(armed=False), tmp_path / "down").put(between, HERE)) == []
    assert alarms(keeper(behind(), tmp_path / "in").put([box(-10.0, 195.0)], HERE)) == ["vehicle_inside"]


@pytest.mark.parametrize(("oa_type", "crosses"), [(0, True), (2, False)])
def test_an_arducopter_that_flies_round_its_fence_has_a_way_home(
    tmp_path: Path, oa_type: int, crosses: bool
) -> None:
    parameters = {**KEPT, "OA_TYPE": oa_type, "GUID_OPTIONS": 64}
    vehicle = behind(autopilot=ARDUPILOT, parameters=parameters)
    report = keeper(vehicle, tmp_path).put([box(-10.0, 80.0)], HERE)
    assert ("way_home_closed" in alarms(report)) is crosses


def test_a_vehicle_that_does_not_know_where_it_is(tmp_path: Path) -> None:
    report = keeper(EmulatedVehicle(position=None, home=None), tmp_path).put(FAR, HERE)
    assert alarms(report) == ["position_unknown"] and "home_unknown" in told(report)


@pytest.mark.parametrize(
    ("parameters", "autopilot", "words"),
    [
        ({"GF_ACTION": 0}, mavlink.MAV_AUTOPILOT_PX4, "GF_ACTION is 0 (none)"),
        ({"GF_ACTION": 1}, mavlink.MAV_AUTOPILOT_PX4, "GF_ACTION is 1 (warn)"),
        ({"FENCE_ENABLE": 0, "FENCE_TYPE": 7, "FENCE_ACTION": 1}, ARDUPILOT, "FENCE_ENABLE is 0"),
        ({"FENCE_ENABLE": 1, "FENCE_TYPE": 3, "FENCE_ACTION": 1}, ARDUPILOT, "FENCE_TYPE is 3"),
        ({"FENCE_ENABLE": 1, "FENCE_TYPE": 4, "FENCE_ACTION": 0}, ARDUPILOT, "FENCE_ACTION is 0"),
        ({"FENCE_TYPE": 4, "FENCE_ACTION": 1}, ARDUPILOT, "FENCE_ENABLE could not be read"),
    ],
)
def test_a_fence_that_will_not_be_kept_is_an_alarm(
    tmp_path: Path, parameters: dict[str, int], autopilot: int, words: str
) -> None:
    vehicle = EmulatedVehicle(parameters=parameters, autopilot=autopilot)
    report = keeper(vehicle, tmp_path).put(FAR, HERE)
    assert words in told(report)["not_enforced"] and alarms(report) == ["not_enforced"]
    assert covers(vehicle, FAR)


@pytest.mark.parametrize(
    ("parameters", "autopilot", "words", "is_alarm"),
    [
        ({"GF_ACTION": 2, "GF_PREDICT": 0}, mavlink.MAV_AUTOPILOT_PX4, "GF_PREDICT is 0", True),
        ({**KEPT, "OA_TYPE": 0}, ARDUPILOT, "OA_TYPE is 0; set 2", True),
        ({**KEPT, "OA_TYPE": 2, "GUID_OPTIONS": 3}, ARDUPILOT, "GUID_OPTIONS is 3", True),
        ({**KEPT, "OA_TYPE": 2, "GUID_OPTIONS": 3}, ARDUPILOT, "set 67,", True),
        (KEPT, ARDUPILOT, "close so much more (--buffer)", False),  # an aeroplane has no way round
    ],
)
def test_a_vehicle_that_halts_only_behind_the_edge_of_the_fence_is_told(
    tmp_path: Path, parameters: dict[str, int], autopilot: int, words: str, is_alarm: bool
) -> None:
    report = keeper(EmulatedVehicle(parameters=parameters, autopilot=autopilot), tmp_path).put(FAR, HERE)
    assert words in told(report)["acts_inside"] and alarms(report) == ["acts_inside"] * is_alarm


@pytest.mark.parametrize(
    ("parameters", "autopilot"),
    [
        ({"GF_ACTION": 2, "GF_PREDICT": 1}, mavlink.MAV_AUTOPILOT_PX4),
        ({"GF_ACTION": 2}, mavlink.MAV_AUTOPILOT_PX4),  # v1.12 predicts, and has no parameter for it
        ({**KEPT, "OA_TYPE": 2, "GUID_OPTIONS": 65}, ARDUPILOT),
        ({**KEPT, "OA_TYPE": 2}, ARDUPILOT),  # not known: what could be said is in the documentation
    ],
)
def test_a_vehicle_that_keeps_away_from_the_fence(
    tmp_path: Path, parameters: dict[str, int], autopilot: int
) -> None:
    report = keeper(EmulatedVehicle(parameters=parameters, autopilot=autopilot), tmp_path).put(FAR, HERE)
    assert "acts_inside" not in told(report)


def test_an_answer_that_is_lost_ends_no_alarm(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle(parameters={"GF_ACTION": 2, "GF_PREDICT": 0})
    keep = keeper(vehicle, tmp_path)
    assert [event.kind for event in keep.enforcement()] == ["acts_inside"]
    del vehicle.parameters["GF_PREDICT"]
    assert [event.kind for event in keep.enforcement()] == ["acts_inside"]
    vehicle.parameters["GF_PREDICT"] = 1
    assert keep.enforcement() == []


def test_what_a_vehicle_does_not_know_it_is_not_asked_again(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle(parameters={"GF_ACTION": 2})
    keep = keeper(vehicle, tmp_path)
    for _ in range(3):
        assert keep.enforcement() == []
    vehicle.parameters["GF_PREDICT"] = 0  # as if it knew it: nobody asks
    assert keep.enforcement() == []


def test_a_vehicle_whose_first_answers_are_lost_is_asked_again(tmp_path: Path) -> None:
    """It was taken for one that does not know the parameter, and the alarm never came."""
    vehicle = EmulatedVehicle(parameters={"GF_ACTION": 2})
    keep = keeper(vehicle, tmp_path)
    assert keep.enforcement() == keep.enforcement() == []
    vehicle.parameters["GF_PREDICT"] = 0
    assert [event.kind for event in keep.enforcement()] == ["acts_inside"]


@pytest.mark.parametrize(
    ("geofence", "armed", "told_of_it"),
    [
        ((True, False), True, True),
        ((True, False), False, False),  # FENCE_AUTOENABLE switches it on at the take-off
        ((True, True), True, False),
        ((False, False), True, False),
        (None, True, False),
    ],
)
def test_a_fence_that_is_switched_off_in_flight_is_an_alarm(
    tmp_path: Path, geofence: tuple[bool, bool] | None, armed: bool, told_of_it: bool
) -> None:
    """FENCE_ENABLE stays 1 then, and nothing keeps the vehicle out."""
    parameters = {**KEPT, "OA_TYPE": 2}
    vehicle = EmulatedVehicle(autopilot=ARDUPILOT, parameters=parameters, geofence=geofence, armed=armed)
    keep = keeper(vehicle, tmp_path)
    keep.station.listen(2.5)
    report = keep.put(FAR, HERE)
    assert alarms(report) == ["not_enforced"] * told_of_it
    assert not told_of_it or "says that its fence is off" in told(report)["not_enforced"]


def test_an_autopilot_that_nobody_knows(tmp_path: Path) -> None:
    report = keeper(EmulatedVehicle(autopilot=0), tmp_path).put(FAR, HERE)
    assert alarms(report) == ["autopilot_unknown"]


def test_a_text_that_refuses_what_the_answer_accepted(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle(
        says="Geofence invalid, doesn't contain Home position\t"
    )  # as newer PX4 ends it
    report = keeper(vehicle, tmp_path).put(FAR, HERE)
    assert alarms(report) == ["refused_by_text"]
    assert told(report)["refused_by_text"].endswith("says: Geofence invalid, doesn't contain Home position")
    vehicle.says = "Battery is hot"
    assert alarms(keeper(vehicle, tmp_path).put(FAR[:1], HERE)) == []


def test_a_zone_without_ground_is_said(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle()
    report = keeper(vehicle, tmp_path).put([*FAR, zone(shapely.Polygon(), "Z3")], HERE)
    assert alarms(report) == ["zone_without_ground"] and covers(vehicle, FAR)


def test_clear_removes_ours_and_all_removes_everything(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle(items=list(THEIRS))
    keep = keeper(vehicle, tmp_path)
    keep.put(FAR, HERE)
    assert "2 shapes removed, 1 stay" in told(keep.clear())["cleared"] and vehicle.items == THEIRS
    assert "0 shapes removed, 1 stay" in told(keep.clear())["cleared"]
    assert "1 shapes removed, 0 stay" in told(keep.clear(everything=True))["cleared"]
    assert vehicle.items == []


def put_and_lost(vehicle: EmulatedVehicle, folder: Path, zones: list[Zone] | None) -> str:
    """The link is lost when the vehicle has taken the list (None: it is cleared), before it is read back."""
    keep = keeper(vehicle, folder)
    take = vehicle._take

    def take_and_fall_silent(items: list[RawItem]) -> None:
        take(items)
        vehicle.mute = True

    vehicle._take = take_and_fall_silent  # type: ignore[method-assign]
    with pytest.raises(FenceError) as raised:
        keep.clear() if zones is None else keep.put(zones, HERE)
    vehicle.mute, vehicle._take = False, take  # type: ignore[method-assign]
    vehicle._beat_s = float("-inf")  # the next link has a clock of its own
    return str(raised.value)


def test_what_was_taken_when_the_link_was_lost_is_ours(tmp_path: Path) -> None:
    """It counted as that of others and stayed for ever: a few lost links, and no crowd had room."""
    vehicle = EmulatedVehicle(items=list(THEIRS))
    for north_m in (100.0, 130.0, 160.0):
        text = put_and_lost(vehicle, tmp_path, [box(100.0, north_m), box(300.0, north_m, name="Z2")])
        assert "it holds the one before or that one (an older PX4," in text
        assert len(vehicle.items) == 3 + 8 and vehicle.items[:3] == THEIRS
    shapes, ours = keeper(vehicle, tmp_path).read()
    assert (len(shapes), len(ours)) == (3, 2)
    report = keeper(vehicle, tmp_path).put(FAR, HERE)
    assert len(vehicle.items) == 3 + 8 and covers(vehicle, FAR)
    assert "kept_others" in told(report) and "changed_by_others" not in told(report)
    put_and_lost(vehicle, tmp_path, None)
    report = keeper(vehicle, tmp_path).put(FAR[:1], HERE)
    assert "changed_by_others" not in told(report) and len(vehicle.items) == 3 + 4


def put_and_broken_off(vehicle: EmulatedVehicle, folder: Path, zones: list[Zone], taken: int) -> str:
    """The link is lost when the vehicle has got so many items of the list, and comes back later."""
    keep = keeper(vehicle, folder)
    hear = vehicle._on_mission_item_int

    def hear_the_last(packet: mavlink.MAVLink_mission_item_int_message, now_s: float) -> None:
        hear(packet, now_s)
        vehicle.mute = packet.seq + 1 == taken

    vehicle._on_mission_item_int = hear_the_last  # type: ignore[method-assign, assignment]
    with pytest.raises(FenceError) as raised:
        keep.put(zones, HERE)
    vehicle.mute, vehicle._on_mission_item_int = False, hear  # type: ignore[method-assign]
    vehicle._beat_s, vehicle._expected = float("-inf"), None
    return str(raised.value)


@pytest.mark.parametrize("taken", [1, 2, 4, 5, 7, 8, 9])
def test_what_was_half_sent_to_an_older_px4_is_ours(tmp_path: Path, taken: int) -> None:
    """It holds the first items of the new list and the others of the old one. These counted as somebody
    else's and were kept for ever: behind a polygon of which some corners are missing it reads all others
    wrong, so that crowds lay in no fence, and what was read back was equal to what was sent."""
    vehicle = EmulatedVehicle(items=list(THEIRS), in_place=True)
    keeper(vehicle, tmp_path).put([box(100.0, 100.0), box(200.0, -50.0, name="Z2")], HERE)
    octagon = zone(shapely.Point(-150.0, -150.0).buffer(20.0, quad_segs=2), "Z3")
    text = put_and_broken_off(vehicle, tmp_path, [octagon, *FAR], taken)
    assert "an older PX4, such as v1.12, some corners of each" in text
    assert len(vehicle.items) == 3 + 8
    shapes, ours = keeper(vehicle, tmp_path).read()
    if taken > 3:  # those before are the same in both
        assert tuple(THEIRS) not in ours and len(ours) == len(shapes) - 1
    report = keeper(vehicle, tmp_path).put(FAR, HERE)
    assert covers(vehicle, FAR) and vehicle.items[:3] == THEIRS and len(vehicle.items) == 3 + 8
    assert report.written or taken <= 3
    keeper(vehicle, tmp_path).clear()
    assert vehicle.items == THEIRS


def test_what_was_half_sent_twice_is_ours_too(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle(items=list(THEIRS), in_place=True)
    keeper(vehicle, tmp_path).put(FAR, HERE)
    for taken, side_m in ((5, 10.0), (9, 15.0), (4, 12.0)):
        put_and_broken_off(vehicle, tmp_path, [box(0.0, 100.0, side_m), box(50.0, 100.0, side_m)], taken)
    keeper(vehicle, tmp_path).put([], HERE)
    assert vehicle.items == THEIRS


def test_a_polygon_of_others_without_some_corners_is_not_sent_again(tmp_path: Path) -> None:
    """Another ground station was broken off: an autopilot reads everything behind it wrong."""
    vehicle = EmulatedVehicle(items=[*THEIRS[:2], *polygon((47.41, 8.5), (47.41, 8.6), (47.42, 8.6))])
    before = list(vehicle.items)
    for act in (lambda keep: keep.put(FAR, HERE), lambda keep: keep.clear()):
        with pytest.raises(FenceError, match="a polygon of 3 corners of which 2 are there.*clear --all"):
            act(keeper(vehicle, tmp_path))
        assert vehicle.items == before
    keeper(vehicle, tmp_path).clear(everything=True)
    keeper(vehicle, tmp_path).put(FAR, HERE)
    assert covers(vehicle, FAR)


def px4_reads(items: list[RawItem]) -> list[list[RawItem]]:
    """Shapes as newer PX4 takes them out of a list (geofence.cpp): behind a circle it goes on by one item a
    polygon, too."""
    shapes, at, was_circle = [], 0, False
    while at < len(items):
        command, param1, _, _ = items[at]
        was_circle |= command not in POLYGONS
        shapes.append(items[at : at + (int(param1) if command in POLYGONS else 1)])
        at += 1 if was_circle else int(param1)
    return shapes


def test_polygons_stand_before_circles(tmp_path: Path) -> None:
    """PX4 reads a polygon behind a circle of somebody else as several, which reach to the next shape: it
    halted where no zone was."""
    theirs = [(CIRCLE, 30.0, 474_100_000, 85_500_000)]
    vehicle = EmulatedVehicle(items=list(theirs))
    keep = keeper(vehicle, tmp_path, capacity=ItemCapacity(10))
    small = box(500.0, 500.0, 2.0, "Z3")  # there is no room for its corners
    report = keep.put([*FAR, small], HERE)
    assert [len(shape) for shape in px4_reads(vehicle.items)] == [4, 4, 1, 1]
    assert {len(shape) for shape in report.ours} == {4, 1} and len(report.ours) == 3
    assert theirs[0] in vehicle.items and covers(vehicle, [*FAR, small])
    assert not keep.put([*FAR, small], HERE).written
    # Somebody puts a circle before ours.
    vehicle.items = [(CIRCLE, 20.0, 474_200_000, 85_500_000), *vehicle.items]
    keep = keeper(vehicle, tmp_path, capacity=ItemCapacity(11))
    report = keep.put([*FAR, small], HERE)
    assert [len(shape) for shape in px4_reads(vehicle.items)] == [4, 4, 1, 1, 1]
    assert report.written and len(report.ours) == 3
    assert not keep.put([*FAR, small], HERE).written
    keep.clear()
    assert len(vehicle.items) == 2 and theirs[0] in vehicle.items


def test_what_somebody_else_changed_while_the_link_was_lost_is_said(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle()
    keeper(vehicle, tmp_path).put(FAR[:1], HERE)
    put_and_lost(vehicle, tmp_path, FAR)
    vehicle.items = []
    report = keeper(vehicle, tmp_path).put(FAR, HERE)
    assert "1 of our shapes changed or gone" in told(report)["changed_by_others"] and covers(vehicle, FAR)


def test_an_accepted_that_is_lost_is_no_refusal(tmp_path: Path) -> None:
    """ArduPilot says "error" to its last item where that comes again: the fence stood there, and push said
    that it was refused, that the one before was gone, and whether the vehicle started anew."""
    keeps = {"FENCE_ENABLE": 1, "FENCE_TYPE": 7, "FENCE_ACTION": 1}
    vehicle = EmulatedVehicle(autopilot=ARDUPILOT, parameters=keeps)
    keep = keeper(vehicle, tmp_path)
    answer = vehicle._ack

    def lost(result: int) -> None:
        vehicle._ack = answer  # type: ignore[method-assign]

    vehicle._ack = lost  # type: ignore[method-assign]
    report = keep.put(FAR, HERE)
    assert report.written and alarms(report) == [] and covers(vehicle, FAR) and len(vehicle.lists) == 1


def test_two_vehicles_of_one_system_id_are_refused(tmp_path: Path) -> None:
    """Both took the list, and whichever answered first was said to hold it."""
    first, second = EmulatedVehicle(), EmulatedVehicle(uid=0x9999)
    with pytest.raises(FenceError, match=r"system id 1 \(their own numbers: 1234, 9999\).*MAV_SYS_ID"):
        FenceKeeper(station(EmulatedLink(first, second)), tmp_path)
    assert not first.lists and not second.lists


def test_a_memory_that_is_damaged_or_cannot_be_written(tmp_path: Path) -> None:
    vehicle = EmulatedVehicle()
    keep = keeper(vehicle, tmp_path)
    keep.memory_path.write_text(json.dumps({"format": "crowdfence fence memory", "version": 9}))
    with pytest.raises(FenceError, match="does not say what was written last.*remove it"):
        keep.put(FAR, HERE)
    whole = {"format": "crowdfence fence memory", "version": 1, "ours": [], "others": [], "most": None}
    item = [5004, 20.0, float("inf"), 1, 0, 0, 0, 0, 0]
    for wrong in ({"most": []}, {"most": -3}, {"ours": [[item]]}, {"ours": [[]]}, {"sent": "text"}):
        keep.memory_path.write_text(json.dumps({**whole, **wrong}))
        with pytest.raises(FenceError, match="does not say what was written last.*remove it"):
            keep.put(FAR, HERE)
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        keeper(vehicle, tmp_path / "file").put(FAR, HERE)
    assert vehicle.lists == []


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    lose=st.sampled_from([0.0, 0.15, 0.3]),
    twice=st.sampled_from([0.0, 0.2]),
    late=st.sampled_from([0.0, 0.2]),
)
def test_a_bad_link_never_covers_less(
    tmp_path_factory: pytest.TempPathFactory, seed: int, lose: float, twice: float, late: float
) -> None:
    """Every list that the vehicle ever takes covers the zones that stay, and those of others stay in it."""
    tmp_path = tmp_path_factory.mktemp("state")
    vehicle = EmulatedVehicle(items=list(THEIRS))
    keeper(vehicle, tmp_path).put(FAR[:1], HERE)
    channel = Channel(seed, lose, twice, late)
    try:
        report = keeper(vehicle, tmp_path, channel).put(FAR, HERE)
    except FenceError:
        assert covers(vehicle, FAR[:1])
    else:
        assert report.written and covers(vehicle, FAR)
    for items in vehicle.lists:
        assert covers(EmulatedVehicle(items=items), FAR[:1]) and items[:3] == THEIRS


def test_a_link_that_loses_a_third_gets_there(tmp_path: Path) -> None:
    for seed in range(6):
        vehicle = EmulatedVehicle()
        channel = Channel(seed, lose=0.3, twice=0.02, late=0.02)
        report = keeper(vehicle, tmp_path / str(seed), channel).put(FAR, HERE)
        assert report.written and covers(vehicle, FAR)


def test_a_link_that_loses_a_third_hides_no_vehicle_from_its_memory(tmp_path: Path) -> None:
    """In one of 15 its number was not heard: what was written then stayed for ever, as that of others."""
    for seed in range(60):
        keep = keeper(EmulatedVehicle(), tmp_path, Channel(seed, lose=0.3))
        assert keep.memory_path.name == "vehicle-1-1234.json", seed


@pytest.mark.parametrize("anchor", [Georeference(89.99, 0.0, 0.0), Georeference(-89.5, 10.0, 0.0)])
def test_zones_at_a_pole_are_refused(tmp_path: Path, anchor: Georeference) -> None:
    vehicle = EmulatedVehicle(items=list(THEIRS))
    with pytest.raises(ValueError, match=r"up to 89.0 degrees"):
        keeper(vehicle, tmp_path).put(FAR, anchor)
    assert vehicle.items == THEIRS
