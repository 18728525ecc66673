"""Per-voxel arrays of a terrain seen from above: one cell per column of voxels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.unmasked import require_unmasked
from crowdfence.voxel_state import VoxelState

if TYPE_CHECKING:
    from crowdfence._core import CrowdMap

MAX_COLUMNS = 1 << 28
"""Largest grid that is built: 268 million columns, about 7 GB. Beyond it: an error, not a full memory."""

_VOXELS_PER_BLOCK = 1 << 20  # 24 MB of indices at a time, however large the terrain is
_NOWHERE = np.zeros(2, dtype=np.int64)
_NO_TOP = np.iinfo(np.int32).min
_NO_BOTTOM = np.iinfo(np.int32).max

# A column is CROWD when any voxel of it is. Short of that it shows the least known of its standing places,
# the voxels without a voxel on top of them: it is EMPTY only when all of them are. Ground under an overhang
# that nobody has looked at therefore keeps its column NEVER_SEEN, however well the roof above it was seen.
# Buried voxels do not count: on a slope every column hides some, and nobody can stand inside the ground.
LEAST_TO_MOST_URGENT = (
    VoxelState.EMPTY,
    VoxelState.STALE,
    VoxelState.NOT_CLEARED,
    VoxelState.OCCLUDED,
    VoxelState.NEVER_SEEN,
    VoxelState.CROWD,
)
_URGENCY = np.argsort(LEAST_TO_MOST_URGENT).astype(np.uint8)  # indexed by state

Crop = Literal["surface", "seen"]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceGrid:
    """Columns of a terrain. Arrays are [X, Y]: first axis east, second north.

    Cell (i, j) covers [east_edges_m[i], east_edges_m[i + 1]) x [north_edges_m[j], north_edges_m[j + 1]) in
    local metres.
    """

    cell_size_m: float
    origin: tuple[float, float, float]
    """Origin of the terrain's voxel grid, local metres."""
    first_column: tuple[int, int]
    """Voxel grid index (i, j) of cell (0, 0)."""
    probability: NDArray[np.float64]
    """[X, Y] largest probability over the voxels of the column that were ever seen, NaN = none was."""
    state: NDArray[np.uint8]
    """[X, Y] `VoxelState`: CROWD if any voxel is, otherwise the least known of the voxels that have no
    voxel on top of them, in the order NEVER_SEEN, OCCLUDED, NOT_CLEARED, STALE, EMPTY. NEVER_SEEN without
    terrain."""
    top_index: NDArray[np.int32]
    """[X, Y] grid index k of the highest voxel; meaningless where `has_surface` is False."""
    bottom_index: NDArray[np.int32]
    """[X, Y] grid index k of the lowest voxel; meaningless where `has_surface` is False."""
    last_seen_ns: NDArray[np.int64]
    """[X, Y] stamp of the newest look at any voxel of the column, -1 = never (or not given)."""

    @staticmethod
    def from_voxels(
        indices: ArrayLike,
        voxel_size_m: float,
        origin: tuple[float, float, float],
        probability: ArrayLike,
        state: ArrayLike,
        last_seen_ns: ArrayLike | None = None,
        *,
        crop: Crop = "surface",
        margin_m: float = 0.0,
    ) -> SurfaceGrid:
        """Grid from plain arrays: indices int [V, 3], probability [V] in [0, 1], state [V] (`VoxelState`).

        crop="surface" keeps every column that holds a voxel, "seen" those within `margin_m` of the bounding
        box of what was ever seen (everything when nothing was).

        Raises ValueError for arrays that do not fit together or are masked, a probability outside [0, 1] in a
        seen voxel, an unknown state, no voxels at all, or more than `MAX_COLUMNS` columns.
        """
        named = {"indices": indices, "probabilities": probability, "states": state, "stamps": last_seen_ns}
        for name, values in named.items():
            if values is not None:
                require_unmasked(values, name)
        index_array = np.asarray(indices)
        if index_array.ndim != 2 or index_array.shape[1] != 3:
            raise ValueError(f"indices must have shape [V, 3], got {list(index_array.shape)}")
        voxels = _Voxels(
            len(index_array),
            lambda ids: index_array[ids],
            _standing_among(index_array),
            _extent(index_array[:, :2]) if len(index_array) else (_NOWHERE, _NOWHERE),
            np.asarray(probability, dtype=np.float64),
            _states(state),
            None if last_seen_ns is None else np.asarray(last_seen_ns, dtype=np.int64),
        )
        return _build(voxels, voxel_size_m, origin, crop, margin_m)

    @staticmethod
    def from_crowd_map(
        crowd_map: CrowdMap,
        stamp_ns: int,
        *,
        threshold: float | None = None,
        stale_after_s: float = 30.0,
        crop: Crop = "seen",
        margin_m: float = 20.0,
    ) -> SurfaceGrid:
        """Grid of a crowd map at `stamp_ns` (not before its last instant), for rasters and pictures.

        It costs the map, whatever was seen: every voxel is looked at, 0.15 s a million. Zones do without it.
        The voxels are read in blocks, so that memory follows the columns kept and not the terrain's voxels.
        Raises ValueError as `from_voxels` does.
        """
        read = read_crowd_map(
            crowd_map,
            stamp_ns,
            threshold=threshold,
            stale_after_s=stale_after_s,
            crop=crop,
            margin_m=margin_m,
        )
        return read()

    @property
    def shape(self) -> tuple[int, int]:
        """(X, Y): columns from west to east, columns from south to north."""
        return (self.probability.shape[0], self.probability.shape[1])

    @property
    def cell_area_m2(self) -> float:
        return self.cell_size_m**2

    @property
    def east_edges_m(self) -> NDArray[np.float64]:
        """Local x [X + 1] of the cells' west edges and of the last one's east edge."""
        return _edges(self.origin[0], self.first_column[0], self.shape[0], self.cell_size_m)

    @property
    def north_edges_m(self) -> NDArray[np.float64]:
        """Local y [Y + 1] of the cells' south edges and of the last one's north edge."""
        return _edges(self.origin[1], self.first_column[1], self.shape[1], self.cell_size_m)

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """(west, south, east, north) in local metres."""
        east, north = self.east_edges_m, self.north_edges_m
        return (float(east[0]), float(north[0]), float(east[-1]), float(north[-1]))

    @property
    def has_surface(self) -> NDArray[np.bool_]:
        """[X, Y] whether the column holds any voxel."""
        return np.asarray(self.top_index != _NO_TOP)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """[X, Y] whether any voxel of the column was ever seen."""
        return ~np.isnan(self.probability)

    @property
    def top_m(self) -> NDArray[np.float64]:
        """[X, Y] local height of the top of the highest voxel, NaN where there is none."""
        return np.where(self.has_surface, self.height_m(self.top_index + 1.0), np.nan)

    def height_m(self, index: ArrayLike) -> NDArray[np.float64]:
        """Local height of the lower face of the voxels with grid index k = `index`."""
        return self.origin[2] + np.asarray(index, dtype=np.float64) * self.cell_size_m

    def area_m2(self, state: VoxelState) -> float:
        """Ground area of the columns with terrain that are in `state`."""
        return float(np.count_nonzero((self.state == state) & self.has_surface)) * self.cell_area_m2


