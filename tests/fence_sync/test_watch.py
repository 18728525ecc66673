"""A fence that follows zones: when it is sent, when ground opens, what is said when something goes wrong."""

import json
import math
import socket
from pathlib import Path

import pytest
import shapely

from crowdfence.fence_sync import FenceEvent, FenceKeeper, FenceWatch, WatchPlan, ZoneFile
from crowdfence.fence_sync.debounce import Debounce
from crowdfence.fence_sync.transport import open_transport
from support.fence_zones import box, station
from support.vehicle_emulator import (
    ARDUPILOT,
    CIRCLE,
    POLYGONS,
    EmulatedLink,
    EmulatedVehicle,
    closes,
    polygon,
)

A, B = box(100.0, 100.0, name="A"), box(200.0, 100.0, name="B")
THEIRS = polygon((47.41, 8.55), (47.41, 8.56), (47.42, 8.56))


def names(zones: object) -> list[str] | None:
    return None if zones is None else sorted(zone.id for zone in zones)  # type: ignore[attr-defined]


def test_new_ground_is_closed_at_once_and_opens_after_a_while() -> None:
    debounce = Debounce(opening_s=5.0, interval_s=0.0)
    assert debounce.due(0.0) is None
    debounce.offer([A], 0.0)
    assert names(debounce.due(0.0)) == ["A"]
    debounce.sent([A], 0.0)
    assert debounce.due(0.1) is None
    debounce.offer([A, B], 1.0)
    wanted = debounce.due(1.0)
    assert wanted is not None and names(wanted) == ["A", "B"]
    debounce.sent(wanted, 1.0)
    debounce.offer([B], 2.0)
    assert debounce.due(2.0) is None and debounce.due(6.9) is None  # A has been open for less than 5 s
    assert names(debounce.due(7.0)) == ["B"]


def test_a_zone_that_comes_and_goes_stays() -> None:
    debounce = Debounce(opening_s=5.0, interval_s=0.0)
    debounce.offer([A], 0.0)
    debounce.sent([A], 0.0)
    for second in range(1, 30):
        debounce.offer([A] if second % 3 else [], float(second))
        assert debounce.due(float(second)) is None


def test_a_zone_that_moves_is_closed_where_it_was_too() -> None:
    debounce = Debounce(opening_s=5.0, interval_s=0.0)
    for second in range(10):
        debounce.offer([box(10.0 * second, 0.0, name="A")], float(second))
    wanted = debounce.due(9.0)
    assert wanted is not None
    closed = shapely.union_all([zone.polygon for zone in wanted])
    assert closed.bounds == (40.0, 0.0, 110.0, 20.0)  # that of 3 ended at 4, 5 s ago


def test_zones_that_change_while_nobody_can_send_are_not_kept_for_ever() -> None:
    """A vehicle that is out of reach for hours: only what ended in the last seconds is still wanted."""
    debounce = Debounce(opening_s=5.0, interval_s=0.0)
    for half_second in range(1000):
        debounce.offer([box(0.01 * half_second, 0.0, name="A")], half_second / 2)
    assert len(debounce._versions) == 11  # the newest of 499.5 s, and those that ended from 495 s on
    wanted = debounce.due(499.5)
    assert wanted is not None and len(wanted) == 11
    assert min(zone.polygon.bounds[0] for zone in wanted) == pytest.approx(9.89)  # began at 494.5 s


def test_fences_are_not_sent_too_often() -> None:
    debounce = Debounce(opening_s=0.0, interval_s=2.0)
    debounce.offer([A], 0.0)
    debounce.sent([A], 0.0)
    debounce.offer([B], 1.0)
    assert debounce.due(1.9) is None and names(debounce.due(2.0)) == ["B"]
    debounce.failed(2.0)
    assert debounce.due(3.9) is None and names(debounce.due(4.0)) == ["B"]


