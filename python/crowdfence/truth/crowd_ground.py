"""The ground of one crowd, seen from above: a region without voxels, from the places where people stand."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.truth.morphology import MAX_PADDED_CELLS, close_with_disc

PERSON_RADIUS_M = 1.0
"""Ground that one person of a crowd takes up: an arm's length around."""

MAX_NEIGHBOURS = 50_000_000
MOST_PER_M2 = 20.0
"""No crowd is as dense, twice what crushes people: such positions are in degrees or kilometres."""
_FEW = 100
"""Neighbours that say nothing of a unit, within whatever radius."""

_HEIGHT_NEIGHBOURS = 4
_HEIGHT_SOFTENING_M2 = 0.05


class CrowdGround:
    """Union of discs of `person_radius_m` around the people of one crowd, closed with a disc of `closing_m`:
    with the gaps between people that a disc of that radius cannot enter. Drawn with pixels of `pixel_m`."""

    def __init__(
        self, feet: NDArray[np.float64], closing_m: float, person_radius_m: float, pixel_m: float
    ) -> None:
        """`feet` [P, 3], at least one. ValueError for a crowd that is too large to draw."""
        from scipy.spatial import cKDTree

        self.feet, self._pixel_m = feet, pixel_m
        """[P, 3] where the people of the crowd stand."""
        self._tree = cKDTree(feet[:, :2])
        self.low: NDArray[np.float64] = feet[:, :2].min(axis=0) - person_radius_m
        """South-west corner of the region's bounding box."""
        self.high: NDArray[np.float64] = feet[:, :2].max(axis=0) + person_radius_m
        """North-east corner."""
        self._corner = self.low - pixel_m
        shape = np.ceil((self.high - self._corner) / pixel_m).astype(np.int64) + 1
        if shape.prod() > MAX_PADDED_CELLS:
            raise ValueError(
                f"one crowd spans {shape[0] * pixel_m:.0f} x {shape[1] * pixel_m:.0f} m, too much to draw: "
                "check the unit of the positions or use a smaller radius_m"
            )
        self._drawn = close_with_disc(self._discs(shape, person_radius_m), closing_m / pixel_m)

    def contains(self, xy: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether points [N, 2] lie on the ground, to within half a pixel."""
        pixel = np.floor((xy - self._corner) / self._pixel_m).astype(np.int64)
        inside = ((pixel >= 0) & (pixel < self._drawn.shape)).all(axis=1)
        result = np.zeros(len(xy), np.bool_)
        result[inside] = self._drawn[tuple(pixel[inside].T)]
        return result

    def distance_m(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Horizontal distance [N] to the nearest person."""
        return np.asarray(self._tree.query(xy)[0])

    def nearest_feet_m(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height [N] that the nearest person stands at."""
        return np.asarray(self.feet[self._tree.query(xy)[1], 2])

    def height_m(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height [N] of the ground, from the feet of the nearest people, the nearer the more."""
        nearest = np.arange(1, min(_HEIGHT_NEIGHBOURS, len(self.feet)) + 1)
        distance_m, who = self._tree.query(xy, k=nearest)
        weight = 1.0 / (distance_m**2 + _HEIGHT_SOFTENING_M2)
        return np.asarray((weight * self.feet[who, 2]).sum(axis=1) / weight.sum(axis=1))

    def _discs(self, shape: NDArray[np.int64], person_radius_m: float) -> NDArray[np.bool_]:
        """Pixels whose centre lies within `person_radius_m` of a person."""
        reach = int(np.ceil(person_radius_m / self._pixel_m)) + 1
        place = (self.feet[:, :2] - self._corner) / self._pixel_m
        near = np.floor(place).astype(np.int64)[:, :, None] + np.arange(-reach, reach + 1)  # [P, 2, K]
        along = near + 0.5 - place[:, :, None]
        close = (
            along[:, 0, :, None] ** 2 + along[:, 1, None, :] ** 2 <= (person_radius_m / self._pixel_m) ** 2
        )
        who, i, j = np.nonzero(close)
        drawn = np.zeros(shape, np.bool_)
        drawn[near[who, 0, i], near[who, 1, j]] = True
        return drawn


def crowd_grounds(
    positions_enu: ArrayLike,
    radius_m: float,
    min_people: int,
    *,
    pixel_m: float,
    person_radius_m: float = PERSON_RADIUS_M,
) -> Iterator[CrowdGround]:
    """The ground of every crowd that `crowds_of` finds. ValueError as from there."""
    feet = np.asarray(positions_enu, np.float64)
    crowd_of_person = crowds_of(feet, radius_m, min_people)
    for crowd in range(crowd_of_person.max(initial=-1) + 1):
        yield CrowdGround(feet[crowd_of_person == crowd], radius_m, person_radius_m, pixel_m)


def crowds_of(positions_enu: ArrayLike, radius_m: float, min_people: int) -> NDArray[np.int64]:
    """Crowd number per person [N], -1 for people in none; distances are horizontal.

    A person with at least `min_people` people within `radius_m`, the person included, is the core of a crowd.
    Cores within `radius_m` of each other share a crowd, and everyone within `radius_m` of a core belongs to
    the crowd of the nearest. These are the clusters of DBSCAN (Ester et al., 1996) with eps = `radius_m`.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    feet = np.asarray(positions_enu, np.float64)
    if feet.ndim != 2 or feet.shape[1] != 3 or not np.isfinite(feet).all():
        raise ValueError(f"positions must be finite metres [N, 3], got shape {list(feet.shape)} or NaN in it")
    if not (np.isfinite(radius_m) and radius_m > 0.0):
        raise ValueError(f"radius_m must be positive and finite, got {radius_m}")
    if min_people < 1:
        raise ValueError(f"min_people must be at least 1, got {min_people}")
    crowd_of_person = np.full(len(feet), -1, np.int64)
    if len(feet) == 0:
        return crowd_of_person
    tree = cKDTree(feet[:, :2])
    neighbours = tree.query_ball_point(feet[:, :2], radius_m, return_length=True)
    # On the mean: a few may be recorded at one place.
    most = max(MOST_PER_M2 * np.pi * radius_m**2, _FEW)
    if neighbours.sum() > MAX_NEIGHBOURS or neighbours.mean() > most:
        raise ValueError(
            f"{len(feet)} people have {neighbours.mean():.0f} others within {radius_m} m on average; "
            "check the unit of the positions or use a smaller radius_m"
        )
    dense = np.flatnonzero(neighbours >= min_people)
    if dense.size == 0:
        return crowd_of_person
    dense_tree = cKDTree(feet[dense, :2])
    pairs = dense_tree.query_pairs(radius_m, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), np.bool_), (pairs[:, 0], pairs[:, 1])), shape=(dense.size,) * 2)
    _, crowd_of_dense = connected_components(links, directed=False)
    distance_m, nearest = dense_tree.query(feet[:, :2])
    return np.where(distance_m <= radius_m, crowd_of_dense[nearest], -1).astype(np.int64)
