"""Worlds in colours of their own, with people of other builds."""

import colorsys

import numpy as np
import pytest

from crowdfence.simulation.people.bodies import random_bodies, usual_bodies
from crowdfence.simulation.random_colours import random_clothes, rgb_of_hsv
from crowdfence.simulation.rendering.random_palette import RandomPalette
from crowdfence.simulation.rendering.season_palette import SeasonPalette
from crowdfence.simulation.scenarios.scenario import ScenarioError
from crowdfence.simulation.scenarios.scenario_file import load_scenario
from crowdfence.simulation.scene import build_scene

LEAVES = np.tile(np.array([[74, 104, 44]], np.uint8), (400, 1))


def test_hues_as_the_standard_library_has_them() -> None:
    hue, saturation, value = np.random.default_rng(1).random((3, 60))
    expected = [colorsys.hsv_to_rgb(*hsv) for hsv in zip(hue, saturation, value, strict=True)]
    np.testing.assert_allclose(rgb_of_hsv(hue, saturation, value), 255.0 * np.array(expected), atol=1e-9)
    np.testing.assert_allclose(rgb_of_hsv(hue + 1.0, saturation, value), rgb_of_hsv(hue, saturation, value))


def test_a_seed_is_a_palette() -> None:
    """Equal for one seed, another for the next; also needles, which no season turns, get new colours."""
    one, same, other = (RandomPalette("summer", seed) for seed in (5, 5, 6))
    for kind in ("conifer", "bush"):
        np.testing.assert_array_equal(one.things(kind, LEAVES), same.things(kind, LEAVES))
        assert (one.things(kind, LEAVES) != other.things(kind, LEAVES)).any()
        assert len(np.unique(one.things(kind, LEAVES), axis=0)) > 10
    np.testing.assert_array_equal(one.covers(), same.covers())
    usual = SeasonPalette("summer").covers()
    assert one.covers().shape == usual.shape and one.covers().dtype == np.float32
    assert (one.covers() != usual).any() and one.covers().min() > 0.0 and one.covers().max() < 1.0


def test_a_mission_has_three_to_thirteen_colours_of_clothes() -> None:
    """Eleven numbers, equally likely: 400 seeds miss one with a chance of 11 * (10 / 11)^400 = 3e-16."""
    assert {len(random_clothes(seed)) for seed in range(400)} == set(range(3, 14))
    np.testing.assert_array_equal(random_clothes(3), random_clothes(3))


def test_people_wear_the_colours_of_their_mission_and_stay_where_they_are() -> None:
    """A top is one of the colours times a shade: 8 % brighter or darker as a whole and 3 % per channel, one
    standard deviation each. Four of both together, sqrt(8^2 + 3^2) = 8.5 %, are 34 %; bytes round by one."""
    natural = build_scene(load_scenario("race"), 3).people
    odd = build_scene(load_scenario("race", looks="random"), 3).people
    np.testing.assert_array_equal(odd.positions(2.0), natural.positions(2.0))
    np.testing.assert_array_equal(odd.colours[:, 0], natural.colours[:, 0])  # skin
    clothes = random_clothes(3)
    odd_tops, natural_tops = (
        (np.abs(people.colours[:, None, 2] - clothes) <= 0.34 * clothes + 1.0).all(axis=-1).any(axis=1)
        for people in (odd, natural)
    )
    assert odd_tops.all()
    assert natural_tops.mean() < 0.5


def test_bodies_are_random_only_where_wanted() -> None:
    natural = usual_bodies(500, 3)
    people = build_scene(load_scenario("race"), 3).people
    np.testing.assert_array_equal(people.bodies.girth, usual_bodies(people.count, 3).girth)
    assert natural.girth.min() >= 0.75 and natural.girth.max() <= 1.4 and natural.stance_rad.max() <= 0.2
    one, same, other = random_bodies(500, 3), random_bodies(500, 3), random_bodies(500, 4)
    np.testing.assert_array_equal(one.girth, same.girth)
    np.testing.assert_array_equal(one.stance_rad, same.stance_rad)
    assert (one.girth != other.girth).all() and one.cheering_share != other.cheering_share
    for bodies in (one, other):
        assert bodies.girth.min() >= 0.6 and bodies.girth.max() <= 1.8 and bodies.girth.std() > 0.1
        assert bodies.stance_rad.min() == 0.0 and bodies.stance_rad.max() <= 0.45
        assert 0.1 <= bodies.cheering_share <= 0.7


def test_unknown_looks_are_refused() -> None:
    with pytest.raises(ScenarioError, match="looks must be one of natural, random; got 'loud'"):
        load_scenario("race", looks="loud")
