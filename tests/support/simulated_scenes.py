"""Scenes that several tests look at; built once."""

from functools import lru_cache

from crowdfence.simulation.scenarios.scenario_file import load_scenario
from crowdfence.simulation.scene import Scene, build_scene

SEED = 7


@lru_cache(maxsize=5)
def scene_of(name: str) -> Scene:
    return build_scene(load_scenario(name), SEED)
