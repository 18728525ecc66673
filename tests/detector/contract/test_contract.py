"""The contract of a model: what is read, what is refused, and how the refusal reads."""

import json
from pathlib import Path
from typing import Any

import pytest

from crowdfence import Contract, DetectorError
from crowdfence.detector.contract.contract import MAX_JSON_BYTES, contract_from_text, read_contract
from crowdfence.detector.contract.lookup import load_contract
from support.damaged_files import damaged, outcome
from support.onnx_models import contract as document

SHIPPED = {
    "schema": 1,
    "name": "crowdnet-s",
    "version": "0.1.0",
    "licence": "Apache-2.0",
    "input": {
        "name": "image", "layout": "NHWC", "dtype": "uint8", "color": "RGB", "scale": 1.0,
        "mean": [0, 0, 0], "std": [1, 1, 1], "size": None, "multiple_of": 16, "resize": "none",
    },
    "output": {
        "name": "heatmap", "kind": "probability", "layout": "NCHW", "stride": 4, "class_index": None,
        "box_format": None, "score_min": None, "count_scale": None,
    },
    "calibration": {"temperature": 1.1, "missions": 7},
    "rates": {
        "per": "voxel observation", "b_threshold": 0.5,
        "true_positive": {"rate": 0.9, "low": 0.8, "high": 0.95},
        "false_positive": {"rate": 0.01, "low": 0.005, "high": 0.02},
    },
    "validity": {"gsd_m": [0.02, 0.25], "distance_m": [15, 150], "tilt_deg": [20, 90]},
    "target_height_m": 0.9,
}  # fmt: skip


def test_every_key_is_read() -> None:
    contract = Contract.from_json(SHIPPED)
    assert (contract.name, contract.version, contract.licence) == ("crowdnet-s", "0.1.0", "Apache-2.0")
    assert (contract.input.multiple_of, contract.input.size, contract.input.is_raw) == (16, None, True)
    assert (contract.output.kind, contract.output.stride) == ("probability", 4)
    assert contract.temperature == 1.1
    assert contract.rates is not None and contract.rates["true_positive"]["rate"] == 0.9
    assert contract.validity is not None and contract.validity.gsd_m == (0.02, 0.25)
    assert contract.target_height_m == 0.9
    assert not contract.needs_gsd


