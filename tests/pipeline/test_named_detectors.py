"""One detector or several by name, and what a run says of them."""

from pathlib import Path

import numpy as np
import pytest

import crowdfence
from crowdfence import DetectorError, open_recording
from crowdfence.detector.shipped import shipped_model
from crowdfence.pipeline import heatmap_source, named_detector
from support.onnx_models import contract as document
from support.onnx_models import write_map_model


@pytest.mark.parametrize("name", ["crowdnet-s", "crowdnet-s-wide"])
def test_the_shipped_models_have_names(name: str) -> None:
    assert named_detector([name]).contract.name == name
    assert crowdfence.Detector(name).contract.name == name


def test_several_are_one(tmp_path: Path) -> None:
    model = write_map_model(tmp_path / "m.onnx", document())
    both = named_detector(["crowdnet-s", str(model)])
    heatmaps = heatmap_source(both, None, 100.0)
    made = heatmaps.to_json()
    assert made["name"] == "crowdnet-s + test model"
    assert [one["file"] for one in made["members"]] == ["crowdnet-s-int8.onnx", "m.onnx"]
    assert all(len(one["sha256"]) == 64 for one in made["members"])
    assert made["calibrated_together"] is False
    assert heatmaps.warnings[0].startswith(
        "the detectors crowdnet-s + test model were not calibrated together"
    )


def test_one_has_nothing_to_be_calibrated_with() -> None:
    heatmaps = heatmap_source(named_detector(["crowdnet-s"]), None, 100.0)
    assert heatmaps.warnings == [] and "calibrated_together" not in heatmaps.to_json()


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["auto", "crowdnet-s"], "--detector auto cannot be combined"),
        (["crowdnet-s", "recorded"], "--detector recorded cannot be combined"),
        (["crowdnet-s", "crowdnet-s"], "is given twice: its opinion would count double"),
    ],
)
def test_words_that_mean_no_model_are_not_combined(names: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        named_detector(names)


def test_one_file_under_two_names_is_one_model(tmp_path: Path) -> None:
    model = write_map_model(tmp_path / "m.onnx", document())
    (tmp_path / "link.onnx").symlink_to(model)
    for other in (tmp_path / "." / "folder" / ".." / "m.onnx", tmp_path / "link.onnx"):
        (tmp_path / "folder").mkdir(exist_ok=True)
        with pytest.raises(ValueError, match="is given twice: its opinion would count double"):
            named_detector([str(model), str(other)])
    with pytest.raises(ValueError, match="is given twice"):
        named_detector(["crowdnet-s", str(shipped_model("crowdnet-s"))])


def test_a_model_without_a_contract_is_still_refused(tmp_path: Path) -> None:
    with pytest.raises(DetectorError, match="says neither what it expects"):
        named_detector(["crowdnet-s", str(write_map_model(tmp_path / "m.onnx"))])


def test_the_shipped_networks_call_the_same_crowds() -> None:
    """On the pictures of the bundled flight, which neither was made from."""
    recording = open_recording(Path(crowdfence.__file__).parent / "demo_data" / "race.mcap")
    images = [frame.image() for frame in recording.frames[::12]]
    names = ("crowdnet-s", "crowdnet-s-float32", "crowdnet-s-wide")
    called = [
        np.stack([one(image, as_it_is=True) >= 0.5 for image in images])
        for one in (named_detector([name]) for name in names)
    ]
    fast, exact, wide = called
    assert fast.sum() > 100
    assert (fast & exact).sum() / (fast | exact).sum() > 0.95
    # Trained further on other pictures: another opinion of most of the same crowds.
    assert 0.5 < (fast & wide).sum() / (fast | wide).sum() < 0.95
