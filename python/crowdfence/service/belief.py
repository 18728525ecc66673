"""The crowd map from above, as bytes for the page: one entry per column that somebody looked at."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap, Terrain
from crowdfence.service.ground import Ground
from crowdfence.surface_grid import LEAST_TO_MOST_URGENT
from crowdfence.voxel_state import VoxelState
from crowdfence.zones.tracker import column_keys, column_places

_HEAD = struct.Struct("<Iqfff")
_OLDEST = 65535
MOST_SIDE = 65536
"""Columns of a map from west to east, and from south to north: more have no number in the bytes."""
_URGENCY = np.argsort(LEAST_TO_MOST_URGENT).astype(np.uint8)
_STATES = np.array(LEAST_TO_MOST_URGENT, dtype=np.uint8)


def check_side(terrain: Terrain) -> None:
    """ValueError for a map that is too long for `belief_bytes`."""
    columns, rows = np.rint(np.diff(terrain.bounds[:, :2], axis=0)[0] / terrain.voxel_size_m).astype(int)
    if max(columns, rows) > MOST_SIDE:
        raise ValueError(
            f"the map has {columns} x {rows} cells of {terrain.voxel_size_m:g} m; a service shows at most "
            f"{MOST_SIDE} to a side: cut it to where the fleet flies, or give a larger voxel_size_m"
        )


def belief_bytes(
    crowd_map: CrowdMap, ground: Ground, stamp_ns: int, *, threshold: float, stale_after_s: float
) -> bytes:
    """Little endian: u32 n, i64 stamp_ns, f32 cell_size_m, west, south; then n each of u16 column (from
    west), u16 row (from south), f32 height, u8 probability * 255, u8 `VoxelState`, u16 age in 0.1 s (65535:
    older).

    A column is crowd where any voxel of it is; otherwise it shows the least known of its standing places.
    Columns that nobody saw are there where a camera pointed at them and something hid them: probability 0,
    oldest age. StampError for a stamp before the newest instant.
    """
    terrain = crowd_map.terrain
    seen_ids = crowd_map.seen_ids()
    state = crowd_map.state(stamp_ns, threshold=threshold, stale_after_s=stale_after_s)
    looked_at = np.concatenate([seen_ids, np.flatnonzero(state == VoxelState.OCCLUDED)])
    keys = column_keys(terrain.voxel_indices(looked_at)[:, :2])
    columns, of_voxel = np.unique(keys, return_inverse=True)
    of_seen = of_voxel[: len(seen_ids)]
    standing, of_standing = ground.places_of(columns)
    seen = crowd_map.knowledge(seen_ids, stamp_ns, threshold=threshold, stale_after_s=stale_after_s)
    count = len(columns)
    urgency = np.zeros(count, dtype=np.uint8)
    np.maximum.at(urgency, of_standing, _URGENCY[state[standing]])
    urgency[of_seen[seen.state == VoxelState.CROWD]] = _URGENCY[VoxelState.CROWD]
    probability = np.zeros(count)
    np.maximum.at(probability, of_seen, seen.probability)
    age_s = np.full(count, np.inf)
    np.minimum.at(age_s, of_seen, seen.age_s)
    height = np.full(count, -np.inf, dtype=np.float32)
    np.maximum.at(height, of_standing, terrain.surface_heights(standing).astype(np.float32))
    place = column_places(columns)
    first = place.min(axis=0) if count else np.zeros(2, dtype=np.int64)
    offset = (place - first).astype("<u2")
    west, south = (terrain.origin[axis] + float(first[axis]) * terrain.voxel_size_m for axis in (0, 1))
    return b"".join(
        (
            _HEAD.pack(count, stamp_ns, terrain.voxel_size_m, west, south),
            offset[:, 0].tobytes(),
            offset[:, 1].tobytes(),
            height.astype("<f4").tobytes(),
            np.rint(probability * 255.0).astype(np.uint8).tobytes(),
            _STATES[urgency].tobytes(),
            np.minimum(np.rint(age_s * 10.0), _OLDEST).astype("<u2").tobytes(),
        )
    )


def aged(belief: bytes, stamp_ns: int, *, stale_after_s: float) -> bytes:
    """A map of before as of a later stamp, until which no other was kept: what was seen empty is that much
    older, and stale where it is too old."""
    count, then_ns, *place = _HEAD.unpack_from(belief)
    if stamp_ns <= then_ns:
        return belief
    ages_at = len(belief) - 2 * count
    states_at = ages_at - count
    state = np.frombuffer(belief, np.uint8, count, states_at).copy()
    tenths = np.frombuffer(belief, "<u2", count, ages_at) + float((stamp_ns - then_ns) / 1e8)
    # Half a tenth may have been rounded away.
    state[(state == VoxelState.EMPTY) & (tenths + 0.5 > stale_after_s * 10.0)] = VoxelState.STALE
    return b"".join(
        (
            _HEAD.pack(count, stamp_ns, *place),
            belief[_HEAD.size : states_at],
            state.tobytes(),
            np.minimum(np.rint(tenths), _OLDEST).astype("<u2").tobytes(),
        )
    )


@dataclass(frozen=True, slots=True, eq=False)
class ColumnBeliefs:
    """What `belief_bytes` says, one value per column [N]."""

    stamp_ns: int
    cell_size_m: float
    west_m: NDArray[np.float64]
    """Of the column's cell."""
    south_m: NDArray[np.float64]
    height_m: NDArray[np.float32]
    probability: NDArray[np.float64]
    """In steps of 1 / 255."""
    state: NDArray[np.uint8]
    """`VoxelState`."""
    age_s: NDArray[np.float64]
    """Since the last look, in steps of 0.1 s; inf beyond 6553 s and where nobody saw it."""

    @staticmethod
    def of(data: bytes) -> ColumnBeliefs:
        """ValueError for bytes of another length."""
        count, stamp_ns, cell_size_m, west_m, south_m = _HEAD.unpack_from(data)
        kinds = ("<u2", "<u2", "<f4", "u1", "u1", "<u2")
        ends = _HEAD.size + np.cumsum([count * np.dtype(kind).itemsize for kind in kinds])
        if len(data) != ends[-1]:
            raise ValueError(f"{count} columns are {ends[-1]} bytes, not {len(data)}")
        starts = (_HEAD.size, *ends[:-1])
        column, row, height, probability, state, age = (
            np.frombuffer(data, kind, count, start) for kind, start in zip(kinds, starts, strict=True)
        )
        return ColumnBeliefs(
            stamp_ns,
            cell_size_m,
            west_m + column * float(cell_size_m),
            south_m + row * float(cell_size_m),
            height.astype(np.float32),
            probability / 255.0,
            state,
            np.where(age == _OLDEST, np.inf, age / 10.0),
        )

    def __len__(self) -> int:
        return len(self.state)
