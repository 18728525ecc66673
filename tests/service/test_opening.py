"""What holds before the first view, and at a restart before the next one."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import shapely

from crowdfence.service.opening import live
from crowdfence.service.settings import ServiceSettings
from crowdfence.zones import Zone
from support.small_service import CONFIG, SIDE_M, START_NS, asked, message, plain, running, settle, views

CLOSED_UNSEEN = replace(CONFIG, zones=replace(CONFIG.zones, close_unseen=True))


def hospital(name: str = "HOSP") -> Zone:
    return Zone.of_no_look(name, shapely.box(1, 1, 9, 9), "static", "given")


def fly(service, first: int, last: int) -> None:
    for one in views(last)[first * 3 :]:
        service.live.intake.give_view(message(one))
    settle(service)


def test_before_the_first_view_static_zones_hold_and_all_ground_is_unseen(tmp_path: Path) -> None:
    how = {"config": CLOSED_UNSEEN, "static_zones": [hospital()]}
    with running(tmp_path, **how) as service, asked(service) as http:
        told = http.get("/api/v1/zones").json()
        assert {zone["id"] for zone in told["zones"]} == {"HOSP", "UNSEEN"} and told["stamp_ns"] is None
        unseen = next(zone for zone in told["zones"] if zone["id"] == "UNSEEN")
        assert unseen["closed_m2"] == SIDE_M**2
        exported = http.get("/api/v1/export").json()
        assert len(exported["features"]) == 2
        fly(service, 0, 10)
        assert service.mission.timeline.span_ns()[0] >= START_NS, "it is of no history"
        first = http.get("/api/v1/zones", params={"at": START_NS - 1}).json()
        assert {zone["id"] for zone in first["zones"]} == {"HOSP", "UNSEEN"}


def test_who_listens_before_the_first_view_hears_what_holds(tmp_path: Path) -> None:
    how = {"config": CLOSED_UNSEEN, "settings": ServiceSettings()}
    with running(tmp_path, **how) as service, asked(service) as http:
        with http.websocket_connect("/api/v1/stream") as stream:
            told = [stream.receive_json() for _ in range(2)]
        step = next(one for one in told if one["type"] == "step")
        assert [zone["id"] for zone in step["zones"]["zones"]] == ["UNSEEN"] and step["belief_version"] == 0


def test_static_zones_that_come_or_go_at_a_restart_count_at_once(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        fly(service, 0, 10)
        number = service.mission.newest.number
    for given in ({"HOSP"}, {"HOSP", "SCHOOL"}, set()):
        with running(tmp_path, static_zones=[hospital(name) for name in sorted(given)]) as service:
            newest = service.mission.newest
            assert {zone.id for zone in newest.zones.static} == given
            assert newest.number == number + 1, "it is published"
            service.store.flush()
            kept = service.mission.timeline.at(newest.stamp_ns)
            assert {zone.id for zone in kept.zones.static} == given, "and in the history"
            number = newest.number
    with running(tmp_path) as service:
        assert service.mission.newest.number == number, "nothing new, nothing published"


@pytest.mark.parametrize("names", [{"name": ""}, {"drones": ["uav1", " "]}])
def test_names_that_nobody_could_call_are_refused(tmp_path: Path, names: dict[str, Any]) -> None:
    """An expected drone without a name can give no view, and is silent for ever."""
    refused = pytest.raises(ValueError, match="need names that are not empty")
    with refused, live(tmp_path, plain(), CONFIG, **{"name": "live", **names}):
        raise AssertionError("it opened")


def test_static_zones_are_after_a_restart_as_they_were_before_it(tmp_path: Path) -> None:
    """They lay at height 0 until the next view came, wherever the ground is, and were told anew each time."""
    told = []
    for _ in range(3):
        with running(tmp_path, static_zones=[hospital()]) as service, asked(service) as http:
            if not told:
                fly(service, 0, 10)
            told.append(http.get("/api/v1/zones").json())
            assert told[-1].pop("run") == service.mission.run
    ground = {"lower_m": 0.0, "upper_m": 1.0, "is_known": True}
    assert told[0]["zones"][-1]["ground"] == ground, "a voxel is a metre high"
    assert told[1] == told[0] and told[2] == told[0]


def test_of_ground_beyond_the_map_nobody_is_told_a_height(tmp_path: Path) -> None:
    """It was told to lie at 0 to 0 m, as if that were known."""
    beyond = Zone.of_no_look("BEYOND", shapely.box(5000.0, 0.0, 5010.0, 10.0), "static", "given")
    with running(tmp_path, static_zones=[beyond]) as service, asked(service) as http:
        (zone,) = http.get("/api/v1/zones").json()["zones"]
        assert zone["ground"]["is_known"] is False
