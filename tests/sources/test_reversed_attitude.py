"""Attitudes that turn the world into the camera are valid rotations, and put what was seen elsewhere."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from crowdfence import open_recording
from crowdfence.sources.reversed_attitude import leans_reversed, reversal_doubt
from support.small_recordings import EPOCH_NS, write_hovering

LEVEL = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # looks north
HEADINGS = np.linspace(40.0, 95.0, 12)


def looking(headings_deg: np.ndarray, pitch_deg: float, roll_deg: float = 0.0) -> Rotation:
    """By heading clockwise from north, pitch up from level, roll clockwise as seen from behind."""
    about_up = Rotation.from_euler("z", -np.atleast_1d(headings_deg)[:, None], degrees=True)
    return about_up * LEVEL * Rotation.from_euler("XZ", [pitch_deg, roll_deg], degrees=True)


def test_a_camera_that_hangs_level_the_other_way_round_is_doubted() -> None:
    """Of a camera that looks down by 55 degrees, the inverse has an x axis of height cos(-55) sin(heading):
    asin(.574 .643) = 21.6 degrees at 40, asin(.574 .996) = 34.8 at 95 and 35.0 at 90 degrees."""
    turns = looking(np.array([40.0, 90.0, 95.0]), -55.0)
    doubt = reversal_doubt(turns.inv().as_matrix())
    assert doubt is not None and "by 22 to 35 degrees" in doubt
    assert leans_reversed(turns.as_matrix()) and not leans_reversed(turns.inv().as_matrix())


@pytest.mark.parametrize(
    "turns",
    [
        looking(HEADINGS, -55.0),
        looking(np.zeros(5), -30.0),  # north all the time
        looking(np.linspace(0, 350, 12), -90.0),  # straight down
        looking(np.linspace(0, 350, 12), -90.0).inv(),  # nobody can tell
        looking(np.zeros(5), -30.0, 90.0),  # a picture in portrait, to the north
        # Fixed to a drone that rolls in the wind on its way to the north.
        Rotation.concatenate([looking(np.zeros(1), -40.0, roll) for roll in (-12, 7, 0, 12)]),
        # A plane that banks from side to side while it turns: its camera is fixed.
        Rotation.concatenate(
            [looking(np.array([h]), -40.0, r) for h, r in zip(HEADINGS, [-25, 25] * 6, strict=True)]
        ),
    ],
)
def test_what_may_hang_so_is_not(turns: Rotation) -> None:
    assert reversal_doubt(turns.as_matrix()) is None


def test_a_track_of_no_poses_is_not() -> None:
    assert reversal_doubt(np.zeros((0, 3, 3))) is None


@pytest.mark.parametrize("reverse", [False, True])
def test_a_recording_warns_of_it(tmp_path: Path, reverse: bool) -> None:
    stamps = [EPOCH_NS + number * 100_000_000 for number in range(10)]
    folder = write_hovering(tmp_path / "rec", {"uav1": stamps})
    rows = list(csv.DictReader((folder / "poses.csv").open()))
    for number, row in enumerate(rows):
        turn = looking(np.array([20.0 * number]), -50.0)[0]
        x, y, z, w = (turn.inv() if reverse else turn).as_quat()
        row |= {"qw": str(w), "qx": str(x), "qy": str(y), "qz": str(z)}
    with (folder / "poses.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    said = [line for line in open_recording(folder).warnings if "would hang level all the time" in line]
    assert len(said) == reverse
    assert all(line.startswith("uav1: ") for line in said)
