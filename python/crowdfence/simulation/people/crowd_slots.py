"""Where the people of one crowd stand relative to each other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

IsFree = Callable[[NDArray[np.float64]], NDArray[np.bool_]]
"""Places [N, 2] in the crowd's own frame -> whether a person can be there all the time [N]."""

_SPARE_AREA = 1.6
_RELAXATIONS = 150
_CORE_SIGMAS = 5.0
_CORE_DRAWS = 60


def core_slots(
    people: int, length_m: float, depth_m: float, spacing_m: float, is_free: IsFree, rng: np.random.Generator
) -> NDArray[np.float64] | None:
    """Places [people, 2] (along, across; 0 = middle) of a crowd with a dense core and a thin edge: normally
    distributed with a fifth of `length_m` and `depth_m` as deviations, none outside them, no two closer than
    `spacing_m`. None without enough room.
    """
    size = np.array([length_m, depth_m])
    places: NDArray[np.float64] = np.zeros((0, 2))
    for _ in range(_CORE_DRAWS):
        drawn = rng.normal(0.0, size / _CORE_SIGMAS, (people, 2))
        drawn = drawn[(np.abs(drawn) <= 0.5 * size).all(axis=1)]
        drawn = drawn[is_free(drawn)]
        if len(places):
            drawn = drawn[cKDTree(places).query(drawn)[0] >= spacing_m]
        # Of two that came too close the later one goes.
        pairs = cKDTree(drawn).query_pairs(spacing_m, output_type="ndarray")
        drawn = np.delete(drawn, pairs[:, 1], axis=0)
        places = np.concatenate([places, drawn])[:people]
        if len(places) == people:
            return places
    return None


def even_slots(
    people: int, length_m: float, depth_m: float, spacing_m: float, is_free: IsFree, rng: np.random.Generator
) -> NDArray[np.float64] | None:
    """Places [people, 2] (along, across; 0 = middle), at least `spacing_m` apart; None without enough room.

    A disturbed hexagonal lattice, pushed apart where it came too close; of its free places the innermost
    of an uneven blob of about `length_m` x `depth_m` are taken.
    """
    pitch = np.sqrt(2.0 / np.sqrt(3.0) * 0.85 * length_m * depth_m / people)
    if pitch < spacing_m:
        return None
    lattice = _hexagonal(length_m * _SPARE_AREA, depth_m * _SPARE_AREA, pitch)
    places = _pushed_apart(lattice + rng.normal(0.0, 0.28 * pitch, lattice.shape), spacing_m)
    if places is None:
        room = 0.5 * (pitch - spacing_m)
        places = lattice + rng.uniform(-room, room, lattice.shape) / np.sqrt(2.0)
    places = places[is_free(places)]
    if len(places) < people:
        return None
    radius = (np.abs(places / [0.5 * length_m, 0.5 * depth_m]) ** 2.5).sum(axis=1) ** 0.4
    angle = np.arctan2(places[:, 1] / depth_m, places[:, 0] / length_m)
    phases = rng.uniform(0.0, 2 * np.pi, 3)
    radius *= 1.0 + 0.12 * sum(np.sin((k + 2) * angle + phase) for k, phase in enumerate(phases)) / 2.0
    chosen = np.argsort(radius, kind="stable")[:people]
    return np.asarray(places[np.sort(chosen)])


def _hexagonal(length_m: float, depth_m: float, pitch_m: float) -> NDArray[np.float64]:
    rows = np.arange(
        -np.ceil(0.5 * depth_m / (pitch_m * 0.866)), np.ceil(0.5 * depth_m / (pitch_m * 0.866)) + 1
    )
    columns = np.arange(-np.ceil(0.5 * length_m / pitch_m), np.ceil(0.5 * length_m / pitch_m) + 1)
    row, column = np.meshgrid(rows, columns, indexing="ij")
    along = (column + 0.5 * (row % 2)) * pitch_m
    return np.stack([along, row * pitch_m * np.sqrt(3.0) / 2.0], axis=-1).reshape(-1, 2)


def _pushed_apart(places: NDArray[np.float64], spacing_m: float) -> NDArray[np.float64] | None:
    """The places moved until no two are closer than `spacing_m`; None when that does not settle."""
    for _ in range(_RELAXATIONS):
        pairs = cKDTree(places).query_pairs(spacing_m, output_type="ndarray")
        if len(pairs) == 0:
            return places
        apart = places[pairs[:, 1]] - places[pairs[:, 0]]
        distance = np.maximum(np.linalg.norm(apart, axis=1, keepdims=True), 1e-6)
        push = 0.5 * (1.02 * spacing_m - distance) * apart / distance
        places = places.copy()
        np.add.at(places, pairs[:, 0], -push)
        np.add.at(places, pairs[:, 1], push)
    return None
