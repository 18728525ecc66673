"""Textures: pictures of nothing that a seed repeats, of every family, scale and colour."""

import numpy as np
import pytest

from crowdfence.detector_training.textures import FAMILIES, palette, texture


@pytest.mark.parametrize("family", dict.fromkeys(FAMILIES), ids=lambda family: family.__name__)
def test_a_family_fills_the_picture_and_a_seed_repeats_it(family):
    first, again, other = (family(np.random.default_rng(seed), 96, 64) for seed in (1, 1, 2))
    assert first.shape == (64, 96, 3) and first.dtype == np.uint8
    assert (first == again).all() and (first != other).any()
    outside = (first == 0).all(axis=2)  # a pattern seen aslant must reach over the corners
    assert outside[[0, 0, -1, -1], [0, -1, 0, -1]].sum() <= 1


def test_some_textures_are_rough_and_some_smooth():
    """Neighbouring pixels correlate below .6 in one picture and above .9 in another; white noise has 0, a
    rendering of a meadow .95 and more."""
    correlations = []
    for seed in range(24):
        grey = texture(np.random.default_rng(seed), 128, 96).astype(np.float64).mean(axis=2)
        correlations.append(np.corrcoef(grey[:, 1:].ravel(), grey[:, :-1].ravel())[0, 1])
    assert min(correlations) < 0.6 and max(correlations) > 0.9


def test_colours_of_a_palette_lie_in_range_and_go_together():
    for seed in range(20):
        colours = palette(np.random.default_rng(seed), 200)
        assert colours.shape == (200, 3) and colours.min() >= 0.0 and colours.max() <= 1.0
    # Colours of one palette are nearer to one another than colours of different ones.
    within = [palette(np.random.default_rng(seed), 200).std(axis=0).mean() for seed in range(20)]
    means = np.array([palette(np.random.default_rng(seed), 200).mean(axis=0) for seed in range(20)])
    assert np.median(within) < 2.0 * means.std(axis=0).mean()
