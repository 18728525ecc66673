"""`crowdfence fence` against an emulated vehicle on loopback: what it holds, what is printed, the code."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from crowdfence import Georeference
from crowdfence.cli.app import app
from crowdfence.zones.history import ZoneHistory
from support.small_zones import SECOND_NS, DrawnZones
from support.vehicle_emulator import EmulatedVehicle, UdpVehicle, polygon
from support.watch_events import events_of

FAILED, ALARM = 1, 3
START_NS = 1_767_225_600 * SECOND_NS
HOME = (47.3977, 8.5456)
THEIRS = polygon((47.41, 8.55), (47.41, 8.56), (47.42, 8.56))
Ran = tuple[int, str]


@pytest.fixture
def served() -> Iterator[UdpVehicle]:
    with UdpVehicle(EmulatedVehicle()) as vehicle:
        yield vehicle


@pytest.fixture
def fence(served: UdpVehicle, tmp_path: Path) -> Any:
    def run(command: str, *arguments: object, code: int = 0) -> str:
        given = ["fence", command, *link(served, tmp_path), *map(str, arguments)]
        done = CliRunner().invoke(app, given)
        assert done.exit_code == code, (done.stdout, done.exception)
        return str(done.exception) if code == FAILED else done.stdout

    return run


def link(served: UdpVehicle, state: Path) -> list[str]:
    """A machine that is busy with other tests may be slow."""
    address = f"udpout:127.0.0.1:{served.port}"
    return ["--link", address, "--system", "1", "--state", str(state / "state"), "--timeout-s", "20"]


def square(north_m: float, name: str = "Z1", **properties: object) -> dict[str, object]:
    """20 x 20 m at the vehicle's longitude, so far to its north."""
    south, west = HOME[0] + north_m / 111_190, HOME[1]
    ring = [(0, 0), (2.7e-4, 0), (2.7e-4, 1.8e-4), (0, 1.8e-4), (0, 0)]
    corners = [[west + east, south + north] for east, north in ring]
    geometry = {"type": "Polygon", "coordinates": [corners]}
    return {"type": "Feature", "id": name, "geometry": geometry, "properties": properties}


def written(path: Path, *features: dict[str, object]) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_push_pull_clear(fence: Any, served: UdpVehicle, tmp_path: Path) -> None:
    served.vehicle.items = list(THEIRS)
    zones = written(tmp_path / "zones.geojson", square(100.0), square(200.0, "Z2"))
    told = json.loads(fence("push", zones, "--json"))
    assert told["vehicle"] == "vehicle 1 (PX4)" and told["written"]
    assert (told["items"], told["our_items"], told["shapes_of_others"]) == (11, 8, 1)
    output = tmp_path / "fence.geojson"
    assert "3 shapes in 11 items, 2 of them ours" in fence("pull", "-o", output)
    features = json.loads(output.read_text())["features"]
    assert [one["properties"]["drawn_by"] for one in features] == ["others", "crowdfence", "crowdfence"]
    assert "exists; --force replaces it" in fence("pull", "-o", output, code=FAILED)
    assert "2 shapes removed, 1 stay" in fence("clear")
    assert served.vehicle.items == THEIRS
    assert "1 shapes removed, 0 stay" in fence("clear", "--all")
    assert json.loads(fence("pull"))["features"] == [] == served.vehicle.items


def test_zones_of_others_stay_while_a_vehicle_is_watched(
    fence: Any, served: UdpVehicle, tmp_path: Path
) -> None:
    """`watch` could not be given them: it opened what `push` had closed for others."""
    zones = written(tmp_path / "zones.geojson", square(100.0))
    others = written(tmp_path / "others.geojson", square(200.0, "CTR"))
    fence("push", zones, "--static-zones", others)
    assert len(served.vehicle.items) == 8
    assert "stand there already" in fence("watch", zones, "--static-zones", others, "--duration-s", 1.5)
    assert len(served.vehicle.items) == 8
    others.write_text("{}")
    assert "others.geojson: " in fence("watch", zones, "--static-zones", others, code=FAILED)


def test_a_margin_is_closed_around_zones(fence: Any, served: UdpVehicle, tmp_path: Path) -> None:
    """Until a multirotor of 5 m/s stands: 3 + 3 + 1 + 5 + 25 / (2 * 9.81) = 13.27 m around 20.4 x 20 m, whose
    area is then 408 + 2 * 40.4 * 13.27 + pi * 13.27 ** 2 = 2033 m2, with at most 5 % of the distance more."""
    served.vehicle.parameters["GF_ACTION"] = 2
    zones, margin = (
        written(tmp_path / "zones.geojson", square(100.0)),
        ("--buffer", "contingency:speed_mps=5"),
    )
    assert json.loads(fence("push", zones, "--json"))["zone_area_m2"] == pytest.approx(408.0, rel=1e-3)
    area_m2 = json.loads(fence("push", zones, *margin, "--json"))["zone_area_m2"]
    assert 2033.0 <= area_m2 <= 2146.0
    assert "stand there already" in fence("watch", zones, *margin, "--duration-s", 1.5)
    assert "needs speed_mps=" in fence("push", zones, "--buffer", "contingency", code=FAILED)


