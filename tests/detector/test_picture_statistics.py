"""Pictures unlike everything that was tested: a measure that must see what it is for, and nothing else."""

import json
from pathlib import Path

import numpy as np
import pytest

from crowdfence import DetectorError
from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.picture_statistics import (
    NAMES,
    PictureRange,
    picture_statistics,
    range_of_missions,
)
from crowdfence.pipeline import PictureWatch
from support.onnx_models import contract as document


def noisy(rng: np.random.Generator, mean: float, spread: float) -> np.ndarray:
    return np.clip(rng.normal(mean, spread, (64, 96, 3)), 0, 255).astype(np.uint8)


def some(seed: int, count: int, mean: float = 100.0, spread: float = 20.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.array(
        [
            picture_statistics(noisy(rng, mean + rng.normal(0, 5), spread + rng.normal(0, 2)))
            for _ in range(count)
        ]
    )


def test_the_statistics_of_a_plain_picture_are_known() -> None:
    """51, 102, 153 of 255: means .2, .4, .6 and neither contrast nor edges (logarithms are cut at 0.001)."""
    plain = np.full((20, 30, 3), (51, 102, 153), np.uint8)
    expected = [0.2, 0.4, 0.6, 0, 0, 0, *np.log([1e-3] * 4)]
    np.testing.assert_allclose(picture_statistics(plain), expected, atol=1e-6)


def test_stripes_are_edges() -> None:
    """Black and white columns in turn: pixels beside each other differ by 1, those 2 and 4 apart not at all.
    All edges are equal, so their root mean square is their mean."""
    stripes = np.zeros((8, 40, 3), np.uint8)
    stripes[:, 1::2] = 255
    found = dict(zip(NAMES, picture_statistics(stripes), strict=True))
    assert found["contrast"] == pytest.approx(0.5, abs=1e-5)
    assert [found["edges"], found["edge_sparsity"]] == pytest.approx([0.0, 0.0], abs=1e-5)
    assert found["edges_of_2px"] == found["edges_of_4px"] == pytest.approx(np.log(1e-3))


@pytest.mark.parametrize("shape", [(1, 1), (1, 3), (5, 1), (480, 2)])
def test_the_smallest_pictures_have_finite_statistics(shape: tuple[int, int]) -> None:
    assert np.isfinite(picture_statistics(np.full((*shape, 3), 9, np.uint8))).all()


def test_tested_pictures_are_alike_and_others_are_not() -> None:
    tested = range_of_missions({"a": some(1, 60), "b": some(2, 60), "c": some(3, 60)})
    assert tested is not None
    assert (tested.distances(some(4, 100)) > tested.limit).mean() <= 0.12
    assert (tested.distances(some(5, 20, mean=200.0)) > tested.limit).all()
    assert (tested.distances(some(6, 20, spread=60.0)) > tested.limit).all()
    assert tested.is_unlike(np.zeros((64, 96, 3), np.uint8))


def test_one_mission_cannot_tell() -> None:
    assert range_of_missions({"a": some(1, 60)}) is None
    assert range_of_missions({"a": some(1, 3), "b": some(2, 3)}) is None


def test_the_range_survives_the_contract() -> None:
    tested = range_of_missions({"a": some(1, 60), "b": some(2, 60)})
    assert tested is not None
    contract = Contract.from_json(document(pictures=tested.to_json()))
    assert Contract.from_json(json.loads(json.dumps(contract.to_json()))) == contract


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("mean", [1, 2], r"pictures.mean is \[1, 2\]; allowed: a list of 10 numbers"),
        ("precision", [[1] * 10], "pictures.precision is .* 10 rows of 10"),
        ("precision", [[0] * 10] * 10, "pictures.precision is no inverse of a covariance"),
        ("limit", 0, "pictures.limit is 0"),
        ("limit", None, "pictures.limit is missing"),
    ],
)
def test_a_wrong_range_is_refused(key: str, value: object, message: str) -> None:
    section = PictureRange((0.0,) * 10, tuple(map(tuple, np.eye(10).tolist())), 3.0).to_json()
    with pytest.raises(DetectorError, match=message):
        Contract.from_json(document(pictures={**section, key: value}))


def test_pictures_are_counted_and_named() -> None:
    """Around black, limit 1: black is alike, white 3 ** 0.5 away in the means of its colours alone."""
    black, white = np.zeros((9, 9, 3), np.uint8), np.full((9, 9, 3), 255, np.uint8)
    near = PictureRange(tuple(picture_statistics(black)), tuple(map(tuple, np.eye(10).tolist())), 1.0)
    watch = PictureWatch(Contract.from_json(document(pictures=near.to_json())))
    assert watch.look("a", black) is False and watch.look("b", white) is True
    assert near.distance(white) == pytest.approx(3**0.5, abs=1e-5)
    assert watch.to_json() == {"looked_at": 2, "unlike_tested": 1, "unlike": ["b"]}
    (warning,) = watch.warnings
    assert warning.startswith("1 of 2 pictures look unlike everything that test model was tested on")
    silent = PictureWatch(Contract.from_json(document()))
    assert silent.look("a", black) is None and silent.looked_at == 0 and silent.warnings == []


def test_drones_most_of_whose_pictures_are_unlike_are_known() -> None:
    """uav1 two of three, uav2 one of two, uav3 too few."""
    black, white = np.zeros((9, 9, 3), np.uint8), np.full((9, 9, 3), 255, np.uint8)
    near = PictureRange(tuple(picture_statistics(black)), tuple(map(tuple, np.eye(10).tolist())), 1.0)
    watch = PictureWatch(Contract.from_json(document(pictures=near.to_json())))
    shown = [
        ("uav1", black),
        ("uav1", white),
        ("uav1", white),
        ("uav2", black),
        ("uav2", white),
        ("uav3", white),
    ]
    for drone, image in shown:
        watch.look("", image, drone)
    told = watch.mostly_unlike(2)
    assert told.keys() == {"uav1", "uav2"} and told["uav2"] is None
    assert told["uav1"] == (
        "2 of 3 pictures of uav1 look unlike everything that test model was tested on: nobody has measured "
        "what it misses there"
    )


def test_detect_flags_pictures_and_says_that_no_range_could_be_checked(tmp_path: Path) -> None:
    from PIL import Image

    from support.command_line import crowdfence
    from support.onnx_models import write_map_model

    black, white = np.zeros((16, 16, 3), np.uint8), np.full((16, 16, 3), 255, np.uint8)
    black[:, 8:], white[:, 8:] = 20, 235  # of one tone they would be refused
    near = PictureRange(tuple(picture_statistics(black)), tuple(map(tuple, np.eye(10).tolist())), 1.0)
    model = write_map_model(tmp_path / "m.onnx", document(pictures=near.to_json()))
    (tmp_path / "pictures").mkdir()
    Image.fromarray(black).save(tmp_path / "pictures" / "a.png")
    Image.fromarray(white).save(tmp_path / "pictures" / "b.png")
    arguments = ("detect", tmp_path / "pictures", "-o", tmp_path / "out", "--model", model, "--no-video")
    finished = crowdfence(*arguments, "--json")
    report = json.loads(finished.stdout)
    assert report["pictures"]["unlike_tested"] == 1
    assert report["warnings"][0].startswith("pictures without poses: no range could be checked")
    rows = (tmp_path / "out" / "index.csv").read_text().splitlines()
    assert [row.split(",")[-1] for row in rows] == ["unlike_tested", "0", "1"]
    known = crowdfence(*arguments, "--force", "--gsd", 0.1, columns=200)
    assert "1 of 2 pictures" in known.stdout and "no range could be checked" not in known.stderr
