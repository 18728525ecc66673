"""Lidar files that the tests write with laspy, read back as terrain."""

import math
import re
import struct

import laspy
import numpy as np
import pyproj
import pytest

from crowdfence import Terrain
from crowdfence.georeference import Georeference
from crowdfence.maps import MapError, open_terrain, point_cover, read_map, stated_place
from crowdfence.maps.ground_surface import triangulate
from crowdfence.maps.point_cells import Gathered, VoxelKeys, cells, lowest, means, summed
from crowdfence.maps.point_cover import PointCover

FOOT_M = 0.3048


def write_las(path, points, kinds=None, *, crs=None, version="1.4", point_format=6, scale=0.001):
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.offsets, header.scales = np.floor(points.min(axis=0)), np.full(3, scale)
    if crs:
        header.add_crs(pyproj.CRS.from_user_input(crs))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T
    cloud.classification = np.full(len(points), 2) if kinds is None else np.asarray(kinds)
    cloud.write(path)
    return path


def grid_points(side, height, step=1.0):
    """One point in the middle of every square of `step` metres, in [0, side]."""
    east, north = np.mgrid[0:side:step, 0:side:step].reshape(2, -1) + step / 2
    return np.column_stack([east, north, np.broadcast_to(height(east, north), east.shape)])


def voxel_set(terrain):
    """Voxels as indices from the local origin."""
    first = np.round(np.array(terrain.origin) / terrain.voxel_size_m).astype(int)
    return {tuple(index) for index in terrain.voxel_indices(np.arange(terrain.voxel_count)) + first}


@pytest.mark.parametrize("suffix", [".las", ".laz", ".copc.laz", ".LAS"])
def test_ground_points_become_a_closed_surface(tmp_path, suffix):
    path = write_las(tmp_path / f"level{suffix}", grid_points(20, lambda x, y: 5.3))
    terrain = open_terrain(path, assume_local=True, voxel_size_m=0.5)
    # Outermost points lie half a metre inside; between them no column of voxels may be missing.
    assert voxel_set(terrain) == {(i, j, 10) for i in range(1, 40) for j in range(1, 40)}
    ids, _ = terrain.raycast([[0.51, 19.49, 50], [10.0, 10.0, 50]], [[0, 0, -1.0]] * 2, 100)
    assert (ids >= 0).all()


def test_a_sloping_plane_of_scattered_points_comes_back_exactly(tmp_path):
    random = np.random.default_rng(7)
    plan = random.uniform(0, 4, (4000, 2))
    points = np.column_stack([plan, 30 + 0.3 * plan[:, 0] - 0.2 * plan[:, 1]])
    terrain = open_terrain(
        write_las(tmp_path / "plane.las", points, scale=1e-6), assume_local=True, voxel_size_m=0.02
    )
    middles = terrain.voxel_centers(np.arange(terrain.voxel_count))
    inside = (np.abs(middles[:, :2] - 2) < 1.5).all(axis=1)
    plane_above_m = 30 + 0.3 * middles[:, 0] - 0.2 * middles[:, 1] - middles[:, 2]
    # A voxel that the plane touches has its middle within half its edge times 1 + 0.3 + 0.2, in height.
    assert np.abs(plane_above_m[inside]).max() <= 0.01 * 1.5 + 1e-6
    columns = {(i, j) for i, j, _ in voxel_set(terrain)}
    assert {(i, j) for i in range(25, 175) for j in range(25, 175)} <= columns


@pytest.mark.parametrize("kind", [8, 11, 20])
def test_roads_key_points_and_ground_at_breaklines_are_ground(tmp_path, kind):
    """A road on a dam 3 m above the ground: people on it stand where it is, not where the fields are."""
    points = grid_points(20, lambda x, y: 5.3)
    road = np.abs(points[:, 0] - 10) < 2
    points[road, 2] += 3
    path = write_las(tmp_path / "road.las", points, np.where(road, kind, 2))
    terrain = open_terrain(path, assume_local=True, voxel_size_m=1.0)
    assert heights_m(terrain, [[10.0, 10.0], [4.0, 10.0]]) == pytest.approx([8.3, 5.3], abs=1e-3)