def read_crowd_map(
    crowd_map: CrowdMap,
    stamp_ns: int,
    *,
    threshold: float | None = None,
    stale_after_s: float = 30.0,
    crop: Crop = "seen",
    margin_m: float = 20.0,
) -> Callable[[], SurfaceGrid]:
    """`SurfaceGrid.from_crowd_map` in two parts: what reads the map, a tenth of the time, and what is called
    after it, while the map may go on. ValueError as there."""
    terrain = crowd_map.terrain
    probability = crowd_map.probability(stamp_ns)
    state = crowd_map.state(stamp_ns, threshold=threshold, stale_after_s=stale_after_s)
    last_seen_ns = crowd_map.last_seen_ns()

    def built() -> SurfaceGrid:
        corners = np.rint((terrain.bounds - terrain.origin) / terrain.voxel_size_m).astype(np.int64)
        stands = np.zeros(terrain.voxel_count, dtype=np.bool_)
        stands[terrain.standing_places()] = True
        voxels = _Voxels(
            terrain.voxel_count,
            terrain.voxel_indices,
            stands,
            (corners[0, :2], corners[1, :2] - 1),
            probability,
            state,
            last_seen_ns,
        )
        return _build(voxels, terrain.voxel_size_m, terrain.origin, crop, margin_m)

    return built


