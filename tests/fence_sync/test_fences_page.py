"""Every command of docs/fences.md, in order, against a vehicle and a run made here."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from crowdfence import Georeference
from crowdfence.cli.app import app
from crowdfence.fence_sync import fence_event
from crowdfence.fence_sync.autopilot_capacity import ARDUPILOT_BYTES, PX4_ITEMS
from crowdfence.fence_sync.inside import CLEARANCE_M
from crowdfence.fence_sync.watch import WatchPlan
from crowdfence.zones.history import ZoneHistory
from support.small_zones import DrawnZones
from support.vehicle_emulator import EmulatedVehicle, UdpVehicle

PAGE = Path(__file__).parents[2] / "docs" / "fences.md"


def sessions() -> list[tuple[list[str], list[str]]]:
    """Arguments and what the page says is printed, of every session that it shows."""
    shown = []
    for block in re.findall(r"^```\n\$ crowdfence (.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE):
        command, *printed = block.splitlines()
        shown.append((command.split(), printed))
    return shown


def without_numbers(line: str) -> str:
    return re.sub(r"\b[A-Z0-9]*\d[\d.]*\b", "#", line)


def test_the_page_shows_what_is_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The demo takes a minute, so these are other crowds: the words are those of the page, the numbers are
    not."""
    monkeypatch.chdir(tmp_path)
    drawn = DrawnZones((60, 60))
    crowd = np.zeros((60, 60))
    for i in range(6):
        crowd[10 * i : 10 * i + 7, ::9] = crowd[10 * i + 3, :] = 1.0
    history = ZoneHistory([0], [drawn.step(crowd)], Georeference(46.5, 8.0, 0.0), {"method": "paper"})
    Path("out/demo").mkdir(parents=True)
    history.write("out/demo/zone_history.jsonl")
    away, within = (46.497, 8.0), (46.5 + 3.5 / 111_190, 8.0 + 5.0 / 76_700)
    shown = sessions()
    assert [arguments[1] for arguments, _ in shown] == ["push", "pull", "watch", "clear", "push"]
    for number, (arguments, printed) in enumerate(shown):
        place = within if number == len(shown) - 1 else away
        if number in (0, len(shown) - 1):
            vehicle = EmulatedVehicle(position=place, home=place)
        with UdpVehicle(vehicle) as served:
            link = [f"udpout:127.0.0.1:{served.port}" if "udpin" in one else one for one in arguments]
            extra = ["--duration-s", "0.5"] if arguments[1] == "watch" else []
            done = CliRunner().invoke(app, [*link, *extra, "--state", "state", "--system", "1"])
        assert done.exit_code == (3 if number == len(shown) - 1 else 0), done.exception
        assert list(map(without_numbers, done.stdout.splitlines())) == list(map(without_numbers, printed))


def test_the_page_names_every_alarm_and_the_numbers_of_the_code() -> None:
    page = PAGE.read_text()
    source = "".join(path.read_text() for path in Path(fence_event.__file__).parent.glob("*.py"))
    calls = re.findall(r'FenceEvent\(\s*"(\w+)",(.*?)\n\s*\)', source, re.DOTALL)
    alarms = {kind for kind, rest in calls if "alarm=" in rest}
    assert alarms >= {"vehicle_inside", "home_inside", "changed_by_others", "refused_by_text"}
    table = page.partition("## What the alarms mean")[2].partition("\n\nThe place")[0]
    named = set(
        re.findall(r"`(\w+)`", "".join(row.split("|")[1] for row in table.splitlines() if "|" in row))
    )
    assert alarms | {"not_enforced"} <= named
    assert f"{PX4_ITEMS} items" in page and f"{ARDUPILOT_BYTES} are assumed" in page
    assert f"{CLEARANCE_M:g} m clear" in page
    plan = WatchPlan()
    assert f"open for {plan.opening_s:g} s" in page and f"Every {plan.check_s:g} s" in page