def test_a_run_is_pushed_as_it_was_at_an_instant(fence: Any, served: UdpVehicle, tmp_path: Path) -> None:
    """Two crowds; a second later they are one, then none."""
    drawn, sets, stamps_ns = DrawnZones((20, 10)), [], []
    apart = np.zeros((20, 10))
    apart[5:7, 3:7] = apart[13:15, 3:7] = 1.0
    one = apart.copy()
    one[5:15, 3:7] = 1.0
    for crowd in (apart, one, np.zeros((20, 10))):
        sets.append(drawn.step(crowd, evidence_of="uav1"))
        stamps_ns.append(START_NS + drawn.stamp_ns)
    run = tmp_path / "run"
    run.mkdir()
    history = ZoneHistory(stamps_ns, sets, Georeference(47.3985, 8.5456, 500.0), {"method": "paper"})
    history.write(run / "zone_history.jsonl")
    for at, items in (("first", 8), ("+1", 4), ("last", 0)):
        fence("push", run, "--at", at)
        assert len(served.vehicle.items) == items
    history = ZoneHistory(stamps_ns, sets, None, {"method": "paper"})
    history.write(run / "zone_history.jsonl")
    assert "the run has no place on Earth" in fence("push", run, code=FAILED)


def test_alarms_have_a_code_of_their_own(fence: Any, served: UdpVehicle, tmp_path: Path) -> None:
    text = fence("push", written(tmp_path / "zones.geojson", square(-10.0)), code=ALARM)
    assert "alarm: the vehicle is in the fence of zone Z1" in text and "alarm: home lies in the fence" in text
    assert served.vehicle.items and served.vehicle.kept == []


@pytest.mark.parametrize(
    ("ring", "message"),
    [
        ([[8, 47], [8.1, 47.1], [8.1, 47], [8, 47.1], [8, 47]], "Self-intersection"),
        ([[8, 47], [8.1, 47], [8, 47]], "has no outline of at least three corners"),
        ([[8, 89.5], [8.1, 89.5], [8, 89.6], [8, 89.5]], "beyond 89 degrees"),
        ([[800, 47], [8, 48], [8, 47], [800, 47]], "no longitude and latitude"),
        ([], "has no outline of at least three corners"),
        (None, "is not iterable"),
    ],
)
def test_zones_that_cannot_be_used_leave_the_fence(
    fence: Any, served: UdpVehicle, tmp_path: Path, ring: object, message: str
) -> None:
    served.vehicle.items = list(THEIRS)
    geometry = {"type": "Polygon", "coordinates": None if ring is None else [ring]}
    zones = written(tmp_path / "zones.geojson", square(100.0) | {"geometry": geometry})
    said = fence("push", zones, code=FAILED)
    assert message in said and "zones.geojson" in said and "\n" not in said
    assert served.vehicle.items == THEIRS and served.vehicle.lists == []


def test_refusals_are_one_line(fence: Any, served: UdpVehicle, tmp_path: Path) -> None:
    served.vehicle.parameters["GF_ACTION"] = 4
    zones = written(tmp_path / "zones.geojson", square(100.0))
    assert "GF_ACTION is 4 (terminate)" in fence("push", zones, code=FAILED)
    assert "no link" in str(CliRunner().invoke(app, ["fence", "clear", "--link", "14550"]).exception)
    assert "nowhere" in fence("push", "nowhere.geojson", code=FAILED)
    assert served.vehicle.lists == []
    served.vehicle.mute = True
    assert "no heartbeat of vehicle 1" in fence("clear", "--timeout-s", 0.3, code=FAILED)


@pytest.mark.parametrize(
    ("command", "option", "value"),
    [
        ("push", "--timeout-s", "inf"),  # it ended in a traceback
        ("push", "--timeout-s", "1e300"),  # it waited for ever
        ("watch", "--stale-after-s", "nan"),  # it was no alarm, ever
        ("watch", "--stale-after-s", "-5"),
        ("watch", "--duration-s", "nan"),
        ("watch", "--interval-s", "inf"),  # new zones were never sent
        ("watch", "--check-s", "inf"),
    ],
)
def test_durations_that_are_none_are_refused(tmp_path: Path, command: str, option: str, value: str) -> None:
    given = ["fence", command, str(tmp_path), "--link", "udpin:127.0.0.1:14550", option, value]
    done = CliRunner().invoke(app, given)
    assert done.exit_code == 2 and f"Invalid value for '{option}'" in done.output


def test_watch_follows_a_file_until_it_is_stopped(served: UdpVehicle, tmp_path: Path) -> None:
    zones = written(tmp_path / "zones.geojson", square(100.0))
    eager = ["--json", "--opening-s", "0", "--interval-s", "0", "--duration-s", "120"]
    process = subprocess.Popen(
        [sys.executable, "-m", "crowdfence", "fence", "watch", str(zones), *link(served, tmp_path), *eager],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "NO_COLOR": "1"},
    )
    try:
        events_of(process, "written")
        assert len(served.vehicle.items) == 4
        written(tmp_path / "new", square(100.0), square(200.0, "Z2")).replace(zones)
        events_of(process, "written")
        assert len(served.vehicle.items) == 8
        zones.write_text("{")
        (bad,) = events_of(process, "zones_unreadable")
        assert bad["level"] == "alarm" and "the last fence stays" in bad["text"]
        written(tmp_path / "new").replace(zones)
        events_of(process, "written")
        assert served.vehicle.items == []
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
    finally:
        process.kill()
        process.wait()


def test_watch_ends_by_itself_with_the_alarms_that_stand(
    fence: Any, served: UdpVehicle, tmp_path: Path
) -> None:
    zones = written(tmp_path / "zones.geojson", square(-10.0))
    began = time.process_time()
    text = fence("watch", zones, "--duration-s", 2.5, code=ALARM)
    assert "in the fence of zone Z1" in text and len(served.vehicle.items) == 4
    assert time.process_time() - began < 5.0
