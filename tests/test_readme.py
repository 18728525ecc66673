"""What the README and the pages that it links to show is what happens."""

import contextlib
import io
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from crowdfence import Detector
from crowdfence.cli.options import Coverage, MethodName, Surface
from support.command_line import commands

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = [*ROOT.glob("*.md"), *ROOT.glob("[!.]*/*.md")]


def printed_by(example: int) -> list[str]:
    """Lines that a Python example of the README prints."""
    code = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)[example]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, str(README), "exec"), {})
    return printed.getvalue().splitlines()


def test_the_first_example_goes_from_a_recording_to_zones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    lines = printed_by(0)
    zones = json.loads(Path("zones.geojson").read_text())["features"]
    assert len(lines) == len(zones) >= 2  # the crowds of the demo's picture
    for line, zone in zip(lines, zones, strict=True):
        seen_by = zone["properties"]["seen_by"]
        assert line.startswith(f"{zone['properties']['id']} ")
        assert line.endswith(f"seen by {' '.join(seen_by)}")
        assert seen_by and set(seen_by) <= {"uav1", "uav2", "uav3"}
    assert json.loads(Path("out/flight/zones.geojson").read_text())["features"] == zones


def test_the_second_example_finds_the_crowd_it_draws() -> None:
    counts, bounds = printed_by(1)
    never_seen, occluded, empty, stale, crowd, not_cleared = map(int, re.findall(r"\d+", counts))
    # Two by two heatmap cells of 40 pixels: at 19 m and f = 400 that is 3.8 m, at most 5 x 5 voxels.
    assert 9 <= crowd <= 25
    # The image covers 640 / 400 * 19 = 30.4 by 22.8 m of the plain.
    assert 29 * 22 <= empty + crowd <= 32 * 24
    assert never_seen + empty + crowd == 60 * 60
    assert occluded == stale == not_cleared == 0
    # The crowd's cells are the middle of the image, which lies above (30, 30).
    west, south, east, north = map(float, re.findall(r"[\d.]+", bounds))
    assert 27 <= west < 30 < east <= 33 and 27 <= south < 30 < north <= 33


def status_table() -> dict[str, str]:
    """Part -> status."""
    _, _, table = README.read_text().partition("| part | status |\n|---|---|\n")
    rows = table.partition("\n\n")[0].splitlines()
    return dict(tuple(map(str.strip, row.strip("|").split("|"))) for row in rows)


def test_the_status_table_names_what_there_is_and_nothing_that_is_still_to_come() -> None:
    known = {*commands(), *(one.value for choice in (MethodName, Coverage, Surface) for one in choice)}
    known.add(Detector().contract.name)
    named: dict[bool, set[str]] = {True: set(), False: set()}
    for part, status in status_table().items():
        assert status.startswith(("works", "coming")), part
        named[status.startswith("works")].update(re.findall(r"`([^`]+)`", part))
    assert named[True] >= {"paper", "or", "detect", "train", "calibrate", "model check", "model evaluate"}
    assert named[True] <= known
    assert not named[False] & known


def shown_commands(page: Path) -> Iterator[str]:
    """What follows "crowdfence" in fenced code, indented code and code between backticks."""
    fence = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
    text = page.read_text()
    code = [line for kind, block in fence.findall(text) if kind != "toml" for line in block.splitlines()]
    code += re.findall(r"^    (\S.*)$", text, re.MULTILINE)
    code += re.findall(r"`([^`\n]+)`", fence.sub("", text))
    return (line.removeprefix("crowdfence ") for line in code if line.startswith("crowdfence "))


def test_the_commands_that_the_pages_show_exist_with_their_options() -> None:
    known = commands()
    shown = set()
    for page in PAGES:
        for line in shown_commands(page):
            name = next(
                (name for name in (" ".join(line.split()[:2]), line.split()[0]) if name in known), None
            )
            assert name is not None, f"{page.name}: crowdfence {line}"
            shown.add(name)
            options = set(re.findall(r"(?<!\S)--?[a-z][a-z0-9-]*", line))
            assert options <= known[name], f"{page.name}: crowdfence {line}"
    assert shown >= {"run", "inspect", "detect", "model check", "model evaluate", "evaluate", "simulate"}
    assert all("--json" in options for options in known.values()), "README: every command takes --json"


def test_every_relative_link_leads_to_a_file() -> None:
    links = [
        (page, target)
        for page in PAGES
        for target in re.findall(r"\]\(([^)#\s]+)", page.read_text())
        if "://" not in target
    ]
    assert {target for _, target in links} >= {"docs/demo.png", "ARCHITECTURE.md", "training/README.md"}
    assert [(page.name, target) for page, target in links if not (page.parent / target).exists()] == []