class Watched:
    """A vehicle on a clock of its own, a file of zones, and what is said."""

    def __init__(self, folder: Path, **plan: object) -> None:
        self.vehicle = EmulatedVehicle()
        self.link = EmulatedLink(self.vehicle)
        self.path = folder / "zones.geojson"
        self.wall_s = 1_000.0
        self.said: list[FenceEvent] = []
        self.write(north_m=100.0)
        keeper = FenceKeeper(station(self.link), folder / "state")
        self.watch = FenceWatch(
            keeper,
            ZoneFile(self.path),
            WatchPlan(**plan),  # type: ignore[arg-type]
            self.said.append,
            wall_ns=lambda: round((self.wall_s + self.link.now_s) * 1e9),
            sleep=self.sleep,
        )

    def sleep(self, duration_s: float) -> None:
        self.link.now_s += duration_s

    def write(
        self,
        *,
        north_m: float,
        count: int = 1,
        west_deg: float = 8.5456,
        step_deg: float = 5e-4,
        side_deg: tuple[float, float] = (2.7e-4, 1.8e-4),
        begun_ns: int | None = None,
        **properties: object,
    ) -> None:
        features = []
        wide, high = side_deg
        for i in range(count):
            south, west = 47.3977 + north_m / 111_190, west_deg + step_deg * i
            ring = [(0, 0), (wide, 0), (wide, high), (0, high), (0, 0)]
            corners = [[west + east, south + north] for east, north in ring]
            geometry = {"type": "Polygon", "coordinates": [corners]}
            features.append(
                {"type": "Feature", "id": f"Z{i}", "geometry": geometry, "properties": properties}
            )
        new = self.path.with_suffix(".new")
        head = {} if begun_ns is None else {"crowdfence": {"first_instant_ns": begun_ns}}
        new.write_text(json.dumps({"type": "FeatureCollection", **head, "features": features}))
        new.replace(self.path)

    def run(self, duration_s: float) -> list[str]:
        """What is said meanwhile."""
        self.said.clear()
        self.watch.run(self.link.now_s + duration_s)
        return [event.kind for event in self.said]


def test_the_fence_follows_the_file(tmp_path: Path) -> None:
    watched = Watched(tmp_path, opening_s=4.0)
    assert "written" in watched.run(1.0) and len(watched.vehicle.items) == 4
    watched.write(north_m=100.0, count=3)
    assert "written" in watched.run(5.0) and len(watched.vehicle.items) == 12
    watched.write(north_m=100.0, count=0)
    assert watched.run(3.0) == [] and len(watched.vehicle.items) == 12
    assert watched.run(3.0) == ["written"] and watched.vehicle.items == []
    assert watched.watch.alarms == ()


def test_another_vehicle_of_the_same_system_id_is_an_alarm(tmp_path: Path) -> None:
    """The first fell silent and nobody heard of it, because the second answered for it."""
    watched = Watched(tmp_path)
    watched.run(3.0)
    watched.link.vehicles = (watched.vehicle, EmulatedVehicle(uid=0x9999))
    assert "several_vehicles" in watched.run(25.0)
    (alarm,) = [one for one in watched.watch.alarms if one.kind == "several_vehicles"]
    assert "system id 1 (their own numbers: 1234, 9999)" in alarm.text and "MAV_SYS_ID" in alarm.text
    watched.vehicle.mute = True
    assert "several_vehicles" not in watched.run(25.0), "said once"
    assert "several_vehicles" in [one.kind for one in watched.watch.alarms]
    watched.vehicle.mute, watched.link.vehicles[1].mute = False, True
    watched.run(25.0)
    assert watched.watch.alarms == ()


def test_zones_that_expire_are_removed_if_asked(tmp_path: Path) -> None:
    for expires, left in ((False, 4), (True, 0)):
        folder = tmp_path / str(expires)
        folder.mkdir()
        watched = Watched(folder, expires=expires, opening_s=1.0)
        watched.write(north_m=100.0, valid_until_ns=round((watched.wall_s + 10.0) * 1e9))
        watched.run(6.0)
        assert len(watched.vehicle.items) == 4
        watched.run(10.0)
        assert len(watched.vehicle.items) == left


