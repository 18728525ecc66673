"""How people are built and how they stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.random_streams import Stream, stream

_USUALLY_CHEERING = 0.22


@dataclass(frozen=True, slots=True)
class Bodies:
    """Of P people."""

    girth: NDArray[np.float64]
    """[P] factor on width and depth of the body."""
    stance_rad: NDArray[np.float64]
    """[P] how far each leg points sideways; raised arms do twice as much."""
    cheering_share: float
    """Share of the people in crowds who raise their arms now and then."""


def usual_bodies(people: int, seed: int) -> Bodies:
    """Most are of nearly the same build and stand with their feet together."""
    rng = stream(seed, Stream.BODIES)
    return Bodies(
        np.clip(rng.lognormal(0.0, 0.1, people), 0.75, 1.4),
        np.clip(rng.normal(0.05, 0.05, people), 0.0, 0.2),
        _USUALLY_CHEERING,
    )


def random_bodies(people: int, seed: int) -> Bodies:
    """Thin and stout, with legs apart and arms up: what other renderers and other days make of people."""
    rng = stream(seed, Stream.BODIES)
    mission_girth, mission_stance = rng.uniform(0.8, 1.3), rng.uniform(0.0, 0.2)
    return Bodies(
        np.clip(mission_girth * rng.lognormal(0.0, 0.15, people), 0.6, 1.8),
        np.clip(rng.normal(mission_stance, 0.1, people), 0.0, 0.45),
        float(rng.uniform(0.1, 0.7)),
    )
