"""Heatmaps in the wrong units leave crowds out of the map: a run says so where all of it looks so."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import crowdfence as cf
from crowdfence.pipeline.heatmap_units import HeatmapUnits
from crowdfence.pipeline.run import Run

CAMERA = cf.Camera.pinhole(640, 480, 400.0, 400.0, 320.0, 240.0)
LOOKS_DOWN = np.array([[1, 0, 0, 30], [0, -1, 0, 30], [0, 0, -1, 20], [0, 0, 0, 1.0]])
BEGIN_NS = 1_760_000_000_000_000_000

MASK = np.zeros((48, 64), np.uint8)
MASK[20:28, 28:36] = 1
"""A crowd of 64 cells in 3072, 2 %."""


def said(heatmaps: Sequence[NDArray[np.generic]]) -> list[str]:
    units = HeatmapUnits()
    for number, heatmap in enumerate(heatmaps):
        units.look(cf.View("a", BEGIN_NS + number * 10**8, CAMERA, LOOKS_DOWN, heatmap))
    return units.warnings


def sixteen_bits(levels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """As a 16-bit picture is read."""
    return (levels / 65535).astype(np.float32)


def test_masks_of_one_in_eight_bits_are_named() -> None:
    assert said([MASK, 0 * MASK, MASK]) == [
        "a: its 3 heatmaps look like masks of 0 and 1 (no 8-bit level is above 1), so that its crowds are "
        "read as probabilities of 0.4 % at most and ground under them as free: multiply them by 255"
    ]


def test_eight_bit_values_in_sixteen_bits_are_named() -> None:
    soft = sixteen_bits(MASK * np.random.default_rng(17).integers(128, 256, MASK.shape, np.uint8))
    (warning,) = said([soft])
    assert "a: its 1 heatmaps look like 0 to 255 saved with 16 bits" in warning
    assert warning.endswith("multiply them by 257")


@pytest.mark.parametrize(
    "heatmaps",
    [
        [0 * MASK],  # nothing at all
        [MASK, 200 * MASK],  # a quiet frame before a crowd
        [200 * MASK, MASK],  # and behind one
        [MASK, 2 * MASK],  # 0.8 %: units that are right, of a detector that is hardly ever sure
        [np.eye(48, 64, dtype=np.uint8)],  # scattered specks
        [sixteen_bits(100 * MASK)],  # 0.15 %
        [(MASK * 0.003).astype(np.float32)],  # no multiple of 1/65535
        [MASK.astype(np.float32)],
    ],
)
def test_heatmaps_in_the_right_units_are_not_doubted(heatmaps: Sequence[NDArray[np.generic]]) -> None:
    assert said(heatmaps) == []


def test_each_drone_is_looked_at_by_itself() -> None:
    units = HeatmapUnits()
    units.look(cf.View("a", BEGIN_NS, CAMERA, LOOKS_DOWN, MASK))
    units.look(cf.View("b", BEGIN_NS, CAMERA, LOOKS_DOWN, 255 * MASK))
    assert [warning[:2] for warning in units.warnings] == ["a:"]


def run_of(folder: Path, heatmap: NDArray[np.generic]) -> Run:
    """Three frames of one drone that hovers 20 m above a plain."""
    (folder / "heatmaps").mkdir()
    rows = ["drone,stamp_ns,x,y,z,qw,qx,qy,qz"]
    for number in range(3):
        stamp_ns = BEGIN_NS + number * 10**8
        rows.append(f"a,{stamp_ns},30,30,20,0,1,0,0")
        Image.fromarray(heatmap).save(folder / "heatmaps" / f"a_{stamp_ns}.png")
    (folder / "poses.csv").write_text("\n".join(rows) + "\n")
    intrinsics = {"width": 640, "height": 480, "fx": 400, "fy": 400, "cx": 320, "cy": 240}
    (folder / "recording.json").write_text(json.dumps({"cameras": {"*": intrinsics}}))
    plain = cf.Terrain.from_height_map(np.zeros((60, 60)), cell_size_m=1.0)
    return cf.run(cf.open_recording(folder), plain)


@pytest.mark.parametrize("heatmap", [MASK, (255 * MASK).astype(np.uint16)])
def test_a_run_warns_of_them(tmp_path: Path, heatmap: NDArray[np.generic]) -> None:
    found = run_of(tmp_path, heatmap)
    assert not found.zones and any("a: its 3 heatmaps look like" in warning for warning in found.warnings)


def test_a_run_of_a_crowd_says_nothing_of_units(tmp_path: Path) -> None:
    found = run_of(tmp_path, 255 * MASK)
    assert len(found.zones) == 1 and not any("look like" in warning for warning in found.warnings)
