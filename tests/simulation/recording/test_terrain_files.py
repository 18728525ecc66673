"""The map beside a simulated mission: the triangles that are rendered, in three formats."""

import numpy as np
import pytest
import rasterio
import trimesh

from crowdfence import Terrain
from crowdfence.simulation.landscape.triangle_mesh import TriangleMesh
from crowdfence.simulation.recording.terrain_files import (
    known_map,
    top_height_m,
    write_ply,
    write_terrain_files,
)
from crowdfence.simulation.scenarios.scenario_file import load_scenario
from crowdfence.simulation.scene import build_scene

VOXEL_M = 4.0


@pytest.fixture(scope="module")
def street():
    camera = {"width": 64, "height": 48}
    return build_scene(load_scenario("street", frames=2, camera=camera, voxel_size_m=VOXEL_M), 1)


@pytest.fixture(scope="module")
def files(street, tmp_path_factory):
    return write_terrain_files(street, tmp_path_factory.mktemp("map"), "terrain", "dem")


def test_voxels_hold_the_surface(street, files):
    """Points of ground and roofs lie in occupied voxels."""
    terrain = Terrain.open(files.octomap)
    mesh = known_map(street.landscape)
    rng = np.random.default_rng(0)
    corners = mesh.vertices[mesh.triangles[rng.integers(0, len(mesh.triangles), 2000)]]
    weights = rng.dirichlet([1.0, 1.0, 1.0], size=2000)
    points = np.einsum("nc,ncx->nx", weights, corners)
    # The street lies in the very plane between two layers of voxels: either will do.
    sides = [np.floor((points + offset_m) / VOXEL_M).astype(np.int64) for offset_m in (-1e-9, 1e-9)]
    assert (np.maximum(*(terrain.voxel_ids(indices) for indices in sides)) >= 0).all()
    assert terrain.voxel_size_m == VOXEL_M and terrain.origin == (0.0, 0.0, 0.0)
    low, high = terrain.bounds
    assert (low <= mesh.vertices.min(axis=0)).all() and (high >= mesh.vertices.max(axis=0)).all()


def test_the_mesh_is_read_by_others(street, files):
    """trimesh is an independent reader of PLY."""
    theirs, ours = trimesh.load(files.mesh, process=False), known_map(street.landscape)
    np.testing.assert_array_equal(theirs.faces, ours.triangles)
    np.testing.assert_allclose(theirs.vertices, ours.vertices, rtol=0, atol=1e-9)


def test_a_ply_file_by_hand(tmp_path):
    write_ply(tmp_path / "t.ply", TriangleMesh(np.eye(3), np.array([[0, 2, 1]], np.int32)))
    header, body = (tmp_path / "t.ply").read_bytes().split(b"end_header\n")
    assert b"element vertex 3" in header and b"element face 1" in header
    assert len(body) == 3 * 3 * 8 + 1 + 3 * 4
    assert (
        body[:8] == np.float64(1.0).tobytes() and body[72:] == b"\x03" + np.array([0, 2, 1], "<i4").tobytes()
    )


def test_heights_of_the_raster_are_those_of_the_surface(street, files):
    """Every tenth cell: its middle put into the local frame at its height meets ground or roof there."""
    anchor = street.scenario.georeference
    with rasterio.open(files.dem) as raster:
        height, transform, crs = raster.read(1), raster.transform, raster.crs
    rows, columns = np.mgrid[5 : height.shape[0] : 10, 5 : height.shape[1] : 10]
    x, y = transform.c + transform.a * (columns + 0.5), transform.f + transform.e * (rows + 0.5)
    local = anchor.local_from_projected(crs.to_wkt(), x.ravel(), y.ravel(), height[rows, columns].ravel())
    off_m = local[:, 2] - top_height_m(street.landscape, local[:, 0], local[:, 1])
    # A cell whose middle lies on a wall to the millimetre may be taken for either side of it.
    assert np.isfinite(height).all() and np.percentile(np.abs(off_m), 99) < 0.01
    roofs = local[:, 2] - street.landscape.height_m(local[:, 0], local[:, 1]) > 2.0
    assert 0.005 < roofs.mean() < 0.5


def test_the_map_reader_gets_the_same_ground_from_all_three(street, files):
    """Raster and mesh say where in the voxels the ground lies; bare voxels leave it to a guess."""
    anchor = street.scenario.georeference
    from_raster = Terrain.open(files.dem, voxel_size_m=VOXEL_M, georeference=anchor)
    from_mesh = Terrain.open(files.mesh, voxel_size_m=VOXEL_M)
    from_voxels = Terrain.open(files.octomap)
    west, south, east, north = street.landscape.extent_m
    x, y = np.meshgrid(np.linspace(west + 20, east - 20, 30), np.linspace(south + 20, north - 20, 30))
    eyes = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 500.0)])
    down = np.tile([0.0, 0.0, -1.0], (len(eyes), 1))
    true_m = top_height_m(street.landscape, x.ravel(), y.ravel())
    for terrain, median_m in ((from_raster, 0.02), (from_mesh, 0.02), (from_voxels, VOXEL_M / 2)):
        error_m = np.abs(500.0 - terrain.raycast(eyes, down, 2000.0)[1] - true_m)
        assert np.median(error_m) <= median_m
        # The others are in columns with a wall: one height for the roof and the street.
        assert np.mean(error_m <= VOXEL_M) > 0.85


class Flat:
    """Ground at height 1 with one triangle above it."""

    def __init__(self, corners):
        self.solids = (TriangleMesh(np.array(corners, float), np.array([[0, 1, 2]], np.int32)),)

    def height_m(self, x, y):
        return np.ones_like(np.asarray(x, float))


def test_the_top_of_one_triangle_by_hand():
    """z = 5 + x over the triangle (0, 0), (4, 0), (0, 4)."""
    landscape = Flat([[0, 0, 5], [4, 0, 9], [0, 4, 5]])
    x, y = np.array([1.0, 2.0, 3.0, -1.0, 0.0]), np.array([1.0, 2.0, 3.0, 0.0, 0.0])
    np.testing.assert_allclose(top_height_m(landscape, x, y), [6.0, 7.0, 1.0, 1.0, 5.0])


def test_an_upright_wall_has_no_top():
    landscape = Flat([[0, 0, 0], [4, 0, 0], [4, 0, 3]])
    np.testing.assert_array_equal(top_height_m(landscape, np.array([2.0]), np.array([0.0])), [1.0])