def test_bridge_decks_that_are_left_out_are_told(tmp_path):
    """A deck 4 m wide and 10 m above the ground: 4 x 20 points of 400."""
    points = grid_points(20, lambda x, y: 5.3)
    deck = np.abs(points[:, 0] - 10) < 2
    points[deck, 2] += 10
    path = write_las(tmp_path / "bridge.las", points, np.where(deck, 17, 2))
    (doubt,) = read_map(path, assume_local=True).doubts
    assert doubt.startswith("80 points of bridge decks (class 17) are no ground")
    everything = read_map(path, assume_local=True, surface="all", voxel_size_m=1.0)
    assert everything.doubts == () and (10, 10, 15) in voxel_set(everything.terrain)
    assert read_map(write_las(tmp_path / "plain.las", points), assume_local=True).doubts == ()


def test_a_stray_point_is_told_by_what_the_header_spans(tmp_path):
    """It pulls the middle of the file away, so that a good point is the first too far from there."""
    points = np.vstack([grid_points(20, lambda x, y: 5.0) + np.array([500_000, 5_150_000, 0]), [0, 0, 0]])
    path = write_las(tmp_path / "a.las", points, [2] * 400 + [7], crs="EPSG:32632", scale=0.01)
    with pytest.raises(MapError, match=r"spans x 0 to 500019\.5, y 0 to 5150019\.5; leave that point out"):
        open_terrain(path)


def test_ground_that_was_classified_in_part_is_told(tmp_path):
    """100 m x 100 m, of which a strip of 40 m in the west has the ground class."""
    points = grid_points(100, lambda x, y: 5.3)
    path = write_las(tmp_path / "part.las", points, np.where(points[:, 0] < 40, 2, 1))
    (doubt,) = read_map(path, assume_local=True, voxel_size_m=1.0).doubts
    assert doubt.startswith("60% of the area that holds points, 6,000 m2, is a hole in the map")
    everything = read_map(path, assume_local=True, voxel_size_m=1.0, surface="all")
    assert everything.doubts == () and len(everything.terrain.columns()) == 10_000
    pond = write_las(tmp_path / "pond.las", points, np.where(points[:, 0] < 76, 2, 9))
    assert read_map(pond, assume_local=True, voxel_size_m=1.0).doubts == ()
    assert read_map(path, assume_local=True, voxel_size_m=1.0, surface="ground").doubts == ()


def test_gaps_are_bridged_up_to_the_given_width(tmp_path):
    points = grid_points(40, lambda x, y: x * 0.5)
    under_a_roof = (np.abs(points[:, :2] - 20) < 6).all(axis=1)
    path = write_las(tmp_path / "a.las", points[~under_a_roof])
    whole = open_terrain(path, assume_local=True, voxel_size_m=1.0)
    middle = whole.voxel_ids([[19, 19, 9], [20, 20, 10]])
    assert (middle >= 0).all()
    # The gap measures 13 m from point to point.
    open_gap = open_terrain(path, assume_local=True, voxel_size_m=1.0, max_hole_m=5)
    ids, _ = open_gap.raycast([[20, 20, 50]], [[0, 0, -1]], 100)
    assert ids[0] == -1
    ids, _ = open_gap.raycast([[5, 5, 50]], [[0, 0, -1]], 100)
    assert ids[0] >= 0


def test_canopies_overhang_the_ground(tmp_path):
    ground = grid_points(10, lambda x, y: 0.5)
    canopy = grid_points(3, lambda x, y: 8.5) + np.array([4, 4, 0])
    noise = np.array([[5.0, 5.0, 90.0], [5.0, 5.0, -40.0]])
    points, kinds = np.vstack([ground, canopy, noise]), [2] * 100 + [5] * 9 + [18, 7]
    path = write_las(tmp_path / "a.laz", points, kinds)
    columns = {(i, j) for i in range(10) for j in range(10)}
    bare = voxel_set(open_terrain(path, assume_local=True, voxel_size_m=1.0))
    assert bare == {(i, j, 0) for i, j in columns}
    everything = voxel_set(open_terrain(path, assume_local=True, voxel_size_m=1.0, surface="all"))
    assert everything - bare == {(i, j, 8) for i in (4, 5, 6) for j in (4, 5, 6)}
    assert bare <= everything


