"""The colour map: what it promises to people who see colours differently."""

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence.exports.colours import STATE_COLOURS, probability_colours, state_colours
from crowdfence.voxel_state import VoxelState

# Machado, Oliveira and Fernandes 2009, severity 1.0, on linear RGB.
PROTAN = np.array(
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
)
DEUTAN = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
)
TRITAN = np.array(
    [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
)
EYES = {"full": np.eye(3), "protan": PROTAN, "deutan": DEUTAN, "tritan": TRITAN}


def lab(rgb: NDArray[np.uint8], eye: NDArray[np.float64]) -> NDArray[np.float64]:
    """CIELAB (D65) of sRGB colours [..., 3] as seen by an eye."""
    encoded = np.asarray(rgb) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    seen = (linear @ eye.T).clip(0, 1)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    ratio = seen @ to_xyz.T / [0.95047, 1.0, 1.08883]
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = np.moveaxis(f, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


@pytest.mark.parametrize("eye", EYES.values(), ids=EYES.keys())
def test_states_differ_for_every_kind_of_eye(eye: NDArray[np.float64]) -> None:
    colours = {state: lab(np.array(colour), eye) for state, colour in STATE_COLOURS.items()}
    for first, second in itertools.combinations(VoxelState, 2):
        # 2.3 is a just noticeable difference; hatches help on the picture, but not in an OctoMap.
        assert np.linalg.norm(colours[first] - colours[second]) > 15, (first.name, second.name)


@pytest.mark.parametrize("eye", EYES.values(), ids=EYES.keys())
@pytest.mark.parametrize("threshold", [0.1, 0.5, 0.9])
def test_more_probable_crowd_is_darker_for_every_kind_of_eye(
    eye: NDArray[np.float64], threshold: float
) -> None:
    lightness = lab(probability_colours(np.linspace(threshold, 1.0, 40), threshold), eye)[:, 0]
    assert (np.diff(lightness) < 0).all()


@pytest.mark.parametrize("eye", EYES.values(), ids=EYES.keys())
def test_crossing_the_threshold_shows(eye: NDArray[np.float64]) -> None:
    below, above = lab(probability_colours([0.4999, 0.5], 0.5), eye)
    assert np.linalg.norm(below - above) > 10


def test_only_seen_ground_is_coloured_by_probability() -> None:
    never, occluded, empty, stale, crowd, not_cleared = VoxelState
    probability = [np.nan, np.nan, 0.0, np.nan, np.nan, 1.0]
    colours = state_colours(probability, [never, occluded, empty, stale, not_cleared, crowd], 0.5)
    assert [tuple(colour) for colour in colours[:5].tolist()] == [
        STATE_COLOURS[known] for known in (never, occluded, empty, stale, not_cleared)
    ]
    with pytest.raises(ValueError, match="NaN has no place"):
        state_colours([np.nan], [crowd], 0.5)


def test_a_threshold_of_one_leaves_one_crowd_colour() -> None:
    assert probability_colours([1.0], 1.0).tolist() == [[255, 214, 70]]
