"""What docs/alignment.md shows runs, on a flight whose poses are a little wrong."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from crowdfence import open_recording
from crowdfence.alignment.estimate import SURE_ENOUGH
from crowdfence.alignment.frame_pairs import MOST_FRAMES
from crowdfence.alignment.offset_fit import COMMON
from crowdfence.alignment.pose_jump import LEAST
from crowdfence.cli.app import app
from crowdfence.sources.convert import convert
from support.painted_flights import circling, paint, write_flight, write_level

PAGE = (Path(__file__).parents[2] / "docs" / "alignment.md").read_text()


def test_the_page_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_flight(tmp_path / "plain", circling, paint(), turned_deg=(0.4, -0.3, 0.2), late_s=0.1)
    convert(open_recording(folder), tmp_path / "flight.mcap")
    write_level(tmp_path / "dem.tif")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for language, code in re.findall(r"^```(\w*)\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE):
        if language == "python":
            exec(compile(code, "alignment.md", "exec"), names)
            continue
        assert language == "sh"
        for line in code.splitlines():
            done = CliRunner().invoke(app, shlex.split(line)[1:], catch_exceptions=False)
            assert done.exit_code == 0, f"{line}\n{done.output}"
    righted = open_recording("corrected.mcap").frames
    assert len(righted) == len(names["righted"].frames) > 0
    for a, b in zip(righted, names["righted"].frames, strict=True):
        assert a.world_from_camera == pytest.approx(b.world_from_camera, abs=1e-9)


def test_the_numbers_on_the_page_are_those_of_the_code() -> None:
    assert f"Up to {MOST_FRAMES} pictures of each drone" in PAGE
    assert f"({COMMON[0]:g} degrees, {1e3 * COMMON[3]:g} ms, {COMMON[6]:g} m)" in PAGE
    assert f"Jumps below {LEAST[0]:g}\n  degrees or {LEAST[-1]:g} m" in PAGE
    told = re.findall(r"^\| ([a-z, ]+) \| .* \| put right", PAGE, re.MULTILINE)
    assert {name for row in told for name in row.split(", ")} == set(SURE_ENOUGH)
