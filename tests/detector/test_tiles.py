"""Tiles: every pixel is answered for once, and a local model does not notice that it was cut."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from crowdfence import Contract, Detector
from crowdfence.detector.inference import patches as patches_module
from crowdfence.detector.inference.patches import patches
from support.onnx_models import contract as document
from support.onnx_models import write_map_model, write_pixel_people_model

sides = st.integers(1, 700)
tile_sides = st.integers(4, 40).map(lambda cells: 8 * cells)


@given(sides, sides, tile_sides, tile_sides)
def test_the_tiles_answer_for_every_pixel_once(height: int, width: int, tile_h: int, tile_w: int) -> None:
    model = Contract.from_json(document(input__size=[tile_w, tile_h], input__resize="tile")).input
    answered = np.zeros((height, width), np.uint8)
    for patch in patches(height, width, model, stride=4):
        rows, columns = patch.rows, patch.columns
        assert (rows.model, columns.model) == (tile_h, tile_w)
        answered[rows.own_start : rows.own_stop, columns.own_start : columns.own_stop] += 1
        for span, pixels in ((rows, height), (columns, width)):
            assert span.start % 8 == 0 and span.own_start % 4 == 0
            assert 0 <= span.start <= span.own_start < span.own_stop <= span.stop <= pixels
    assert (answered == 1).all()


@pytest.fixture(scope="module")
def local_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every cell is the mean of 3 x 3 cells: it looks 4 pixels beyond its own."""
    return write_map_model(tmp_path_factory.mktemp("local") / "m.onnx", document(), blur_cells=1)


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(64, 200), st.integers(64, 200), st.integers(0, 2**32 - 1))
def test_a_local_model_gives_the_same_on_tiles(local_model: Path, height: int, width: int, seed: int) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    tiles = document(input__size=[64, 64], input__resize="tile")
    np.testing.assert_array_equal(Detector(local_model, tiles)(image), Detector(local_model)(image))


def test_large_images_are_tiled_by_themselves(local_model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    image = np.random.default_rng(4).integers(0, 256, (300, 420, 3), dtype=np.uint8)
    whole = Detector(local_model)(image)
    monkeypatch.setattr(patches_module, "MAX_UNTILED_PIXELS", 300 * 420 - 1)
    monkeypatch.setattr(patches_module, "TILE_PX", 100)
    model = Contract.from_json(document()).input
    shapes = {(p.rows.model, p.columns.model) for p in patches(300, 420, model, 4)}
    assert shapes == {(104, 104)}  # 100 rounded up to a multiple of 8
    np.testing.assert_array_equal(Detector(local_model)(image), whole)


def test_an_image_at_the_limit_is_one_patch() -> None:
    model = Contract.from_json(document()).input
    assert len(list(patches(2000, 2000, model, 4))) == 1
    assert len(list(patches(2000, 2001, model, 4))) > 1


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32 - 1))
def test_people_on_seams_are_counted_once(tmp_path: Path, seed: int) -> None:
    """A model that finds every red pixel, on tiles of 64 and on the whole image."""
    rng = np.random.default_rng(seed)
    image = np.zeros((150, 170, 3), np.uint8)
    image[rng.integers(0, 150, 60), rng.integers(0, 170, 60), 0] = 255
    path = write_pixel_people_model(tmp_path / "m.onnx", document("points"))
    tiles = document("points", input__size=[64, 64], input__resize="tile")
    on_tiles, whole = Detector(path, tiles)(image, 0.2), Detector(path)(image, 0.2)
    np.testing.assert_allclose(on_tiles, whole, atol=1e-6)
    assert whole.max() > 0.5
