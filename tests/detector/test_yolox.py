"""YOLOX's raw output: cells of three grids, offsets from their corners, logarithms of sizes."""

import math
from pathlib import Path

import numpy as np
import pytest

from crowdfence import Detector, DetectorError
from crowdfence.detector.contract import lookup
from crowdfence.detector.contract.contract import Contract, read_contract
from crowdfence.detector.contract.lookup import KNOWN_CONTRACTS, load_contract
from crowdfence.detector.inference.people_output import in_pixels
from support.onnx_models import contract as document
from support.onnx_models import write_fixed_output_model, write_map_model

ROWS = 16 + 4 + 1
"""Cells of grids of strides 8, 16 and 32 on 32 x 32 pixels."""


def raw(*filled: tuple[int, list[float]]) -> np.ndarray:
    """Rows of cx, cy, log w, log h, objectness, two class scores."""
    rows = np.zeros((ROWS, 7), np.float32)
    for index, values in filled:
        rows[index] = values
    return rows


def test_rows_become_pixels() -> None:
    """Row 6 is cell (row 1, column 2) of stride 8, row 18 cell (1, 0) of stride 16, row 20 the one of 32."""
    rows = raw(
        (6, [0.5, 0.25, math.log(2.0), 0.0, 1, 1, 0]),
        (18, [0.0, 1.0, 0.0, math.log(0.5), 1, 1, 0]),
        (20, [0.5, 0.5, math.log(0.25), 0.0, 1, 1, 0]),
    )
    placed = in_pixels(rows.astype(np.float64), (8, 16, 32), (32, 32))
    np.testing.assert_allclose(placed[6, :4], [(2 + 0.5) * 8, (1 + 0.25) * 8, 16, 8], rtol=1e-6)
    np.testing.assert_allclose(placed[18, :4], [0, (1 + 1) * 16, 16, 8], rtol=1e-6)
    np.testing.assert_allclose(placed[20, :4], [16, 16, 8, 32], rtol=1e-6)


def test_grids_are_counted_row_by_row_on_oblong_inputs() -> None:
    """64 x 32 pixels, stride 32: row 0 is the left cell, row 1 the right one."""
    placed = in_pixels(np.zeros((2, 5)), (32,), (32, 64))
    np.testing.assert_array_equal(placed[:, :2], [[0, 0], [32, 0]])


def test_another_number_of_rows_is_refused() -> None:
    with pytest.raises(DetectorError, match=r"20 detections; grids of strides \[8, 16, 32\].*have 21 cells"):
        in_pixels(np.zeros((20, 7)), (8, 16, 32), (32, 32))


def test_an_absurd_logarithm_does_not_overflow() -> None:
    assert np.isfinite(in_pixels(np.full((ROWS, 7), 1e6), (8, 16, 32), (32, 32))).all()


def yolox(path: Path, rows: np.ndarray, **changes: object) -> Detector:
    given = document(
        "boxes",
        input__size=[32, 32],
        input__resize="tile",
        output__row="objectness_class_scores",
        output__box_format="cxcywh",
        output__coordinates="grid",
        output__grid_strides=[8, 16, 32],
        output__class_index=0,
        output__score_min=0.3,
        output__rule={"min_people": 1, "radius_m": 1.0, "softness_people": 0.05, "closing_m": 0.0},
        **changes,
    )
    write_fixed_output_model(path, rows[None], given, output_shape=(1, ROWS, 7), image_shape=(1, 32, 32, 3))
    return Detector(path)


def test_people_stand_where_the_grids_say_they_do(tmp_path: Path) -> None:
    """A box of 8 x 8 pixels around (22, 10): feet at (22, 14), the centre of cell (3, 5) of 4 pixels. At 1 m
    per pixel the radius reaches no other centre. A dog in another cell and a weak person do not count."""
    rows = raw(
        (6, [0.75, 0.25, 0.0, 0.0, 0.9, 0.9, 0.0]),
        (0, [0.5, 0.5, 0.0, 0.0, 0.9, 0.0, 0.9]),
        (15, [0.5, 0.5, 0.0, 0.0, 0.5, 0.5, 0.0]),
    )
    heatmap = yolox(tmp_path / "m.onnx", rows)(np.zeros((32, 32, 3), np.uint8), 1.0)
    assert np.argwhere(heatmap > 0.5).tolist() == [[3, 5]]


def test_tiles_find_people_anywhere_in_a_large_picture(tmp_path: Path) -> None:
    """Every tile of 32 x 32 holds the same person; each answers for its own part, so none counts twice."""
    rows = raw((6, [0.5, 0.25, 0.0, 0.0, 0.9, 0.9, 0.0]))
    heatmap = yolox(tmp_path / "m.onnx", rows)(np.zeros((32, 80, 3), np.uint8), 1.0)
    columns = np.argwhere(heatmap > 0.5)[:, 1].tolist()
    assert columns == sorted(set(columns)) and len(columns) >= 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"output__coordinates": "grid"}, "grid_strides go with coordinates 'grid'"),
        ({"output__grid_strides": [8]}, "grid_strides go with coordinates 'grid'"),
        ({"output__coordinates": "grid", "output__grid_strides": [0]}, "grid_strides is"),
        ({"output__coordinates": "grid", "output__grid_strides": [8]}, "boxes of format 'cxcywh'"),
    ],
)
def test_half_a_grid_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(DetectorError, match=message):
        Contract.from_json(document("boxes", **changes))


def test_a_model_with_a_known_checksum_finds_the_contract_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import hashlib
    import json

    model = write_map_model(tmp_path / "theirs.onnx")
    with pytest.raises(DetectorError, match="says neither what it expects"):
        load_contract(model)
    known = document(about={"sha256": hashlib.sha256(model.read_bytes()).hexdigest()})
    (tmp_path / "known").mkdir()
    (tmp_path / "known" / "theirs.crowdfence.json").write_text(json.dumps(known))
    monkeypatch.setattr(lookup, "KNOWN_CONTRACTS", tmp_path / "known")
    assert load_contract(model).name == "test model"


def test_the_contract_of_yolox_nano_is_valid_and_names_its_file() -> None:
    contract = read_contract(KNOWN_CONTRACTS / "yolox_nano.crowdfence.json")
    assert contract.about is not None and len(contract.about["sha256"]) == 64
    assert contract.output.grid_strides == (8, 16, 32) and not contract.needs_gsd and contract.uses_gsd
