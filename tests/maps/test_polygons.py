"""Faces of many corners, cut into triangles: nothing added, nothing left out."""

import struct

import numpy as np
import pytest
import shapely

from crowdfence.maps import MapError, open_terrain
from crowdfence.maps.polygons import triangles_of, triangles_of_faces


def starlike(random, corners):
    """A simple polygon [N, 2] around the origin: one corner in each of `corners` equal sectors."""
    angle = (np.arange(corners) + random.uniform(0.05, 0.95, corners)) * 2 * np.pi / corners
    return random.uniform(1, 10, corners)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("corners", [4, 5, 8, 30])
@pytest.mark.parametrize("seed", range(10))
def test_triangles_cover_the_polygon_once(corners, seed):
    random = np.random.default_rng(seed)
    plan = starlike(random, corners)[:: random.choice([-1, 1])]  # either way round
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]  # facing anywhere
    triangles = triangles_of(plan @ axes[:2] + random.normal(0, 1000, 3))
    assert len(triangles) == corners - 2
    pieces = [shapely.Polygon(plan[list(triangle)]) for triangle in triangles]
    whole = shapely.Polygon(plan)
    assert sum(piece.area for piece in pieces) == pytest.approx(whole.area)
    assert shapely.union_all(pieces).symmetric_difference(whole).area < 1e-9


def test_a_polygon_around_a_hole():
    """A square of 10 m around one of 4 m, joined by a cut, as such faces are written."""
    ring = np.array(
        [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0], [3, 3], [3, 7], [7, 7], [7, 3], [3, 3]], np.float64
    )
    triangles = triangles_of(np.column_stack([ring, np.full(10, 5.0)]))
    pieces = [shapely.Polygon(ring[list(triangle)]) for triangle in triangles]
    assert sum(piece.area for piece in pieces) == pytest.approx(84)
    assert not shapely.union_all([p for p in pieces if p.area]).intersects(shapely.Point(5, 5))


U_ROOF = [(0, 0), (10, 0), (10, 10), (7, 10), (7, 3), (3, 3), (3, 10), (0, 10)]
GROUND = [(-5, -5), (15, -5), (15, 15), (-5, 15)]


def ply(vertices, faces, kind="ascii"):
    head = f"ply\nformat {kind} 1.0\nelement vertex {len(vertices)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    if kind == "ascii":
        rows = [*vertices, *((len(face), *face) for face in faces)]
        return (head + "".join(" ".join(map(str, row)) + "\n" for row in rows)).encode()
    body = np.asarray(vertices, "<f4").tobytes()
    return head.encode() + body + b"".join(struct.pack(f"<B{len(f)}i", len(f), *f) for f in faces)


def obj(vertices, faces, end=""):
    lines = ["v " + " ".join(map(str, vertex)) for vertex in vertices]
    lines += ["f " + " ".join(f"{corner + 1}{end}" for corner in face) for face in faces]
    return "\n".join([*lines, ""]).encode()


def u_house(ground_corners=4):
    """A roof like a U, 8.25 m high, of one face, and the ground around it."""
    spare = [(-5, 5), (-5, 0), (-5, -2), (-5, -3)][: ground_corners - 4]  # on the last side of the ground
    ground = [*GROUND, *spare]
    vertices = [(*at, 8.25) for at in U_ROOF] + [(*at, 0.25) for at in ground]
    return vertices, [range(8), range(8, 8 + len(ground))]


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("house.obj", obj(*u_house())),
        ("mixed.ply", ply(*u_house())),
        ("even.ply", ply(*u_house(8))),
        ("binary.ply", ply(*u_house(8), "binary_little_endian")),
    ],
)
def test_the_court_of_a_house_is_no_roof(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    terrain = open_terrain(path, voxel_size_m=0.5)
    down = [[0.0, 0.0, -1.0]] * 4
    ids, _ = terrain.raycast([[5, 5, 20], [5, 9, 20], [5, 1.5, 20], [1.5, 8, 20]], down, 50)
    np.testing.assert_allclose(terrain.surface_heights(ids), [0.25, 0.25, 8.25, 8.25], atol=1e-6)


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("quads.obj", obj),
        ("textured.obj", lambda v, f: b"vt 0 0\nvn 0 0 1\n" + obj(v, f, "/1/1")),
        ("normals.obj", lambda v, f: b"vn 0 0 1\n" + obj(v, f, "//1")),
        ("mixed.obj", lambda v, f: obj(v, [*f, (0, 1, 2)])),
        ("mixed.ply", lambda v, f: ply(v, [*f, (0, 1, 2)])),
        ("quads.ply", ply),
        ("binary.ply", lambda v, f: ply(v, f, "binary_little_endian")),
    ],
)
def test_an_arrow_of_four_corners_is_no_kite(tmp_path, name, written, first, turn):
    """An arrow with its notch at (5, 3), over the ground, from whichever corner it is written."""
    arrow = np.roll([(0, 0), (5, 3), (10, 0), (5, 10)], first, axis=0)[::turn]
    vertices = [(*GROUND[i], 0.25) for i in range(4)] + [(*map(float, at), 8.25) for at in arrow]
    path = tmp_path / name
    path.write_bytes(written(vertices, [range(4), range(4, 8)]))
    terrain = open_terrain(path, voxel_size_m=0.5)
    down = [[0.0, 0.0, -1.0]] * 3
    ids, _ = terrain.raycast([[5, 1, 20], [5, 5, 20], [2.2, 2.5, 20]], down, 50)
    np.testing.assert_allclose(terrain.surface_heights(ids), [0.25, 8.25, 8.25], atol=1e-6)


@pytest.mark.parametrize("corners", [3, 4, 5, 8])
def test_many_faces_are_cut_as_each_alone(corners):
    """Convex ones and others, facing anywhere: the triangles of all have the area of all."""
    random = np.random.default_rng(corners)
    plans = [starlike(random, corners)[:: random.choice([-1, 1])] for _ in range(200)]
    axes = [np.linalg.qr(random.normal(size=(3, 3)))[0][:2] for _ in plans]
    vertices = np.concatenate([plan @ axis for plan, axis in zip(plans, axes, strict=True)])
    faces = np.arange(len(vertices)).reshape(200, corners)
    triangles = triangles_of_faces(vertices, faces)
    a, b, c = (vertices[corner] for corner in triangles.T)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    by_face = np.bincount(triangles[:, 0] // corners, areas, 200)
    np.testing.assert_allclose(by_face, [shapely.Polygon(plan).area for plan in plans])
    assert (triangles // corners == triangles[:, :1] // corners).all()


def test_a_concave_face_of_too_many_corners_in_a_ply_is_refused(tmp_path):
    path = tmp_path / "star.ply"
    angle = np.linspace(0, 2 * np.pi, 1002, endpoint=False)
    radius = np.where(np.arange(1002) % 2, 5, 10)
    vertices = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(1002)])
    path.write_bytes(ply(vertices.tolist(), [range(1002)]))
    with pytest.raises(MapError, match="a face that is not convex has 1002 corners, the bound is 1000"):
        open_terrain(path)


def test_a_face_of_too_many_corners_is_refused(tmp_path):
    path = tmp_path / "disc.obj"
    angle = np.linspace(0, 2 * np.pi, 1001, endpoint=False)
    lines = [f"v {x} {y} 0" for x, y in zip(np.cos(angle), np.sin(angle), strict=True)]
    path.write_text("\n".join([*lines, "f " + " ".join(map(str, range(1, 1002))), ""]))
    with pytest.raises(MapError, match="line 1002 gives a face 1001 corners, the bound is 1000"):
        open_terrain(path)
