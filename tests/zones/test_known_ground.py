"""Where the ground of a map ends."""

import numpy as np
import shapely

from crowdfence import Terrain
from crowdfence.zones.known_ground import known_ground


def terrain_of(columns: np.ndarray, size_m: float = 1.0) -> Terrain:
    """One voxel in each of the columns [X, Y] that are set."""
    i, j = np.nonzero(columns)
    return Terrain.from_indices(np.stack([i, j, np.zeros_like(i)], axis=1), size_m)


def test_the_rim_is_exact_and_holes_are_within() -> None:
    """An L of 4 x 4 columns less the 2 x 2 in the north-east, and less one column inside."""
    columns = np.ones((4, 4), dtype=bool)
    columns[2:, 2:] = columns[1, 1] = False
    ground = known_ground(terrain_of(columns, 2.0))
    assert ground.equals(shapely.box(0, 0, 8, 8) - shapely.box(4, 4, 8, 8)) and ground.area == 48.0


def test_a_bay_is_beyond_the_map_and_islands_are_ground() -> None:
    columns = np.ones((5, 3), dtype=bool)
    columns[3] = False
    columns[1, 1:] = False
    ground = known_ground(terrain_of(columns))
    expected = shapely.union_all([shapely.box(0, 0, 3, 3) - shapely.box(1, 1, 2, 3), shapely.box(4, 0, 5, 3)])
    assert ground.equals(expected)


def test_a_ragged_rim_loses_corners_and_gains_no_ground() -> None:
    """A comb: every second column of the northern row is missing, 2000 of them."""
    columns = np.ones((2000, 30), dtype=bool)
    columns[::2, -1] = False
    ground = known_ground(terrain_of(columns))
    assert shapely.get_num_coordinates(ground) <= 1000
    assert (shapely.box(0, 0, 2000, 29) | shapely.box(0, 0, 2000, 30)).covers(ground)
    assert not ground.intersects(shapely.box(0.25, 29.25, 0.75, 29.75))
    # Not more than some columns are lost at the rim.
    assert ground.covers(shapely.box(5, 5, 1995, 24))
