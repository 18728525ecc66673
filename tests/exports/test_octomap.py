"""OctoMap exports, read back by the OctoMap library itself (pyoctomap)."""

import json
import pickle
from pathlib import Path

import numpy as np
import pyoctomap
import pytest
from numpy.typing import NDArray

from crowdfence import Georeference, Terrain, VoxelState
from crowdfence.exports.colours import STATE_COLOURS
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.octomap import write_coloured_octomap, write_terrain_octomap

DESCRIPTION = MapDescription(1_760_000_009_500_000_001, 0.5, "paper", mission='two\nlines # and "quotes"')
ORIGIN = (100.0, -20.0, 7.0)


@pytest.fixture
def terrain() -> Terrain:
    occupied = np.zeros((3, 2, 2), dtype=bool)
    occupied[:, :, 0] = True
    occupied[0, 0, 1] = True
    return Terrain.from_occupancy(occupied, 0.5, ORIGIN)


def tree_centres(terrain: Terrain) -> NDArray[np.float64]:
    """Where other programs must find the voxels: where they are."""
    return terrain.voxel_centers(np.arange(terrain.voxel_count))


def comment(path: Path) -> dict[str, object]:
    lines = path.read_bytes().split(b"\n", 2)
    assert lines[1].startswith(b"# crowdfence ")
    content = json.loads(lines[1].removeprefix(b"# crowdfence "))
    assert isinstance(content, dict)
    return content


def test_the_terrain_file_holds_exactly_the_voxels(tmp_path: Path, terrain: Terrain) -> None:
    path = tmp_path / "terrain.bt"
    write_terrain_octomap(path, terrain)
    tree = pyoctomap.OcTree(0.1)
    assert tree.readBinary(str(path))
    assert tree.getResolution() == 0.5
    for centre in tree_centres(terrain):
        assert tree.isNodeOccupied(tree.search(centre))
    assert tree.search(np.array([1.25, 0.75, 0.75]) + ORIGIN) is None
    assert comment(path)["origin_m"] == [0.0, 0.0, 0.0]
    again = Terrain.open(path)
    assert (again.fingerprint, again.voxel_count) == (terrain.fingerprint, 7)


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), ORIGIN, (1e6, 0.0, 0.0)])
def test_what_nobody_measured_of_the_map_comes_back(
    tmp_path: Path, origin: tuple[float, float, float]
) -> None:
    columns = np.array([[-1, 4], [-1, 5], [-1, 7], [0, 0], [0, 1], [3, 5]])
    ground = Terrain.from_indices([(i, j, 0) for i in range(-2, 5) for j in range(9)], 0.5, origin)
    path = tmp_path / "terrain.bt"
    write_terrain_octomap(path, ground)
    assert "unmeasured" not in comment(path)
    marked = ground.with_unmeasured(columns)
    write_terrain_octomap(path, marked)
    again = Terrain.open(path)
    assert again.fingerprint == ground.fingerprint and again.unmeasured.tolist() == columns.tolist()
    assert pyoctomap.OcTree(0.1).readBinary(str(path))
    # Where the caller says where the file lies, its own columns count.
    moved = Terrain.open(path, origin=(5.0, 5.0, 5.0))
    at = [tuple(ground.voxel_centers(ground.voxel_ids([[i, j, 0]]))[0, :2]) for i, j in columns]
    assert len(moved.unmeasured) == len(columns) == len(set(at))
    assert pickle.loads(pickle.dumps(marked)).unmeasured.tolist() == columns.tolist()


@pytest.mark.parametrize(
    "claim", ["[[0, 0, 9e18]]", "[[0, -9223372036854775808, 9223372036854775807]]", "[[-5, 0, 1]]"]
)
def test_what_a_file_claims_of_its_columns_costs_no_more_than_its_map(
    tmp_path: Path, terrain: Terrain, claim: str
) -> None:
    path = tmp_path / "terrain.bt"
    write_terrain_octomap(path, terrain)
    path.write_bytes(path.read_bytes().replace(b', "moved"', f', "unmeasured": {claim}, "moved"'.encode(), 1))
    assert len(Terrain.open(path).unmeasured) <= 6


def test_every_voxel_that_was_seen_is_occupied_and_has_the_colour_of_its_state(
    tmp_path: Path, terrain: Terrain
) -> None:
    terrain.georeference = Georeference(46.5, 8.0, 1200.0)
    never, occluded, empty, stale, crowd, not_cleared = VoxelState
    state = np.array([never, occluded, empty, stale, crowd, crowd, not_cleared])
    # A never seen voxel with a high initial value must not look like crowd.
    probability = np.array([0.9, 0.9, 0.0, 0.0, 0.5, 1.0, 0.25])
    path = tmp_path / "crowd_map.ot"
    write_coloured_octomap(path, terrain, probability, state, DESCRIPTION)
    tree = pyoctomap.ColorOcTree(0.1)
    tree = tree.read(str(path)) or tree
    nodes = [tree.search(centre) for centre in tree_centres(terrain)]
    assert nodes[:2] == [None, None]  # what nobody has seen is not in the file
    # Seen and empty ground is ground, not free space.
    assert all(tree.isNodeOccupied(node) for node in nodes[2:])
    colours = [tuple(int(channel) for channel in node.getColor()) for node in nodes[2:]]
    assert colours[:2] == [STATE_COLOURS[known] for known in (empty, stale)]
    assert colours[4] == STATE_COLOURS[not_cleared]
    assert colours[2] == (255, 214, 70)  # at the threshold: the yellow end of the ramp
    assert colours[3] == (112, 8, 38)  # certain: its dark red end
    content = comment(path)
    assert content["mission"] == DESCRIPTION.mission
    assert content["anchor_wgs84"] == [46.5, 8.0, 1200.0]
    assert content["stamp_utc"] == "2025-10-09T08:53:29.500000001Z"


def test_arrays_of_another_terrain_are_refused(tmp_path: Path, terrain: Terrain) -> None:
    with pytest.raises(ValueError, match=r"state must have shape \[7\], got \[6\]"):
        write_coloured_octomap(tmp_path / "x.ot", terrain, np.zeros(7), np.zeros(6), DESCRIPTION)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("origin", [(-768.3, 12.1, 55.0), (0.2, -0.2, 0.0), (20_000.0, 0.0, 0.0)])
def test_other_programs_find_the_ground_within_half_a_voxel(
    tmp_path: Path, origin: tuple[float, float, float]
) -> None:
    """The grid of a height model starts anywhere: at 0.5 m as far out as OctoMap's keys reach, 16 km."""
    heights = np.random.default_rng(1).uniform(0.0, 8.0, (40, 30))
    terrain = Terrain.from_height_map(heights, 0.5, origin=origin)
    path = tmp_path / "terrain.bt"
    write_terrain_octomap(path, terrain)
    tree = pyoctomap.OcTree(0.1)
    assert tree.readBinary(str(path))
    if origin[0] < 16_000.0:
        low, high = np.array(tree.getMetricMin()), np.array(tree.getMetricMax())
        assert (np.abs([low, high] - terrain.bounds) <= 0.25 + 1e-9).all()
    # And we find it exactly, planes and all.
    again = Terrain.open(path)
    assert (again.fingerprint, again.origin) == (terrain.fingerprint, terrain.origin)