def heights_m(terrain, plan):
    """Where rays from straight above meet the terrain [N]."""
    above = np.column_stack([plan, np.full(len(plan), 100.0)])
    _, distance_m = terrain.raycast(above, np.broadcast_to([0.0, 0.0, -1.0], above.shape), 200)
    return 100 - distance_m


@pytest.mark.parametrize("surface", ["ground", "all"])
def test_rays_meet_ground_and_canopy_at_the_height_of_their_points(tmp_path, surface):
    random = np.random.default_rng(3)
    plan = random.uniform(0, 20, (3000, 2))
    ground = np.column_stack([plan, 3 + 0.3 * plan[:, 0] - 0.1 * plan[:, 1]])
    crown = np.column_stack([random.uniform(12, 18, (600, 2)), np.full(600, 15.3)])
    points, kinds = np.vstack([ground, crown]), [2] * 3000 + [5] * 600
    path = write_las(tmp_path / "a.las", points, kinds)
    terrain = open_terrain(path, assume_local=True, voxel_size_m=1.0, surface=surface)
    open_ground = random.uniform(2, 11, (500, 2))
    expected_m = 3 + 0.3 * open_ground[:, 0] - 0.1 * open_ground[:, 1]
    # A plane keeps its slopes to 1 / 128: over half a metre along both axes that is 8 mm.
    np.testing.assert_allclose(heights_m(terrain, open_ground), expected_m, atol=0.009)
    if surface == "all":
        np.testing.assert_allclose(heights_m(terrain, random.uniform(13, 17, (100, 2))), 15.3, atol=0.002)


def test_a_point_on_the_floor_of_its_voxel_stays_in_it(tmp_path):
    # The mean of three times 0.3 is a little less than 0.3.
    points = np.repeat([[0.1, 0.1, 0.3], [0.9, 0.7, 0.3]], 3, axis=0)
    path = write_las(tmp_path / "a.las", points, [1] * 6)
    terrain = open_terrain(path, assume_local=True, voxel_size_m=0.1, max_hole_m=0.1)
    assert voxel_set(terrain) == {
        tuple(index) for index in np.floor(laspy.read(path).xyz / 0.1).astype(int).tolist()
    }


def test_without_ground_class_the_lowest_points_close_the_ground(tmp_path):
    ground, canopy = grid_points(10, lambda x, y: 0.5, step=2.0), grid_points(10, lambda x, y: 6.5, step=2.0)
    path = write_las(tmp_path / "a.las", np.vstack([canopy, ground]), [1] * 50)
    voxels = voxel_set(open_terrain(path, assume_local=True, voxel_size_m=1.0))
    assert {(i, j) for i, j, k in voxels if k == 0} == {(i, j) for i in range(1, 10) for j in range(1, 10)}
    assert {index for index in voxels if index[2] != 0} == {
        (i, j, 6) for i in range(1, 10, 2) for j in range(1, 10, 2)
    }
    with pytest.raises(MapError, match=r"no point of ground \(classes 2, 8, 11, 20\); pass surface='all'"):
        open_terrain(path, assume_local=True, surface="ground")


def test_feet_become_metres_at_the_right_place(tmp_path):
    # 100 x 100 feet at 400 feet in Oregon's state system; nothing states the unit of the heights.
    points = grid_points(100, lambda x, y: 400.0, step=2.0) + np.array([636_000, 849_000, 0])
    path = write_las(tmp_path / "a.laz", points, crs="EPSG:2994", version="1.2", point_format=1)
    terrain = open_terrain(path, voxel_size_m=0.5)
    anchor = terrain.georeference
    assert anchor.height_m == math.floor(400 * FOOT_M)
    wgs84 = pyproj.Transformer.from_crs(2994, 4326, always_xy=True)
    assert wgs84.transform(636_050, 849_050) == pytest.approx(
        (anchor.longitude_deg, anchor.latitude_deg), abs=1e-7
    )
    low, high = terrain.bounds
    # 98 feet from the first to the last point, turned by 1.8 degrees against true north.
    np.testing.assert_allclose((high - low)[:2], 98 * FOOT_M * (math.cos(0.031) + math.sin(0.031)), atol=1.1)
    assert low[2] <= 400 * FOOT_M - anchor.height_m <= high[2]
    assert open_terrain(path, voxel_size_m=0.5, height_unit="m").georeference.height_m == 400
    assert open_terrain(path, voxel_size_m=0.5, height_offset_m=-22.5).georeference.height_m == 99


