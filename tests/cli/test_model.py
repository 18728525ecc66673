"""`crowdfence model check` as people and scripts see it."""

import json
import math
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from support.command_line import crowdfence
from support.onnx_models import contract as document
from support.onnx_models import write_fixed_output_model, write_map_model

OK, FAILED, USAGE = 0, 1, 2


def check(*arguments: object) -> subprocess.CompletedProcess[str]:
    return crowdfence("model", "check", *arguments, columns=160)


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """40 x 24 pixels, red 204 in the left half."""
    pixels = np.zeros((24, 40, 3), np.uint8)
    pixels[:, :20, 0] = 204
    Image.fromarray(pixels).save(tmp_path / "picture.png")
    return tmp_path / "picture.png"


def test_a_usable_model_is_described(tmp_path: Path, picture: Path) -> None:
    given = document(validity={"gsd_m": [0.02, 0.25]}, target_height_m=0.9)
    given["rates"] = {"true_positive": {"rate": 0.9, "low": 0.8, "high": 0.95}}
    model = write_map_model(tmp_path / "m.onnx", given)
    finished = check(model, "--image", picture, "--overlay", tmp_path / "overlay.png")
    assert (finished.returncode, finished.stderr) == (OK, "")
    for line in (
        f"{model}: usable",
        'metadata "crowdfence"',
        "test model 1.0, Apache-2.0",
        "image: uint8 NHWC RGB, any size, sides multiples of 8, resize none",
        "heatmap: probability NCHW, stride 4",
        "true positive 0.9 (0.8 to 0.95)",
        "0.02 to 0.25 m per pixel",
        "what is 0.9 m above the ground",
        "picture.png, 40 x 24",
        "10 x 6, 0.000 to 0.800, 50.0% above 0.5",
        "p50",
    ):
        assert line in finished.stdout
    with Image.open(tmp_path / "overlay.png") as overlay:
        drawn = np.asarray(overlay)
    assert drawn.shape == (24, 40, 3)
    assert drawn[12, 10].tolist() != [204, 0, 0] and drawn[12, 35].tolist() == [0, 0, 0]


def test_the_same_as_json(tmp_path: Path, picture: Path) -> None:
    finished = check(write_map_model(tmp_path / "m.onnx", document()), "--image", picture, "--json")
    report = json.loads(finished.stdout)
    assert report["contract"]["output"]["kind"] == "probability"
    assert report["heatmap"] == {
        "size": [10, 6],
        "lowest": 0.0,
        "highest": pytest.approx(0.8, abs=1e-6),
        "share_above_half": 0.5,
    }
    assert 0.0 < report["latency_ms"]["p50"] <= report["latency_ms"]["p95"]


def test_without_a_picture_it_takes_a_bundled_one(tmp_path: Path) -> None:
    model = write_map_model(tmp_path / "m.onnx", document())
    report = json.loads(check(model, "--json").stdout)
    assert report["image"]["size"] == [640, 480] and report["heatmap"]["highest"] > 0.5


def test_a_contract_may_be_given(tmp_path: Path, picture: Path) -> None:
    model = write_map_model(tmp_path / "m.onnx", scale=0.1)
    (tmp_path / "mine.json").write_text(json.dumps(document("density")))
    finished = check(model, "--image", picture, "--contract", tmp_path / "mine.json", "--gsd-m", "0.5")
    assert finished.returncode == OK
    assert "people_per_m2 0.24" in finished.stdout and "mine.json" in finished.stdout


def test_what_cannot_be_used_is_one_line_and_exit_1(tmp_path: Path, picture: Path) -> None:
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"\x08\x07garbage")
    (tmp_path / "nan").mkdir()
    weights = tmp_path / "weights.pt"
    weights.write_bytes(b"\x08\x07garbage")
    cases = {
        broken: "cannot be loaded by ONNX Runtime",
        weights: "; models of other kinds are exported to ONNX first",
        write_map_model(tmp_path / "silent.onnx"): "says neither what it expects",
        write_map_model(tmp_path / "logits.onnx", document(), offset=-3.0): "are these kind 'logits'?",
        write_fixed_output_model(
            tmp_path / "nan.onnx", np.full((1, 1, 6, 10), math.nan), document()
        ): "output heatmap holds nan",
        tmp_path / "none.onnx": "is no file",
        "crowdnet": "crowdnet is no file: no model there; those that come along: crowdnet-s, crowdnet-s-",
    }
    for model, message in cases.items():
        finished = check(model, "--image", picture)
        assert finished.returncode == FAILED and finished.stdout == ""
        assert message in finished.stderr and finished.stderr.count("\n") == 1
        assert str(model) in finished.stderr


def test_metres_per_pixel_count_for_every_model_that_is_shown_pictures_to_scale(
    tmp_path: Path, picture: Path
) -> None:
    """0.8 of red in the left half, seen as it is at 0.1 m; at several sizes its logit would be halved."""
    sizes = {"gsd_m": [0.05, 0.3], "without_gsd": [1.0], "weights": [0.5]}
    model = write_map_model(tmp_path / "m.onnx", document(sizes=sizes))
    for gsd_m, expected in ((None, 2.0 / 3.0), (0.1, 0.8)):
        given = () if gsd_m is None else ("--gsd-m", gsd_m)
        told = json.loads(check(model, "--image", picture, *given, "--json").stdout)
        assert told["heatmap"]["highest"] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("gsd_m", ["nan", "inf", "0", "-1"])
def test_metres_per_pixel_that_are_none_are_said_of_the_option(tmp_path: Path, gsd_m: str) -> None:
    model = write_map_model(tmp_path / "m.onnx", document())
    finished = check(model, "--gsd-m", gsd_m)
    assert finished.returncode == 2 and "Invalid value for '--gsd-m'" in finished.stderr


def test_a_picture_of_sixteen_bits_is_not_clipped(tmp_path: Path) -> None:
    model = write_map_model(tmp_path / "m.onnx", document())
    Image.fromarray(np.full((24, 40), 4000, np.uint16)).save(tmp_path / "deep.png")
    finished = check(model, "--image", tmp_path / "deep.png")
    assert finished.returncode == FAILED and "save it with 8 bits a channel" in finished.stderr


def test_a_picture_that_is_none_is_named(tmp_path: Path) -> None:
    model = write_map_model(tmp_path / "m.onnx", document())
    text = tmp_path / "text.png"
    text.write_text("no picture")
    for image in (text, tmp_path / "none.png"):
        finished = check(model, "--image", image)
        assert finished.returncode == FAILED and image.name in finished.stderr
    assert check(model, "--threads", 0).returncode == USAGE
