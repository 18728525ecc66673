"""Which data `train`, and what measures a model on labelled data, takes from folders."""

import json
import os
import shutil
from pathlib import Path

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
