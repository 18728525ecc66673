"""Parts of a picture at the size that a model knows, pictures of unknown scale at several."""

import math
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from crowdfence import Detector, DetectorError
from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.inference import picture_parts
from crowdfence.detector.inference.people_output import People
from crowdfence.detector.inference.people_scale import gsd_of_people
from crowdfence.detector.inference.picture_parts import (
    AFFORDABLE_PX,
    AFFORDABLE_SHARE,
    MARGIN_PX,
    Enlarge,
    far_cells,
    near_parts,
    parts_by_gsd,
    suspicious_parts,
)
from support.onnx_models import contract as document
from support.onnx_models import write_fixed_output_model, write_map_model

KNOWN_M = (0.05, 0.3)
STRIDE = 4


def picture(height: int = 96, width: int = 128) -> np.ndarray:
    return np.zeros((height, width, 3), np.uint8)


def sizes(gsd_m: Any, enlarge: Enlarge = "always") -> list[float]:
    return [part.size for part in parts_by_gsd(gsd_m, KNOWN_M, picture(), STRIDE, enlarge)]


@pytest.mark.parametrize(
    ("gsd_m", "size"),
    [
        (0.05, 1.0),
        (0.3, 1.0),
        (0.049, 0.5),  # shown at 0.098 m per pixel
        (0.025, 0.5),  # 0.05
        (0.02, 0.25),  # 0.08
        (0.006, 0.0625),  # 0.096: halved four times
        (0.31, 2.0),  # 0.155
        (3.0, 2.0),  # no more than twofold
    ],
)
def test_the_size_of_a_part_follows_from_its_metres_per_pixel(gsd_m: float, size: float) -> None:
    assert sizes(gsd_m) == [size]


def test_ground_beyond_what_is_known_is_enlarged_as_far_as_is_affordable() -> None:
    """A picture of 128 x 96 may be shown at 307,200 pixels, one of 1280 x 960 not at four times its own."""
    assert sizes(0.4, "affordable") == [2.0]
    assert sizes(0.4, "never") == [1.0]
    large = np.zeros((960, 1280, 3), np.uint8)
    assert [part.size for part in parts_by_gsd(0.4, KNOWN_M, large, STRIDE, "affordable")] == [1.0]
    assert [part.size for part in parts_by_gsd(0.4, KNOWN_M, large, STRIDE, "always")] == [2.0]


def test_the_sky_is_never_enlarged() -> None:
    """Rows of 0.4 m per pixel below rows without ground: those take the size of the nearest ground, but 1."""
    gsd_m = np.full((4, 4), 0.4)
    gsd_m[:2] = np.nan
    parts = parts_by_gsd(gsd_m, KNOWN_M, picture(), STRIDE, "always")
    assert [part.size for part in parts] == [1.0, 2.0]
    assert parts[0].own is not None and parts[0].own[:12].all() and not parts[0].own[12:].any()