@dataclass(frozen=True, slots=True)
class _Voxels:
    count: int
    indices_of: Callable[[NDArray[np.int64]], NDArray[np.int64]]
    """ids [N] -> grid indices [N, 3]"""
    stands: NDArray[np.bool_]
    """Whether no voxel lies on top, so that somebody can stand on it [V]."""
    columns: tuple[NDArray[np.int64], NDArray[np.int64]]
    """Lowest and highest column index [2] of all voxels."""
    probability: NDArray[np.float64]
    state: NDArray[np.uint8]
    last_seen_ns: NDArray[np.int64] | None

    def __post_init__(self) -> None:
        if self.count == 0:
            raise ValueError("the terrain has no voxels; there is nothing to map")
        for name in ("probability", "state", "last_seen_ns"):
            array = getattr(self, name)
            if array is not None and array.shape != (self.count,):
                raise ValueError(
                    f"{name} must have one value per voxel [{self.count}], got {list(array.shape)}"
                )
        seen = self.probability[_is_seen(self.state)]
        bad = seen[~((seen >= 0.0) & (seen <= 1.0))]
        if bad.size:
            raise ValueError(f"probability {bad[0]} of a seen voxel is outside [0, 1]")

    def blocks(self) -> Iterator[NDArray[np.int64]]:
        """Ids in blocks, so that no array of indices of the whole terrain ever exists."""
        for start in range(0, self.count, _VOXELS_PER_BLOCK):
            yield np.arange(start, min(start + _VOXELS_PER_BLOCK, self.count), dtype=np.int64)

    def seen_columns(self) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
        """Lowest and highest column index [2] of the voxels that were ever seen."""
        corners: list[NDArray[np.int64]] = []
        for ids in self.blocks():
            seen = ids[_is_seen(self.state[ids[0] : ids[-1] + 1])]
            if seen.size:
                corners += _extent(self.indices_of(seen)[:, :2])
        return _extent(np.array(corners)) if corners else None


def _states(state: ArrayLike) -> NDArray[np.uint8]:
    """In a byte 258 would be 2, which is EMPTY, and so would 2.9."""
    given = np.asarray(state)
    is_state = np.isin(given, list(VoxelState))
    if not is_state.all():
        bad = given[~is_state].flat[0]
        raise ValueError(f"state {bad} is not a VoxelState (0 to {max(VoxelState).value})")
    return given.astype(np.uint8)


