"""What operators close, lock and open: conservative, for a while, and told."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shapely import MultiPolygon, Point, Polygon, box

from crowdfence import Georeference, View
from crowdfence.config import EvidenceConfig, PaperConfig, ZoneConfig
from crowdfence.exports.zone_formats.times import rfc3339
from crowdfence.fence_sync.zone_file import placed_geojson
from crowdfence.planner import ClearAir
from crowdfence.service.access import User
from crowdfence.service.clock import Clock
from crowdfence.service.operator_zones import OperatorAction, OperatorZones, RefusedAction, passable
from crowdfence.service.service import Service
from crowdfence.zones import Zone, ZoneEvent, ZoneSet
from crowdfence.zones.tracker import EventKind
from support.small_service import (
    CONFIG,
    SECOND_NS,
    START_NS,
    asked,
    message,
    plain,
    running,
    settle,
    view,
    views,
)
from support.small_zones import DrawnZones, ids

SQUARE = [[[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [0.0, 0.0]]]]


def crowd(name: str, polygon: Polygon | MultiPolygon) -> Zone:
    return Zone(name, polygon, 4, 4.0, 0.9, 0.8, 0.0, 1.0, START_NS, START_NS, ("a",), reason="seen")


def zone_set(*zones: Zone) -> ZoneSet:
    return ZoneSet(tuple(zones), 0.5, 0.0, 0, 0.0)


def action(what: str, zone: str = "Z1", stamp_ns: int = START_NS, rings=None) -> OperatorAction:
    return OperatorAction(what, zone, stamp_ns, "ana", "operator", "because", rings)  # type: ignore[arg-type]


def operators() -> OperatorZones:
    return OperatorZones(ZoneConfig(), plain(), dismissed_for_s=60.0)


def test_a_locked_zone_keeps_what_it_closed_and_outlives_its_crowd() -> None:
    mine, large = operators(), crowd("Z1", box(0, 0, 10, 10))
    mine.do(action("lock"), zone_set(large))
    smaller, marks = mine.applied_to(zone_set(crowd("Z1", box(0, 0, 2, 2))), START_NS)
    assert smaller.zones[0].polygon.equals(box(0, 0, 10, 10)) and marks["Z1"]["locked"]
    moved, _ = mine.applied_to(zone_set(crowd("Z1", box(5, 5, 15, 15))), START_NS)
    assert moved.zones[0].polygon.covers(box(0, 0, 10, 10)) and moved.zones[0].polygon.covers(
        box(5, 5, 15, 15)
    )
    gone, marks = mine.applied_to(zone_set(), START_NS)
    assert [zone.id for zone in gone.closed] == ["Z1"] and marks["Z1"]["kind"] == "operator"
    mine.do(action("unlock"), gone)
    assert mine.applied_to(zone_set(), START_NS)[0].closed == ()


def test_a_locked_zone_closes_all_of_its_heights_and_has_no_end() -> None:
    """On a hillside: crowd at 140 to 150 m is locked, and walks down to 20 to 30 m."""
    up = replace(crowd("Z1", box(0, 0, 10, 10)), lower_m=140.0, upper_m=150.0)
    up = replace(up, valid_until_ns=START_NS + 9 * SECOND_NS)
    down = replace(up, polygon=box(50, 0, 60, 10), lower_m=20.0, upper_m=30.0)
    mine = operators()
    mine.do(action("lock"), zone_set(up))
    for now, heights in ((up, (140.0, 150.0)), (down, (20.0, 150.0))):
        (zone,), _ = mine.applied_to(zone_set(now), START_NS)
        assert (zone.lower_m, zone.upper_m, zone.valid_until_ns) == (*heights, None)
        assert zone.polygon.covers(up.polygon) and zone.polygon.covers(now.polygon)
        # 40 m above the ground that was locked, and ten minutes later.
        air = ClearAir(zone_set(zone), expires=True)
        assert not air.is_clear([[5.0, 5.0, 190.0]], START_NS + 600 * SECOND_NS)[0]


def test_dismissed_crowd_stays_on_the_list_and_comes_back_by_itself() -> None:
    mine, zones = operators(), zone_set(crowd("Z1", box(0, 0, 9, 9)), crowd("Z2", box(20, 0, 29, 9)))
    mine.do(action("dismiss"), zones)
    published, marks = mine.applied_to(zones, START_NS + 59 * SECOND_NS)
    assert [zone.id for zone in published.closed] == ["Z1", "Z2"]
    assert marks["Z1"]["dismissed"]["until_ns"] == str(START_NS + 60 * SECOND_NS)
    assert [zone.id for zone in passable(published, marks).closed] == ["Z2"]
    published, marks = mine.applied_to(zones, START_NS + 60 * SECOND_NS)
    assert [zone.id for zone in passable(published, marks).closed] == ["Z1", "Z2"] and not marks


def test_a_dismissal_does_not_pass_on_to_other_crowd() -> None:
    """Z1 ends; what comes later with whatever name is closed."""
    mine, zones = operators(), zone_set(crowd("Z1", box(0, 0, 9, 9)))
    mine.do(action("dismiss"), zones)
    mine.applied_to(zone_set(), START_NS + SECOND_NS)
    published, marks = mine.applied_to(zones, START_NS + 2 * SECOND_NS)
    assert [zone.id for zone in passable(published, marks).closed] == ["Z1"]


def test_drawn_zones_are_there_until_they_are_taken_back() -> None:
    mine = operators()
    name = mine.do(action("add", "", rings=SQUARE), zone_set())
    published, marks = mine.applied_to(zone_set(), START_NS)
    (zone,) = published.closed
    assert (zone.id, zone.polygon.area, marks[name]["kind"]) == (name, 16.0, "operator")
    mine.do(action("dismiss", name), published)
    assert mine.applied_to(zone_set(), START_NS)[0].closed == ()
    assert mine.do(action("add", "", rings=SQUARE), zone_set()) != name


def test_ground_beyond_the_map_that_is_drawn_has_no_known_height() -> None:
    """A hill beside the map may be higher than all of it: absolute heights close it at every one."""
    low_m, high_m = plain().bounds[:, 2]
    (west, *_), (east, *_) = plain().bounds
    mine = operators()
    for x, known in ((west + 1.0, True), (east - 2.0, False)):
        ring = [[x, 0.0], [x + 4.0, 0.0], [x + 4.0, 4.0], [x, 4.0], [x, 0.0]]
        mine.do(action("add", "", rings=[[ring]]), zone_set())
        zone = mine.applied_to(zone_set(), START_NS)[0].closed[-1]
        assert (zone.lower_m, zone.upper_m, zone.ground_is_known) == (low_m, high_m, known)


@pytest.mark.parametrize(
    ("what", "zone", "words"),
    [
        ("unlock", "Z1", "not locked"),
        ("lock", "Z7", "no zone Z7"),
        ("lock", "UNSEEN", "only zones of crowd"),
        ("dismiss", "UNSEEN", "cannot be dismissed"),
    ],
)
def test_what_cannot_be_done_is_refused(what: str, zone: str, words: str) -> None:
    unseen = Zone("UNSEEN", box(0, 0, 1, 1), 0, 0, 0, 0, 0, 1, -1, -1, (), kind="unseen")
    zones = ZoneSet((crowd("Z1", box(0, 0, 9, 9)),), 0.5, 0.0, 0, 0.0, unseen=(unseen,))
    with pytest.raises(RefusedAction, match=words):
        operators().do(action(what, zone), zones)


def test_a_locked_zone_is_unlocked_before_it_is_dismissed() -> None:
    mine, zones = operators(), zone_set(crowd("Z1", box(0, 0, 9, 9)))
    mine.do(action("lock"), zones)
    with pytest.raises(RefusedAction, match="unlock it first"):
        mine.do(action("dismiss"), zones)


@pytest.mark.parametrize(
    "ring",
    [
        [[0, 0], [1, 1]],
        [[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]],
        [[0, 0], [1, 0], [2, 0], [0, 0]],
        [[0, 0], [1, float("nan")], [1, 1], [0, 0]],
        [[0, 0], [1e200, 0], [1e200, 1e200], [0, 0]],
    ],
)
def test_what_is_no_polygon_is_refused(ring) -> None:
    with pytest.raises(RefusedAction):
        operators().do(action("add", "", rings=[[ring]]), zone_set())


def test_what_they_did_goes_through_bytes() -> None:
    mine, zones = operators(), zone_set(crowd("Z1", box(0, 0, 9, 9)), crowd("Z2", box(20, 0, 29, 9)))
    mine.do(action("add", "", rings=SQUARE), zones)
    mine.do(action("lock"), zones)
    mine.do(action("dismiss", "Z2"), zones)
    again = operators()
    again.restore(mine.to_json())
    assert again.to_json() == mine.to_json()
    for later in (zones, zone_set()):
        (one, marks), (other, other_marks) = (
            mine.applied_to(later, START_NS),
            again.applied_to(later, START_NS),
        )
        assert marks == other_marks and [zone.id for zone in one.closed] == [zone.id for zone in other.closed]


def flown(service: Service, instants: int) -> None:
    assert service.live is not None
    for one in views(instants):
        service.live.intake.give_view(message(one))
    settle(service)


def test_on_the_running_service(tmp_path: Path) -> None:
    with running(tmp_path) as service, asked(service) as http:
        flown(service, 9)
        (first,) = [zone for zone in http.get("/api/v1/zones").json()["zones"] if zone["id"] == "Z1"]
        assert Polygon(first["polygon"][0][0]).covers(Point(20.0, 22.0))  # the first crowd
        told = http.post("/api/v1/zones/Z1/dismiss", json={"reason": "medical flight"}).json()
        assert told["dismissed"]["until_ns"] and "medical flight" in told["why"]
        assert '"Z1"' not in http.get("/api/v1/export").text
        ids = [zone["id"] for zone in http.get("/api/v1/zones").json()["zones"]]
        assert "Z1" in ids
        # A minute of stamps later it is closed again, though nobody did anything.
        assert service.live is not None
        late = view("uav1", 9 + 5 * 61)
        service.live.intake.give_view(message(late))
        service.live.intake.give_view(message(view("uav1", 9 + 5 * 63)))
        settle(service)
        zones = {zone["id"]: zone for zone in http.get("/api/v1/zones").json()["zones"]}
        assert zones["Z1"]["dismissed"] is None and '"Z1"' in http.get("/api/v1/export").text


def test_a_zone_appears_once_though_operators_act_at_its_instant(tmp_path: Path) -> None:
    """Its history said "appeared" once more for each of their actions."""
    with running(tmp_path) as service, asked(service) as http:
        for instants in range(1, 13):
            flown(service, instants)
            for action in ("lock", "unlock"):
                http.post(f"/api/v1/zones/Z1/{action}", json={"reason": "stage"})
        service.store.flush()
        events = http.get("/api/v1/zones/Z1/history").json()["events"]
        assert [event["kind"] for event in events if event["kind"] != "updated"] == ["created"]


def test_files_with_times_say_when_a_dismissed_zone_is_closed_again(tmp_path: Path) -> None:
    """A consumer that asks every ten minutes, and once within the minute, had none of it for ten."""
    with running(tmp_path, georeference=Georeference(46.5, 8.0, 1200.0)) as service, asked(service) as http:
        flown(service, 9)
        before = http.get("/api/v1/export?format=ed318&country=CHE").json()["features"]
        told = http.post("/api/v1/zones/Z1/dismiss", json={"reason": "medical flight"}).json()
        until = rfc3339(int(told["dismissed"]["until_ns"]))
        features = http.get("/api/v1/export?format=ed318&country=CHE").json()["features"]
        assert len(features) == len(before) >= 2
        starts = {
            feature["properties"]["identifier"]: feature["properties"]["limitedApplicability"][0]
            for feature in features
        }
        now = rfc3339(service.mission.newest.stamp_ns)
        assert starts.pop("Z1") == {"startDateTime": until}
        assert {start["startDateTime"] for start in starts.values()} == {now}
        for kind in ("ed269", "f3548", "kml", "csv"):
            assert until in http.get(f"/api/v1/export?format={kind}&country=CHE").text
        # Whoever reads these looks at no times.
        assert '"Z1"' not in http.get("/api/v1/export?format=geojson").text
        assert http.get("/api/v1/export?format=multidrone").text.count("<Placemark") == len(before) - 1
        service.live.intake.give_view(message(view("uav1", 9 + 5 * 63)))
        service.live.finish()
        features = http.get("/api/v1/export?format=ed318&country=CHE").json()["features"]
        assert until not in json.dumps(features) and '"Z1"' in json.dumps(features)


def test_a_file_says_which_mission_it_is_of(tmp_path: Path) -> None:
    """Whoever follows it, as `fence watch` does, tells by that zones that open from those of a service that
    knows nothing of them."""
    with running(tmp_path, georeference=Georeference(46.5, 8.0, 1200.0)) as service, asked(service) as http:
        flown(service, 9)
        first_ns = int(http.get("/api/v1/scene").json()["first_stamp_ns"])
        assert placed_geojson(http.get("/api/v1/export").content, "zones.geojson").begun_ns == first_ns
        assert START_NS <= first_ns < START_NS + SECOND_NS


def test_heights_that_a_format_does_not_know_are_refused(tmp_path: Path) -> None:
    """They came above the ground, as 0 to 120 m, which above the sea is below the ground of most missions."""
    with running(tmp_path, georeference=Georeference(46.5, 8.0, 1200.0)) as service, asked(service) as http:
        flown(service, 9)
        for kind in ("geojson", "kml", "multidrone", "qgc"):
            assert http.get(f"/api/v1/export?format={kind}&datum=AGL").status_code == 200
            refused = http.get(f"/api/v1/export?format={kind}&datum=WGS84")
            assert refused.status_code == 422 and "no heights above WGS84" in refused.json()["detail"]
        refused = http.get("/api/v1/export?format=f3548&datum=AMSL")
        assert refused.status_code == 422 and "none above AMSL" in refused.json()["detail"]
        for kind in ("ed318", "f3548", "csv"):
            assert http.get(f"/api/v1/export?format={kind}&datum=WGS84&country=CHE").status_code == 200


@pytest.mark.parametrize("method", [EvidenceConfig(memory_s=3.0), PaperConfig(fleet_size=3, decay=0.01)])
def test_files_of_zones_that_stand_though_nobody_looks_name_no_end_that_is_over(
    tmp_path: Path, method: EvidenceConfig | PaperConfig
) -> None:
    """Of F3548 a zone ends a day after it begins at the latest. By hand, of equation 3: at 0.01 a second a
    crowd falls from 1 below the threshold of 0.5 after ln 2 / 0.01 = 69 s, and yet stands until somebody
    looks."""
    now_ns = START_NS
    clock = Clock("system", system=lambda: now_ns, steady=lambda: now_ns)
    how = {"config": replace(CONFIG, method=method), "clock": clock}
    anchor = Georeference(46.5, 8.0, 1200.0)
    with running(tmp_path, georeference=anchor, **how) as service, asked(service) as http:
        assert service.live is not None
        for one in views(9):
            now_ns = one.stamp_ns
            service.live.intake.give_view(message(one))
        settle(service)
        then_ns, zones = service.mission.newest.stamp_ns, len(service.mission.newest.zones)
        now_ns += 25 * 3600 * SECOND_NS
        constraints = http.get("/api/v1/export?format=f3548").json()["constraints"]
        assert len(constraints) == zones > 0
        for constraint in constraints:
            told, (volume, *_) = constraint["reference"], constraint["details"]["volumes"]
            for one in (told, volume):
                assert one["time_start"]["value"] == rfc3339(now_ns)
                assert one["time_end"]["value"] == rfc3339(now_ns + 24 * 3600 * SECOND_NS)
            assert told["version"] == now_ns // SECOND_NS, "who knows an earlier one must read it again"
        periods = [
            *(
                feature["properties"]["limitedApplicability"]
                for feature in http.get("/api/v1/export?format=ed318&country=CHE").json()["features"]
            ),
            *(
                feature["applicability"]
                for feature in http.get("/api/v1/export?format=ed269&country=CHE").json()["features"]
            ),
        ]
        assert len(periods) == 2 * zones
        assert not any("endDateTime" in period for (period,) in periods)
        # `fence watch --expires` takes a zone out of the autopilot's fence at the end that its file names.
        features = http.get("/api/v1/export?format=geojson").json()["features"]
        assert [feature["properties"]["valid_until_ns"] for feature in features] == [None] * zones
        # What is asked of an earlier moment stays as it was.
        earlier = http.get(f"/api/v1/export?format=f3548&at={then_ns - 1}").json()["constraints"]
        assert all(one["reference"]["time_start"]["value"] < rfc3339(then_ns) for one in earlier)


def test_zones_that_a_drone_shows_whose_clock_is_ahead_hold_from_now_on(tmp_path: Path) -> None:
    """Stamps up to 2 s ahead are taken. Whoever reads times took the ground for open until then."""
    ahead_ns = 1_900_000_000
    now_ns = START_NS
    clock = Clock("system", system=lambda: now_ns, steady=lambda: now_ns)
    anchor = Georeference(46.5, 8.0, 1200.0)
    with running(tmp_path, georeference=anchor, clock=clock) as service, asked(service) as http:
        assert service.live is not None
        for one in views(9):
            now_ns = one.stamp_ns - ahead_ns
            service.live.intake.give_view(message(one))
        settle(service)
        assert service.mission.newest.stamp_ns > now_ns + SECOND_NS
        for one in http.get("/api/v1/export?format=f3548").json()["constraints"]:
            assert one["reference"]["time_start"]["value"] == rfc3339(now_ns)
        for kind in ("ed318", "ed269", "kml", "csv"):
            assert rfc3339(now_ns) in http.get(f"/api/v1/export?format={kind}&country=CHE").text


def passed(mine: OperatorZones, zones: ZoneSet, second: int) -> list[str]:
    """The zones that are dismissed then."""
    published, marks = mine.applied_to(zones, START_NS + second * SECOND_NS)
    assert [zone.id for zone in published] == [zone.id for zone in zones], "they stay on the list"
    return [zone.id for zone in published if zone not in passable(published, marks).zones]


def test_a_dismissal_ends_where_its_crowd_reaches_beyond_the_dismissed_ground() -> None:
    """Step by step too: what counts is the ground of the moment at which somebody looked at it."""
    mine, first = operators(), zone_set(crowd("Z1", box(0, 0, 9, 9)))
    mine.do(action("dismiss"), first)
    assert passed(mine, zone_set(crowd("Z1", box(0, 0, 10, 10))), 1) == ["Z1"], "flicker"
    assert passed(mine, zone_set(crowd("Z1", box(-2, -2, 11, 11))), 2) == ["Z1"]
    assert passed(mine, zone_set(crowd("Z1", box(0, 0, 11.5, 9))), 3) == []
    assert passed(mine, first, 4) == [], "it takes a new dismissal"


def test_crowd_that_came_while_the_reason_was_written_is_not_dismissed() -> None:
    """Somebody looked at 9 x 9 m. More than 2 m beyond them is crowd that nobody spoke of, whenever it
    comes."""
    seen = [[[[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0], [0.0, 0.0]]]]
    flicker, grown = zone_set(crowd("Z1", box(0, 0, 10.5, 9))), zone_set(crowd("Z1", box(0, 0, 12, 9)))
    mine = operators()
    with pytest.raises(RefusedAction, match="crowd of zone Z1 reaches beyond the ground .* look again"):
        mine.do(action("dismiss", rings=seen), grown)
    assert passed(mine, grown, 1) == []
    mine.do(action("dismiss", rings=seen), flicker)
    assert passed(mine, flicker, 2) == ["Z1"]
    anew = operators()
    anew.restore(json.loads(json.dumps(mine.to_json())))
    for one in (mine, anew):
        assert passed(one, grown, 3) == [], "2 m beyond what was seen, not beyond what it had become"


def test_a_dismissal_over_http_is_of_what_was_seen(tmp_path: Path) -> None:
    """A crowd of 3 x 3 pixels of 1.5 m becomes one of 10 x 8."""
    with running(tmp_path) as service, asked(service) as http:
        assert service.live is not None

        def show(numbers: range, rows: slice, columns: slice) -> str:
            """The stamp of the zones that follow."""
            for number in numbers:
                one, shown = view("uav1", number), np.zeros((12, 16), np.float32)
                shown[rows, columns] = 0.95
                still = View("uav1", one.stamp_ns, one.camera, view("uav1", 0).world_from_camera, shown)
                service.live.intake.give_view(message(still))
            service.live.finish()
            return str(http.get("/api/v1/zones").json()["stamp_ns"])

        def dismissed(seen_ns: str) -> tuple[int, str]:
            told = {"reason": "two cars", "seen_ns": seen_ns}
            answer = http.post("/api/v1/zones/Z1/dismiss", json=told)
            return answer.status_code, answer.text

        small = show(range(8), slice(5, 8), slice(6, 9))
        large = show(range(8, 60), slice(2, 10), slice(3, 13))
        assert [zone.id for zone in service.mission.newest.zones] == ["Z1"]
        for seen, status, words in (
            (small, 409, "reaches beyond the ground"),
            (str(START_NS), 409, "there was no zone Z1"),
            ("yesterday", 422, "seen_ns: 'yesterday' is no stamp"),
        ):
            answer = dismissed(seen)
            assert answer[0] == status and words in answer[1]
        assert not any(mark.get("dismissed") for mark in service.mission.newest.marks.values())
        assert dismissed(large)[0] == 200
        assert service.mission.newest.marks["Z1"]["dismissed"]


def test_other_crowd_that_merges_into_a_dismissed_zone_is_closed() -> None:
    """The zones of the engine: the merged zone keeps the dismissed name, as the older one."""
    drawn, mine = DrawnZones((9, 3)), operators()
    first = drawn.drawn("""
