"""What docs/recordings.md shows runs, on flights written with the names that it uses."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from crowdfence import open_recording
from crowdfence.cli.app import app
from support.foreign_recordings import (
    camera_pose_messages,
    frames,
    picture_messages,
    rows,
    write_bag,
    write_dem,
    write_film,
    write_photographs,
    write_subtitles,
    write_ulog,
)
from support.small_data_sets import DataSet, write_data_set

PAGE = (Path(__file__).parents[2] / "docs" / "recordings.md").read_text()


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flights")
    write_dem(folder / "dem.tif")
    for name in ("DJI_0001", "DJI_0002"):
        _, start_ns = write_film(folder / f"{name}.MP4")
        write_subtitles(folder / f"{name}.SRT", start_ns)
    write_film(folder / "film.mp4")
    write_ulog(folder / "film.ulg")
    write_photographs(folder / "photos")
    people = [(4.0, 6.0), (4.8, 6.2), (4.4, 6.9)]
    eyes = [(0.5, 1.0, 2.6), (9.0, 2.0, 2.6)]
    write_data_set(folder / "Wildtrack", DataSet(True, eyes, (4.5, 6.5, 0.8), [people] * 2))
    write_bag(
        folder / "flight_bag", "sqlite3", [*picture_messages("uav1", "cam"), *camera_pose_messages("uav1")]
    )
    camera = frames()[0].camera
    (folder / "camera.yaml").write_text(
        f"image_width: {camera.width}\nimage_height: {camera.height}\n"
        f"camera_matrix: {{data: [{camera.fx}, 0, {camera.cx - 0.5}, 0, {camera.fy}, "
        f"{camera.cy - 0.5}, 0, 0, 1]}}\n"
    )
    return folder


def shown() -> list[str]:
    blocks = re.findall(r"^```\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    return [line for block in blocks for line in block.splitlines() if line.startswith("crowdfence ")]


@pytest.mark.parametrize("line", shown(), ids=lambda line: line[11:60])
def test_every_command_works(line: str, flights: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(flights)
    done = CliRunner().invoke(app, shlex.split(line)[1:], catch_exceptions=False)
    assert done.exit_code == 0, done.output


def test_the_options_of_python_are_those_of_the_command_line(
    flights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(flights)
    film = open_recording(["DJI_0001.MP4", "DJI_0002.MP4"], mount="north:-60,0", calibration="camera.yaml")
    assert len(film.drones) == 2 and film.frames
    assert np.allclose(film.frames[0].world_from_camera[:3, 2], [0, 0.5, -np.sqrt(0.75)], atol=1e-6)
    assert rows()
