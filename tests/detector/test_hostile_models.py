"""Files that are no usable model: one line that says so, never another exception, never noise."""

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto

from crowdfence import Detector, DetectorError
from support.onnx_models import contract as document
from support.onnx_models import write_fixed_output_model, write_map_model, write_two_input_model

IMAGE = np.zeros((16, 16, 3), np.uint8)


def refused(path: Path, message: str | None = None, image: Any = IMAGE) -> str:
    with pytest.raises(DetectorError, match=message) as caught:
        Detector(path)(image)
    text = str(caught.value)
    assert text.startswith(str(path)) and "\n" not in text and len(text) < 600
    return text


def test_no_file_is_no_model(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none.onnx is no file"):
        Detector(tmp_path / "none.onnx")
    with pytest.raises(FileNotFoundError, match=r"is no file"):
        Detector(tmp_path)


def test_a_truncated_model_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    whole = write_map_model(tmp_path / "m.onnx", document()).read_bytes()
    path = tmp_path / "cut.onnx"
    for length in [0, 1, 10, *range(50, len(whole), 151)]:
        path.write_bytes(whole[:length])
        refused(path)
    assert capfd.readouterr() == ("", "")


def test_random_bytes_and_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "noise.onnx"
    for seed in range(20):
        path.write_bytes(np.random.default_rng(seed).bytes(2000))
        refused(path, r"cannot be loaded by ONNX Runtime")
    path.write_text("<!doctype html>")
    refused(path, r"cannot be loaded by ONNX Runtime")


def test_damaged_bytes_give_a_heatmap_or_a_detector_error(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = write_map_model(tmp_path / "m.onnx", document()).read_bytes()
    path = tmp_path / "damaged.onnx"
    rng = np.random.default_rng(0)
    for _ in range(100):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            heatmap = Detector(path)(IMAGE)
        except DetectorError as error:
            assert "\n" not in str(error)
        else:
            assert heatmap.shape == (4, 4) and 0.0 <= heatmap.min() <= heatmap.max() <= 1.0
    assert capfd.readouterr() == ("", "")


def test_an_opset_of_the_far_future_is_refused(tmp_path: Path) -> None:
    path = write_map_model(tmp_path / "m.onnx", document())
    model = onnx.load(path)
    model.opset_import[0].version = 9999
    path.write_bytes(model.SerializeToString())
    refused(path, r"cannot be loaded by ONNX Runtime: .*9999")


def test_metadata_that_are_no_text_are_refused_quietly(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write_map_model(tmp_path / "m.onnx", metadata={"crowdfence": "#" * 40})
    path.write_bytes(path.read_bytes().replace(b"#" * 40, b"\xff" * 40))
    refused(path)
    assert capfd.readouterr() == ("", "")


def test_several_inputs_are_refused(tmp_path: Path) -> None:
    refused(write_two_input_model(tmp_path / "m.onnx"), r"has 2 inputs \('image, other'\); allowed: 1")


@pytest.mark.parametrize(
    ("model", "changes", "message"),
    [
        ({"image_shape": ["N", "H", "W", 1]}, {}, r"1 channels in NHWC; allowed: 3 \(RGB\)"),
        ({"image_shape": ["N", "H", "W", 4]}, {}, r"4 channels in NHWC; allowed: 3"),
        ({"image_shape": [2, "H", "W", 3]}, {}, r"2 images at once; allowed: 1 or any number"),
        ({"image_shape": [1, 16, 16, 3]}, {}, r"16 pixels wide; the contract's input.size is null"),
        (
            {"image_shape": [1, 16, 16, 3]},
            {"input__size": [16, 24]},
            r"16 pixels high; the contract's input.size is \[16, 24\]",
        ),
        ({"dtype": TensorProto.FLOAT}, {}, r"the input is image float32 .*; the contract says uint8"),
        ({}, {"input__name": "picture"}, r"the contract's input.name is 'picture'; the model has 'image'"),
        ({}, {"output__name": "mask"}, r"the contract's output.name is 'mask'; the model has 'heatmap'"),
        ({}, {"output__layout": "NHW"}, r"the output is heatmap float32 .*; the contract says NHW"),
    ],
)
def test_a_contract_of_another_model_is_refused(
    tmp_path: Path, model: dict[str, Any], changes: dict[str, Any], message: str
) -> None:
    refused(write_map_model(tmp_path / "m.onnx", document(**changes), **model), message)


def test_an_image_of_rank_three_is_refused(tmp_path: Path) -> None:
    path = write_fixed_output_model(
        tmp_path / "m.onnx", np.zeros((1, 1, 4, 4)), document(), image_shape=("H", "W", 3)
    )
    refused(path, r"the input is image uint8 \[H, W, 3\]; allowed: 4 dimensions, NHWC")


def test_a_model_that_fails_while_it_runs_is_named(tmp_path: Path) -> None:
    """The graph says that any size will do, and adds a constant of 3 x 5 cells."""
    path = write_map_model(tmp_path / "m.onnx", document())
    model = onnx.load(path)
    offset = next(constant for constant in model.graph.initializer if constant.name == "offset")
    offset.CopyFrom(onnx.numpy_helper.from_array(np.zeros((1, 1, 3, 5), np.float32), "offset"))
    path.write_bytes(model.SerializeToString())
    refused(path, r"the model failed on an input of shape \[1, 16, 16, 3\]: ")


def test_output_that_is_not_floating_point_is_refused(tmp_path: Path) -> None:
    image = onnx.helper.make_tensor_value_info("image", TensorProto.UINT8, [1, "H", "W", 3])
    labels = onnx.helper.make_tensor_value_info("heatmap", TensorProto.INT64, [1, "H", "W", 1])
    node = onnx.helper.make_node("ArgMax", ["image"], ["heatmap"], axis=3)
    graph = onnx.helper.make_graph([node], "labels", [image], [labels])
    path = tmp_path / "m.onnx"
    onnx.save(
        onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8), path
    )
    with pytest.raises(DetectorError, match=r"the output is heatmap int64 .*; allowed: float32, float16"):
        Detector(path, document(output__layout="NHWC"))


def test_threads_must_be_one_or_more(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="threads is 0"):
        Detector(write_map_model(tmp_path / "m.onnx", document()), threads=0)
