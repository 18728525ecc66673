"""Meshes written by hand as .ply and .obj, read back as terrain."""

import math
import struct

import numpy as np
import pytest

from crowdfence import Terrain
from crowdfence.georeference import Georeference
from crowdfence.maps import MapError, open_terrain, read_map
from crowdfence.maps.voxel_size import round_voxel_size_m

SQUARE = np.array([[0.5, 0.5, 2.5], [3.5, 0.5, 2.5], [3.5, 3.5, 2.5], [0.5, 3.5, 2.5]])
TWO = [(0, 1, 2), (0, 2, 3)]
PLY = """ply
format {format} 1.0
comment TextureFile missing.png
element vertex {vertices}
property float x
property float y
property float z
element face {faces}
property list uchar int vertex_indices
end_header
"""


def ascii_ply(vertices=SQUARE, faces=TWO):
    lines = [" ".join(map(str, vertex)) for vertex in vertices]
    lines += [" ".join(map(str, (len(face), *face))) for face in faces]
    head = PLY.format(format="ascii", vertices=len(vertices), faces=len(faces))
    return (head + "\n".join(lines) + "\n").encode()


def binary_ply(vertices=SQUARE, faces=TWO):
    head = PLY.format(format="binary_little_endian", vertices=len(vertices), faces=len(faces))
    body = np.asarray(vertices, "<f4").tobytes()
    return head.encode() + body + b"".join(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)


def obj(vertices=SQUARE, faces=TWO):
    lines = ["mtllib missing.mtl", "o one", "usemtl stone"]
    lines += [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(index + 1) for index in face) for face in faces]
    return "\n".join(lines).encode()


def voxel_set(terrain):
    return {tuple(index) for index in terrain.voxel_indices(np.arange(terrain.voxel_count))}


