"""A scene: everything that can be seen, as a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from crowdfence.simulation.flight.flight import Flight, build_flight
from crowdfence.simulation.landscape import build_landscape
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.light import Light, daylight
from crowdfence.simulation.people.cyclists import Cyclists, build_cyclists
from crowdfence.simulation.people.people import People, build_people
from crowdfence.simulation.scenarios.plan_checks import ScenarioError
from crowdfence.simulation.scenarios.scenario import Scenario

MAX_SEED = 2**32 - 1


@dataclass(frozen=True, slots=True)
class Scene:
    """The world of one mission. Nothing in it changes: people, cyclists and drones are asked for a time, so
    any frame can be made without the frames before it, in any process."""

    scenario: Scenario
    seed: int
    landscape: Landscape
    people: People
    cyclists: Cyclists
    flight: Flight
    light: Light

    def cyclist_instance_ids(self) -> range:
        """Instance ids of the cyclists; those of people are 1 .. `people.count`, in their order."""
        first = self.people.count + 1
        return range(first, first + self.cyclists.count)


PARTS = ("ground and houses", "cyclists", "people", "paths of the drones", "light")
"""What a scene is built of, in that order."""


def build_scene(scenario: Scenario, seed: int, on_part: Callable[[str], None] = lambda part: None) -> Scene:
    """The scene of `scenario` for one `seed` in [0, 2^32): equal for equal arguments, in every process.
    `on_part` is called after each of `PARTS`.

    Raises ScenarioError for a seed out of range and for a plan that the landscape of this seed cannot hold.
    """
    if not 0 <= seed <= MAX_SEED:
        raise ScenarioError(f"seed must be between 0 and {MAX_SEED}, got {seed}")
    landscape = build_landscape(scenario.landscape, seed)
    on_part(PARTS[0])
    cyclists = build_cyclists(scenario, seed, landscape)
    on_part(PARTS[1])
    people = build_people(scenario, seed, landscape)
    on_part(PARTS[2])
    flight = build_flight(scenario, seed, landscape, cyclists)
    on_part(PARTS[3])
    latitude_deg = scenario.georeference.latitude_deg
    light = daylight(scenario.season, scenario.time_of_day_h, seed, latitude_deg=latitude_deg)
    on_part(PARTS[4])
    return Scene(scenario, seed, landscape, people, cyclists, flight, light)