##.....##
##.....##
.........""")
    assert ids(first) == ["Z1", "Z2"]
    mine.do(action("dismiss"), first)
    assert passed(mine, first, 0) == ["Z1"]
    merged = drawn.drawn("""
#########
#########
.........""")
    assert ids(merged) == ["Z1"] and passed(mine, merged, 1) == []


def test_a_small_crowd_beside_a_dismissed_zone_that_merges_into_it_is_closed() -> None:
    """Two columns away both ways it is another zone, and within what flickers of the dismissed one."""
    drawn, mine = DrawnZones((9, 4)), operators()
    first = drawn.drawn("""
.......#.
.........
######...
######...""")
    assert ids(first) == ["Z1", "Z2"]
    mine.do(action("dismiss"), first)
    merged = drawn.drawn("""
.......#.
......#..
######...
######...""")
    assert ids(merged) == ["Z1"] and passed(mine, merged, 1) == []


def test_a_dismissed_zone_that_falls_apart_is_dismissed_with_all_that_comes_out_of_it() -> None:
    """Loose crowds do so every few seconds. The part that got another name was closed, for which nobody was
    warned."""
    drawn, mine = DrawnZones((12, 3)), operators()
    first = drawn.drawn("""
............
####.##.####
####.##.####""")
    assert ids(first) == ["Z1"]
    mine.do(action("dismiss"), first)
    apart = drawn.drawn("""
............
####.....###
####.....###""")
    assert ids(apart) == ["Z1", "Z2"] and passed(mine, apart, 1) == ["Z1", "Z2"]
    kept, marks = operators(), mine.applied_to(replace(apart, events=()), START_NS)[1]
    kept.restore(json.loads(json.dumps(mine.to_json())))
    assert kept.applied_to(replace(apart, events=()), START_NS)[1] == marks
    together = drawn.drawn("""
##.........#
####.##.####
####.##.####""")
    assert ids(together) == ["Z1"] and passed(mine, together, 2) == ["Z1"], "it flickers as one alone does"
    assert passed(mine, together, 61) == []