def test_the_frame_of_a_recording_is_used_exactly(tmp_path):
    anchor = Georeference.from_projected("EPSG:32632", 423_000, 5_150_000, 500.0)
    corners = np.array([[423_800, 5_150_600, 520], [423_802, 5_150_600, 520], [423_800, 5_150_603, 521.0]])
    path = write_las(tmp_path / "a.las", corners, [1, 1, 1], crs="EPSG:32632")
    terrain = open_terrain(path, georeference=anchor, voxel_size_m=0.05, max_hole_m=0.5)
    expected = anchor.local_from_projected("EPSG:32632", *corners.T)
    middles = terrain.voxel_centers(np.arange(terrain.voxel_count))
    assert len(middles) == 3
    nearest = np.linalg.norm(middles[:, None] - expected, axis=-1).min(axis=0)
    assert nearest.max() < 0.05 * math.sqrt(3) / 2 + 0.001


def test_voxels_follow_the_density_of_the_points(tmp_path):
    # 0.6 m from point to point: the next of 1, 2, 5 is 1 m.
    path = write_las(tmp_path / "a.las", grid_points(30, lambda x, y: 3.0, step=0.6))
    assert Terrain.open(path, assume_local=True).voxel_size_m == 1.0


def with_stray(points, *strays):
    return np.vstack([points, *strays])


@pytest.mark.parametrize(
    ("strays", "kind"),
    [([[60_000.0, 5, 3]], 2), ([[60_000.0, 5, 3]] * 200, 7), ([[60_000.0, -60_000, 3]], 1)],
)
@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("point_format", [1, 6])
def test_points_far_from_all_others_do_not_make_voxels_coarse(tmp_path, suffix, point_format, strays, kind):
    """120 m by 120 m of points 0.45 m apart: voxels of 0.5 m, though the header spans 60 km."""
    points = grid_points(120, lambda x, y: 3.0, step=0.45)
    kinds = np.r_[np.full(len(points), 2), np.full(len(strays), kind)]
    path = tmp_path / f"a{suffix}"
    write_las(path, with_stray(points, strays), kinds, point_format=point_format)
    reading = read_map(path, assume_local=True)
    assert reading.terrain.voxel_size_m == 0.5
    assert "up to 0.5 m apart on average" in reading.voxel_size_why


def test_withheld_points_and_noise_are_not_counted(tmp_path):
    """Points 0.45 m apart make voxels of 0.5 m. With three of four marked, 0.9 m are between the others."""
    for kind, withheld in ((7, 0), (18, 0), (1, 1)):
        points = grid_points(45, lambda x, y: 3.0, step=0.45)
        apart = (np.floor(points[:, 0] / 0.45) % 2 == 0) & (np.floor(points[:, 1] / 0.45) % 2 == 0)
        path = write_las(tmp_path / "a.las", points, np.where(apart, 2, kind))
        cloud = laspy.read(path)
        cloud.withheld = np.where(apart, 0, withheld)
        cloud.write(path)
        assert Terrain.open(path, assume_local=True).voxel_size_m == 1.0
        cloud.withheld[:], cloud.classification = 0, np.full(len(points), 2)
        cloud.write(path)
        assert Terrain.open(path, assume_local=True).voxel_size_m == 0.5


def test_a_strip_across_its_box_is_as_dense_as_its_points(tmp_path):
    """40 m wide and 1 km long towards the north-east, points 0.4 m apart: 0.5 m, where the box of half a km2
    would say 2 m."""
    along = np.mgrid[0.2:1000:0.4, 0.2:40:0.4].reshape(2, -1).T
    turned = along @ np.array([[1, 1], [-1, 1]]) / math.sqrt(2)
    path = write_las(tmp_path / "strip.las", np.column_stack([turned, np.full(len(along), 3.0)]))
    assert Terrain.open(path, assume_local=True).voxel_size_m == 0.5


