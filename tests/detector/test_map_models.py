"""Map models: probability, logits and class logits, every layout, size and normalisation."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from onnx import TensorProto

from crowdfence import Detector, DetectorError
from support.onnx_models import contract as document
from support.onnx_models import write_fixed_output_model, write_map_model

Image = NDArray[np.uint8]


def cells_of(reds: list[list[int]]) -> Image:
    """An image of cells of 4 x 4 pixels with the given red, green 255 - red, blue 7."""
    red = np.kron(np.array(reds, np.uint8), np.ones((4, 4), np.uint8))
    return np.stack([red, 255 - red, np.full_like(red, 7)], axis=-1)


REDS = [[0, 51], [102, 255]]
P = np.array(REDS) / 255.0


def test_a_probability_is_taken_as_it_is(tmp_path: Path) -> None:
    heatmap = Detector(write_map_model(tmp_path / "m.onnx", document()))(cells_of(REDS))
    assert heatmap.dtype == np.float32 and heatmap.shape == (2, 2)
    assert heatmap == pytest.approx(P, abs=1e-6)


def test_a_contract_that_was_changed_in_python_is_checked(tmp_path: Path) -> None:
    path = write_map_model(tmp_path / "m.onnx", document())
    contract = Detector(path).contract
    assert Detector(path, contract).contract == contract
    changes: Any = {"kind": "logit"}
    with pytest.raises(DetectorError, match=r"the given contract: output.kind is 'logit'; allowed: prob"):
        Detector(path, replace(contract, output=replace(contract.output, **changes)))


def test_logits_are_divided_by_the_temperature(tmp_path: Path) -> None:
    """Red 0, 51, 102, 255 -> z = -1, 0, 1, 4; T = 2 -> sigmoid(-0.5, 0, 0.5, 2)."""
    given = document("logits", calibration={"temperature": 2.0})
    path = write_map_model(tmp_path / "m.onnx", given, scale=1 / 51, offset=-1.0)
    expected = [[0.377541, 0.5], [0.622459, 0.880797]]
    assert Detector(path)(cells_of(REDS)) == pytest.approx(np.array(expected), abs=1e-5)


def test_logits_of_any_size_become_zero_and_one(tmp_path: Path) -> None:
    path = write_map_model(tmp_path / "m.onnx", document("logits"), scale=1e5, offset=-1e6)
    assert Detector(path)(cells_of([[0, 255]] * 2)).tolist() == [[0.0, 1.0]] * 2


def test_class_logits_are_a_softmax(tmp_path: Path) -> None:
    """Red 102 and green 153 -> logits 2 and 3; P(red) = e^2 / (e^2 + e^3) = 1 / (1 + e)."""
    image = cells_of([[102, 102]] * 2)
    first = document("class_logits", output__class_index=0)
    path = write_map_model(tmp_path / "m.onnx", first, channels=(0, 1), scale=1 / 51)
    assert Detector(path)(image) == pytest.approx(np.full((2, 2), 1 / (1 + math.e)), abs=1e-6)
    # Of two classes the second is crowd when the contract does not say.
    second = Detector(path, document("class_logits"))
    assert second(image) == pytest.approx(np.full((2, 2), math.e / (1 + math.e)), abs=1e-6)


@pytest.mark.parametrize(
    ("kind", "channels", "class_index", "message"),
    [
        ("class_logits", (0, 1, 2), None, r"output.class_index is missing .* 3 channels; allowed: 0 to 2"),
        ("class_logits", (0, 1, 2), 3, r"output.class_index is 3 .* 3 channels; allowed: 0 to 2"),
        ("class_logits", (0,), None, r"1 channel: class_logits need 2 and more"),
        ("probability", (0, 1), None, r"output.class_index is missing .* 2 channels"),
        ("logits", (0,), 1, r"output.class_index is 1 .* 1 channels; allowed: 0 to 0"),
    ],
)
def test_the_class_must_be_known(
    tmp_path: Path, kind: str, channels: tuple[int, ...], class_index: int | None, message: str
) -> None:
    given = document(kind, output__class_index=class_index)
    path = write_map_model(tmp_path / "m.onnx", given, channels=channels)
    with pytest.raises(DetectorError, match=message):
        Detector(path)


@pytest.mark.parametrize("layout", ["NCHW", "NHWC", "NHW"])
def test_output_layouts(tmp_path: Path, layout: str) -> None:
    path = write_map_model(tmp_path / "m.onnx", document(output__layout=layout), output_layout=layout)
    assert Detector(path)(cells_of(REDS)) == pytest.approx(P, abs=1e-6)


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
@pytest.mark.parametrize("layout", ["NCHW", "NHWC"])
@pytest.mark.parametrize("color", ["RGB", "BGR"])
def test_input_layouts_and_colours(tmp_path: Path, layout: str, dtype: str, color: str) -> None:
    """The model answers with its channel 0: red of RGB, blue (7 everywhere) of BGR."""
    given = document(input__layout=layout, input__dtype=dtype, input__color=color)
    kind = TensorProto.UINT8 if dtype == "uint8" else TensorProto.FLOAT
    path = write_map_model(tmp_path / "m.onnx", given, layout=layout, dtype=kind)
    expected = P if color == "RGB" else np.full((2, 2), 7 / 255)
    assert Detector(path)(cells_of(REDS)) == pytest.approx(expected, abs=1e-6)


def test_normalisation_is_per_channel_in_the_models_order(tmp_path: Path) -> None:
    """BGR: channel 0 is blue. (7 * 0.1 - 0.2) / 0.8 = 0.625."""
    given = document(
        input__dtype="float32",
        input__color="BGR",
        input__scale=0.1,
        input__mean=[0.2, 0, 0],
        input__std=[0.8, 1, 1],
    )
    path = write_map_model(tmp_path / "m.onnx", given, dtype=TensorProto.FLOAT, scale=1.0)
    assert Detector(path)(cells_of(REDS)) == pytest.approx(np.full((2, 2), 0.625), abs=1e-6)


@pytest.mark.parametrize("color", ["RGB", "BGR"])
def test_pale_colours_are_shown_stronger(tmp_path: Path, color: str) -> None:
    """y of (130, 100, 100) is 108.97; red, 21.03 above it, becomes 21.03 * 3 / (1 + 2 * 21.03 / 128) = 47.49:
    156, and blue 89. Grey stays grey."""
    image = np.full((8, 8, 3), 100, np.uint8)
    image[:, :4, 0] = 130
    path = write_map_model(tmp_path / "m.onnx", document(input__vibrance=3.0, input__color=color))
    pale = 156 if color == "RGB" else 89
    assert Detector(path)(image) == pytest.approx(np.array([[pale, 100]] * 2) / 255.0, abs=1e-6)
    assert image[0, 0].tolist() == [130, 100, 100]  # the caller's picture is left alone


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (3, 4), (7, 5), (8, 8), (9, 17), (31, 33)])
def test_any_size_has_its_cells_and_borders_repeat(tmp_path: Path, size: tuple[int, int]) -> None:
    """Padding repeats the border: a cell of 4 x 4 pixels is their mean with rows and columns clamped. Where
    such cells do not divide the image, smaller ones lie in each."""
    height, width = size
    image = np.random.default_rng(1).integers(0, 256, (height, width, 3), dtype=np.uint8)
    heatmap = Detector(write_map_model(tmp_path / "m.onnx", document()))(image)
    side = math.gcd(4, height, width)
    assert heatmap.shape == (height // side, width // side)
    for (i, j), value in np.ndenumerate(heatmap):
        top, left = side * i // 4 * 4, side * j // 4 * 4
        rows = np.minimum(np.arange(top, top + 4), height - 1)
        columns = np.minimum(np.arange(left, left + 4), width - 1)
        assert value == pytest.approx(image[np.ix_(rows, columns)][..., 0].mean() / 255, abs=1e-6)


def test_a_view_of_an_image_is_as_good_as_a_copy(tmp_path: Path) -> None:
    detector = Detector(write_map_model(tmp_path / "m.onnx", document()))
    image = np.random.default_rng(2).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    flipped = image[::-1, ::-1]
    np.testing.assert_array_equal(detector(flipped), detector(flipped.copy()))


def test_stretch_lays_the_answer_back_over_the_image(tmp_path: Path) -> None:
    """A model of 32 x 32 on an image of 128 x 64, left half red: the heatmap has the image's cells."""
    given = document(input__size=[32, 32], input__resize="stretch")
    path = write_map_model(tmp_path / "m.onnx", given, image_shape=(1, 32, 32, 3))
    image = np.zeros((64, 128, 3), np.uint8)
    image[:, :64] = 255
    heatmap = Detector(path)(image)
    assert heatmap.shape == (16, 32)
    assert (heatmap[:, :10] == 1.0).all() and (heatmap[:, 22:] == 0.0).all()
    assert heatmap.mean() == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("size", [(64, 128), (128, 64), (100, 100), (17, 90)])
