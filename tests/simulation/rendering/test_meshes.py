"""Meshes of people and things: sound triangles, true sizes, joints on both sides."""

import numpy as np
import pytest

from crowdfence.simulation.landscape.props import PROP_KINDS
from crowdfence.simulation.rendering.instances import packed_colours
from crowdfence.simulation.rendering.mesh_catalogue import cyclist_family, people_family, prop_families
from crowdfence.simulation.rendering.meshes.shape import FIXED, Limb, ball, box, joined, loft, tube
from crowdfence.simulation.rendering.season_palette import SeasonPalette
from crowdfence.simulation.rendering.shader_program import shader_source

FAMILIES = {**prop_families(), "person": people_family(), "cyclist": cyclist_family()}


def volume(shape):
    """Signed volume inside a closed surface (divergence theorem); positive when its faces look outwards."""
    a, b, c = (shape.position[shape.triangles[:, k]] for k in range(3))
    return np.einsum("ni,ni->", np.cross(a, b), c) / 6


def test_every_kind_of_prop_has_a_mesh():
    assert set(prop_families()) == set(PROP_KINDS)


@pytest.mark.parametrize("name", FAMILIES)
def test_meshes_are_sound(name):
    for levels in FAMILIES[name].variants:
        counts = [len(shape.triangles) for shape in levels]
        assert counts == sorted(counts), "near levels have more triangles"
        for shape in levels:
            assert np.isfinite(shape.position).all()
            assert shape.triangles.min() >= 0
            assert shape.triangles.max() < len(shape.position)
            np.testing.assert_allclose(np.linalg.norm(shape.normal, axis=1), 1.0, atol=1e-6)
            slots = np.unique(shape.colour[:, 3])
            assert ((slots < 6) | (slots == FIXED)).all()
            assert set(shape.limb) <= {int(limb) for limb in Limb}
            assert (np.linalg.norm(shape.position, axis=1) <= FAMILIES[name].radius_m + 1e-9).all()


@pytest.mark.parametrize("kind", range(6))
def test_people_are_people_sized_and_have_two_arms_and_legs(kind):
    for shape in people_family().variants[kind]:
        assert shape.position[:, 2].min() == pytest.approx(0.0, abs=0.08)
        assert shape.position[:, 2].max() == pytest.approx(1.76, abs=0.05)
        assert 0.4 < np.ptp(shape.position[:, 1]) < 0.75
        for left, right in (
            (Limb.LEFT_LEG, Limb.RIGHT_LEG),
            (Limb.LEFT_SHIN, Limb.RIGHT_SHIN),
            (Limb.LEFT_ARM, Limb.RIGHT_ARM),
            (Limb.LEFT_FOREARM, Limb.RIGHT_FOREARM),
        ):
            one, other = shape.position[shape.limb == left], shape.position[shape.limb == right]
            assert len(one) == len(other) > 0
            assert (one[:, 1] > -0.02).all()
            assert (other[:, 1] < 0.02).all()


@pytest.mark.parametrize("name", ["car", "van", "tent", "marquee", "stage"])
def test_big_things_fit_into_the_ground_that_they_block(name):
    from crowdfence.simulation.landscape.furnishing import Furnishing
    from crowdfence.simulation.landscape.ground import Ground, cover_weights
    from crowdfence.simulation.landscape.surface_lattice import square_lattice

    lattice = square_lattice(64.0, 1.0)
    flat = np.zeros((lattice.rows, lattice.columns), np.float32)
    things = Furnishing(
        Ground(lattice, flat, cover_weights(flat.shape), flat, flat, flat), np.random.default_rng(1)
    )
    things.place(name, np.zeros(1), np.zeros(1), heading_rad=0.0)
    for shape in FAMILIES[name].variants[0]:
        # What is lower than a person's head must not reach where a person may stand.
        low = shape.position[shape.position[:, 2] < 1.6]
        assert things.obstacles.blocked(low[:, 0], low[:, 1], 0.25).all()


def test_solids_have_the_volume_of_geometry():
    assert volume(box((1, 2, 3), (2, 3, 4))) == pytest.approx(24.0)
    fine_tube = tube((0, 0, 0), (3, 4, 0), 0.5, 64)
    assert volume(fine_tube) == pytest.approx(np.pi * 0.25 * 5, rel=5e-3)
    cone = tube((0, 0, 0), (0, 0, 3), 1.0, 64, end_radius=0.0)
    assert volume(cone) == pytest.approx(np.pi, rel=5e-3)
    assert volume(ball((5, 5, 5), (1, 2, 3), rings=40, sides=64)) == pytest.approx(8 * np.pi, rel=1e-2)
    assert volume(loft([(0, 0, 0, 1, 1), (0, 0, 2, 1, 1)], 4)) == pytest.approx(4.0)  # a square prism


def test_turning_and_scaling_keep_normals_upright_to_the_surface():
    shape = ball((0, 0, 0), 1.0, rings=20, sides=32).scaled((1.0, 1.0, 0.5))
    side = np.abs(shape.position[:, 2]) < 0.05
    np.testing.assert_allclose(shape.normal[side][:, 2], 0.0, atol=0.25)
    both = joined([shape, shape.moved((3, 0, 0))])
    assert volume(both) == pytest.approx(2 * volume(shape))


def test_colours_survive_packing():
    colours = np.array([[0, 0, 0], [255, 255, 255], [1, 2, 3], [200, 100, 50]], np.uint8)
    packed = packed_colours(colours)
    assert packed.dtype == np.float32
    assert packed.tolist() == [0, 16777215, 1 + 2 * 256 + 3 * 65536, 200 + 100 * 256 + 50 * 65536]


@pytest.mark.parametrize("season", ["summer", "autumn", "winter", "dry"])
def test_seasons_colour_leaves_but_not_needles(season):
    summer = np.array([[74, 104, 44], [96, 120, 50], [62, 92, 48]], np.uint8)
    palette = SeasonPalette(season)
    assert (palette.things("conifer", summer) == summer).all()
    assert (palette.things("broadleaf", summer) == summer).all() == (season == "summer")
    assert palette.covers().shape == (16, 3)
    assert (palette.covers() < 1.0).all()


def test_shader_includes_are_expanded():
    text = shader_source("thing.vert")
    assert "#include" not in text
    assert "pose_cyclist" in text
    assert text.count("#version") == 1
