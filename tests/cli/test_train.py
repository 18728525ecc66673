"""Which data `train`, and what measures a model on labelled data, takes from folders."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from crowdfence.cli.options import recordings_in

DEMO = Path(__file__).parents[2] / "python" / "crowdfence" / "demo_data"


def test_annotated_pictures_beside_missions_are_taken_too(tmp_path: Path) -> None:
    """The pictures were passed over without a word."""
    for name in ("b.mcap", "a.mcap", "map.json"):
        (tmp_path / name).write_text("{}")
    missions = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    assert recordings_in([tmp_path]) == missions
    (tmp_path / "annotations.json").write_text(json.dumps({"images": [], "annotations": []}))
    assert recordings_in([tmp_path]) == [*missions, tmp_path]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "m.checkpoint"], "--output m.checkpoint: a model's name ends in .onnx"),
        (
            ["-o", "m.onnx", "--live-statistics"],
            "--live-statistics is for a training that starts from a model",
        ),
    ],
)
def test_what_training_could_not_use_is_refused(options: list[str], message: str) -> None:
    """The model took the place of its checkpoint; statistics were as without the option."""
    from crowdfence.cli.app import app

    refused = CliRunner().invoke(app, ["train", "--data", "a", "--validation", "b", *options])
    assert message in str(refused.exception)


@pytest.mark.skipif("PYTEST_XDIST_WORKER" in os.environ, reason="beside other tests PyTorch is not loaded")
def test_a_model_made_from_another_is_shown_pictures_as_that_one(tmp_path: Path) -> None:
    """It had neither its sizes nor its colours nor its licence, and nothing said so."""
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxscript")
    from crowdfence.calibration.graph import write_contract
    from crowdfence.cli.app import app
    from crowdfence.detector.contract.lookup import load_contract
    from crowdfence.detector.shipped import shipped_model

    graph = onnx.load(str(shipped_model("crowdnet-s-float32")))
    first = load_contract(shipped_model("crowdnet-s-float32"))
    first = replace(first, input=replace(first.input, vibrance=3.0), version="7")
    models = [tmp_path / name for name in ("first.onnx", "second.onnx", "blue.onnx")]
    write_contract(graph, first.to_json())
    onnx.save_model(graph, str(models[0]))
    few = ["--steps", "1", "--batch", "1", "--target", "silhouettes", "--json"]
    data = [tmp_path / name for name in ("a.mcap", "b.mcap")]
    for place in data:
        shutil.copyfile(DEMO / "race.mcap", place)
    given = ["train", "--data", str(data[0]), "--validation", str(data[1]), *few]
    done = CliRunner().invoke(app, [*given, "--initial", str(models[0]), "-o", str(models[1])])
    assert json.loads(done.stdout)["plan"]["vibrance"] == 3.0
    second = load_contract(models[1])
    assert second.input.vibrance == 3.0 and second.licence == "Apache-2.0"
    assert second.about is not None and second.about["started_from"] == "crowdnet-s 7"
    assert second.rates is None and second.calibration is None and second.pictures is None
    # Those of the first join maps after its calibration: -.64 after a scale of 1.1407.
    assert first.sizes is not None and second.sizes is not None
    assert replace(second.sizes, bias=first.sizes.bias) == first.sizes
    assert second.sizes.bias == pytest.approx(-0.64 * 0.8767, abs=1e-3)

    write_contract(graph, replace(first, input=replace(first.input, color="BGR")).to_json())
    onnx.save_model(graph, str(models[2]))
    refused = CliRunner().invoke(app, [*given, "--initial", str(models[2]), "-o", str(tmp_path / "m.onnx")])
    assert "is shown pictures as BGR, and training shows RGB" in str(refused.exception)


@pytest.mark.skipif("PYTEST_XDIST_WORKER" in os.environ, reason="beside other tests PyTorch is not loaded")
@pytest.mark.parametrize(
    ("model", "more", "message"),
    [
        ("crowdnet-s", [], "of a model in eight bits the one that it was made from"),
        ("crowdnet-s-float32", ["--width", "0.5"], "no model of `crowdfence train` of width 0.5"),
    ],
)
def test_a_start_that_does_not_fit_is_refused_before_missions_are_decoded(
    tmp_path: Path, model: str, more: list[str], message: str
) -> None:
    """A wrong --width was told after all missions had been decoded, which takes minutes."""
    pytest.importorskip("onnxscript")
    from crowdfence.cli.app import app
    from crowdfence.detector.shipped import shipped_model

    given = ["train", "--data", str(tmp_path / "none"), "--validation", str(tmp_path / "other"), *more]
    start = ["--initial", str(shipped_model(model)), "-o", str(tmp_path / "m.onnx")]
    assert message in str(CliRunner().invoke(app, [*given, *start]).exception)


@pytest.mark.skipif("PYTEST_XDIST_WORKER" in os.environ, reason="beside other tests PyTorch is not loaded")
def test_a_teacher_is_looked_at_before_missions_are_decoded_and_told_of(tmp_path: Path) -> None:
    """A model as a teacher was no checkpoint, "remove it", after minutes of decoding; a smaller one taught
    without a word, and neither the report nor the model said that there had been one."""
    pytest.importorskip("onnxscript")
    from crowdfence.cli.app import app
    from crowdfence.detector.contract.lookup import load_contract

    data = [tmp_path / name for name in ("a.mcap", "b.mcap")]
    for place in data:
        shutil.copyfile(DEMO / "race.mcap", place)
    few = ["--steps", "1", "--batch", "1", "--store", str(tmp_path / "frames"), "--json"]
    given = ["train", "--data", str(data[0]), "--validation", str(data[1]), *few]

    def trained(name: str, width: float, *more: str, target: str = "silhouettes") -> Any:
        whole = [*given, "--width", str(width), "--target", target, *more, "-o", str(tmp_path / name)]
        return CliRunner().invoke(app, whole)

    assert trained("small.onnx", 0.1).exit_code == 0
    small = str(tmp_path / "small.checkpoint")
    taught = trained("taught.onnx", 0.2, "--teacher", small)
    assert "small.checkpoint has width 0.1, this training 0.2" in taught.stderr.replace("\n", " ")
    teacher = {"checkpoint": "small.checkpoint", "width": 0.1, "steps": 1, "share": 0.7}
    assert json.loads(taught.stdout)["teacher"] == teacher
    about = load_contract(tmp_path / "taught.onnx").about
    assert about is not None and about["teacher"] == teacher

    shutil.rmtree(tmp_path / "frames")
    model = trained("m.onnx", 0.2, "--teacher", str(tmp_path / "small.onnx"))
    assert "small.onnx is a model; a teacher is the checkpoint that its training left" in str(model.exception)
    other = trained("m.onnx", 0.2, "--teacher", small, target="ground")
    assert "was trained with targets ('silhouettes',), this training has ('ground',)" in str(other.exception)
    own = trained("small.onnx", 0.1, "--teacher", small, "--force")
    assert "small.checkpoint is read for this, and would be lost" in str(own.exception)
    assert not list((tmp_path / "frames").glob("*"))


@pytest.mark.skipif("PYTEST_XDIST_WORKER" in os.environ, reason="beside other tests PyTorch is not loaded")
def test_missions_of_one_name_are_told_apart_and_none_counts_twice(tmp_path: Path) -> None:
    pytest.importorskip("onnxscript")
    from crowdfence.cli.app import app

    places = [tmp_path / "monday", tmp_path / "tuesday"]
    for place in places:
        place.mkdir()
        shutil.copyfile(DEMO / "race.mcap", place / "race.mcap")
    few = ["--steps", "1", "--batch", "1", "--width", "0.1", "--target", "silhouettes", "--json"]
    given = ["train", "--validation", str(places[1]), "-o", str(tmp_path / "m.onnx"), *few]
    twice = CliRunner().invoke(
        app, [*given, "--data", str(places[0]), "--data", str(places[0] / "race.mcap")]
    )
    assert twice.exit_code != 0 and "is given twice" in str(twice.exception) + twice.output
    done = CliRunner().invoke(app, [*given, "--data", str(places[0])])
    facts = json.loads(done.stdout)
    assert [*facts["missions"], *facts["validation_missions"]] == [
        str(place / "race.mcap") for place in places
    ]