@pytest.mark.parametrize(
    "given",
    [
        SHIPPED,
        document("logits", calibration={"temperature": 2.0}),
        document("class_logits", output__class_index=3),
        document("density", output__rule={"people_per_m2": 1.0}),
        document("points", output__rule={"min_people": 5}),
        document("boxes", output__row="class_scores", output__class_index=[0, 1], output__iou_max=0.5),
        document(input__vibrance=3.0),
        document(about={"data": ["a", "b"]}),
    ],
)
def test_written_and_read_again_it_is_the_same(given: dict[str, Any]) -> None:
    contract = Contract.from_json(given)
    assert Contract.from_json(json.loads(json.dumps(contract.to_json()))) == contract


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": 2}, r"schema is 2; allowed: 1"),
        ({"schema": True}, r"schema is True; allowed: 1"),
        ({"name": ""}, r"name is ''; allowed: text"),
        ({"naem": "x"}, r"'naem' is not a key of the contract"),
        ({"output__kind": "heat"}, r"output.kind is 'heat'; allowed: probability, logits, class_logits"),
        ({"output__strid": 4}, r"output.'strid' is not a key"),
        ({"output__stride": 0}, r"output.stride is 0; allowed: a whole number from 1"),
        ({"output__stride": True}, r"output.stride is True"),
        ({"output__stride": None}, r"output.stride is missing"),
        ({"output__stride": 3}, r"input.multiple_of is 8; allowed: multiples of output.stride \(3\)"),
        ({"output__class_index": -1}, r"output.class_index is -1"),
        ({"output__class_index": [0, 1]}, r"output.class_index is \[0, 1\]"),
        ({"output__box_format": "xyxy"}, r"output.box_format goes with boxes, not with probability"),
        ({"output__rule": {}}, r"output.rule goes with density, points and boxes"),
        ({"input__layout": "HWC"}, r"input.layout is 'HWC'; allowed: NHWC, NCHW"),
        ({"input__dtype": "float16"}, r"input.dtype is 'float16'; allowed: uint8, float32"),
        ({"input__color": None}, r"input.color is missing"),
        ({"input__scale": 0.5}, r"input.dtype is 'uint8'.* scale, mean and std must be 1, 0, 1"),
        ({"input__std": [1, 1, 0]}, r"input.std is \[1, 1, 0\]; allowed: 3 numbers above 0"),
        ({"input__mean": [0, 0]}, r"input.mean is \[0, 0\]; allowed: a list of 3 numbers"),
        ({"input__mean": [0, 0, float("nan")]}, r"allowed: a list of 3 finite numbers"),
        ({"input__mean": [0, 0, 10**400]}, r"allowed: a list of 3 finite numbers"),
        ({"target_height_m": 10**400}, r"target_height_m is 10+\.*; allowed: a finite number of at least 0"),
        ({"input__size": [60, 64]}, r"input.size is \[60, 64\].* multiples of 8"),
        ({"input__size": [0, 8]}, r"input.size is \[0, 8\]"),
        ({"input__size": [10**9, 8]}, r"from 1 to 16384"),
        ({"input__resize": "stretch"}, r"input.resize is 'stretch', which needs input.size"),
        ({"input__vibrance": 0.5}, r"input.vibrance is 0.5; allowed: a finite number of at least 1"),
        ({"input__vibrance": 9}, r"input.vibrance is 9; allowed: a number from 1 to 8"),
        ({"input": None}, r"input is missing"),
        ({"input": [1]}, r"input must be a JSON object, got \[1\]"),
        ({"calibration": {"temperature": 0}}, r"calibration.temperature is 0; allowed: .* above 0"),
        ({"calibration": {"temperature": "1"}}, r"calibration.temperature is '1'"),
        ({"validity": {"gsd_m": [0.2, 0.1]}}, r"validity.gsd_m is \[0.2, 0.1\]; allowed: \[low, high\]"),
        ({"validity": {"gsd": [0.1, 0.2]}}, r"validity.'gsd' is not a key"),
        (
            {"rates": {"true_positive": {"rate": 0.9, "low": 0.95, "high": 1.0}}},
            r"rates.true_positive is 0.9 in \[0.95, 1\]; allowed: 0 <= low <= rate",
        ),
        ({"about": {"map50": [float("nan")]}}, r"about is no JSON .*Out of range.*; allowed: .* not NaN"),
        ({"rates": {"finer": 3}}, r"rates.finer must be a JSON object, got 3"),
        ({"rates": {"finer": {"focal_px": 0.0}}}, r"rates.finer.focal_px is 0.0; allowed: .* above 0"),
        (
            {"rates": {"finer": {"focal_px": 9.0, "validity": {"gsd_m": 1}}}},
            r"rates.finer.validity.gsd_m is 1",
        ),
        ({"rates": {"voxel_size_m": float("inf")}}, r"rates is no JSON .*Out of range"),
        ({"about": {"classes": {1}}}, r"about is no JSON \(.*set.*\); allowed"),
        ({"target_height_m": -1}, r"target_height_m is -1; allowed: a finite number of at least 0"),
    ],
)
def test_a_doubt_is_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(DetectorError, match=message) as caught:
        Contract.from_json(document(**changes))
    assert "\n" not in str(caught.value)


IMAGENET_MEAN, IMAGENET_STD = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]
OF_255 = [123.675, 116.28, 103.53], [58.395, 57.12, 57.375]


@pytest.mark.parametrize(
    ("scale", "mean", "std"),
    [
        (1.0, [0, 0, 0], [1, 1, 1]),
        (1 / 255, [0, 0, 0], [1, 1, 1]),
        (1 / 255, IMAGENET_MEAN, IMAGENET_STD),
        (1.0, *OF_255),
        (1.0, [103.94, 116.78, 123.68], [1, 1, 1]),  # Caffe
        (1 / 127.5, [1, 1, 1], [1, 1, 1]),  # -1 to 1
    ],
)
def test_pixels_are_scaled_as_networks_have_them(scale: float, mean: list[float], std: list[float]) -> None:
    changes = {"input__dtype": "float32", "input__scale": scale, "input__mean": mean, "input__std": std}
    assert Contract.from_json(document(**changes)).input.scale == scale


