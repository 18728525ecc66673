"""Models that see pictures of unknown scale at several sizes: what was measured is what the written model
does."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from crowdfence import Detector
from crowdfence.calibration.calibrate import calibrate_model, plan_for
from crowdfence.calibration.choice import calibrate
from crowdfence.calibration.correction import LogitMap, line
from crowdfence.calibration.logit_counts import cell_logits, logit_counts
from crowdfence.calibration.model_file import about_after, calibrated_contract, sizes_before
from crowdfence.detector.contract.contract import Contract
from crowdfence.evaluation.labelled_missions import MeasurementPlan
from crowdfence.labelled_pictures.annotated_picture import AnnotatedPicture, rectangle
from crowdfence.labelled_pictures.coco import ANNOTATIONS, write_coco
from support.onnx_models import contract, write_map_model

SIZES = {"without_gsd": [1.0, 0.5], "weights": [1.5, 0.5], "bias": -1.0}
"""Plain pictures have the same logit z at both sizes; joined they have 2 z - 1."""


def plain(level: int, place: str = "") -> np.ndarray:
    """One level of red, which is all that the model sees; the other colours are those of a `place`."""
    image = np.random.default_rng([level, *place.encode()]).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    image[..., 0] = level
    return image


def labelled(folder: Path, levels: list[tuple[int, bool]]) -> Path:
    """Plain pictures, each of them crowd all over or nowhere."""
    folder.mkdir()
    pictures = []
    for number, (level, is_crowd) in enumerate(levels):
        place = folder / f"{number}.png"
        Image.fromarray(plain(level, folder.name)).save(place)
        crowds = (rectangle(0.0, 0.0, 63.0, 63.0),) if is_crowd else ()
        pictures.append(AnnotatedPicture(place, 64, 64, np.empty((0, 4)), crowds))
    write_coco(pictures, folder / ANNOTATIONS)
    return folder


def test_the_joined_answer_of_a_written_model_is_that_which_was_measured(tmp_path: Path) -> None:
    """Logits from -2 to 2 by the level of red. A quarter of the pictures of either kind look like the other,
    so no correction is perfect; dark ones are crowd, so a bias is needed."""
    model = write_map_model(
        tmp_path / "m.onnx", contract("logits", sizes=SIZES), scale=4.0 / 255.0, offset=-2.0
    )
    one = [(40, False), (40, False), (40, True), (200, True), (200, True), (200, True), (200, False)]
    data = [labelled(tmp_path / "a", one), labelled(tmp_path / "b", one[:0:-1])]
    before = Detector(model)
    plan = plan_for(before.contract, MeasurementPlan())
    done = calibrate_model(before, model, data, tmp_path / "calibrated.onnx", plan)
    chosen, after = done.calibration.chosen, Detector(tmp_path / "calibrated.onnx")
    assert chosen.method != "none" and "curve" not in done.calibration.candidates
    assert after.contract.about == before.contract.about
    for level in (20, 90, 128, 180, 240):
        z = 4.0 * level / 255.0 - 2.0
        assert cell_logits(before(plain(level))) == pytest.approx(np.full((16, 16), 2.0 * z - 1.0), abs=1e-3)
        expected = chosen.scale * (2.0 * z - 1.0) + chosen.bias
        assert cell_logits(after(plain(level))) == pytest.approx(np.full((16, 16), expected), abs=1e-3)


def test_figures_of_photographs_go_where_the_correction_moves_one_half() -> None:
    """A temperature leaves what is above one half there; a bias does not, so nobody has counted it then."""
    about = {"marks": "ground", "photographs": {"mean_recall": 0.66}}
    assert about_after(about, line("temperature", 0.5)) == about
    assert about_after(about, line("scale and bias", 1.0, 0.3)) == {"marks": "ground"}


def test_what_joins_the_sizes_is_undone_however_often_a_model_was_calibrated() -> None:
    """A training that starts from a model without its corrections kept what the first of three had moved."""

    def calibrated(before: Contract, chosen: LogitMap) -> Contract:
        done = replace(calibrate({"a": counts}), chosen=chosen)
        return calibrated_contract(before, done, None, None, 0.6)

    values, crowd = np.array([[0.2, 0.8]]), np.array([[False, True]])
    counts = logit_counts(values, crowd)
    first = Contract.from_json(contract("logits", sizes=SIZES))
    model = first
    for scale, bias in ((2.0, 0.5), (0.8, -0.3), (1.5, 0.1)):
        model = calibrated(model, line("scale and bias", scale, bias))
    assert model.sizes is not None and first.sizes is not None
    # The weights add up to 2: of scale s and bias c, b becomes s b - c.
    assert model.sizes.bias == pytest.approx(1.5 * (0.8 * (2.0 * -1.0 - 0.5) + 0.3) - 0.1)
    undone = sizes_before(model)
    assert undone is not None and undone.bias == pytest.approx(first.sizes.bias)