@given(
    hnp.arrays(np.float32, (3, 4), elements=st.floats(2.0**-10, 4.0, width=32) | st.just(float("nan"))),
    st.sampled_from(("never", "affordable", "always")),
    st.tuples(st.integers(60, 130), st.integers(60, 130)),
    st.sampled_from((0, 500, picture_parts.PART_COST_PX)),
)
def test_every_cell_is_answered_for_once_at_a_size_that_is_known(
    gsd_m: np.ndarray, enlarge: Enlarge, shape: tuple[int, int], part_cost_px: int
) -> None:
    if not np.isfinite(gsd_m).any():
        return
    image = picture(*shape)
    cells = tuple(-(-side // STRIDE) for side in shape)
    with mock.patch.object(picture_parts, "PART_COST_PX", part_cost_px):
        parts = parts_by_gsd(gsd_m, KNOWN_M, image, STRIDE, enlarge)
    owners = np.zeros(cells, int)
    of_cell = gsd_m[
        np.ix_(*(((np.arange(n) + 0.5) * k / n).astype(int) for n, k in zip(cells, (3, 4), strict=True)))
    ]
    for part in parts:
        own = np.ones(cells, bool) if part.own is None else part.own
        owners += own
        for cell, axis, span, side in zip(
            np.nonzero(own), (0, 1), (part.rows, part.columns), shape, strict=True
        ):
            margin = MARGIN_PX / part.size
            assert span.start == 0 or span.start <= cell.min() * STRIDE - margin, axis
            assert span.stop == side or span.stop >= (cell.max() + 1) * STRIDE + margin, axis
        shown_m = of_cell[own] / part.size
        seen = np.isfinite(shown_m)
        assert (shown_m[seen] >= KNOWN_M[0] * (1 - 1e-5)).all()
        if part.size < 1.0:
            assert (shown_m[seen] < 2 * KNOWN_M[0] * (1 + 1e-5)).all()
        if enlarge == "always" and part.size == 1.0:
            assert (shown_m[seen] <= KNOWN_M[1] * (1 + 1e-5)).all()
    assert (owners == 1).all()
    if enlarge == "affordable" and any(part.size > 1.0 for part in parts):
        shown = sum(part.shown_pixels for part in parts)
        assert shown <= AFFORDABLE_SHARE * max(shape[0] * shape[1], AFFORDABLE_PX)


@given(
    hnp.arrays(np.float32, (3, 4), elements=st.floats(2.0**-10, 4.0, width=32) | st.just(float("nan"))),
    st.tuples(st.integers(60, 130), st.integers(60, 130)),
)
def test_far_ground_and_the_sky_above_it_are_left_out_and_nothing_else(
    gsd_m: np.ndarray, shape: tuple[int, int]
) -> None:
    if not np.isfinite(gsd_m).any():
        return
    image = picture(*shape)
    parts, far = near_parts(gsd_m, KNOWN_M, image, STRIDE)
    if np.isfinite(gsd_m).all():
        assert np.array_equal(far, far_cells(gsd_m, KNOWN_M, far.shape))
    assert far[far_cells(gsd_m, KNOWN_M, far.shape)].all()
    owners = np.zeros(far.shape, int)
    for part in parts:
        owners += np.ones(far.shape, bool) if part.own is None else part.own
    assert np.array_equal(owners, np.where(far, 0, 1))


def test_the_sky_above_near_ground_is_looked_at() -> None:
    """People on roofs stand before it. Columns: near and far, the upper rows without ground."""
    gsd_m = np.array([[np.nan, np.nan], [0.1, 0.4]])
    parts, far = near_parts(gsd_m, KNOWN_M, picture(), STRIDE)
    assert [part.size for part in parts] == [1.0]
    assert far[:, 16:].all() and not far[:, :16].any()


@pytest.fixture(scope="module")
def red(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    """The mean red of every cell, at sizes that pose and map ask for, or at two."""
    given = document(
        sizes={"gsd_m": list(KNOWN_M), "without_gsd": [1.0, 0.5], "weights": [0.5, 0.25], "bias": -1.0}
    )
    return Detector(write_map_model(tmp_path_factory.mktemp("red") / "m.onnx", given))


def test_a_picture_in_the_known_range_is_seen_as_it_is(red: Detector) -> None:
    image = np.random.default_rng(0).integers(0, 256, (90, 118, 3), dtype=np.uint8)
    np.testing.assert_array_equal(red(image, 0.1), red(image, as_it_is=True))


@pytest.mark.parametrize("size", [(120, 160), (123, 161)])
def test_a_look_at_near_ground_says_what_a_whole_look_says_there(
    red: Detector, size: tuple[int, int]
) -> None:
    image = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    gsd_m = np.array([[0.5, 0.5], [0.2, 0.4], [0.2, 0.04]])
    whole, near = red(image, gsd_m), red.near_ground(image, gsd_m)
    assert isinstance(near, np.ma.MaskedArray) and near.shape == whole.shape and near.dtype == np.float32
    seen = ~np.ma.getmaskarray(near)
    thirds = np.array_split(np.arange(whole.shape[0]), 3)
    left = np.arange(whole.shape[1]) < whole.shape[1] // 2
    assert not seen[thirds[0][:-4]].any() and seen[thirds[2][4:]].all()
    assert np.array_equal(seen[thirds[1][4:-4]][:, 4:-4].all(axis=0), left[4:-4])
    assert np.array_equal(near.data[seen], whole[seen]) and not near.data[~seen].any()


def test_a_look_at_near_ground_where_all_is_far_was_at_nothing(red: Detector) -> None:
    near = red.near_ground(picture(), 0.5)
    assert np.ma.getmaskarray(near).all() and near.shape == (24, 32)
    assert not np.ma.is_masked(red.near_ground(picture(), 0.1))


def test_detectors_that_count_people_or_do_not_say_how_far_they_see_leave_nothing_out(tmp_path: Path) -> None:
    for name, stated in (("plain", document()), ("known", document(sizes={"gsd_m": list(KNOWN_M)}))):
        model = write_map_model(tmp_path / f"{name}.onnx", stated)
        assert Detector(model).far_every_s == 0.0
        detector = Detector(model, far_every_s=0.25)
        assert detector.far_every_s == (0.25 if name == "known" else 0.0)
    of_function = Detector.from_callable(lambda image: np.zeros((24, 32)), stride=4)
    both = Detector.combined([detector, Detector(tmp_path / "plain.onnx")])
    for other in (of_function, both):
        assert other.far_every_s == 0.0
        with pytest.raises(ValueError, match="does not tell near ground from far"):
            other.near_ground(picture(), 0.1)
    for seconds in (-0.1, math.inf, math.nan):
        with pytest.raises(ValueError, match=r"far_every_s is .*; it must be finite and >= 0"):
            Detector(tmp_path / "known.onnx", far_every_s=seconds)


def test_another_word_for_what_is_enlarged_is_refused() -> None:
    """It was taken for a fourth, with which less of far ground is looked at."""
    with pytest.raises(ValueError, match="enlarge is 'Always'; allowed: never, affordable, always"):
        Detector(enlarge="Always")  # type: ignore[arg-type]


@given(hnp.arrays(np.int8, (3, 3), elements=st.integers(0, 3)))
def test_no_seam_shows_where_parts_meet(red: Detector, which: np.ndarray) -> None:
    """The mean colour of a cell is the same at any size of the picture: on a ramp of one level a pixel all
    parts answer alike, but for the width of the filters, which reaches 3 cells from the edges."""
    gsd_m = np.array([0.01, 0.04, 0.1, 0.5], np.float32)[which]
    ramp = np.zeros((160, 200, 3), np.uint8)
    ramp[..., 0] = np.arange(200)
    found, expected = red(ramp, gsd_m), red(ramp, as_it_is=True)
    assert found.shape == expected.shape
    inner = np.s_[:, 12:-12]
    assert np.abs(found[inner] - expected[inner]).max() <= 2.0 / 255.0


def test_pictures_of_unknown_scale_are_combined_by_their_sorted_logits(red: Detector) -> None:
    """A grey picture is 0.8 at both sizes: z = ln 4, P = sigmoid(0.5 z + 0.25 z - 1)."""
    grey = np.full((64, 64, 3), 204, np.uint8)
    z = 0.75 * math.log(4.0) - 1.0
    np.testing.assert_allclose(red(grey), 1.0 / (1.0 + math.exp(-z)), atol=1e-5)


def test_certain_cells_are_cut_before_they_are_weighted(red: Detector) -> None:
    """Black and white halves: far from the edge both sizes agree, at a logit of 16, where it is cut."""
    image = np.zeros((64, 64, 3), np.uint8)
    image[:, 32:] = 255
    found = red(image)
    far_white, far_black = found[8, 15], found[8, 0]
    assert far_white == pytest.approx(1.0 / (1.0 + math.exp(-(0.75 * 16.0 - 1.0))), abs=1e-5)
    assert far_black == pytest.approx(1.0 / (1.0 + math.exp(0.75 * 16.0 + 1.0)), abs=1e-5)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"gsd_m": [0.1, 0.15]}, r"sizes.gsd_m is \[0.1, 0.15\]; allowed: \[low, high\].*2 \* low <= high"),
        ({"without_gsd": [1, 0.5]}, r"sizes.weights are missing: 2 maps become one by them"),
        ({"without_gsd": [1, 0.5], "weights": [1]}, r"sizes.weights is \[1\]; allowed: a list of 2 numbers"),
        ({"without_gsd": []}, r"sizes.without_gsd is \[\]; allowed: a list of 1 to 8 numbers"),
        ({"without_gsd": [100]}, r"sizes.without_gsd is \[100\]; allowed: sizes from"),
        ({"without_gsd": [math.nan]}, r"sizes.without_gsd is \[nan\]"),
        ({"scales": [1]}, r"sizes.'scales' is not a key of the contract"),
    ],
)
def test_sizes_that_cannot_be_are_refused(section: dict[str, Any], message: str) -> None:
    with pytest.raises(DetectorError, match=message):
        Contract.from_json(document(sizes=section))