def test_the_stray_point_is_none_in_degrees_and_feet_either(tmp_path):
    points = grid_points(120, lambda x, y: 3.0, step=0.45)
    for crs, units, first in (
        ("EPSG:4979", [1 / 111_320 / math.cos(math.radians(48)), 1 / 111_200, 1], [11, 48, 500]),
        ("EPSG:2227+6360", [1 / 0.3048006] * 3, [6_000_000, 2_000_000, 0]),
    ):
        placed = with_stray(points, [[40_000.0, 5, 3]]) * units + first
        path = write_las(tmp_path / "a.las", placed, crs=crs, scale=1e-7 if crs == "EPSG:4979" else 0.001)
        assert Terrain.open(path, height_offset_m=0.0).voxel_size_m == 0.5


def test_cover_of_points_is_that_of_their_ground():
    random = np.random.default_rng(3)
    for metres in (1.0, 0.3048, 111_000.0):
        cover = PointCover(np.full(2, metres), near=np.zeros(2))
        for _ in range(5):
            cover.add(*(random.uniform(-400, 600, (2, 30_000)) / metres))  # 1 km2
        cover.add(*(np.array([[90_000.0], [-90_000.0]]) / metres))
        assert cover.points == 150_001
        assert cover.area_m2(90_600 * 90_600) == pytest.approx(1e6, rel=0.02)
        assert cover.area_m2(1.02e6) == 1.02e6


def test_cover_of_points_takes_bounded_memory(monkeypatch):
    monkeypatch.setattr(point_cover, "_MOST_CELLS", 1000)
    cover = PointCover(np.ones(2), near=np.zeros(2))
    east, north = (axis.ravel() for axis in np.mgrid[-256.0:256.0, -256.0:256.0] + 0.5)
    for rows in np.array_split(np.arange(len(east)), 7):
        cover.add(east[rows], north[rows])
        assert len(cover._keys) <= 1000
    assert cover.area_m2(1e9) == 512 * 512


def test_files_without_reference_system_are_refused(tmp_path):
    path = write_las(tmp_path / "a.las", grid_points(5, lambda x, y: 3.0))
    with pytest.raises(MapError, match=r"no coordinate reference system; pass crs=.* or assume_local=True"):
        open_terrain(path)
    with_crs = write_las(tmp_path / "b.las", grid_points(5, lambda x, y: 3.0), crs="EPSG:32632")
    with pytest.raises(MapError, match="assume_local contradicts"):
        open_terrain(with_crs, assume_local=True)


def test_a_local_system_is_none(tmp_path):
    path = tmp_path / "a.las"
    write_las(path, grid_points(5, lambda x, y: 3.0), crs='LOCAL_CS["site",UNIT["metre",1]]')
    assert stated_place(path) == "unstated"
    with pytest.raises(MapError, match="no coordinate reference system"):
        open_terrain(path)
    assert open_terrain(path, assume_local=True).georeference is None


def test_useless_clouds_are_refused(tmp_path):
    empty = tmp_path / "empty.las"
    laspy.LasData(laspy.LasHeader(point_format=6, version="1.4")).write(empty)
    with pytest.raises(MapError, match="holds no points"):
        open_terrain(empty, assume_local=True)
    noise = write_las(tmp_path / "noise.las", grid_points(3, lambda x, y: 1.0), [7] * 9)
    with pytest.raises(MapError, match="all are noise or withheld"):
        open_terrain(noise, assume_local=True)
    line = write_las(tmp_path / "line.las", np.column_stack([np.arange(9.0), np.arange(9.0), np.zeros(9)]))
    with pytest.raises(MapError, match="lie on one line"):
        open_terrain(line, assume_local=True, surface="ground", voxel_size_m=0.5)
    ground = write_las(tmp_path / "ground.las", grid_points(30, lambda x, y: 1.0))
    with pytest.raises(MapError, match=r"in 1 columns of 100 m, .* pass a smaller voxel_size_m"):
        open_terrain(ground, assume_local=True, voxel_size_m=100.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"surface": "roof"}, "surface is 'roof', must be 'ground' or 'all'"),
        ({"max_hole_m": 0}, "max_hole_m is 0, must be finite and > 0"),
        ({"voxel_size_m": math.nan}, "voxel_size_m is nan; it must be"),
    ],
)
def test_impossible_options_are_refused(tmp_path, options, message):
    path = write_las(tmp_path / "a.las", grid_points(3, lambda x, y: 1.0))
    with pytest.raises(MapError, match=message):
        open_terrain(path, assume_local=True, **options)


