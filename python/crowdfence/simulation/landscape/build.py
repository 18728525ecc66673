"""Which builder makes which kind of landscape."""

from collections.abc import Callable

from crowdfence.simulation.landscape.beach import build_beach
from crowdfence.simulation.landscape.field import build_field
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.landscape.mountain_road import build_mountain_road
from crowdfence.simulation.landscape.street import build_street
from crowdfence.simulation.scenarios.plans import LandscapePlan

_BUILDERS: dict[str, Callable[[LandscapePlan, int], Landscape]] = {
    "mountain_road": build_mountain_road,
    "field": build_field,
    "street": build_street,
    "beach": build_beach,
}


def build_landscape(plan: LandscapePlan, seed: int) -> Landscape:
    """The landscape of `plan`, equal for equal plan and seed. ValueError for a kind that cannot be built."""
    if plan.kind not in _BUILDERS:
        raise ValueError(
            f"landscape.kind {plan.kind!r} cannot be built: choose one of {', '.join(_BUILDERS)}"
        )
    return _BUILDERS[plan.kind](plan, seed)
