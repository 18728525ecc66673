"""Where a contract comes from: the order of the sources, and what each of them leaves in doubt."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import TensorProto

from crowdfence import Detector, DetectorError
from crowdfence.detector.contract.lookup import load_contract
from support.onnx_models import contract as document
from support.onnx_models import write_fixed_output_model, write_map_model

YOLO_IMAGE = (1, 3, 32, 64)
PREPROCESSOR = {
    "do_resize": True,
    "size": {"height": 32, "width": 64},
    "do_rescale": True,
    "rescale_factor": 1 / 255,
    "do_normalize": True,
    "image_mean": [0.5, 0.25, 0.0],
    "image_std": [0.5, 0.5, 2.0],
}


def ultralytics_model(path: Path, output: Any, **metadata: str) -> Path:
    keys = {"task": "detect", "stride": "32", "imgsz": "[32, 64]", "names": "{0: 'car', 1: 'Person'}"}
    return write_fixed_output_model(
        path,
        output,
        dtype=TensorProto.FLOAT,
        image_shape=YOLO_IMAGE,
        metadata={name: value for name, value in (keys | metadata).items() if value},
        output_name="output0",
    )


def deepness_model(path: Path, output: Any, **values: Any) -> Path:
    keys = {"model_type": "Segmentor", "class_names": {"0": "ground", "1": "crowd"}, "resolution": 10}
    return write_fixed_output_model(
        path,
        output,
        dtype=TensorProto.FLOAT,
        image_shape=(1, 3, 16, 16),
        metadata={name: json.dumps(value) for name, value in (keys | values).items() if value is not None},
    )


def float_model(path: Path, **more: Any) -> Path:
    return write_map_model(
        path, layout="NCHW", dtype=TensorProto.FLOAT, image_shape=("N", 3, "H", "W"), scale=1.0, **more
    )


def test_the_sidecar_wins_over_the_metadata(tmp_path: Path) -> None:
    path = write_map_model(tmp_path / "m.onnx", document(name="inside"))
    assert load_contract(path).name == "inside"
    (tmp_path / "m.crowdfence.json").write_text(json.dumps(document(name="beside")))
    detector = Detector(path)
    assert detector.contract.name == "beside"
    assert detector.contract_source.endswith("m.crowdfence.json")


def test_a_partial_sidecar_is_not_completed_from_the_metadata(tmp_path: Path) -> None:
    path = write_map_model(tmp_path / "m.onnx", document())
    (tmp_path / "m.crowdfence.json").write_text('{"schema": 1, "name": "half"}')
    with pytest.raises(DetectorError, match=r"m.crowdfence.json: output is missing"):
        load_contract(path)


def test_the_contract_of_the_call_wins_over_both(tmp_path: Path) -> None:
    path = write_map_model(tmp_path / "m.onnx", document(name="inside"))
    assert Detector(path, document(name="given")).contract.name == "given"
    (tmp_path / "other.json").write_text(json.dumps(document(name="file")))
    assert Detector(path, tmp_path / "other.json").contract.name == "file"


def test_a_model_that_says_nothing_is_refused(tmp_path: Path) -> None:
    path = write_map_model(tmp_path / "m.onnx")
    with pytest.raises(DetectorError, match=r"no m.crowdfence.json beside it, no metadata .*docs/models.md"):
        Detector(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not json", r'm.onnx, metadata "crowdfence" is not JSON'),
        ("{}", r'm.onnx, metadata "crowdfence": schema is None'),
        ("x" * 10_000_000, r"10,000,000 bytes are too many"),
        ("[" * 200_000, r"is not JSON"),
    ],
)
def test_damaged_metadata_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = write_map_model(tmp_path / "m.onnx", metadata={"crowdfence": text})
    with pytest.raises(DetectorError, match=message) as caught:
        Detector(path)
    assert len(str(caught.value)) < 500


def test_ultralytics_raw_output(tmp_path: Path) -> None:
    """[1, 4 + 2 classes, anchors]: cx, cy, w, h, car, person; three people and a car on one spot."""
    people = [(10 + i, 20, 4, 8, 0.0, 0.9) for i in range(0, 15, 5)]
    car = (32, 16, 20, 10, 0.9, 0.1)
    path = ultralytics_model(tmp_path / "yolo.onnx", np.array([[*people, car]]).transpose(0, 2, 1))
    contract = load_contract(path)
    assert contract.input.size == (64, 32)
    assert (contract.input.resize, contract.input.scale) == ("letterbox", 1 / 255)
    output = contract.output
    assert (output.kind, output.layout, output.row, output.classes) == ("boxes", "NCD", "class_scores", (1,))
    assert (output.score_min, output.iou_max) == (0.25, 0.7)
    heatmap = Detector(path)(np.zeros((32, 64, 3), np.uint8), gsd_m=0.1)
    # Feet at (10, 24), (15, 24), (20, 24): 2.7 people within 2 m, sigmoid((2.7 - 2.5) / 0.25).
    assert heatmap[6, 3] == pytest.approx(1 / (1 + math.exp(-0.8)), abs=1e-5)
    assert heatmap[4, 12] < 0.01


def test_ultralytics_final_boxes_and_masks(tmp_path: Path) -> None:
    final = load_contract(ultralytics_model(tmp_path / "a.onnx", np.zeros((1, 300, 6)))).output
    assert (final.layout, final.box_format, final.row, final.iou_max) == ("NDC", "xyxy", "score_class", None)
    segment = ultralytics_model(tmp_path / "b.onnx", np.zeros((1, 4 + 2 + 32, 21)), task="segment")
    assert load_contract(segment).output.layout == "NCD"


def test_ultralytics_takes_every_class_of_people(tmp_path: Path) -> None:
    names = "{0: 'pedestrian', 1: 'people', 2: 'car'}"
    path = ultralytics_model(tmp_path / "m.onnx", np.zeros((1, 7, 21)), names=names)
    assert load_contract(path).output.classes == (0, 1)


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"task": "pose"}, r"task is 'pose'; allowed: detect, segment"),
        ({"names": "{0: 'car', 1: 'tree'}"}, r"names has no class named .*person.* but 'car, tree'"),
        ({"names": "import os"}, r"names is 'import os', which is no value of JSON or Python"),
        ({"names": "{0: 1}"}, r"names is \{0: 1\}; allowed: class numbers with their names"),
        ({"names": "(" * 50_000}, r"names is .*which is no value"),
        ({"names": "[" + "'a'," * 400_000 + "]"}, r"names has 1,600,002 characters; allowed: 1,000,000"),
        ({"names": "{0: 'person'}"}, r"allowed: either \[N, 5, anchors\] or \[N, detections, 6\]"),
    ],
)
def test_ultralytics_doubts(tmp_path: Path, metadata: dict[str, str], message: str) -> None:
    path = ultralytics_model(tmp_path / "m.onnx", np.zeros((1, 6, 21)), **metadata)
    with pytest.raises(DetectorError, match=message) as caught:
        load_contract(path)
    assert "m.crowdfence.json takes its place" in str(caught.value)


def test_ultralytics_output_that_fits_both_forms_is_refused(tmp_path: Path) -> None:
    path = ultralytics_model(tmp_path / "m.onnx", np.zeros((1, 6, 6)))
    with pytest.raises(DetectorError, match=r"allowed: either"):
        load_contract(path)


def test_deepness_segmentor(tmp_path: Path) -> None:
    answer = np.zeros((1, 2, 8, 8))
    answer[:, 1, 2, 3] = 0.75
    path = deepness_model(tmp_path / "m.onnx", answer, standardization_mean=[0.5, 0.5, 0.5])
    contract = load_contract(path)
    assert (contract.output.kind, contract.output.stride, contract.output.classes) == ("probability", 2, (1,))
    assert (contract.input.resize, contract.input.size) == ("tile", (16, 16))
    assert contract.input.mean == (0.5, 0.5, 0.5)
    assert contract.validity is not None and contract.validity.gsd_m == (0.1, 0.1)
    heatmap = Detector(path)(np.zeros((16, 16, 3), np.uint8))
    assert heatmap[2, 3] == 0.75 and heatmap.sum() == 0.75


@pytest.mark.parametrize("names", [{"0": "crowd"}, {"0": "ground", "1": "crowd"}])
def test_the_one_channel_of_a_deepness_segmentor_is_crowd(tmp_path: Path, names: dict[str, str]) -> None:
    path = deepness_model(tmp_path / "m.onnx", np.full((1, 1, 8, 8), 0.75), class_names=names)
    assert Detector(path)(np.zeros((16, 16, 3), np.uint8)) == pytest.approx(np.full((8, 8), 0.75))


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({"0": "ground", "1": "road"}, r"class_names has no class named crowd, .* but 'ground, road'"),
        ({"0": "road"}, r"class_names has no class named crowd, .* but 'road'"),
        (None, r"class_names are missing: which class is people or crowd\?"),
    ],
)
def test_one_channel_of_another_class_is_no_crowd(tmp_path: Path, names: Any, message: str) -> None:
    path = deepness_model(tmp_path / "m.onnx", np.zeros((1, 1, 8, 8)), class_names=names)
    with pytest.raises(DetectorError, match=message):
        load_contract(path)


def test_deepness_detector(tmp_path: Path) -> None:
    path = deepness_model(
        tmp_path / "m.onnx",
        np.zeros((1, 10, 7)),
        model_type="Detector",
        class_names={"0": "person", "1": "car"},
        det_type="YOLO_v5_or_v7_default",
        det_conf=0.3,
        det_iou_thresh=0.4,
    )
    output = load_contract(path).output
    assert (output.row, output.classes, output.score_min) == ("objectness_class_scores", (0,), 0.3)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"model_type": "Regressor"}, r"model_type is 'Regressor'; allowed: Segmentor, Detector"),
        ({"model_type": 3}, r"model_type is 3"),
        ({"model_type": "Detector"}, r"det_type is None; allowed: YOLO_v5_or_v7_default"),
        ({"class_names": {"0": "a", "1": "b"}}, r"class_names has no class named"),
        ({"class_names": {"0": "people", "1": "crowd"}}, r"several classes of people"),
        ({"resolution": -1}, r"resolution is -1; allowed: centimetres per pixel above 0"),
        ({"standardization_std": [0, 1, 1]}, r"input.std is \[0, 1, 1\]"),
    ],
)
def test_deepness_doubts(tmp_path: Path, values: dict[str, Any], message: str) -> None:
    path = deepness_model(tmp_path / "m.onnx", np.zeros((1, 2, 8, 8)), **values)
    with pytest.raises(DetectorError, match=message):
        load_contract(path)


def test_hugging_face_input_with_the_callers_output(tmp_path: Path) -> None:
    path = float_model(tmp_path / "m.onnx")
    (tmp_path / "preprocessor_config.json").write_text(json.dumps(PREPROCESSOR))
    detector = Detector(path, output={"kind": "probability", "layout": "NCHW", "stride": 4})
    assert detector.contract.input.size == (64, 32)
    assert detector.contract.output.name == "heatmap"
    # Red 191.25 / 255 = 0.75; (0.75 - 0.5) / 0.5 = 0.5. With 191: (191 / 255 - 0.5) / 0.5 = 0.49804.
    image = np.full((32, 64, 3), (191, 0, 0), np.uint8)
    assert detector(image) == pytest.approx(np.full((8, 16), 0.49804), abs=1e-5)


def test_hugging_face_turns_channels_round(tmp_path: Path) -> None:
    path = float_model(tmp_path / "m.onnx")
    config = PREPROCESSOR | {"do_normalize": False, "do_flip_channel_order": True}
    (tmp_path / "preprocessor_config.json").write_text(json.dumps(config))
    detector = Detector(path, output={"kind": "probability", "layout": "NCHW", "stride": 4})
    # The model answers with its first channel, which is blue: 51 / 255.
    image = np.full((32, 64, 3), (191, 0, 51), np.uint8)
    assert detector(image) == pytest.approx(np.full((8, 16), 0.2), abs=1e-5)


def test_hugging_face_says_nothing_about_the_output(tmp_path: Path) -> None:
    (tmp_path / "preprocessor_config.json").write_text(json.dumps(PREPROCESSOR))
    with pytest.raises(DetectorError, match=r"what the output means is not stated: give output="):
        Detector(float_model(tmp_path / "m.onnx"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"do_normalize": None}, r"do_normalize is None; allowed: true or false, written out"),
        ({"do_rescale": "yes"}, r"do_rescale is 'yes'; allowed: true or false"),
        ({"image_mean": None}, r"image_mean is None; allowed: a list of 3 numbers"),
        ({"size": {"shortest_edge": 32}}, r"size is .*shortest_edge.*; allowed: .*height"),
        ({"size": {"height": 32, "width": 64, "shortest_edge": 32}}, r"shortest_edge"),
        ({"do_center_crop": True}, r"do_center_crop is True; allowed: false"),
        ({"do_flip_channel_order": True}, r"do_flip_channel_order is True; allowed: false where do_norm"),
        ({"rescale_offset": True}, r"rescale_offset is True; allowed: false"),
        ({"rescale_factor": 0}, r"rescale_factor is 0; allowed: a finite number above 0"),
    ],
)
def test_hugging_face_doubts(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    path = float_model(tmp_path / "m.onnx")
    (tmp_path / "preprocessor_config.json").write_text(json.dumps(PREPROCESSOR | changes))
    with pytest.raises(DetectorError, match=message):
        Detector(path, output={"kind": "probability", "layout": "NCHW", "stride": 4})


def test_a_damaged_preprocessor_file_is_named(tmp_path: Path) -> None:
    path = float_model(tmp_path / "m.onnx")
    (tmp_path / "preprocessor_config.json").write_text("{")
    with pytest.raises(DetectorError, match=r"preprocessor_config.json: it is not JSON"):
        Detector(path, output={"kind": "probability", "layout": "NCHW", "stride": 4})
