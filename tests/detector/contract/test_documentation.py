"""The contracts printed in docs/models.md are contracts."""

import json
import re
from pathlib import Path

import pytest

from crowdfence import Contract
from crowdfence.detector.contract.crowd_rules import DensityRule, PeopleRule
from crowdfence.detector.contract.lookup import load_contract
from crowdfence.detector.shipped import shipped_model

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
