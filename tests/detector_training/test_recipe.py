"""The recipe of the shipped detector: its missions can be simulated and are kept apart."""

import importlib.util
from collections import defaultdict
from pathlib import Path

import pytest

RECIPE = Path(__file__).parents[2] / "training" / "simulate_missions.py"


@pytest.fixture(scope="module")
def recipe():
    spec = importlib.util.spec_from_file_location("simulate_missions", RECIPE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_mission_is_a_valid_scenario(recipe):
    scenarios = {name: recipe.scenario_of(mission) for name, mission in recipe.missions()}
    assert len(scenarios) >= 70
    assert all(scenario.camera.width == 640 for scenario in scenarios.values())
    kinds = {name.split("/")[1].split("-")[0] for name in scenarios}
    assert kinds == {"race", "festival", "street", "beach", "empty", "roadside"}


def test_no_world_and_no_autumn_of_the_judging_missions_is_ever_trained_on(recipe):
    groups, seasons = defaultdict(set), defaultdict(set)
    for name, mission in recipe.missions():
        groups[mission["seed"]].add(name.split("/")[0])
        seasons[name.split("/")[0]].add(recipe.scenario_of(mission).season)
    assert all(len(found) == 1 for found in groups.values()), "a seed is a world: one group only"
    assert seasons["test-unseen-season"] == {"autumn"}
    assert all("autumn" not in found for group, found in seasons.items() if group != "test-unseen-season")