def test_people_and_density_have_sizes_of_their_own_kind() -> None:
    boxes = document("boxes", sizes={"without_gsd": [1, 2]})
    assert Contract.from_json(boxes).sizes is not None
    for kind in ("points", "density"):
        with pytest.raises(DetectorError, match=f"{kind} are looked for at one size"):
            Contract.from_json(document(kind, sizes={"without_gsd": [1, 2]}))
    with pytest.raises(DetectorError, match=r"weights go with maps of probabilities, not boxes"):
        Contract.from_json(document("boxes", sizes={"without_gsd": [1, 2], "weights": [1, 1]}))


def test_sizes_survive_json() -> None:
    given = Contract.from_json(
        document(sizes={"gsd_m": [0.05, 0.3], "without_gsd": [1, 0.5], "weights": [1, 0], "bias": 0.5})
    )
    assert Contract.from_json(given.to_json()) == given


def test_a_person_seen_at_two_sizes_is_one(tmp_path: Path) -> None:
    """The model finds the same box whenever it is shown the picture, here twice at one size."""
    rows = [[[8.0, 8.0, 24.0, 40.0, 1.0]]]
    rule = {"min_people": 1, "radius_m": 1.0, "softness_people": 0.05, "closing_m": 0.0}
    given = document("boxes", output__rule=rule, output__iou_max=0.5, sizes={"without_gsd": [1.0, 1.0]})
    write_fixed_output_model(tmp_path / "m.onnx", rows, given, output_shape=(1, "a", "b"))
    given["output"]["rule"] = {**rule, "person_height_m": 1.6}
    found = Detector(tmp_path / "m.onnx", given)(picture())
    # n = 1 once joined: P = sigmoid((1 - 0.5) / 0.05); counted twice it would be sigmoid(1.5 / 0.05).
    assert found.max() == pytest.approx(1.0 / (1.0 + math.exp(-10.0)), abs=1e-7)


