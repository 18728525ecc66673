"""OctoMap files against the OctoMap library (pyoctomap): what it writes we read, what we write it reads."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyoctomap
import pytest
from numpy.typing import NDArray

from crowdfence import Terrain, _core

VOXEL_SIZE_M = 0.25
Index = tuple[int, int, int]
Colour = tuple[int, int, int]


def some_voxels() -> NDArray[np.int64]:
    """Loose voxels on both sides of 0, blocks of 8 and of 64 that prune, and one that nearly does."""
    random = np.random.default_rng(4)
    block = np.argwhere(np.ones((4, 4, 4), dtype=bool))
    loose = random.integers(-40, 40, (300, 3))
    small_block = np.argwhere(np.ones((2, 2, 2), dtype=bool))
    parts = [loose, block + np.array([8, -12, 16]), small_block - np.array([6, 2, 8]), block[1:]]
    return np.unique(np.concatenate(parts), axis=0)


def centre(index: NDArray[np.int64]) -> NDArray[np.float64]:
    return (np.asarray(index, dtype=np.float64) + 0.5) * VOXEL_SIZE_M


def terrain_of(voxels: NDArray[np.int64]) -> Terrain:
    return Terrain.from_points(centre(voxels), VOXEL_SIZE_M)


def cells(leaf: Any) -> list[Index]:
    """Indices of the smallest cells of a leaf of the library."""
    side = 2 ** (16 - leaf.getDepth())
    low = np.round(np.array(leaf.getCoordinate()) / VOXEL_SIZE_M - side / 2).astype(int)
    return [(int(i), int(j), int(k)) for i, j, k in low + np.argwhere(np.ones((side,) * 3))]


def occupied_cells(tree: Any) -> set[Index]:
    return {
        cell for leaf in tree.begin_leafs() if tree.isNodeOccupied(leaf.current_node) for cell in cells(leaf)
    }


def indices(terrain: Terrain) -> set[Index]:
    return {(i, j, k) for i, j, k in terrain.voxel_indices(np.arange(terrain.voxel_count)).tolist()}


def as_set(voxels: NDArray[np.int64]) -> set[Index]:
    return {(i, j, k) for i, j, k in voxels.tolist()}


def nodes(file: bytes) -> bytes:
    """What follows the header."""
    return file.split(b"\ndata\n", 1)[1]


def test_binary_files_of_the_library_are_read(tmp_path: Path) -> None:
    voxels, path = some_voxels(), tmp_path / "map.bt"
    tree = pyoctomap.OcTree(VOXEL_SIZE_M)
    for voxel in voxels:
        tree.updateNode(centre(voxel), True)
        tree.updateNode(centre(voxel + np.array([100, 0, 0])), False)
    assert tree.writeBinary(str(path))

    terrain = Terrain.from_octomap(path.read_bytes())
    assert terrain.voxel_size_m == VOXEL_SIZE_M
    assert indices(terrain) == as_set(voxels) == occupied_cells(tree)


@pytest.mark.parametrize("tree_type", [pyoctomap.OcTree, pyoctomap.OcTreeStamped, pyoctomap.ColorOcTree])
def test_full_files_of_the_library_are_read(tmp_path: Path, tree_type: Any) -> None:
    voxels, path = some_voxels(), tmp_path / "map.ot"
    log_odds = np.random.default_rng(7).choice([-2.0, -0.125, 0.0, 0.5, 3.5], len(voxels))
    tree = tree_type(VOXEL_SIZE_M)
    for voxel, value in zip(voxels, log_odds, strict=True):
        tree.updateNode(centre(voxel), float(value))
    assert tree.write(str(path))

    terrain = Terrain.from_octomap(path.read_bytes())
    assert indices(terrain) == as_set(voxels[log_odds >= 0]) == occupied_cells(tree)


def test_origin_moves_the_voxels_and_not_their_indices(tmp_path: Path) -> None:
    file = _core.write_octomap_binary(terrain_of(np.array([[3, -2, 0]])), [0])
    terrain = Terrain.from_octomap(file, origin=(100.0, 200.0, 0.1))
    assert terrain.voxel_indices([0]).tolist() == [[3, -2, 0]]
    np.testing.assert_allclose(terrain.voxel_centers([0]), [[100.875, 199.625, 0.225]], rtol=0, atol=1e-12)


def test_our_binary_files_are_read_by_the_library(tmp_path: Path) -> None:
    terrain, path = terrain_of(some_voxels()), tmp_path / "map.bt"
    ids = np.arange(0, terrain.voxel_count)[::-1]
    path.write_bytes(_core.write_octomap_binary(terrain, ids))
    tree = pyoctomap.OcTree(1.0)
    assert tree.readBinary(str(path))
    assert tree.getResolution() == VOXEL_SIZE_M
    assert occupied_cells(tree) == indices(terrain)

    # Written again by the library, which prunes, not a byte may change.
    again = tmp_path / "again.bt"
    assert tree.writeBinary(str(again))
    assert nodes(again.read_bytes()) == nodes(path.read_bytes())


def test_only_the_chosen_voxels_are_written() -> None:
    terrain = terrain_of(some_voxels())
    ids = np.arange(0, terrain.voxel_count, 3)
    read_back = Terrain.from_octomap(_core.write_octomap_binary(terrain, ids))
    assert indices(read_back) == as_set(terrain.voxel_indices(ids))


def test_voxels_are_written_as_many_voxels_away_as_is_said() -> None:
    terrain = terrain_of(some_voxels())
    ids = np.arange(terrain.voxel_count)
    moved = (1000, -7, 3)
    away = as_set(terrain.voxel_indices(ids) + moved)
    assert indices(Terrain.from_octomap(_core.write_octomap_binary(terrain, ids, moved))) == away
    colours, certain = np.zeros((len(ids), 3), np.uint8), np.ones(len(ids))
    assert (
        indices(Terrain.from_octomap(_core.write_octomap_color(terrain, ids, colours, certain, moved)))
        == away
    )


@pytest.mark.parametrize("far", [1 << 15, (1 << 31) - 1, -(1 << 31)])
def test_voxels_beyond_the_keys_of_the_format_are_refused(far: int) -> None:
    """A sum beyond 32 bits must not come round to the other end of the world."""
    terrain = terrain_of(np.array([[1, 1, 1], [-1, -1, -1]]))
    with pytest.raises(ValueError, match="-32768"):
        _core.write_octomap_binary(terrain, [0, 1], (0, far, 0))


def test_our_colour_files_are_read_by_the_library(tmp_path: Path) -> None:
    terrain, path = terrain_of(some_voxels()), tmp_path / "crowd.ot"
    ids = np.arange(terrain.voxel_count)
    # Probability and colour change every second layer, so blocks of 2 x 2 x 2 prune and larger ones do not.
    probability = np.clip((terrain.voxel_indices(ids)[:, 2] // 2 + 20) / 40, 0.0, 1.0)
    colours = np.stack([255 * probability, 255 * (1 - probability), np.full(len(ids), 30)], axis=1).astype(
        np.uint8
    )
    path.write_bytes(_core.write_octomap_color(terrain, ids, colours, probability))

    tree = pyoctomap.ColorOcTree(1.0).read(str(path))
    seen: dict[Index, tuple[Colour, float]] = {}
    for leaf in tree.begin_leafs():
        node = leaf.current_node
        seen |= {cell: (node.getColor(), node.getOccupancy()) for cell in cells(leaf)}
    assert len(seen) == terrain.voxel_count
    assert tree.getNumLeafNodes() < terrain.voxel_count, "nothing was pruned"
    for index, colour, value in zip(
        terrain.voxel_indices(ids).tolist(), colours.tolist(), probability, strict=True
    ):
        assert seen[tuple(index)][0] == tuple(colour)
        assert seen[tuple(index)][1] == pytest.approx(value, abs=2e-6)


def test_inner_nodes_of_colour_files_are_what_the_library_makes_of_them(tmp_path: Path) -> None:
    terrain, path = terrain_of(some_voxels()), tmp_path / "crowd.ot"
    ids = np.arange(terrain.voxel_count)
    random = np.random.default_rng(9)
    probability = random.choice([0.1, 0.5, 0.8], len(ids))
    colours = random.choice(np.array([[255, 255, 255], [255, 0, 0], [7, 8, 9]], dtype=np.uint8), len(ids))
    path.write_bytes(_core.write_octomap_color(terrain, ids, colours, probability))

    tree = pyoctomap.ColorOcTree(VOXEL_SIZE_M)
    for index, colour, value in zip(terrain.voxel_indices(ids), colours.tolist(), probability, strict=True):
        # Lazy: the library neither prunes nor updates inner nodes until told to.
        tree.updateNode(centre(index), True, lazy_eval=True)
        tree.setNodeColor(centre(index), *colour)
        tree.search(centre(index)).setLogOdds(math.log(value / (1 - value)))
    tree.updateInnerOccupancy()
    assert tree.write(str(tmp_path / "library.ot"))
    assert nodes(path.read_bytes()) == nodes((tmp_path / "library.ot").read_bytes())


def test_a_file_of_no_voxels_is_an_empty_tree_for_the_library(tmp_path: Path) -> None:
    path = tmp_path / "empty.bt"
    path.write_bytes(_core.write_octomap_binary(terrain_of(some_voxels()), np.zeros(0, dtype=np.int64)))
    tree = pyoctomap.OcTree(1.0)
    assert tree.readBinary(str(path)) and tree.size() == 0


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not an OctoMap file"),
        (b"PK\x03\x04", "not an OctoMap file"),
        (b"# Octomap OcTree binary file\nid OcTree\nsize 3\nres 1\ndata\n\x03", "cut short"),
        (
            b"# Octomap OcTree binary file\nid OcTree\nsize 999999999999\nres 1\ndata\n\x02\0",
            "its header says 999999999999",
        ),
        (
            b"# Octomap OcTree binary file\nid OcTree\nsize 1\nres 1\ndata\n\0\0",
            "281474976710656 occupied voxels",
        ),
        (b"# Octomap OcTree file\nid CountingOcTree\nsize 1\nres 1\ndata\n\0\0\0\0\0", "CountingOcTree"),
    ],
)
def test_unusable_files_are_value_errors(data: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Terrain.from_octomap(data)


def test_a_probability_outside_its_bounds_is_refused_by_voxel() -> None:
    terrain = terrain_of(np.array([[1, 2, 3]]))
    with pytest.raises(ValueError, match=r"\[1, 2, 3\] has the probability 1.5"):
        _core.write_octomap_color(terrain, [0], np.zeros((1, 3), dtype=np.uint8), [1.5])


def test_a_file_of_ours_says_where_it_lies(tmp_path: Path) -> None:
    from crowdfence import Georeference
    from crowdfence.exports.octomap import write_terrain_octomap
    from crowdfence.maps import MapError

    terrain = Terrain.from_points([[100.5, -20.5, 3.0]], 1.0, origin=(100.25, -21.0, 2.5))
    terrain.georeference = Georeference(46.5, 8.0, 1200.0)
    path = tmp_path / "here.bt"
    write_terrain_octomap(path, terrain)
    read = Terrain.open(path)
    assert read.fingerprint == terrain.fingerprint
    assert read.georeference == terrain.georeference
    assert Terrain.open(path, origin=(0.0, 0.0, 0.0)).origin == (0.0, 0.0, 0.0)
    with pytest.raises(MapError, match="is anchored 100 m away"):
        Terrain.open(path, georeference=Georeference(46.5, 8.0, 1100.0))
    path.write_bytes(path.read_bytes().replace(b'"origin_m"', b'"origin__"'))
    with pytest.raises(MapError, match="comment in the header cannot be read"):
        Terrain.open(path)
