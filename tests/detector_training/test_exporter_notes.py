"""A shipped model says what it is, and nothing of the machine that made it."""

import re

import onnx
import pytest
from onnx import TensorProto, helper

from crowdfence.detector.shipped import FILES, shipped_model
from crowdfence.detector_training.exporter_notes import forget_exporter_notes


def test_notes_go_and_the_contract_stays() -> None:
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1])
    heatmap = helper.make_tensor_value_info("heatmap", TensorProto.FLOAT, [1])
    node = helper.make_node("Sigmoid", ["image"], ["heatmap"], doc_string="line 27 of /somewhere/net.py")
    model = helper.make_model(helper.make_graph([node], "net", [image], [heatmap]))
    for noted in (model.graph, model.graph.node[0], model.graph.input[0]):
        noted.metadata_props.add(key="stack_trace", value="/somewhere/net.py")
    model.metadata_props.add(key="crowdfence", value="{}")
    forget_exporter_notes(model)
    assert b"/somewhere" not in model.SerializeToString()
    assert [entry.key for entry in model.metadata_props] == ["crowdfence"]
    onnx.checker.check_model(model)


@pytest.mark.parametrize("name", FILES)
def test_no_shipped_model_names_a_folder(name: str) -> None:
    data = shipped_model(name).read_bytes()
    assert b"stack_trace" not in data and not re.search(rb"\.py\W", data)
