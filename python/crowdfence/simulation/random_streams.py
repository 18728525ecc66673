"""One random stream per part of the world, so that a change of one part leaves the others as they are."""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """What a stream of random numbers decides. Numbers are part of every recording: add, never renumber."""

    CROWD = 101
    WALKERS = 102
    APPEARANCE = 103
    CYCLISTS = 104
    FLIGHT = 105
    LIGHT = 106
    CLOCK = 107
    FRAMES = 108
    TELEMETRY = 109
    DETECTOR = 110
    COLOURS = 111
    BODIES = 112
    LANDING_PLACES = 113
    LANDING_FRAMES = 114


def stream(seed: int, purpose: Stream, *numbers: int) -> np.random.Generator:
    """Generator for one purpose; `numbers` tell apart drones, crowds and the like."""
    return np.random.default_rng([seed, int(purpose), *numbers])