def test_letterbox_cuts_the_grey_away(tmp_path: Path, size: tuple[int, int]) -> None:
    """A plain white image answers 1; the bars would answer 114 / 255 = 0.447.

    Cells of the model's output that show both are mixed, so the middle is looked at.
    """
    given = document(input__size=[64, 64], input__resize="letterbox")
    path = write_map_model(tmp_path / "m.onnx", given, image_shape=(1, 64, 64, 3))
    heatmap = Detector(path)(np.full((*size, 3), 255, np.uint8))
    rows, columns = heatmap.shape
    side = math.gcd(4, *size)
    assert (rows, columns) == (size[0] // side, size[1] // side)
    assert heatmap[rows // 3 : rows - rows // 3, columns // 3 : columns - columns // 3].min() > 0.95


def test_a_model_of_one_size_refuses_another(tmp_path: Path) -> None:
    given = document(input__size=[32, 32])
    path = write_map_model(tmp_path / "m.onnx", given, image_shape=(1, 32, 32, 3))
    assert Detector(path)(np.zeros((32, 32, 3), np.uint8)).shape == (8, 8)
    with pytest.raises(DetectorError, match=r"the image is 64 x 32 and the model takes 32 x 32"):
        Detector(path)(np.zeros((32, 64, 3), np.uint8))


def test_a_batch_is_what_single_images_give(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    images = [rng.integers(0, 256, (40, 56, 3), dtype=np.uint8) for _ in range(3)]
    vibrant = document(input__vibrance=2.0)
    for batch in ("N", 1):  # a model that takes several at once, and one that does not
        detector = Detector(write_map_model(tmp_path / f"{batch}.onnx", vibrant, batch=batch))
        for one, of_batch in zip(images, detector.batch(images), strict=True):
            np.testing.assert_array_equal(detector(one), of_batch)
    mixed = detector.batch([images[0], images[1][:20]])
    assert [heatmap.shape for heatmap in mixed] == [(10, 14), (5, 14)]
    assert detector.batch([]) == []


def test_one_detector_serves_several_threads(tmp_path: Path) -> None:
    detector = Detector(write_map_model(tmp_path / "m.onnx", document(), blur_cells=1))
    rng = np.random.default_rng(6)
    images = [rng.integers(0, 256, (64, 64, 3), dtype=np.uint8) for _ in range(16)]
    with ThreadPoolExecutor(4) as pool:
        for image, heatmap in zip(images, pool.map(detector, images), strict=True):
            np.testing.assert_array_equal(heatmap, detector(image))


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((8, 8, 3), np.float32), r"uint8 \[H, W, 3\] RGB, got float32 \[8, 8, 3\]"),
        (np.zeros((8, 8), np.uint8), r"got uint8 \[8, 8\]"),
        (np.zeros((8, 8, 4), np.uint8), r"got uint8 \[8, 8, 4\]"),
        (np.zeros((0, 8, 3), np.uint8), r"got uint8 \[0, 8, 3\]"),
        ([[1]], r"got list"),
        (None, r"got NoneType"),
    ],
)
def test_what_is_no_image_is_refused(tmp_path: Path, image: Any, message: str) -> None:
    detector = Detector(write_map_model(tmp_path / "m.onnx", document()))
    with pytest.raises(DetectorError, match=message):
        detector(image)


