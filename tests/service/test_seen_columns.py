"""Seen ground is counted from above."""

import numpy as np
import pytest

from crowdfence import Terrain
from crowdfence.service.seen_columns import SeenColumns


def roofed() -> Terrain:
    """3 x 2 columns of ground; a wall of three voxels in one, a roof over another."""
    occupied = np.zeros((3, 2, 5), bool)
    occupied[:, :, 0] = True
    occupied[0, 0, :3] = True
    occupied[2, 1, 4] = True
    return Terrain.from_occupancy(occupied, 1.0)


def ids(terrain: Terrain, *indices: tuple[int, int, int]) -> np.ndarray:
    return terrain.voxel_ids(np.array(indices))


def test_walls_add_nothing_and_ground_below_a_roof_is_seen_with_it() -> None:
    terrain = roofed()
    columns = SeenColumns(terrain)
    columns.add(ids(terrain, (0, 0, 0), (0, 0, 1)))
    assert columns.count == 0, "the side of a wall"
    columns.add(ids(terrain, (0, 0, 1), (0, 0, 2), (1, 0, 0)))
    assert columns.count == 2
    columns.add(ids(terrain, (0, 0, 2), (1, 0, 0)))
    assert columns.count == 2, "again"
    columns.add(ids(terrain, (2, 1, 4)))
    assert columns.count == 2, "a roof, and nobody looked under it"
    columns.add(ids(terrain, (2, 1, 0)))
    assert columns.count == 3
    columns.add(np.arange(terrain.voxel_count))
    assert columns.count == 6


@pytest.mark.parametrize("seed", range(3))
def test_in_any_parts_it_is_what_all_at_once_is(seed: int) -> None:
    random = np.random.default_rng(seed)
    terrain = Terrain.from_occupancy(random.random((12, 9, 6)) < 0.4, 1.0)
    parts, whole = SeenColumns(terrain), SeenColumns(terrain)
    seen: set[int] = set()
    for _ in range(6):
        some = random.choice(terrain.voxel_count, terrain.voxel_count // 4, replace=False)
        parts.add(some)
        seen |= set(some.tolist())
    whole.add(np.array(sorted(seen)))
    by_hand = {tuple(place[:2]) for place in terrain.voxel_indices(np.arange(terrain.voxel_count)).tolist()}
    places = terrain.standing_places()
    for voxel, (i, j, _) in zip(places.tolist(), terrain.voxel_indices(places).tolist(), strict=True):
        if voxel not in seen:
            by_hand.discard((i, j))
    assert parts.count == whole.count == len(by_hand)
