"""What a model is worth behind finer cameras: measured by the command, written beside its other rates."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from crowdfence import Detector
from crowdfence.calibration.model_file import write_with_contract
from crowdfence.detector.contract.contract import Contract
from support.command_line import crowdfence
from support.onnx_models import contract, write_map_model
from support.small_recordings import FOV_DEG, HEIGHT, WIDTH, flight, write_airsim, write_labelled_missions

FOCAL_PX = WIDTH / 2.0 / np.tan(np.radians(FOV_DEG / 2.0))
"""Of the recordings: 19.1 px."""
TABLE = {
    "distance_m": [0.0, 50.0, 300.0],
    "tilt_deg": [0.0, 90.0],
    "mean": [0.0, 0.5, 1.0],
    "log10_ratio": [[[-1.0, 2.0]], [[-0.5, 1.0]]],
}


@pytest.fixture(scope="module")
def missions(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two over a plane."""
    return write_labelled_missions(tmp_path_factory.mktemp("labelled"))


def calibrated(path: Path, times: float, **rates: object) -> Path:
    """A model calibrated, as it says, with cameras of which those of the recordings are `times` as fine."""
    write_map_model(path)
    gsd_m = [10.0 / (FOCAL_PX / times), 200.0 / (FOCAL_PX / times)]
    told = {
        "rates": {"b_threshold": 0.5, "likelihood_ratio": TABLE, "note": "kept", **rates},
        "validity": {"gsd_m": gsd_m, "distance_m": [10.0, 200.0], "tilt_deg": None},
    }
    write_with_contract(path, Contract.from_json({**contract(), **told}), path)
    return path


def measured(model: Path, missions: list[Path], output: Path, *more: object):  # type: ignore[no-untyped-def]
    words = [word for path in missions for word in ("--data", path)]
    return crowdfence("model", "finer", model, *words, "-o", output, *more, columns=300)


def test_the_rates_of_finer_cameras_stand_beside_the_others(missions: list[Path], tmp_path: Path) -> None:
    model = calibrated(tmp_path / "model.onnx", 3.0)
    done = measured(model, missions, tmp_path / "both.onnx", "--json")
    assert done.returncode == 0, done.stderr
    finer = json.loads(done.stdout)
    before, after = Detector(model).contract.to_json(), Detector(tmp_path / "both.onnx").contract.to_json()
    assert after["rates"].pop("finer") == finer and after == before
    assert finer["focal_px"] == pytest.approx(FOCAL_PX, abs=0.05) and finer["missions"] == 2
    # As `model evaluate` measures the same rates, which does not ask whose cameras they are of.
    words = [word for path in missions for word in ("--data", path)]
    told = json.loads(crowdfence("model", "evaluate", model, *words, "--json").stdout)["rates"]
    assert {name: finer[name] for name in ("true_positive", "false_positive")} == {
        name: told[name] for name in ("true_positive", "false_positive")
    }
    assert "finer cameras" in crowdfence("model", "check", tmp_path / "both.onnx", columns=300).stdout
    picture = np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    heatmaps = [Detector(path)(picture) for path in (model, tmp_path / "both.onnx")]
    np.testing.assert_array_equal(*heatmaps)


def test_rates_of_few_looks_at_crowd_are_told(missions: list[Path], tmp_path: Path) -> None:
    """A look clears ground by what they say of it, which calibrate told alone."""
    few = Path(shutil.copytree(missions[0], tmp_path / "few"))
    first, *others = sorted((few / "truth" / "regions").iterdir())
    for path in (first, *others):
        label = np.zeros((HEIGHT, WIDTH), np.uint8)
        label[-3:-1, :2] = path == first  # four pixels of the ground below, in one picture
        Image.fromarray(label).save(path)
    done = measured(calibrated(tmp_path / "model.onnx", 3.0), [few], tmp_path / "out.onnx", "--json")
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)["crowd_observations"]
    assert 0 < seen < 1000
    assert f"{seen} observations of crowd voxels, fewer than one picture of a crowd shows" in done.stderr


def test_what_cannot_be_measured_is_told_in_a_line(missions: list[Path], tmp_path: Path) -> None:
    alike = calibrated(tmp_path / "alike.onnx", 1.1)
    done = measured(alike, missions, tmp_path / "out.onnx")
    assert done.returncode == 1 and not (tmp_path / "out.onnx").exists()
    assert (
        "have focal lengths from 19.07 to 19.07 px; one table is for cameras from 20.8 px on" in done.stderr
    )
    plain = tmp_path / "plain.onnx"
    write_map_model(plain)
    write_with_contract(plain, Contract.from_json(contract()), plain)
    done = measured(plain, missions, tmp_path / "out.onnx")
    assert done.returncode == 1 and "states no likelihood ratios of the cameras" in done.stderr
    bare = write_airsim(tmp_path / "bare", flight(frames=2))
    (bare / "terrain" / "dem.tif").unlink()
    done = measured(calibrated(tmp_path / "model.onnx", 3.0), [bare], tmp_path / "out.onnx")
    assert done.returncode == 1 and "comes without a map: rates per voxel need one" in done.stderr