@pytest.mark.parametrize(
    ("kind", "value", "message"),
    [
        ("probability", math.nan, r"output heatmap holds nan at \[0, 1, 1\]"),
        ("probability", math.inf, r"holds inf at"),
        ("probability", 1.5, r"holds 1.5 at .*allowed: probabilities in \[0, 1\]$"),
        ("probability", -3.0, r"holds -3.0 at .*are these kind 'logits'\?"),
        ("logits", math.nan, r"output heatmap holds nan at .*allowed: finite numbers"),
        ("logits", -math.inf, r"output heatmap holds -inf"),
        ("class_logits", math.inf, r"output heatmap holds inf"),
    ],
)
def test_output_that_is_no_heatmap_is_refused(tmp_path: Path, kind: str, value: float, message: str) -> None:
    answer = np.full((1, 2 if kind == "class_logits" else 1, 2, 2), 0.5)
    answer[0, -1, 1, 1] = value
    path = write_fixed_output_model(tmp_path / "m.onnx", answer, document(kind))
    with pytest.raises(DetectorError, match=message) as caught:
        Detector(path)(np.zeros((8, 8, 3), np.uint8))
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_probabilities_are_no_class_logits(tmp_path: Path, dtype: type) -> None:
    """Of 20 classes P = 1 would become e / (e + 19) = 0.125: nothing would ever be crowd."""
    logits = np.random.default_rng(0).normal(0.0, 5.0, (1, 20, 2, 2))
    answer = (np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)).astype(dtype).astype(float)
    given = document("class_logits", output__class_index=12)
    path = write_fixed_output_model(tmp_path / "m.onnx", answer, given)
    with pytest.raises(DetectorError, match=r"add up to 1: .*; is output.kind 'probability'\?"):
        Detector(path)(np.zeros((8, 8, 3), np.uint8))
    given = document("probability", output__class_index=12)
    path = write_fixed_output_model(tmp_path / "m.onnx", answer, given)
    assert Detector(path)(np.zeros((8, 8, 3), np.uint8)) == pytest.approx(answer[0, 12], abs=1e-6)


