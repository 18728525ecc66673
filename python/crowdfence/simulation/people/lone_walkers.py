"""Single people who walk round far from crowds and from each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.random_streams import Stream, stream
from crowdfence.simulation.scenarios.plan_checks import ScenarioError
from crowdfence.simulation.scenarios.plans import WalkerPlan

APART_M = 6.0
"""A walker never comes closer than this to where a crowd passes or another walker walks."""

_WALKED_POINTS = 96
_TRIES_PER_WALKER = 400
_NEAR_CROWD_M = (8.0, 45.0)


@dataclass(frozen=True, slots=True)
class LoneWalkers:
    """Closed walks: ellipses of different size, direction and speed."""

    centre: NDArray[np.float64]
    """[W, 2] east, north."""
    half_axes: NDArray[np.float64]
    """[W, 2] metres."""
    turn_rad: NDArray[np.float64]
    """[W] direction of the first axis, counter-clockwise from east."""
    speed_m_s: NDArray[np.float64]
    """[W] fastest speed on the way; negative walks clockwise."""
    phase_rad: NDArray[np.float64]

    @property
    def count(self) -> int:
        return len(self.centre)

    def positions(self, t_s: float) -> NDArray[np.float64]:
        """Positions [W, 2] east, north."""
        return self._on_ellipse(
            self.phase_rad + self.speed_m_s * t_s / self.half_axes.max(axis=1, initial=0.1)
        )

    def walked_m(self, t_s: float) -> NDArray[np.float64]:
        """Way [W] since the start, to first order: what legs need."""
        return np.asarray(np.abs(self.speed_m_s) * t_s)

    def _on_ellipse(self, angle: NDArray[np.float64]) -> NDArray[np.float64]:
        a, b = (self.half_axes * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).T
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return self.centre + np.stack([cos * a - sin * b, sin * a + cos * b], axis=-1)


def place_walkers(
    plan: WalkerPlan, seed: int, landscape: Landscape, crowd_ways: NDArray[np.float64]
) -> LoneWalkers:
    """Walkers near the points `crowd_ways` [N, 2] where crowds pass (anywhere without crowds), apart from
    them, from each other, from the road and from everything that blocks.

    Raises ScenarioError when the landscape has no room for so many.
    """
    rng = stream(seed, Stream.WALKERS)
    avoid = cKDTree(crowd_ways) if len(crowd_ways) else None
    rows: list[NDArray[np.float64]] = []
    for _ in range(plan.count):
        row = _free_walk(plan, landscape, crowd_ways, avoid, rows, rng)
        if row is None:
            raise ScenarioError(
                f"walkers.count {plan.count}: only {len(rows)} walkers have room {APART_M:g} m from crowds "
                "and each other; use fewer walkers or a larger landscape"
            )
        rows.append(row)
    table = np.array(rows).reshape(-1, 7)
    return LoneWalkers(table[:, :2], table[:, 2:4], table[:, 4], table[:, 5], table[:, 6])


def _free_walk(
    plan: WalkerPlan,
    landscape: Landscape,
    crowd_ways: NDArray[np.float64],
    avoid: cKDTree | None,
    others: list[NDArray[np.float64]],
    rng: np.random.Generator,
) -> NDArray[np.float64] | None:
    for _ in range(_TRIES_PER_WALKER):
        centre = _centre(landscape, crowd_ways, rng)
        longer = rng.uniform(1.5, 9.0)
        row = np.array(
            [
                *centre,
                longer,
                longer * rng.uniform(0.15, 1.0),
                rng.uniform(0.0, 2 * np.pi),
                rng.uniform(*plan.speed_m_s) * rng.choice([-1.0, 1.0]),
                rng.uniform(0.0, 2 * np.pi),
            ]
        )
        if any(np.hypot(*(row[:2] - other[:2])) < row[2] + other[2] + APART_M for other in others):
            continue
        angle = np.linspace(0.0, 2 * np.pi, _WALKED_POINTS, endpoint=False, dtype=np.float64)
        same = np.repeat(row[None], _WALKED_POINTS, axis=0)
        way = LoneWalkers(same[:, :2], same[:, 2:4], same[:, 4], same[:, 5], same[:, 6])._on_ellipse(angle)
        if avoid is not None and avoid.query(way)[0].min() < APART_M:
            continue
        if not landscape.blocked(way[:, 0], way[:, 1], 0.6).any() and not _on_road(landscape, way):
            return row
    return None


def _centre(
    landscape: Landscape, crowd_ways: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    west, south, east, north = landscape.extent_m
    if len(crowd_ways) == 0:
        return np.array([rng.uniform(west, east), rng.uniform(south, north)])
    angle, distance = rng.uniform(0.0, 2 * np.pi), rng.uniform(*_NEAR_CROWD_M)
    return np.asarray(
        crowd_ways[rng.integers(len(crowd_ways))] + distance * np.array([np.cos(angle), np.sin(angle)])
    )


def _on_road(landscape: Landscape, way: NDArray[np.float64]) -> bool:
    return landscape.road is not None and bool(landscape.on_road(way[:, 0], way[:, 1]).any())
