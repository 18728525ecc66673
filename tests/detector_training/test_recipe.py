"""The recipe of the shipped detector: its missions can be simulated and are kept apart."""

import importlib.util
import re
from collections import Counter, defaultdict
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "training"
RECIPE = FOLDER / "simulate_missions.py"


@pytest.fixture(scope="module")
def recipe():
    spec = importlib.util.spec_from_file_location("simulate_missions", RECIPE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_mission_is_a_valid_scenario(recipe):
    scenarios = {name: recipe.scenario_of(mission) for name, mission in recipe.missions()}
    widths = {(name.startswith("finer/"), scenario.camera.width) for name, scenario in scenarios.items()}
    assert widths == {(False, 640), (True, 1920)}
    kinds = {name.split("/")[1].split("-")[0] for name in scenarios}
    assert kinds == {"race", "festival", "street", "beach", "empty", "roadside", "packed"}


def test_there_are_as_many_missions_as_the_page_says(recipe):
    """The table of training/README.md: missions by group, and those of the scenarios beside it."""
    names = [name.split("/") for name, _ in recipe.missions()]
    counts = Counter(group for group, _ in names)
    groups = ("train", "varied", "validation", "calibration", "finer")
    groups += ("test-unseen-season", "test-known-seasons")
    rows = {
        match[1]: [int(number) for number in re.findall(r"\d+", match[2])]
        for match in re.finditer(r"^\| `(\S+)` \| (.*) \|$", (FOLDER / "README.md").read_text(), re.MULTILINE)
    }
    assert set(counts) == set(groups)
    assert [counts[group] for group in groups] == rows["missions.toml"]
    for own in ("roadside", "packed"):
        assert sum(mission.startswith(own) for _, mission in names) == rows[f"{own}.toml"][0]


def test_groups_can_be_recorded_on_their_own(recipe):
    every = [name for name, _ in recipe.missions()]
    some = [name for name, _ in recipe.missions(["varied", "calibration"])]
    assert {name.split("/")[0] for name in some} == {"varied", "calibration"}
    assert some == [name for name in every if name.startswith(("varied/", "calibration/"))]


def test_no_world_and_no_autumn_of_the_judging_missions_is_ever_trained_on(recipe):
    groups, seasons = defaultdict(set), defaultdict(set)
    for name, mission in recipe.missions():
        groups[mission["seed"]].add(name.split("/")[0])
        seasons[name.split("/")[0]].add(recipe.scenario_of(mission).season)
    assert all(len(found) == 1 for found in groups.values()), "a seed is a world: one group only"
    assert seasons["test-unseen-season"] == {"autumn"}
    assert all("autumn" not in found for group, found in seasons.items() if group != "test-unseen-season")


def test_what_was_measured_of_one_model_is_not_said_of_a_mixture():
    """The mixture stated the rates of the second model, and had its correction."""
    onnx = pytest.importorskip("onnx")
    from crowdfence.detector.shipped import shipped_model

    spec = importlib.util.spec_from_file_location("between_weights", FOLDER / "between_weights.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    calibrated = onnx.load(str(shipped_model("crowdnet-s-float32")))
    with pytest.raises(ValueError, match="the second model is calibrated: give it as it was trained"):
        module.between(calibrated, calibrated, 0.5)