def _extent(columns: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Lowest and highest [2] of column indices [N, 2], N at least 1."""
    return columns.min(axis=0), columns.max(axis=0)


def _standing_among(indices: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether no voxel lies on top of each, for a plain array of indices."""
    low = indices.min(axis=0, initial=0)
    # One more level than there is, so that the level above the highest one is free.
    span = indices.max(axis=0, initial=0) - low + (1, 1, 2)
    flat = np.ravel_multi_index(tuple((indices - low).T), tuple(span))
    return ~np.isin(flat + 1, flat)


def _is_seen(state: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return (state != VoxelState.NEVER_SEEN) & (state != VoxelState.OCCLUDED)


def _edges(origin_m: float, first: int, count: int, cell_size_m: float) -> NDArray[np.float64]:
    # One expression for every edge, so that neighbouring cells share bit-identical coordinates.
    return origin_m + (first + np.arange(count + 1, dtype=np.float64)) * cell_size_m


def _build(
    voxels: _Voxels, cell_size_m: float, origin: Sequence[float], crop: Crop, margin_m: float
) -> SurfaceGrid:
    if not (cell_size_m > 0.0 and np.isfinite(cell_size_m)):
        raise ValueError(f"voxel_size_m must be positive and finite, got {cell_size_m}")
    if not margin_m >= 0.0:
        raise ValueError(f"margin_m must not be negative, got {margin_m}")
    lowest, highest = _kept_columns(voxels, crop, margin_m / cell_size_m)
    shape = highest - lowest + 1
    if shape[0] * shape[1] > MAX_COLUMNS:
        raise ValueError(
            f"the map spans {shape[0]} x {shape[1]} columns, more than {MAX_COLUMNS}; "
            'crop it to what was seen (crop="seen") or use larger voxels'
        )
    columns = _Columns(int(shape[0]), int(shape[1]))
    for ids in voxels.blocks():
        columns.add(ids, voxels, lowest)
    return SurfaceGrid(
        cell_size_m=float(cell_size_m),
        origin=(float(origin[0]), float(origin[1]), float(origin[2])),
        first_column=(int(lowest[0]), int(lowest[1])),
        probability=columns.probability_or_nan(),
        state=columns.state(),
        top_index=columns.top_index.reshape(columns.shape),
        bottom_index=columns.bottom_index.reshape(columns.shape),
        last_seen_ns=columns.last_seen_ns.reshape(columns.shape),
    )


def _kept_columns(
    voxels: _Voxels, crop: Crop, margin_cells: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Lowest and highest column index [2] to keep."""
    surface = voxels.columns
    if crop == "surface":
        return surface
    if crop != "seen":
        raise ValueError(f'crop must be "surface" or "seen", got {crop!r}')
    seen = voxels.seen_columns()
    if seen is None:
        return surface
    # The margin never reaches beyond the terrain, where there is nothing to show.
    margin = int(np.ceil(min(margin_cells, float(MAX_COLUMNS))))
    return np.maximum(seen[0] - margin, surface[0]), np.minimum(seen[1] + margin, surface[1])


class _Columns:
    """Flat per-column accumulators; each `add` folds one block of voxels in."""

    def __init__(self, east: int, north: int) -> None:
        self.shape = (east, north)
        self.probability = np.full(east * north, -np.inf)
        self.urgency = np.zeros(east * north, dtype=np.uint8)
        self.top_index = np.full(east * north, _NO_TOP, dtype=np.int32)
        self.bottom_index = np.full(east * north, _NO_BOTTOM, dtype=np.int32)
        self.last_seen_ns = np.full(east * north, -1, dtype=np.int64)

    def add(self, ids: NDArray[np.int64], voxels: _Voxels, lowest: NDArray[np.int64]) -> None:
        indices = voxels.indices_of(ids)
        column = indices[:, :2] - lowest
        inside = ((column >= 0) & (column < self.shape)).all(axis=1)
        ids, column, level = ids[inside], column[inside], indices[inside, 2].astype(np.int32)
        flat = column[:, 0] * self.shape[1] + column[:, 1]
        state = voxels.state[ids]
        stands = voxels.stands[ids] | (state == VoxelState.CROWD)
        np.maximum.at(self.urgency, flat[stands], _URGENCY[state[stands]])
        np.maximum.at(self.top_index, flat, level)
        np.minimum.at(self.bottom_index, flat, level)
        seen = _is_seen(state)
        np.maximum.at(self.probability, flat[seen], voxels.probability[ids[seen]])
        if voxels.last_seen_ns is not None:
            np.maximum.at(self.last_seen_ns, flat[seen], voxels.last_seen_ns[ids[seen]])

    def probability_or_nan(self) -> NDArray[np.float64]:
        self.probability[np.isneginf(self.probability)] = np.nan
        return self.probability.reshape(self.shape)

    def state(self) -> NDArray[np.uint8]:
        state = np.array(LEAST_TO_MOST_URGENT, dtype=np.uint8)[self.urgency]
        state[self.top_index == _NO_TOP] = VoxelState.NEVER_SEEN
        return state.reshape(self.shape)
