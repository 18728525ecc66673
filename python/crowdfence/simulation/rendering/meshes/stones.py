"""Rocks."""

import numpy as np

from crowdfence.simulation.rendering.meshes.shape import Shape, ball


def rock(detail: int, seed: int) -> Shape:
    """Boulder about 1.8 m wide, edged like broken stone. Slot 0 is its colour."""
    rng = np.random.default_rng([seed, 41])
    stone = ball((0, 0, 0.35), 1.0, rings=(2, 3, 4)[detail], sides=(5, 6, 8)[detail], roughness=0.2, rng=rng,
                 smooth=False)  # fmt: skip
    flat = rng.uniform(0.45, 0.8)
    shape = stone.scaled((1.0, rng.uniform(0.6, 0.95), flat))
    low = np.clip(0.72 + 0.4 * shape.position[:, 2], 0.5, 1.05)
    return shape.painted(slot=0).shaded(low)