FLAT = {(i, j, 2) for i in range(4) for j in range(4)}


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.ply", ascii_ply()),
        ("b.ply", binary_ply()),
        ("quad.ply", ascii_ply(faces=[(0, 1, 2, 3)])),
        ("c.obj", obj()),
        ("quad.obj", obj(faces=[(0, 1, 2, 3)])),
        ("latin1.obj", "# Höhe über Meer\n".encode("latin-1") + obj()),
    ],
)
def test_every_kind_of_file_gives_the_same_voxels(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    anchor = Georeference(46.5, 8.0, 1200.0)
    terrain = Terrain.open(path, voxel_size_m=1.0, georeference=anchor)
    assert voxel_set(terrain) == FLAT
    assert terrain.georeference == anchor


def test_y_up_units_and_origin(tmp_path):
    # Centimetres with y up: (x, y, z) becomes (x, -z, y).
    path = tmp_path / "a.obj"
    path.write_bytes(obj(SQUARE[:, [0, 2, 1]] * [100, 100, -100]))
    terrain = open_terrain(path, voxel_size_m=1.0, up="y", unit_m=0.01, origin=(10, 0, -2))
    assert voxel_set(terrain) == {(i + 10, j, k - 2) for i, j, k in FLAT}


@pytest.mark.parametrize(("up", "other"), [("z", "y"), ("y", "z")])
def test_ground_that_stands_upright_is_doubted(tmp_path, up, other):
    """A square of 3 x 3 m that rises by 0.4 m to the north; upright it shows 3 x 0.4 m from above."""
    ground = SQUARE + np.outer(SQUARE[:, 1] > 1, [0, 0, 0.4])
    turned = np.stack([ground[:, 0], ground[:, 2], -ground[:, 1]], axis=-1)
    for name, points in (("z", ground), ("y", turned)):
        (tmp_path / f"{name}.obj").write_bytes(obj(points))
    assert read_map(tmp_path / f"{up}.obj", up=up).doubts == ()
    (doubt,) = read_map(tmp_path / f"{other}.obj", up=up).doubts
    assert doubt.startswith("it shows 9 m2 of surface from the south and 1 m2 from above, a wall")
    assert doubt.endswith(f"does its {other} axis point up? Then pass up='{other}'")


def test_a_town_and_a_tower_are_no_doubt(tmp_path):
    """Walls of 1 x 9 m on all sides: as much seen from the west as from the south; a roof of 1 m2."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 9)], np.float64)
    sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (1, 3, 7, 5)]
    (tmp_path / "tower.obj").write_bytes(obj(corners, [(a, b, c) for a, b, c, _ in sides]))
    assert read_map(tmp_path / "tower.obj").doubts == ()


# Two squares of 4 x 4 voxels, the second one 6 m further east and 3 m higher, as every dialect writes them.
LOW = "v 0.5 0.5 2.5\nv 3.5 0.5 2.5\nv 3.5 3.5 2.5\nv 0.5 3.5 2.5\n"
HIGH = "v 6.5 0.5 5.5\nv 9.5 0.5 5.5\nv 9.5 3.5 5.5\nv 6.5 3.5 5.5\n"
DIALECTS = {
    "backwards": LOW + "f -4 -3 -2 -1\n" + HIGH + "f -4 -3 -2 -1\n",
    "mixed": LOW + HIGH + "f 1 2 3 4\nf -4 -3 -2 -1\n",
    "textured": LOW
    + "vt 0 0\nvn 0 0 1\nf -4/-1/-1 -3/-1/-1 -2/-1/-1 -1/-1/-1\n"
    + HIGH
    + "f 5//1 6//1 7//1 8//1\n",
    "later": "f 1 2 3 4\n" + LOW + "f -4 -3 -2 -1\nf 5 6 7 8\n" + HIGH,
    "tabs": LOW + HIGH + "f\t1\t2\t3\t4\n  f 5 6 7 8\n",
    "continued": LOW + HIGH + "f 1 2 \\\n3 4\r\nf -4 -3 \\\r\n -2 \\\r\n -1\r\n",
    "mark of bytes": "\ufeff" + LOW + HIGH + "f -8 -7 -6 -5\nf -4 -3 -2 -1\n",
    "path": "# C:\\models\\\n" + LOW + HIGH + "f 1 2 3 4\nf 5 6 7 8\n",
    # As many numbers in the line of the one as in that of the other.
    "textured in part": LOW + HIGH + "vt 0 0\nf 1/1 2 3/1 4\nf 5/1 6 7 8/1\n",
    "uneven": LOW + HIGH + "vn 0 0 1\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\nf 5 6 7 7 8 5\n",
}


@pytest.mark.parametrize("name", DIALECTS)
def test_no_house_of_an_obj_is_lost(tmp_path, name):
    path = tmp_path / f"{name}.obj"
    path.write_bytes(DIALECTS[name].encode())
    assert voxel_set(open_terrain(path, voxel_size_m=1.0)) == FLAT | {(i + 6, j, k + 3) for i, j, k in FLAT}


def test_voxels_are_a_thousandth_of_the_longest_side(tmp_path):
    path = tmp_path / "a.ply"
    path.write_bytes(ascii_ply(SQUARE * [100, 1, 1]))
    assert open_terrain(path).voxel_size_m == 0.5


@pytest.mark.parametrize(
    ("wanted_m", "chosen_m"), [(0.0, 0.05), (0.05, 0.05), (0.3, 0.5), (1.0, 1.0), (1.01, 2.0), (7.0, 10.0)]
)
def test_round_voxel_sizes(wanted_m, chosen_m):
    assert round_voxel_size_m(wanted_m) == pytest.approx(chosen_m)


BROKEN = [
    ("cut.ply", ascii_ply()[:-8], "promises 6 elements, but 5 lines follow: truncated"),
    ("lines.ply", ascii_ply().replace(b"face 2", b"face 2000000000"), "promises 2000000004 elements"),
    ("bytes.ply", binary_ply()[:-5], "different numbers of corners.* or it is cut off"),
    ("mixed.ply", binary_ply(faces=[(0, 1, 2, 3), (0, 1, 2)]), "different numbers of corners"),
    # As long as three quads: read as such, the second one would have the corner 5 + 256 * 0.
    (
        "even.ply",
        binary_ply([*SQUARE] * 2, [(0, 1, 2, 3), (0, 1, 2), (0, 1, 2, 3, 0)]),
        "different numbers of corners",
    ),
    ("huge.ply", binary_ply().replace(b"vertex 4", b"vertex 4000000000"), "or it is cut off"),
    ("text.ply", b"a picture of a hill", "not a readable mesh"),
    ("points.ply", ascii_ply(faces=[]), "holds no triangles"),
    (
        "strips.ply",
        ascii_ply(faces=[(0, 1, 3, 2)]).replace(b"element face", b"element tristrips"),
        "its triangles are written as strips .*write them as faces",
    ),
    # Two lists of faces: only the second one was read, and the houses of the first were missing.
    (
        "twice.ply",
        ascii_ply().replace(
            b"element face 2\n", b"element face 1\nproperty list uchar int vertex_indices\nelement face 1\n"
        ),
        "its header has the element 'face' twice",
    ),
    ("index.ply", ascii_ply(faces=[(0, 1, 4)]), "use vertices 0 to 4, but there are 4"),
    ("negative.ply", ascii_ply(faces=[(0, 1, -1)]), "use vertices -1 to 1, but there are 4"),
    ("nan.ply", ascii_ply([[0, 0, 0], [1, math.nan, 0], [0, 1, 0]], [(0, 1, 2)]), "vertex 1 is .*nan"),
    ("index.obj", obj(faces=[(0, 1, 8)]), "not a readable mesh"),
    ("cut.obj", obj()[:-3], "line 9 gives a face 1 corner"),
    ("zero.obj", obj() + b"\nf 0 1 2", "line 10 gives a face the corner '0', and 4 vertices come before it"),
    ("before.obj", obj() + b"\nf -1 -2 -5/-1", "line 10 gives a face the corner '-5', and 4 vertices"),
    ("word.obj", obj() + b"\nf -1 -2 up", "line 10 gives a face the corner 'up'"),
    ("points.obj", obj(faces=[]), "holds no triangles"),
    # Surfaces that the parser passes over: a house so written was missing, and nothing said so.
    ("old.obj", obj() + b"\nfo 1 2 3", "line 10 is a 'fo', a surface that cannot be read"),
    ("other.obj", obj() + b"\n\tcall house.obj", "line 10 is a 'call', a surface that cannot be read"),
    ("curved.obj", obj() + b"\nsurf 0 1 0 1 1 2 3 4", "line 10 is a 'surf', a surface that cannot be read"),
]


@pytest.mark.parametrize(("name", "data", "message"), BROKEN, ids=[name for name, *_ in BROKEN])
def test_broken_meshes_are_refused(tmp_path, name, data, message):
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(MapError, match=message) as caught:
        open_terrain(path, voxel_size_m=1.0)
    assert caught.value.path == path


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"up": "x"}, "up is 'x', must be 'z' or 'y'"),
        ({"unit_m": 0}, "unit_m is 0, must be finite and > 0"),
        (
            {"unit_m": 1e300},
            r"longest side is 3e\+300 m, the bound is 1e\+06; check unit_m, which is 1e\+300",
        ),
        ({"unit_m": 1.7e308}, "longest side is .*; check unit_m"),
        ({"voxel_size_m": -1}, "voxel_size_m"),
    ],
)
def test_impossible_options_are_refused(tmp_path, options, message):
    path = tmp_path / "a.ply"
    path.write_bytes(ascii_ply())
    with pytest.raises(MapError, match=message):
        open_terrain(path, **options)


@pytest.mark.parametrize(("name", "data"), [("a.ply", ascii_ply), ("b.ply", binary_ply), ("c.obj", obj)])
def test_a_mark_of_missing_data_is_no_pit(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data(vertices=np.vstack([SQUARE[:3], [0.5, 3.5, -32768.0]])))
    with pytest.raises(MapError, match="vertex 3 has the height -32768; heights of ground are within 9000 m"):
        open_terrain(path, voxel_size_m=1.0)


@pytest.mark.parametrize("kind", ["float", "double", "origin", "obj"])
def test_coordinates_of_single_precision_far_from_zero_are_told(tmp_path, kind):
    """A roof of 10.3 m by 10.3 m in UTM: between 2^22 and 2^23 neighbouring float32 are 0.5 apart, the
    eastings between 2^18 and 2^19 0.03."""
    corners = np.array([[0.0, 0.0, 5.1], [10.3, 0.0, 5.1], [10.3, 10.3, 5.1], [0.0, 10.3, 5.1]])
    origin = np.array([412345.6, 5654321.7, 0.0])
    written = corners if kind == "origin" else corners + origin
    written = written if kind == "double" else written.astype(np.float32).astype(np.float64)
    if kind == "obj":
        path = tmp_path / "roof.obj"
        lines = ["v " + " ".join(map(repr, row)) for row in written.tolist()]
        path.write_text("\n".join([*lines, "f 1 2 3 4"]) + "\n")
    else:
        path, of = tmp_path / "roof.ply", "double" if kind == "double" else "float"
        head = ["ply", "format binary_little_endian 1.0", "element vertex 4"]
        head += [f"property {of} {axis}" for axis in "xyz"]
        head += ["element face 1", "property list uchar int vertex_indices", "end_header"]
        data = written.astype("<f8" if kind == "double" else "<f4").tobytes()
        path.write_bytes("\n".join([*head, ""]).encode() + data + struct.pack("<B4i", 4, 0, 1, 2, 3))
    options = {"origin": origin.tolist()} if kind == "origin" else {}
    doubts = read_map(path, voxel_size_m=1.0, **options).doubts
    if kind in ("double", "origin"):
        assert doubts == ()
    else:
        (doubt,) = doubts
        assert "single precision (float32), so far from 0 in steps of 0.5 m, beside voxels of 1 m" in doubt
        assert "by up to 0.25 m" in doubt
    assert read_map(path, voxel_size_m=2.0, **options).doubts == ()


@pytest.mark.parametrize(
    ("spacing_m", "step_m"), [(0.7, 10), (5.0, 10), (13.0, 10), (10.0, None), (30.0, None)]
)
def test_coordinates_of_six_digits_far_from_zero_are_told(tmp_path, spacing_m, step_m):
    """Hills in UTM as programs write them that leave the digits to their language: 5.20001e+06."""
    east, north = np.meshgrid(600_000 + spacing_m * np.arange(30), 5_200_000 + spacing_m * np.arange(30))
    points = np.column_stack([east.ravel(), north.ravel(), 400 + np.sin(east.ravel())])
    corner = np.arange(900).reshape(30, 30)[:-1, :-1].ravel() + 1
    faces = [f"f {first} {first + 1} {first + 31} {first + 30}" for first in corner]
    path = tmp_path / "hills.obj"

    def doubts_with(digits):
        lines = ["v " + " ".join(f"{value:.{digits}g}" for value in point) for point in points]
        path.write_text("\n".join([*lines, *faces]) + "\n")
        return read_map(path, voxel_size_m=1.0).doubts

    doubts = doubts_with(6)
    if step_m is None:
        assert doubts == ()
    else:
        (doubt,) = doubts
        assert f"six digits, so far from 0 in steps of {step_m} m, beside voxels of 1 m" in doubt
    assert doubts_with(9) == ()