@pytest.mark.parametrize("classes", [2, 5])
def test_a_sigmoid_for_each_class_gives_no_class_logits(tmp_path: Path, classes: int) -> None:
    """Nobody but in one cell, where it is sure. Of 5 classes a softmax would make e / (e + 4) = 0.40 of that,
    and of 2 that and of the empty cells 0.5."""
    answer = np.full((1, classes, 2, 2), 0.02)
    answer[0, 1, 0, 0] = 0.99
    given = document("class_logits", output__class_index=1)
    path = write_fixed_output_model(tmp_path / "m.onnx", answer, given)
    with pytest.raises(DetectorError, match=r"all values lie in \[0, 1\], .* 'probability'\?"):
        Detector(path)(np.zeros((8, 8, 3), np.uint8))


def test_logits_of_a_network_that_says_nothing_are_no_probabilities(tmp_path: Path) -> None:
    """All the same: that is told of a flight as a whole."""
    path = write_fixed_output_model(tmp_path / "m.onnx", np.zeros((1, 2, 2, 2)), document("class_logits"))
    assert Detector(path)(np.zeros((8, 8, 3), np.uint8)).tolist() == [[0.5, 0.5]] * 2


def test_a_rounding_beyond_one_is_cut(tmp_path: Path) -> None:
    answer = np.array([[[[0.5, 1.0 + 5e-5], [-5e-5, 0.0]]]])
    path = write_fixed_output_model(tmp_path / "m.onnx", answer, document())
    assert Detector(path)(np.zeros((8, 8, 3), np.uint8)).tolist() == [[0.5, 1.0], [0.0, 0.0]]


@pytest.mark.parametrize("shape", [(1, 1, 3, 2), (1, 1, 0, 0), (2, 1, 2, 2)])
def test_output_of_another_shape_is_refused(tmp_path: Path, shape: tuple[int, ...]) -> None:
    path = write_fixed_output_model(
        tmp_path / "m.onnx", np.zeros(shape), document(), output_shape=("a", "b", "c", "d")
    )
    with pytest.raises(DetectorError, match=r"cells for an input of 8 x 8|2 maps of one image"):
        Detector(path)(np.zeros((8, 8, 3), np.uint8))
