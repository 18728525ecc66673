"""A page left open while another mission begins at its address: nothing of the first is taken for it."""

from pathlib import Path

from playwright.sync_api import Browser, Error

from support.live_field import level_mission
from support.map_page import Console, Server, free_port, open_console, replay
from support.near_ground import write_near_ground


def name_shown(console: Console) -> str | None:
    try:
        return str(console.state("scene.name"))
    except Error:  # while the page begins anew
        return None


def test_the_ground_alerts_and_zones_are_those_of_the_mission_that_answers(
    browser: Browser, tmp_path: Path
) -> None:
    first = Server(tmp_path / "tokens.json", free_port(), mission=replay("recorded", "8"))
    first.mission += ["--terrain", str(write_near_ground(tmp_path))]
    second = Server(first.tokens, first.port, mission=[*level_mission(tmp_path), "--name", "meadow"])
    first.admit("operator")
    second.token = first.token
    context = browser.new_context(reduced_motion="reduce")
    try:
        first.start()
        console = open_console(context, first, "operator")
        console.wait("mode", lambda mode: mode == "finished")
        console.choose("Z1")
        console.pause()
        first.kill()
        console.wait("connected", lambda connected: connected is False)
        second.start()
        for _ in range(200):
            if name_shown(console) == "meadow":
                break
            console.page.wait_for_timeout(150)
        console.wait("moment.stamp_ns")
        console.wait("heights")
        assert console.state("heights.frame") == second.ask("/scene")["terrain"]
        assert console.state("moment.zones.zones") == [] and console.state("selection") is None
        assert console.state("alerts") == [] and console.state("time.following")
        assert len(console.state("timeline.points")) <= 1
    finally:
        context.close()
        first.kill()
        second.kill()