@pytest.mark.parametrize(
    ("scale", "mean", "std", "apart"),
    [
        (1 / 255, *OF_255, "0.0171"),  # 1 / 58.395
        (1 / 255, OF_255[0], [1, 1, 1], "1"),
        (1.0, IMAGENET_MEAN, IMAGENET_STD, "1.11e\\+03"),  # 255 / 0.229
        (1.0, [0.5, 0.5, 0.5], [0.5, 0.5, 0.5], "510"),
    ],
)
def test_mean_and_std_of_other_pixels_are_refused(
    scale: float, mean: list[float], std: list[float], apart: str
) -> None:
    changes = {"input__dtype": "float32", "input__scale": scale, "input__mean": mean, "input__std": std}
    with pytest.raises(DetectorError, match=rf"input.scale {scale:.6g}.* would be {apart} apart"):
        Contract.from_json(document(**changes))


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        ("boxes", {"output__box_format": None}, r"output.box_format is missing"),
        ("boxes", {"output__row": None}, r"output.row is missing"),
        ("boxes", {"output__row": "class_scores"}, r"output.class_index is missing"),
        ("boxes", {"output__iou_max": 1.5}, r"output.iou_max is 1.5"),
        ("boxes", {"output__score_min": 25}, r"output.score_min is 25; allowed: null or a number from 0 to"),
        ("points", {"output__layout": "NCHW"}, r"output.layout is 'NCHW'; allowed: NDC, NCD"),
        ("points", {"output__rule": {"min_people": 0}}, r"output.rule.min_people is 0"),
        ("density", {"output__count_scale": None}, r"output.count_scale is missing"),
        ("points", {"output__rule": {"radius_m": 1e300}}, r"radius_m is 1e\+300; allowed: metres up to 100"),
        ("points", {"output__rule": {"closing_m": 150}}, r"closing_m is 150; allowed: metres up to 100"),
        (
            "points",
            {"output__rule": {"min_people": 32, "radius_m": 1.0}},
            r"output.rule.min_people 32 within output.rule.radius_m 1 is met nowhere; no more than 31.4 ",
        ),
        (
            "boxes",
            {"output__rule": {"person_height_m": 170}},
            r"output.rule.person_height_m is 170; allowed: null or metres from 0.3 to 3",
        ),
        ("density", {"output__rule": {"people_per_m2": 24}}, r"people_per_m2 is 24; allowed: above 0 and at"),
        ("density", {"output__rule": {"window_m": 350}}, r"window_m is 350; allowed: metres from 0 to 100"),
        ("density", {"output__rule": {"people_per_m2": -1}}, r"output.rule.people_per_m2 is -1"),
    ],
)
def test_each_kind_needs_its_keys(kind: str, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(DetectorError, match=message):
        Contract.from_json(document(kind, **changes))


@pytest.mark.parametrize("text", ["", "{", "[1]", "null", "NaN", "[" * 100_000])
def test_text_that_is_no_contract_names_its_source(text: str) -> None:
    with pytest.raises(DetectorError, match=r"^here"):
        contract_from_text(text, "here")


def test_a_damaged_contract_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "model.crowdfence.json"
    rule = {"min_people": 3, "radius_m": 2.0, "softness_people": 0.25, "closing_m": 1.0}
    intact = json.dumps(document("points", output__rule=rule)).encode()
    refused = 0
    for data in damaged(intact, 600):
        path.write_bytes(data)
        said = outcome(lambda: read_contract(path))
        assert not said or said.startswith(str(path))
        refused += bool(said)
    assert refused > 200


def test_a_huge_text_is_not_parsed() -> None:
    with pytest.raises(DetectorError, match=r"10,000,000 bytes are too many .* 4,000,000"):
        contract_from_text("x" * 10_000_000, "here")
    assert MAX_JSON_BYTES == 4_000_000


def test_load_contract_reads_a_json_file(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(SHIPPED))
    assert load_contract(path) == Contract.from_json(SHIPPED)
    with pytest.raises(FileNotFoundError):
        load_contract(tmp_path / "none.json")
