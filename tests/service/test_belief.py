"""The map from above against the raster of `SurfaceGrid`, which is made another way."""

from pathlib import Path

import numpy as np
import pytest

from crowdfence import SurfaceGrid, Terrain, VoxelState
from crowdfence.service.belief import ColumnBeliefs, belief_bytes, check_side
from crowdfence.service.ground import MAX_SIDE, Ground
from crowdfence.service.opening import live, replayed
from crowdfence.service.seen_columns import SeenColumns
from support.small_service import CONFIG, START_NS, plain, recording, view, views


def house() -> Terrain:
    """A plain with a roof on posts over a part of it: two standing places in a column."""
    occupied = np.zeros((60, 60, 6), bool)
    occupied[:, :, 0] = True
    occupied[15:24, 18:26, 4] = True
    occupied[30, :, 1:3] = True
    return Terrain.from_occupancy(occupied, 1.0)


@pytest.mark.parametrize("terrain", [plain(), house()], ids=["plain", "house"])
@pytest.mark.parametrize("later_s", [0.0, 2.0, 40.0])
def test_columns_are_those_of_the_surface_grid(terrain: Terrain, later_s: float) -> None:
    crowd_map = CONFIG.crowd_map(terrain, 3)
    for number in range(8):
        flown = [view(drone, number) for drone in ("uav1", "uav2", "uav3")]
        crowd_map.integrate(flown, flown[-1].stamp_ns)
    stamp_ns = crowd_map.span_ns[1] + round(later_s * 1e9)
    told = {"threshold": crowd_map.default_threshold(), "stale_after_s": 30.0}
    belief = ColumnBeliefs.of(belief_bytes(crowd_map, Ground(terrain), stamp_ns, **told))
    grid = SurfaceGrid.from_crowd_map(crowd_map, stamp_ns, crop="surface", **told)
    i = np.rint(belief.west_m - grid.east_edges_m[0]).astype(int)
    j = np.rint(belief.south_m - grid.north_edges_m[0]).astype(int)
    assert len({*zip(i.tolist(), j.tolist(), strict=True)}) == len(belief) > 500
    assert np.array_equal(belief.state, grid.state[i, j])
    told_of = np.zeros(grid.shape, bool)
    told_of[i, j] = True
    hidden = grid.state == VoxelState.OCCLUDED
    assert (told_of >= (grid.seen | hidden)).all()
    assert hidden.any() == (terrain.bounds[1, 2] > 1.0)  # behind the house, nowhere on the plain
    seen = grid.seen[i, j]
    assert np.isinf(belief.age_s[~seen]).all() and not belief.probability[~seen].any()
    assert np.abs(belief.probability - grid.probability[i, j])[seen].max() <= 0.5 / 255 + 1e-9
    age_s = (stamp_ns - grid.last_seen_ns[i, j]) / 1e9
    assert np.abs(belief.age_s - age_s)[seen].max() <= 0.05 + 1e-9
    assert (belief.height_m <= grid.top_m[i, j] + 1e-3).all()
    if later_s == 40.0:
        assert not (belief.state == VoxelState.EMPTY).any()


def test_before_the_first_look_there_is_nothing() -> None:
    crowd_map = CONFIG.crowd_map(plain(), 1)
    told = belief_bytes(crowd_map, Ground(plain()), START_NS, threshold=0.5, stale_after_s=30.0)
    assert len(ColumnBeliefs.of(told)) == 0
    with pytest.raises(ValueError, match="bytes"):
        ColumnBeliefs.of(told + b"\0")


def test_the_raster_shows_heights_north_row_first_and_holes_as_nan() -> None:
    # East first, as `from_height_map` takes them: 3 m wide, 4 m deep.
    heights = np.array([[0.0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11]])
    terrain = Terrain.from_height_map(heights, cell_size_m=1.0)
    raster = Ground(terrain).raster()
    ids, distances = terrain.raycast([[2.5, 0.5, 50.0], [0.5, 2.5, 50.0]], [[0, 0, -1]] * 2, 100.0)
    assert (np.asarray(ids) >= 0).all()
    assert raster.heights_m.shape == (4, 3) and (raster.west_m, raster.north_m) == (0.0, 4.0)
    assert raster.height_at(np.array([[2.5, 0.5], [0.5, 2.5]])) == pytest.approx(50.0 - distances, abs=0.51)
    assert np.isnan(raster.height_at(np.array([[-1.0, 0.5], [2.0, 9.0]]))).all()
    part = Ground(terrain).raster((1.2, 0.0, 2.9, 1.9))
    assert part.heights_m.shape == (2, 2) and (part.west_m, part.north_m) == (1.0, 2.0)


def test_a_raster_of_a_long_map_is_thinned_to_what_a_browser_draws() -> None:
    terrain = Terrain.from_height_map(np.zeros((3, 3000)), cell_size_m=1.0)
    raster = Ground(terrain).raster()
    assert max(raster.heights_m.shape) <= MAX_SIDE and raster.cell_size_m == 3.0
    assert np.isfinite(raster.heights_m).all()


def test_seen_ground_is_what_the_map_shows_of_it() -> None:
    terrain = house()
    crowd_map, ground = CONFIG.crowd_map(terrain, 3), Ground(terrain)
    columns = SeenColumns(terrain)
    for number in range(8):
        flown = [view(drone, number) for drone in ("uav1", "uav2", "uav3")]
        columns.add(crowd_map.integrate(flown, flown[-1].stamp_ns).voxel_ids)
    stamp_ns = crowd_map.span_ns[1]
    told = belief_bytes(crowd_map, ground, stamp_ns, threshold=0.9999, stale_after_s=30.0)
    state = ColumnBeliefs.of(told).state
    shown = np.isin(state, (VoxelState.EMPTY, VoxelState.STALE, VoxelState.NOT_CLEARED))
    assert columns.count == np.count_nonzero(shown) > 500 and not (state == VoxelState.CROWD).any()
    assert columns.count < crowd_map.seen_count, "walls were seen, too"


def test_a_map_whose_columns_have_no_number_is_refused(tmp_path: Path) -> None:
    """Crowd at its eastern end, 70 km away, was shown 65,536 m to the west of where it stood."""
    check_side(Terrain.from_height_map(np.zeros((65_536, 2)), cell_size_m=1.0))
    for shape, told in (((70_000, 2), "70000 x 2 cells of 1 m"), ((2, 65_537), "2 x 65537 cells of 1 m")):
        terrain = Terrain.from_height_map(np.zeros(shape), cell_size_m=1.0)
        with pytest.raises(ValueError, match=told), live(tmp_path / "data", terrain, CONFIG, name="long"):
            pass
        with pytest.raises(ValueError, match=told), replayed(recording(views(2)), terrain, CONFIG):
            pass
    assert not (tmp_path / "data").exists()
