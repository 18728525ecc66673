"""What the core reads lies where the model saw it: cells divide the picture evenly, also at its far edges."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowdfence import Detector
from crowdfence.detector.inference.even_cells import cells_of_stride, evenly
from support.onnx_models import contract as document
from support.onnx_models import write_map_model

WIDTH, HEIGHT = 641, 483
BLOB = np.s_[472:480, 632:640]
"""Whole cells of 4 x 4 and of 8 x 8 pixels, as far to the right and down as there are some."""


def picture() -> np.ndarray:
    """Black with one red blob near its far corner."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[(*BLOB, 0)] = 255
    return image


def as_the_core_reads(heatmap: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Value of every pixel: of the cell that holds its centre, the cells laid evenly over the picture."""
    rows, columns = (
        np.floor((np.arange(side) + 0.5) * cells / side).astype(int)
        for cells, side in zip(heatmap.shape, shape, strict=True)
    )
    return heatmap[np.ix_(rows, columns)]


@pytest.mark.parametrize(
    "changes",
    [{}, {"input__size": [64, 64], "input__resize": "tile"}, {"sizes": {"gsd_m": [0.05, 0.3]}}],
    ids=["whole", "tiles", "at a known size"],
)
def test_a_blob_at_the_far_edge_lies_at_its_pixels(tmp_path: Path, changes: dict[str, Any]) -> None:
    detector = Detector(write_map_model(tmp_path / "m.onnx", document(**changes)))
    expected = np.zeros((HEIGHT, WIDTH))
    expected[BLOB] = 1.0
    for heatmap in (detector(picture(), 0.1), *detector.batch([picture(), picture()], 0.1)):
        np.testing.assert_allclose(as_the_core_reads(heatmap, (HEIGHT, WIDTH)), expected, atol=1e-6)


@pytest.mark.parametrize("stride", [1, 3, 4, 8])
@pytest.mark.parametrize("rounded", ["up", "down"])
def test_so_does_that_of_a_function(stride: int, rounded: str) -> None:
    """A function with cells of its stride, with a last one that reaches beyond the picture or without."""
    rows, columns = (-(-side // stride) if rounded == "up" else side // stride for side in (HEIGHT, WIDTH))
    row, column = 470 // stride, 630 // stride
    cells = np.zeros((rows, columns))
    cells[row, column] = 0.75
    heatmap = Detector.from_callable(lambda _: cells, stride=stride)(picture())
    found = as_the_core_reads(heatmap, (HEIGHT, WIDTH))
    there = np.s_[row * stride : (row + 1) * stride, column * stride : (column + 1) * stride]
    assert (found[there] == 0.75).all()
    assert np.count_nonzero(found) == stride**2


@pytest.mark.parametrize("resize", ["stretch", "letterbox"])
@pytest.mark.parametrize("gsd_m", [None, 0.02])
def test_an_answer_that_is_laid_back_over_the_picture_is_not_shifted(
    tmp_path: Path, resize: str, gsd_m: float | None
) -> None:
    """Shown smaller and interpolated it is blurred, but its middle is that of the blob, to within a pixel."""
    given = document(input__size=[320, 320], input__resize=resize, sizes={"gsd_m": [0.03, 0.3]})
    detector = Detector(write_map_model(tmp_path / "m.onnx", given, image_shape=(1, 320, 320, 3)))
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[420:440, 580:600, 0] = 255
    found = as_the_core_reads(detector(image, gsd_m), (HEIGHT, WIDTH)).astype(float)
    near = found[400:460, 560:620]  # the grey around a letterboxed picture reaches over its border
    row, column = (np.average(np.arange(60) + 0.5, weights=near.sum(axis=axis)) for axis in (1, 0))
    assert (400 + row, 560 + column) == (pytest.approx(430.0, abs=1.0), pytest.approx(590.0, abs=1.0))


def test_a_combination_of_strides_lies_there_too() -> None:
    """Both see the blob, on cells of 4 and of 8 pixels; what is behind the last cell takes its value."""
    fine, coarse = (
        Detector.from_callable(
            lambda image, stride=stride: np.kron(
                image[: HEIGHT // 8 * 8 : 8, : WIDTH // 8 * 8 : 8, 0] / 255.0, np.ones((8 // stride,) * 2)
            ),
            stride=stride,
            name=f"of {stride}",
        )
        for stride in (4, 8)
    )
    found = as_the_core_reads(Detector.combined([fine, coarse])(picture()), (HEIGHT, WIDTH))
    assert (found[472:, 632:] > 0.9).all() and np.count_nonzero(found > 0.5) == 11 * 9


@given(st.integers(1, 40), st.integers(1, 200), st.integers(1, 200))
def test_evenly_spread_cells_hold_the_value_of_their_pixels(stride: int, height: int, width: int) -> None:
    cells = (-(-height // stride), -(-width // stride))
    values = np.arange(cells[0] * cells[1], dtype=np.float32).reshape(cells)
    spread = evenly(values, stride, (height, width))
    rows, columns = np.arange(height) // stride, np.arange(width) // stride
    np.testing.assert_array_equal(as_the_core_reads(spread, (height, width)), values[np.ix_(rows, columns)])
    np.testing.assert_array_equal(cells_of_stride(spread, stride, (height, width)), values)


def test_pictures_of_whole_cells_keep_them(tmp_path: Path) -> None:
    detector = Detector(write_map_model(tmp_path / "m.onnx", document()))
    shapes = {(480, 640): (120, 160), (480, 854): (240, 427), (3, 5): (3, 5)}
    for size, cells in shapes.items():
        assert detector(np.zeros((*size, 3), np.uint8)).shape == cells
