"""A flight whose heatmaps are all exactly 0 clears ground with full weight: a run says so."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import crowdfence as cf
from crowdfence.pipeline.nobody_shown import NobodyShown
from support.small_recordings import flight, write_folder

CAMERA = cf.Camera.pinhole(32, 24, 20.0, 20.0, 16.0, 12.0)
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
EMPTY = np.zeros((6, 8), np.float32)
FAINT = EMPTY.copy()
FAINT[3, 4] = 1e-6


def said(heatmaps: list[NDArray[np.float32]]) -> list[str]:
    shown = NobodyShown()
    for number, heatmap in enumerate(heatmaps):
        shown.look(cf.View(f"uav{number % 2}", number * 10**8, CAMERA, DOWN, heatmap))
    return shown.warnings


def test_ten_heatmaps_of_nobody_are_told() -> None:
    (warning,) = said([EMPTY] * 10)
    assert warning.startswith("all 10 heatmaps are 0 everywhere")


@pytest.mark.parametrize("heatmaps", [[], [EMPTY] * 9, [*[EMPTY] * 10, FAINT], [FAINT, *[EMPTY] * 10]])
def test_fewer_and_such_that_show_anything_are_not(heatmaps: list[NDArray[np.float32]]) -> None:
    assert said(heatmaps) == []


@pytest.mark.parametrize(("heatmap", "told"), [(EMPTY, 1), (FAINT, 0)])
def test_a_run_warns_of_a_function_that_gives_them(
    tmp_path: Path, heatmap: NDArray[np.float32], told: int
) -> None:
    recording = cf.open_recording(write_folder(tmp_path, flight(6)))
    plain = cf.Terrain.from_height_map(np.zeros((200, 200)), cell_size_m=1.0, origin=(-340.0, 20.0, 0.0))
    found = cf.run(recording, plain, detector=lambda _: heatmap)
    frames = len(recording.frames)
    assert frames == 18
    warned = [one for one in found.warnings if one.startswith(f"all {frames} heatmaps are 0 everywhere")]
    assert len(warned) == told
