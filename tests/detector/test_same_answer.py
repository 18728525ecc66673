"""A model that does not see its pictures: told by its answers, which are the same wherever it looks."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.same_answer import SameAnswer
from support.command_line import crowdfence
from support.onnx_models import contract, write_map_model


def warning(kind: str, *values: float) -> str | None:
    """Of a picture of one cell for each value."""
    answer = SameAnswer(Contract.from_json(contract(kind)))
    for value in values:
        answer.add(np.full((1, 1), value, np.float32))
    return answer.warning


@pytest.mark.parametrize("kind", ["probability", "logits"])
def test_answers_half_a_logit_apart_are_the_same(kind: str) -> None:
    """By hand: sigmoid(-6) = 0.0024726, sigmoid(-5.6) = 0.0036842, sigmoid(-5.4) = 0.0044963."""
    told = warning(kind, 0.0024726, 0.0036842)
    assert told is not None and told.startswith("test model gives P = 0.0037 everywhere in all 2 pictures")
    assert warning(kind, 0.0024726, 0.0044963) is None


@pytest.mark.parametrize("certain", [0.0, 1e-30, 1.0])
def test_certainty_is_an_answer_like_any_other(certain: float) -> None:
    assert warning("logits", certain, certain) is not None
    assert warning("logits", certain, 0.5) is None


def test_probabilities_that_are_taken_for_logits_are_told() -> None:
    """By hand: sigmoid(0) = 0.5, sigmoid(1) = 0.7310586."""
    told = warning("logits", 0.5, 0.7310586)
    assert told is not None and told.startswith(
        "test model gives P = 0.5 to 0.73 in all 2 pictures, so all is"
    )
    assert told.endswith("its contract says output.kind 'logits'; is it 'probability'?")
    assert warning("probability", 0.5, 0.7310586) is None
    assert warning("logits", 0.49, 0.7310586) is None
    assert warning("logits", 0.5, 0.74) is None


def test_a_few_masks_of_nobody_and_people_who_are_not_there_are_no_doubt() -> None:
    assert warning("probability", *[0.0] * 9) is None
    assert warning("points", 4.5e-5, 4.5e-5) is None
    assert warning("density", 0.0025, 0.0025) is None
    assert warning("logits") is None


def test_ten_masks_of_nobody_and_nothing_else_are_one() -> None:
    """A threshold inside the model that nothing reaches, say: all ground in view would be called empty."""
    told = warning("probability", *[0.0] * 10)
    assert told is not None
    assert told.startswith(
        "test model gives 0 everywhere in all 10 pictures: nobody is in any of them, or it "
    )
    assert warning("probability", *[0.0] * 10, 1.0) is None


def test_commands_say_that_a_model_does_not_see(tmp_path: Path) -> None:
    blind = write_map_model(tmp_path / "blind.onnx", contract("logits"), scale=0.0, offset=-6.0)
    (tmp_path / "pictures").mkdir()
    for number in range(2):
        levels = np.random.default_rng(number).integers(0, 256, (32, 32, 3), np.uint8)
        Image.fromarray(levels).save(tmp_path / "pictures" / f"{number}.png")
    checked = crowdfence("model", "check", blind, "--json")
    assert "test model gives P = 0.0025 everywhere in the picture" in checked.stderr
    assert len(json.loads(checked.stdout)["warnings"]) == 1
    detected = crowdfence(
        "detect", tmp_path / "pictures", "-o", tmp_path / "out", "--model", blind, "--no-video"
    )
    assert "test model gives P = 0.0025 everywhere in all 2 pictures" in detected.stderr
