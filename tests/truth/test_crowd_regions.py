"""Silhouettes to crowd regions: which gaps a disc closes, by hand and against scipy's morphology."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import ndimage

from crowdfence.truth.crowd_regions import crowd_regions
from crowdfence.truth.morphology import close_with_disc


def two_bars(value: int = 1, other: int = 1) -> NDArray[np.uint8]:
    """Bars of 21 pixels in columns 10 and 14: between them a disc of radius below 2 fits, no larger one."""
    bars = np.zeros((31, 40), np.uint8)
    bars[5:26, 10] = value
    bars[5:26, 14] = other
    return bars


def gap_is_filled(regions: NDArray[np.bool_], first_column: int = 11) -> bool:
    gap = regions[12:19, first_column : first_column + 3]
    assert gap.all() or not gap.any()
    return bool(gap.all())


def test_a_gap_is_closed_when_the_disc_does_not_fit() -> None:
    assert not gap_is_filled(crowd_regions(two_bars(), closing_px=1.9))
    assert gap_is_filled(crowd_regions(two_bars(), closing_px=2.0))


def test_a_radius_of_zero_changes_nothing() -> None:
    np.testing.assert_array_equal(crowd_regions(two_bars(), closing_px=0.0), two_bars() != 0)


def test_two_crowds_never_grow_together() -> None:
    np.testing.assert_array_equal(crowd_regions(two_bars(1, 2), closing_px=10.0), two_bars() != 0)


def test_the_gap_is_measured_at_the_depth_of_the_people() -> None:
    """0.5 m with a focal length of 100 px: 5 px at 10 m, 1.25 px at 40 m. The same bars at both depths."""
    bars = np.hstack([two_bars(), two_bars()])
    depth = np.full(bars.shape, np.nan)  # needed only where people are
    depth[:, :40][two_bars() != 0] = 10.0
    depth[:, 40:][two_bars() != 0] = 40.0
    regions = crowd_regions(bars != 0, closing_m=0.5, depth_m=depth, focal_px=100.0)
    assert gap_is_filled(regions, 11)
    assert not gap_is_filled(regions, 51)
    near = crowd_regions(two_bars(), closing_m=0.5, depth_m=10.0, focal_px=100.0)
    np.testing.assert_array_equal(near, crowd_regions(two_bars(), closing_px=5.0))
    infinitely_far = crowd_regions(two_bars(), closing_m=0.5, depth_m=np.inf, focal_px=100.0)
    np.testing.assert_array_equal(infinitely_far, two_bars() != 0)


def test_holes_are_filled_but_not_bays() -> None:
    ring = np.zeros((30, 30), np.bool_)
    ring[5:25, 5:25] = True
    ring[7:23, 7:23] = False
    assert crowd_regions(ring, closing_px=1.0)[5:25, 5:25].all()
    ring[5:7, 10:20] = False  # now open to the outside
    assert not crowd_regions(ring, closing_px=1.0)[15, 15]


def test_small_regions_are_left_out() -> None:
    people = np.zeros((20, 20), np.bool_)
    people[2:5, 2:5] = True
    people[10, 10] = people[11, 11] = True  # connected over the corner: 2 pixels
    regions = crowd_regions(people, closing_px=0.0, min_pixels=3)
    assert np.count_nonzero(regions) == 9
    assert np.count_nonzero(crowd_regions(people, closing_px=0.0, min_pixels=2)) == 11


def test_nobody() -> None:
    assert not crowd_regions(np.zeros((4, 5), np.bool_), closing_px=3.0).any()


masks = hnp.arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12)))


@given(masks, st.floats(0, 5))
@settings(max_examples=60)
def test_closing_against_scipy(mask: NDArray[np.bool_], radius: float) -> None:
    reach = int(radius)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = x * x + y * y <= radius * radius
    padded = np.pad(mask, 2 * reach + 1)
    expected = ndimage.binary_closing(padded, disc)[
        2 * reach + 1 : -2 * reach - 1, 2 * reach + 1 : -2 * reach - 1
    ]
    np.testing.assert_array_equal(close_with_disc(mask, radius), expected)


@given(masks, st.integers(0, 2**32 - 1))
def test_closing_keeps_the_mask_whatever_the_radii(mask: NDArray[np.bool_], seed: int) -> None:
    radius = np.random.default_rng(seed).uniform(0, 6, mask.shape)
    closed = close_with_disc(mask, radius)
    assert (closed | ~mask).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"closing_px": None}, "give the closing radius once"),
        ({"closing_m": 1.0}, "give the closing radius once"),
        ({"closing_px": -1.0}, "closing_px must be a finite length of at least 0, got -1"),
        ({"closing_px": np.nan}, "closing_px must be a finite length"),
        ({"closing_px": 1e6}, "radius 1e.06 needs more than .* cells"),
        ({"closing_px": None, "closing_m": 1.0}, "closing_m needs depth_m and focal_px"),
        (
            {"closing_px": None, "closing_m": 1.0, "depth_m": 5.0, "focal_px": 0.0},
            "focal_px must be positive",
        ),
        (
            {"closing_px": None, "closing_m": 1.0, "depth_m": 0.0, "focal_px": 9.0},
            "depth 0.0 m at row 5, column 10",
        ),
        (
            {"closing_px": None, "closing_m": 1.0, "depth_m": np.ones((3, 3)), "focal_px": 9.0},
            r"depth_m must be one number or \[31, 40\], got \[3, 3\]",
        ),
        ({"silhouettes": np.zeros((3, 3))}, "silhouettes must be bool or integer"),
        ({"silhouettes": np.zeros((3, 3, 3), np.uint8)}, "silhouettes must be bool or integer"),
    ],
)
def test_bad_input(change: dict[str, object], message: str) -> None:
    arguments = {"silhouettes": two_bars(), "closing_px": 2.0} | change
    with pytest.raises(ValueError, match=message):
        crowd_regions(**arguments)  # type: ignore[arg-type]


def test_closing_refuses_what_is_no_mask() -> None:
    with pytest.raises(ValueError, match=r"mask must be bool \[H, W\]"):
        close_with_disc(np.zeros((3, 3)), 1.0)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="closing radius must be finite and at least 0, got -1"):
        close_with_disc(np.ones((3, 3), np.bool_), -1.0)
