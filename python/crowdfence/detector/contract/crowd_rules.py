"""When counted people are a crowd: the numbers behind the density, points and boxes adapters."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from crowdfence.detector.contract.json_section import JsonSection
from crowdfence.errors import DetectorError

MOST_PER_M2 = 10.0
"""No crowd is denser; a rule that asks for more is met nowhere."""
_WIDEST_M = 100.0
_PERSON_HEIGHT_M = 0.3, 3.0


@dataclass(frozen=True, slots=True)
class PeopleRule:
    """A cell is crowd where at least `min_people` stand within `radius_m`.

    P = sigmoid((n - (min_people - 1/2)) / softness_people), n = sum of the scores of the people within
    `radius_m` of the cell; gaps up to twice `closing_m` wide are then closed. Number and radius are those
    of the crowds that the simulator marks.
    """

    min_people: int = 3
    radius_m: float = 2.0
    softness_people: float = 0.25
    closing_m: float = 1.0
    person_height_m: float | None = None
    """Boxes in a picture of unknown scale: a person is that long, so boxes say how many metres a pixel is.
    People look shorter from above; a pixel then seems to be more metres, and a crowd thinner, than it is."""

    @staticmethod
    def from_json(section: JsonSection | None) -> PeopleRule:
        if section is None:
            return PeopleRule()
        default = PeopleRule()
        rule = PeopleRule(
            min_people=section.integer("min_people", 1, 1_000_000, default.min_people),
            radius_m=section.number("radius_m", 0.0, default.radius_m, above=True),
            softness_people=section.number("softness_people", 0.0, default.softness_people, above=True),
            closing_m=section.number("closing_m", 0.0, default.closing_m),
            person_height_m=section.number("person_height_m", 0.0, None, above=True),
        )
        section.done()
        for name in ("radius_m", "closing_m"):
            if getattr(rule, name) > _WIDEST_M:
                raise section.refuse(name, f"metres up to {_WIDEST_M:g}")
        fitting = MOST_PER_M2 * math.pi * rule.radius_m**2
        if rule.min_people > max(fitting, 1.0):
            raise DetectorError(
                f"{section.key('min_people')} {rule.min_people} within {section.key('radius_m')} "
                f"{rule.radius_m:g} is met nowhere; no more than {fitting:.3g} people find room there"
            )
        low_m, high_m = _PERSON_HEIGHT_M
        if rule.person_height_m is not None and not low_m <= rule.person_height_m <= high_m:
            raise section.refuse("person_height_m", f"null or metres from {low_m:g} to {high_m:g}")
        return rule

    def to_json(self) -> dict[str, Any]:
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True, slots=True)
class DensityRule:
    """A cell is crowd where the density, averaged over a square of side `window_m`, is `people_per_m2`.

    P = sigmoid((density - people_per_m2) / softness_per_m2). The default is 3 people in a disc of radius 2 m
    (0.24 per m2), counted in a square of about the area of that disc.
    """

    people_per_m2: float = 0.24
    softness_per_m2: float = 0.04
    window_m: float = 3.5

    @staticmethod
    def from_json(section: JsonSection | None) -> DensityRule:
        if section is None:
            return DensityRule()
        default = DensityRule()
        rule = DensityRule(
            people_per_m2=section.number("people_per_m2", 0.0, default.people_per_m2, above=True),
            softness_per_m2=section.number("softness_per_m2", 0.0, default.softness_per_m2, above=True),
            window_m=section.number("window_m", 0.0, default.window_m),
        )
        section.done()
        if rule.people_per_m2 > MOST_PER_M2:
            raise section.refuse("people_per_m2", f"above 0 and at most {MOST_PER_M2:g}: no crowd is denser")
        if rule.window_m > _WIDEST_M:
            raise section.refuse("window_m", f"metres from 0 to {_WIDEST_M:g}")
        return rule

    def to_json(self) -> dict[str, Any]:
        return asdict(self)