def test_points_too_far_apart_for_the_voxels_are_refused(tmp_path):
    wide = grid_points(3, lambda x, y: 1.0) * [2000.0, 2000.0, 1.0]
    with pytest.raises(MapError, match=r"1048576 voxels of 0\.001 m away"):
        open_terrain(write_las(tmp_path / "wide.las", wide), assume_local=True, voxel_size_m=0.001)


def test_truncated_and_lying_files(tmp_path):
    points = np.random.default_rng(3).uniform(0, 100, (5000, 3))
    las, laz = (write_las(tmp_path / f"a.{suffix}", points) for suffix in ("las", "laz"))
    whole = las.read_bytes(), laz.read_bytes()
    for path, data in zip((las, laz), whole, strict=True):
        for cut in (len(data) // 2, len(data) - 9, 300, 50, 3):
            path.write_bytes(data[:cut])
            with pytest.raises(MapError, match="truncated or damaged|starts with"):
                open_terrain(path, assume_local=True)
    las.write_bytes(b"not a point cloud, but long enough to hold a header" * 9)
    with pytest.raises(MapError, match="starts with b'not ', a lidar file starts with b'LASF'"):
        open_terrain(las, assume_local=True)


@pytest.mark.parametrize(
    ("offset", "layout", "value", "what"),
    [
        (247, "<Q", 10**15, "number of points"),
        (96, "<I", 10**9, "offset of the points"),
        (100, "<I", 4 * 10**9, "start of a record"),
        (243, "<I", 4 * 10**9, "length of a record"),
    ],
)
def test_promises_larger_than_the_file_are_refused_at_once(tmp_path, offset, layout, value, what):
    path = write_las(tmp_path / "a.las", grid_points(5, lambda x, y: 3.0))
    data = bytearray(path.read_bytes())
    struct.pack_into(layout, data, offset, value)
    path.write_bytes(data)
    with pytest.raises(MapError, match=f"as {what}, at most .* is possible: truncated or damaged"):
        open_terrain(path, assume_local=True)


def test_a_table_of_chunks_larger_than_the_file_does_not_end_the_process(tmp_path):
    path = write_las(tmp_path / "a.laz", grid_points(5, lambda x, y: 3.0))
    data = bytearray(path.read_bytes())
    (points_at,) = struct.unpack_from("<I", data, 96)
    (table_at,) = struct.unpack_from("<q", data, points_at)
    struct.pack_into("<I", data, table_at + 4, 0xFFFF_FFF0)
    path.write_bytes(data)
    with pytest.raises(MapError, match="4294967280 as number of chunks, at most 25 is possible"):
        open_terrain(path, assume_local=True)


def test_points_in_chunks_give_the_same_cells_as_all_at_once():
    points = np.random.default_rng(5).uniform(-30, 30, (5000, 3))
    keys = VoxelKeys(2.0, near=np.zeros(3))
    mean, low = Gathered(summed, "columns", 10_000), Gathered(lowest, "columns", 10_000)
    for part in np.array_split(points, 7):
        mean.add(cells(keys.columns_of(part), part))
        low.add(cells(keys.columns_of(part), part))
    by_column = {}
    for point in points:
        by_column.setdefault((point[0] // 2, point[1] // 2), []).append(point)
    expected = np.array([np.mean(column, axis=0) for column in by_column.values()])
    np.testing.assert_allclose(np.sort(means(mean.rows()), axis=0), np.sort(expected, axis=0), atol=1e-12)
    expected = np.array([min(column, key=lambda point: point[2]) for column in by_column.values()])
    np.testing.assert_array_equal(np.sort(means(low.rows()), axis=0), np.sort(expected, axis=0))
    few = Gathered(summed, "columns", 10)
    few.add(cells(keys.columns_of(points), points))
    with pytest.raises(ValueError, match="more than 10 columns; pass a larger voxel_size_m"):
        few.rows()


def test_voxel_keys_come_back_as_middles():
    points = np.array([[0.1, -0.1, 5.0], [-777.3, 12.0, 0.0]])
    keys = VoxelKeys(0.5, near=np.zeros(3))
    np.testing.assert_allclose(keys.centres(keys.of(points)), [[0.25, -0.25, 5.25], [-777.25, 12.25, 0.25]])


def test_triangles_cover_the_outline_once():
    plan = np.vstack([[[0, 0], [10, 0], [10, 10], [0, 10]], np.random.default_rng(2).uniform(1, 9, (50, 2))])
    triangles = triangulate(np.column_stack([plan, np.zeros(54)]), max_hole_m=100)
    a, b, c = (plan[triangles[:, corner]] for corner in range(3))
    areas = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert areas.sum() == pytest.approx(100)
    assert len(triangulate(np.zeros((2, 3)), 1.0)) == 0


@pytest.mark.parametrize("crs", [None, "EPSG:32632"])
@pytest.mark.parametrize("surface", ["ground", "all"])
@pytest.mark.parametrize("height", [-32768.0, -9999.0, 9999.0, 1e6])
def test_a_point_where_no_land_is_can_only_be_noise(tmp_path, crs, surface, height):
    points = grid_points(20, lambda x, y: 5.3) + ([500_000.0, 5_000_000.0, 0.0] if crs else 0.0)
    outlier = np.append(points[150, :2], height)
    options = {"surface": surface, "voxel_size_m": 1.0, "assume_local": crs is None}
    options["georeference"] = (
        Georeference.from_projected("EPSG:32632", 500_000.0, 5_000_000.0, 0.0) if crs else None
    )
    path = write_las(tmp_path / "a.las", np.vstack([points, outlier]), crs=crs)
    with pytest.raises(
        MapError, match=rf"point 400 has the height {height:.10g}, outside \[-500, 9000\] m.*class 7"
    ):
        open_terrain(path, **options)
    as_noise = write_las(tmp_path / "b.las", np.vstack([points, outlier]), [2] * 400 + [7], crs=crs)
    without = write_las(tmp_path / "c.las", points, crs=crs)
    assert voxel_set(open_terrain(as_noise, **options)) == voxel_set(open_terrain(without, **options))


def test_noise_far_below_does_not_place_the_map(tmp_path):
    ground = grid_points(20, lambda x, y: 5.3) + np.array([500_000.0, 5_000_000.0, 0.0])
    points = np.vstack([ground, (500_010.0, 5_000_010.0, -32768.0)])
    path = write_las(tmp_path / "a.las", points, [2] * 400 + [7], crs="EPSG:32632")
    assert open_terrain(path).georeference.height_m == -500.0


def with_low_noise(down_m, count=20):
    """120 m x 120 m, a point on every square metre, on a slope of one in two at 600 m and above; `count`
    points so far below it, some beside each other."""
    plane = lambda x, y: 600.0 + x / 2  # noqa: E731
    noise = grid_points(120, lambda x, y: plane(x, y) - down_m)[np.arange(count) * 701]
    return np.vstack([grid_points(120, plane), noise])


@pytest.mark.parametrize("options", [{}, {"surface": "ground"}, {"surface": "all"}])
@pytest.mark.parametrize("kind", [1, 2])
def test_a_few_points_far_below_the_ground_are_told(tmp_path, options, kind):
    """Nothing was said where unmarked low noise dug pits. The lowest lie higher than most of the ground."""
    points = with_low_noise(40.0)
    kinds = np.r_[np.full(120 * 120, 2), np.full(20, kind)]
    path = write_las(tmp_path / "a.las", points, kinds)
    doubts = read_map(path, assume_local=True, voxel_size_m=2.0, **options).doubts
    if kind == 1 and options != {"surface": "all"}:
        assert doubts == ()  # no ground, and not in the map
        return
    (doubt,) = doubts
    told = re.fullmatch(r"20 points lie up to (\d+) m below all around .*\(class 7\).* pits .*", doubt)
    assert told is not None
    assert 25 <= int(told[1]) <= 45  # cells of 10 m and those beside them are up to 15 m lower on this slope


def test_points_below_are_counted_and_told_of_level_ground_exactly(tmp_path):
    points = np.vstack([grid_points(60, lambda x, y: 5.0), [[30.5, 30.5, -35.0]]])
    path = write_las(tmp_path / "a.las", points, np.ones(len(points)))
    (doubt,) = read_map(path, assume_local=True, voxel_size_m=1.0).doubts
    assert doubt.startswith("1 point lies up to 40 m below all around")


def test_what_lies_low_and_is_ground_is_not_doubted(tmp_path):
    """A quay wall of 25 m, a yard amid roofs of 30 m, noise that is marked, a bird, a steep slope."""
    east, north = grid_points(120, lambda x, y: 0.0)[:, :2].T
    yard = (np.abs(east - 60) < 6) & (np.abs(north - 60) < 6)
    for heights, kinds in (
        (np.where(east < 60, 0.0, 25.0), 1),
        (np.where(yard, 0.0, 30.0), 1),
        (east * 3.0, 2),
    ):
        points = np.column_stack([east, north, heights])
        path = write_las(tmp_path / "a.las", points, np.full(len(points), kinds))
        assert read_map(path, assume_local=True, voxel_size_m=2.0).doubts == ()
    marked = write_las(tmp_path / "b.las", with_low_noise(40.0), [2] * 120 * 120 + [7] * 20)
    assert read_map(marked, assume_local=True, voxel_size_m=2.0).doubts == ()
    bird = np.vstack([grid_points(60, lambda x, y: 5.0), [[30.5, 30.5, 70.0]]])
    path = write_las(tmp_path / "c.las", bird, np.ones(len(bird)))
    assert read_map(path, assume_local=True, voxel_size_m=1.0).doubts == ()


def test_a_cloud_too_sparse_to_tell_is_not_doubted(tmp_path):
    """A point every 15 m on a slope of two in one: each lies alone, 30 m below the next."""
    points = grid_points(600, lambda x, y: 2.0 * x, step=15.0)
    path = write_las(tmp_path / "a.las", points)
    assert read_map(path, assume_local=True, voxel_size_m=2.0).doubts == ()


def test_ground_in_a_gap_was_measured_by_nobody(tmp_path):
    """A tank without echoes, 4 x 4 m between points 0.5 m apart, and a house of which no point is ground."""
    points = grid_points(30, lambda x, y: 5.3 + 0.1 * x, step=0.5)
    tank = (np.abs(points[:, :2] - 8) < 2).all(axis=1)
    house = (np.abs(points[:, :2] - 20) < 4).all(axis=1)
    kinds, points[house, 2] = np.where(house, 6, 2), 12.0
    path = write_las(tmp_path / "a.las", points[~tank], kinds[~tank])
    options = {"assume_local": True, "voxel_size_m": 0.5}

    def columns(low, high):
        return {(i, j) for i in range(2 * low, 2 * high) for j in range(2 * low, 2 * high)}

    ground = {tuple(column) for column in open_terrain(path, **options).unmeasured.tolist()}
    corners = columns(6, 10) | columns(16, 24)
    assert ground <= corners and len(corners - ground) <= 2 * 4 * 3  # discs do not reach into corners
    all_points = {
        tuple(column) for column in open_terrain(path, surface="all", **options).unmeasured.tolist()
    }
    assert all_points == ground & columns(6, 10)
    whole = write_las(tmp_path / "b.las", grid_points(30, lambda x, y: 5.3))
    assert len(open_terrain(whole, **options).unmeasured) == 0


def test_points_at_random_leave_no_gaps_of_note(tmp_path):
    plan = np.random.default_rng(4).uniform(0, 100, (10_000, 2))  # one a square metre
    path = write_las(tmp_path / "a.las", np.column_stack([plan, np.full(10_000, 3.0)]))
    terrain = open_terrain(path, assume_local=True, voxel_size_m=0.5)
    assert len(terrain.unmeasured) < 0.01 * terrain.voxel_count


@pytest.mark.parametrize("point_format", [1, 3, 6, 7, 8])
def test_compressed_points_of_any_fields_in_several_chunks_are_read(tmp_path, point_format):
    """The lengths of layers are checked by chunks of 50,000 points, of which each kind has others."""
    header = laspy.LasHeader(point_format=point_format, version="1.4")
    header.scales = np.full(3, 0.01)
    header.add_extra_dim(laspy.ExtraBytesParams("echo", "uint16"))
    cloud = laspy.LasData(header)
    points = grid_points(33, lambda x, y: 5.3, step=0.1)
    cloud.x, cloud.y, cloud.z = points.T
    cloud.classification = np.full(len(points), 2)
    cloud.echo = np.arange(len(points)) % 7
    path = tmp_path / "a.laz"
    cloud.write(path)
    assert open_terrain(path, assume_local=True, voxel_size_m=1.0).voxel_count == 33**2