def test_boxes_tell_the_scale_where_nothing_else_does() -> None:
    """1.7 m over 34 pixels: 0.05 m per pixel; the median of the nearest five ignores one that is cut off."""
    heights = np.array([34.0, 34.0, 10.0, 34.0, 34.0])
    people = People(np.full(5, 50.0), np.full(5, 40.0), np.ones(5), np.full(5, 8.0), heights)
    np.testing.assert_allclose(gsd_of_people(people, (64, 96), 1.7), 0.05, rtol=1e-6)


def test_without_people_there_is_no_crowd(tmp_path: Path) -> None:
    given = document("boxes", output__rule={"person_height_m": 1.7}, output__score_min=0.5)
    write_fixed_output_model(tmp_path / "m.onnx", [[[0, 0, 1, 1, 0.1]]], given, output_shape=(1, "a", "b"))
    assert not Detector(tmp_path / "m.onnx")(picture()).any()


def test_suspicious_far_ground_is_looked_at_again_within_the_budget() -> None:
    """640 x 480 at 0.4 m per pixel: enlarged as a whole it would cost fourfold: only suspicious places are:
    of two, the one of 0.4 comes first; a sure crowd (0.9) is not looked for again."""
    image, cells = np.zeros((480, 640, 3), np.uint8), (120, 160)
    parts = parts_by_gsd(0.4, KNOWN_M, image, STRIDE, "affordable")
    assert [part.size for part in parts] == [1.0]
    heatmap = np.zeros(cells, np.float32)
    heatmap[10:14, 10:14], heatmap[100:104, 100:104], heatmap[60, 60] = 0.4, 0.1, 0.9
    far = far_cells(0.4, KNOWN_M, cells)
    assert far.all()
    found = suspicious_parts(heatmap, parts, far, image, STRIDE)
    assert found and found[0].own is not None and found[0].own[12, 12] and not found[0].own[60, 60]
    assert all(part.size == 2.0 and part.own is not None and not part.own[60, 60] for part in found)
    shown = sum(part.shown_pixels for part in [*parts, *found])
    assert shown <= AFFORDABLE_SHARE * AFFORDABLE_PX
    near = np.zeros(cells, np.bool_)
    assert suspicious_parts(heatmap, parts, near, image, STRIDE) == []