def test_a_new_part_beside_a_dismissed_zone_is_closed_where_it_could_be_a_zone() -> None:
    """Half a metre away, so that the zone has it as a part: 3 m2 are a crowd, less is flicker."""
    mine = operators()
    first, least = crowd("Z1", box(0, 0, 9, 9)), {"min_area_m2": 3.0}
    mine.do(action("dismiss"), replace(zone_set(first), **least))
    for number, (length_m, told) in enumerate(((2.9, ["Z1"]), (3.0, []))):
        parts = MultiPolygon([box(0, 0, 9, 9), box(9.5, 0, 10.5, length_m)])
        assert passed(mine, replace(zone_set(crowd("Z1", parts)), **least), 1 + number) == told


def test_crowd_that_comes_to_a_dismissed_zone_is_told(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        flown(service, 12)
        mission = service.mission
        zone = next(one for one in mission.found)
        service.decide(User("ana", "operator"), "dismiss", zone.id, "two cars")
        assert mission.newest is not None and mission.newest.marks[zone.id]["dismissed"]
        grown = replace(zone, polygon=zone.polygon.buffer(9.0), crowd_outline=None)
        mission.found = replace(mission.found, zones=(grown,), events=())
        moment = mission.publish(mission.newest.stamp_ns + SECOND_NS)
        assert [one.id for one in passable(moment.zones, moment.marks).closed] == [zone.id]
        alert = service.alerts.active("new_zone", zone=zone.id)
        assert alert is not None and alert.level == "warning" and "closed again" in alert.text


def test_crowd_that_comes_to_a_zone_that_was_dismissed_once_more_is_told_once_more(tmp_path: Path) -> None:
    """Also where views come late, so that it came at a stamp before the first dismissal had ended."""
    with running(tmp_path) as service:
        flown(service, 12)
        mission = service.mission
        zone = next(one for one in mission.found)
        newest_ns = mission.newest.stamp_ns
        text = f"zone {zone.id} is closed again: it is no longer dismissed"
        service.alerts.clear("new_zone", newest_ns, zone=zone.id)  # that it appeared
        service.alerts.raise_("new_zone", "warning", text, newest_ns - SECOND_NS // 10, zone=zone.id)
        service.decide(User("ana", "operator"), "dismiss", zone.id, "two cars")
        mission.publish(newest_ns - SECOND_NS // 2)
        grown = replace(zone, polygon=zone.polygon.buffer(9.0), crowd_outline=None)
        mission.found = replace(mission.found, zones=(grown,), events=())
        mission.publish(newest_ns - SECOND_NS // 4)
        alert = service.alerts.active("new_zone", zone=zone.id)
        assert alert is not None and (alert.text, alert.raised_ns) == (text, newest_ns - SECOND_NS // 4)


@pytest.mark.parametrize("kind", ["split", "merged"])
def test_dismissed_ground_that_is_closed_under_another_name_is_told(tmp_path: Path, kind: EventKind) -> None:
    """As a new zone, for those who fly through it to know, or not at all."""
    with running(tmp_path) as service:
        flown(service, 12)
        mission = service.mission
        zone, other = list(mission.found)[:2]
        service.decide(User("ana", "operator"), "dismiss", zone.id, "two cars")
        names = (zone.id, other.id) if kind == "merged" else (other.id, zone.id)
        zones = (other,) if kind == "merged" else (zone, other)
        event = ZoneEvent(mission.newest.stamp_ns, kind, *names)
        mission.found = replace(mission.found, zones=zones, events=(event,))
        mission.publish(mission.newest.stamp_ns)
        alert = service.alerts.active("new_zone", zone=other.id)
        assert alert is not None and alert.level == "warning"
        assert alert.text == f"zone {other.id} closes ground of {zone.id}, which was dismissed"


def test_a_part_with_a_name_of_its_own_is_no_crowd_that_appears(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        flown(service, 12)
        mission = service.mission
        zone, other = list(mission.found)[:2]
        service.alerts.clear("new_zone", mission.newest.stamp_ns, zone=other.id)
        event = ZoneEvent(mission.newest.stamp_ns, "split", other.id, zone.id)
        mission.found = replace(mission.found, events=(event,))
        mission.publish(mission.newest.stamp_ns)
        alert = service.alerts.active("new_zone", zone=other.id)
        assert alert is not None and alert.text.startswith(f"zone {other.id} came out of {zone.id}: ")


@pytest.mark.parametrize("text", ["abc \\ud800 def", "\\udc00\\udc00\\udc00"])
def test_a_reason_with_half_a_character_is_refused(tmp_path: Path, text: str) -> None:
    body = f'{{"reason": "{text}", "polygon": [[1, 1], [5, 1], [5, 5]]}}'.encode()
    with running(tmp_path) as service, asked(service) as http:
        answer = http.post("/api/v1/zones", content=body, headers={"content-type": "application/json"})
        assert answer.status_code == 422 and service.works
        odd = f'{{"reason": "because", "{text}": 1}}'.encode()
        answer = http.post("/api/v1/zones", content=odd, headers={"content-type": "application/json"})
        assert answer.status_code == 422


def test_a_zone_drawn_in_degrees_is_refused(tmp_path: Path) -> None:
    """Of 80 x 110 m near Bern it would close a square millimetre, and look as if it stood."""
    corners = [[8.0, 46.5], [8.001, 46.5], [8.001, 46.501], [8.0, 46.501]]
    with running(tmp_path) as service, asked(service) as http:
        answer = http.post("/api/v1/zones", json={"reason": "concert", "polygon": corners})
        assert answer.status_code == 422 and "closes 1e-06 m2" in answer.json()["detail"]
        assert "local metres east and north, not degrees" in answer.json()["detail"]
        square = [[8.0, 46.0], [9.0, 46.0], [9.0, 47.0], [8.0, 47.0]]
        assert http.post("/api/v1/zones", json={"reason": "manhole", "polygon": square}).status_code == 201