def test_zones_that_had_ended_before_they_were_read_are_an_alarm(tmp_path: Path) -> None:
    """On a computer whose clock is an hour ahead every zone had ended: none was closed, without a word."""
    watched = Watched(tmp_path, expires=True)
    ends_ns = round((watched.wall_s + 60.0) * 1e9)
    watched.write(north_m=100.0, valid_until_ns=ends_ns)
    watched.wall_s += 3600.0
    assert "zones_ended" in watched.run(3.0) and watched.vehicle.items == []
    (alarm,) = watched.watch.alarms
    assert alarm.text.startswith("1 of 1 zones had ended when they were read, by the clock")
    assert "(1970-01-01T01:16:4" in alarm.text
    watched.wall_s -= 3600.0
    watched.write(north_m=100.0, valid_until_ns=ends_ns)
    watched.run(3.0)
    assert watched.watch.alarms == () and len(watched.vehicle.items) == 4
    watched.run(80.0)  # it ends while it is watched
    assert watched.watch.alarms == () and watched.vehicle.items == []


def test_zones_that_are_not_there_yet_are_named(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    watched.path.unlink()
    assert watched.run(3.0) == ["zones_unreadable"]
    (missing,) = watched.watch.alarms
    assert missing.text == f"{watched.path}: No such file or directory; the last fence stays"


def test_a_file_that_cannot_be_read_is_said_once_and_the_fence_stays(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    watched.run(3.0)
    watched.path.write_text("{")
    assert watched.run(5.0) == ["zones_unreadable"]
    assert len(watched.vehicle.items) == 4 and [one.kind for one in watched.watch.alarms] == [
        "zones_unreadable"
    ]
    watched.path.unlink()
    assert watched.run(5.0) == []
    watched.write(north_m=100.0, count=2)
    assert watched.run(5.0) == ["written"] and watched.watch.alarms == ()


def test_zones_that_nobody_writes_any_more_are_an_alarm(tmp_path: Path) -> None:
    watched = Watched(tmp_path, stale_s=10.0)
    assert "zones_stale" not in watched.run(9.0)
    assert watched.run(5.0) == ["zones_stale"] and len(watched.vehicle.items) == 4
    watched.write(north_m=100.0)
    watched.run(1.0)
    assert watched.watch.alarms == ()


def test_a_vehicle_that_flies_into_the_fence_is_an_alarm_at_once(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    watched.run(3.0)
    watched.vehicle.position = (47.3977 + 110.0 / 111_190, 8.5457)
    assert watched.run(4.0) == ["vehicle_inside"]
    watched.vehicle.position = (47.3977, 8.5456)
    assert watched.run(4.0) == [] and watched.watch.alarms == ()


def test_a_vehicle_that_takes_off_in_the_fence_is_told_to_leave(tmp_path: Path) -> None:
    """It had been told not to take off, and nothing was said when it did."""
    watched = Watched(tmp_path)
    watched.vehicle.armed, watched.vehicle.position = False, (47.3977 + 110.0 / 111_190, 8.5457)
    watched.run(5.0)
    assert [event.details["suggestion"] for event in watched.said if event.alarm] == ["stay_down"]
    watched.vehicle.armed = True
    assert watched.run(5.0) == ["vehicle_inside"]
    assert watched.said[0].details["suggestion"] == "evacuate" and watched.run(20.0) == []


def test_a_place_to_go_to_that_is_closed_since_is_taken_back(tmp_path: Path) -> None:
    """The vehicle was sent into the crowd that had gathered there, and no other place was named."""
    watched = Watched(tmp_path)
    watched.vehicle.position = (47.3977 + 115.0 / 111_190, 8.5456 + 0.3e-4)
    watched.run(5.0)
    (sent,) = [event for event in watched.said if event.kind == "vehicle_inside"]
    assert sent.details["bearing_deg"] == 270.0
    watched.write(north_m=60.0, count=2, west_deg=8.5449, step_deg=7e-4, side_deg=(6e-4, 1e-3))
    assert "vehicle_inside" in watched.run(5.0)
    (sent,) = [event for event in watched.said if event.kind == "vehicle_inside"]
    place = sent.details["clear_latitude"], sent.details["clear_longitude"]
    assert closes(watched.vehicle.items, *place) == []
    assert "vehicle_inside" not in watched.run(20.0)


def test_a_link_that_is_lost_and_comes_back(tmp_path: Path) -> None:
    """Meanwhile the vehicle was given another fence."""
    watched = Watched(tmp_path)
    watched.run(3.0)
    watched.vehicle.mute = True
    assert watched.run(6.0) == ["link_lost"]
    watched.vehicle.items, watched.vehicle.mute = list(THEIRS), False
    said = watched.run(6.0)
    assert said[0] == "link_back" and "changed_by_others" in said and "written" in said
    assert watched.vehicle.items[:3] == THEIRS and len(watched.vehicle.items) == 3 + 4


def test_what_others_do_to_the_fence_is_found_by_reading_it(tmp_path: Path) -> None:
    watched = Watched(tmp_path, check_s=5.0)
    watched.run(3.0)
    watched.vehicle.items = []
    assert "changed_by_others" in watched.run(8.0) and len(watched.vehicle.items) == 4


def test_a_fence_that_somebody_switches_off_is_an_alarm(tmp_path: Path) -> None:
    """The zones stay the same, and nothing is sent that would ask for the parameters."""
    watched = Watched(tmp_path, check_s=5.0)
    assert "written" in watched.run(3.0) and watched.watch.alarms == ()
    watched.vehicle.parameters["GF_ACTION"] = 1
    assert watched.run(8.0) == ["not_enforced"]
    watched.vehicle.parameters["GF_ACTION"] = 4
    assert watched.run(8.0) == ["failed"], "the motors would stop at the fence that stands there"
    assert any("terminate" in alarm.text for alarm in watched.watch.alarms)
    watched.vehicle.parameters["GF_ACTION"] = 2
    assert watched.run(8.0) == [] and watched.watch.alarms == ()


def test_each_parameter_that_switches_a_fence_off_is_named(tmp_path: Path) -> None:
    watched = Watched(tmp_path, check_s=5.0)
    watched.vehicle.autopilot, watched.vehicle.parameters = (
        ARDUPILOT,
        {
            "FENCE_ENABLE": 0,
            "FENCE_TYPE": 7,
            "FENCE_ACTION": 0,
        },
    )
    watched.watch._keeper.station.vehicle.autopilot = ARDUPILOT
    watched.run(3.0)
    off = [event.text.split(" is ")[0] for event in watched.said if event.kind == "not_enforced"]
    assert off == ["FENCE_ENABLE", "FENCE_ACTION"]
    watched.vehicle.parameters["FENCE_ACTION"] = 1
    assert watched.run(8.0) == []
    assert [alarm.text.split(" is ")[0] for alarm in watched.watch.alarms] == ["FENCE_ENABLE"]


def test_a_switch_that_puts_a_fence_off_in_flight_is_told_until_it_is_on_again(tmp_path: Path) -> None:
    watched = Watched(tmp_path, check_s=5.0)
    keeps = {"FENCE_ENABLE": 1, "FENCE_TYPE": 7, "FENCE_ACTION": 1, "OA_TYPE": 2}
    watched.vehicle.autopilot, watched.vehicle.parameters = ARDUPILOT, keeps
    watched.watch._keeper.station.vehicle.autopilot = ARDUPILOT
    watched.vehicle.geofence = (True, True)
    watched.run(3.0)
    assert watched.watch.alarms == ()
    watched.vehicle.geofence = (True, False)
    assert watched.run(8.0) == ["not_enforced"]
    watched.vehicle.geofence = (True, True)
    assert watched.run(8.0) == [] and watched.watch.alarms == ()


def test_a_shape_of_others_that_is_none_ends_no_watch(tmp_path: Path) -> None:
    """A latitude beyond the pole or corners of no number ended it with an error, in flight."""
    watched = Watched(tmp_path, check_s=5.0)
    watched.run(3.0)
    ours = list(watched.vehicle.items)
    watched.vehicle.items = [*ours, (CIRCLE, math.nan, 2**31 - 1, 0), (CIRCLE, 30.0, 2**31 - 1, 0)]
    assert watched.run(8.0).count("kept_others") == 1
    assert watched.run(40.0) == [] and watched.watch.alarms == ()
    watched.vehicle.items = [(POLYGONS[1], math.inf, 473_000_000, 85_000_000), *ours]
    assert "failed" in watched.run(8.0)
    watched.vehicle.items = ours
    watched.run(8.0)
    assert watched.watch.alarms == ()


def test_a_circle_of_others_without_end_is_one_alarm(tmp_path: Path) -> None:
    """The vehicle was sent to the other side of the Earth, and elsewhere there at every look."""
    watched = Watched(tmp_path, check_s=5.0)
    watched.run(3.0)
    watched.vehicle.items = [*watched.vehicle.items, (CIRCLE, math.inf, 473_977_000, 85_456_000)]
    assert watched.run(30.0).count("vehicle_inside") == 1


def test_a_home_that_is_set_in_the_fence_is_an_alarm(tmp_path: Path) -> None:
    """Whoever takes off elsewhere has another home; not every autopilot says so by itself."""
    watched = Watched(tmp_path, check_s=5.0)
    watched.run(3.0)
    watched.vehicle.home = (47.3977 + 110.0 / 111_190, 8.5457)
    assert watched.run(8.0) == ["home_inside"]


def test_zones_of_another_mission_are_an_alarm_because_those_of_before_open(tmp_path: Path) -> None:
    """As of a service that was started anew with another folder: nobody has seen those crowds leave."""
    watched = Watched(tmp_path, opening_s=0.0, interval_s=0.0)
    watched.write(north_m=100.0, begun_ns=1_700_000_000_000_000_000)
    watched.run(3.0)
    watched.write(north_m=110.0, begun_ns=1_700_000_000_000_000_000)
    assert "another_mission" not in watched.run(3.0)
    watched.write(north_m=110.0, count=0, begun_ns=1_700_003_600_000_000_000)
    assert watched.run(3.0) == ["another_mission", "written"]
    assert watched.said[0].alarm and "which began 2023-11-14T23:13:20" in watched.said[0].text
    assert "its 1 zones closed opens" in watched.said[0].text
    watched.write(north_m=110.0)  # a file that does not say when it began
    assert "another_mission" not in watched.run(3.0)


def test_a_zone_between_a_vehicle_and_its_home_is_an_alarm_until_it_is_round_it(tmp_path: Path) -> None:
    """The zone begins 100 m north of where the vehicle took off, and is 20 m wide."""
    watched = Watched(tmp_path)
    watched.run(3.0)
    watched.vehicle.position = (47.3977 + 200.0 / 111_190, 8.5457)
    assert watched.run(8.0) == ["way_home_closed"]
    watched.vehicle.position = (47.3977 + 50.0 / 111_190, 8.5457)
    assert watched.run(8.0) == [] and watched.watch.alarms == ()


def test_a_check_that_failed_is_over_when_the_next_one_does_not(tmp_path: Path) -> None:
    """It stayed an alarm until zones changed, and the next one like it was not told."""
    watched = Watched(tmp_path, check_s=5.0)
    watched.run(3.0)
    answers, watched.vehicle._on_mission_request_list = watched.vehicle._on_mission_request_list, _ignored
    for _ in range(2):
        assert watched.run(12.0) == ["failed"]
        watched.vehicle._on_mission_request_list = answers
        assert watched.run(8.0) == [] and watched.watch.alarms == ()
        watched.vehicle._on_mission_request_list = _ignored


def _ignored(packet: object, now_s: float) -> None:
    """As a vehicle does that is too busy to answer."""


def test_two_ground_stations_leave_the_fence_of_each_other_alone(tmp_path: Path) -> None:
    """Each put its own last: they wrote in turn at every check, and the vehicle kept none meanwhile."""
    (tmp_path / "one").mkdir()
    (tmp_path / "other").mkdir()
    one, other = Watched(tmp_path / "one", check_s=5.0), Watched(tmp_path / "other", check_s=5.0)
    other.vehicle = one.vehicle
    other.link.vehicles = (one.vehicle,)
    other.write(north_m=300.0)

    def run_both() -> None:
        for watched, following in ((one, other), (other, one)):
            watched.run(12.0)
            following.link.now_s = watched.link.now_s

    for _ in range(4):
        run_both()
    assert len(one.vehicle.items) == 4 + 4 and len(one.vehicle.lists) == 2
    one.write(north_m=200.0)
    for _ in range(3):
        run_both()
    north_m = {round((item[2] / 1e7 - 47.3977) * 111_190, -1) for item in one.vehicle.items}
    assert north_m == {200.0, 220.0, 300.0, 320.0}, "what each wants, and no more"
    assert one.watch.alarms == other.watch.alarms == ()


def test_two_that_share_what_they_remember_are_told_of_each_other(tmp_path: Path) -> None:
    """Each took the zones of the other for its own old ones and removed them, and neither said a word."""
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
    (tmp_path / "other" / "state").symlink_to(tmp_path / "one" / "state", target_is_directory=True)
    one, other = Watched(tmp_path / "one", check_s=5.0), Watched(tmp_path / "other", check_s=5.0)
    other.vehicle = one.vehicle
    other.link.vehicles = (one.vehicle,)
    other.write(north_m=300.0)
    one.run(12.0)
    other.link.now_s = one.link.now_s
    assert "changed_by_others" not in other.run(12.0), "one may go on where another ended"
    one.link.now_s = other.link.now_s
    assert "changed_by_others" in one.run(12.0)
    (event,) = [event for event in one.said if event.kind == "changed_by_others"]
    assert event.alarm and "give each a --state of its own" in event.text
    one.said.clear()
    assert "changed_by_others" not in one.run(20.0)


def test_a_refusal_is_said_once_and_tried_again(tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    watched.vehicle.rejects = 5
    assert watched.run(10.0).count("failed") == 1 and watched.vehicle.items == []
    watched.vehicle.rejects = None
    assert "written" in watched.run(5.0) and watched.watch.alarms == ()


def test_a_stop_is_granted_between_two_steps(tmp_path: Path) -> None:
    """What a stop meets on its way is sent to its end."""
    watched = Watched(tmp_path)
    watched.watch.run(stopped=lambda: watched.link.now_s > 12.0)
    assert 12.0 < watched.link.now_s < 13.5 and len(watched.vehicle.items) == 4
    other = Watched(tmp_path)
    asked_with: list[int] = []

    def ask() -> None:
        if other.vehicle.is_taking_a_list:
            asked_with.append(len(other.vehicle.items))

    other.link.before_receive = ask
    other.watch.run(stopped=lambda: bool(asked_with))
    assert asked_with[0] == 0 and len(other.vehicle.items) == 4


def test_a_link_that_closes_is_said_and_opened_again(tmp_path: Path) -> None:
    """Zones that changed meanwhile are written once the vehicle is heard again."""
    watched = Watched(tmp_path, opening_s=1.0)
    assert "written" in watched.run(3.0)
    watched.link.broken_until_s = watched.link.now_s + 20.0
    said = watched.run(10.0)
    assert said == ["link_lost"], "once"
    assert "closed the link" in watched.said[0].text and watched.watch.alarms == tuple(watched.said)
    watched.write(north_m=100.0, count=2)
    said = watched.run(50.0)
    assert said[:2] == ["link_back", "written"] and len(watched.vehicle.items) == 8
    assert watched.watch.alarms == ()


def test_a_stream_is_opened_again() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_transport(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        server.accept()[0].close()
        with pytest.raises(ConnectionError):
            link.receive(5.0)
        link.reopen()
        there, _ = server.accept()
        there.sendall(b"again")
        assert link.receive(5.0) == b"again"
        there.close()
        link.close()
