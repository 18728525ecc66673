"""The contracts printed in docs/models.md are contracts, and its Python runs."""

import json
import re
from pathlib import Path

import numpy as np
import onnx
import pytest

import crowdfence
from crowdfence import Contract, Detector
from crowdfence.detector.contract.crowd_rules import DensityRule, PeopleRule
from crowdfence.detector.contract.lookup import load_contract
from crowdfence.detector.shipped import shipped_model
from support.onnx_models import contract, write_map_model

TEXT = (Path(__file__).parents[3] / "docs" / "models.md").read_text(encoding="utf-8")
BLOCKS = [json.loads(block) for block in re.findall(r"```json\n(.*?)```", TEXT, re.DOTALL)]
WHOLE = next(block for block in BLOCKS if "schema" in block)
SIZES = next(block for block in BLOCKS if "sizes" in block)
OUTPUTS = [block for block in BLOCKS if "kind" in block]


def test_the_whole_contract_is_one() -> None:
    contract = Contract.from_json(WHOLE)
    assert (contract.output.kind, contract.temperature, contract.target_height_m) == ("probability", 1.1, 0.9)


def test_the_section_of_sizes_is_that_of_the_shipped_model() -> None:
    sizes = Contract.from_json(WHOLE | SIZES).sizes
    assert sizes is not None and sizes == load_contract(shipped_model()).sizes


@pytest.mark.parametrize("output", OUTPUTS, ids=lambda output: str(output["kind"]))
def test_every_output_section_is_one(output: dict[str, object]) -> None:
    contract = Contract.from_json(WHOLE | {"output": output})
    assert contract.output.kind == output["kind"]


def test_every_kind_has_its_example_and_the_defaults_are_true() -> None:
    kinds = {"logits", "class_logits", "density", "points", "boxes"}
    assert {output["kind"] for output in OUTPUTS} == kinds
    rules = {output["kind"]: output["rule"] for output in OUTPUTS if "rule" in output}
    assert rules == {"density": DensityRule().to_json(), "points": PeopleRule().to_json()}


def test_the_python_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the models, pictures and functions that a reader would have."""
    monkeypatch.chdir(tmp_path)
    for name in ("mine.onnx", "yolox_nano.onnx"):
        write_map_model(tmp_path / name, contract())
    image = np.full((48, 64, 3), 51, np.uint8)  # a fifth of 255
    desk = {"crowdfence": crowdfence, "json": json, "onnx": onnx, "contract": WHOLE, "function": lambda _: []}
    desk |= dict.fromkeys(("image", "image_1", "image_2"), image)
    using, writing = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    exec(compile(using, "docs/models.md", "exec"), desk)
    for heatmap in (desk["heatmap"], *desk["heatmaps"]):
        np.testing.assert_allclose(heatmap, np.full((12, 16), 0.2), atol=1e-6)
    exec(compile(writing, "docs/models.md", "exec"), desk)
    assert Detector("mine.onnx").contract == Contract.from_json(WHOLE)
