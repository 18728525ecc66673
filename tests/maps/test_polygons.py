"""Faces of many corners, cut into triangles: nothing added, nothing left out."""

import numpy as np
import pytest
import shapely

from crowdfence.maps import MapError, open_terrain
from crowdfence.maps.polygons import triangles_of


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


def test_the_court_of_a_house_is_no_roof(tmp_path):
    """A roof like a U, 8 m high, of one face, over ground at 0."""
    roof = [(0, 0), (10, 0), (10, 10), (7, 10), (7, 3), (3, 3), (3, 10), (0, 10)]
    lines = [f"v {x} {y} 8.25" for x, y in roof] + [
        "v -5 -5 0.25",
        "v 15 -5 0.25",
        "v 15 15 0.25",
        "v -5 15 0.25",
    ]
    path = tmp_path / "house.obj"
    path.write_text("\n".join([*lines, "f 1 2 3 4 5 6 7 8", "f 9 10 11 12", ""]))
    terrain = open_terrain(path, voxel_size_m=0.5)
    down = [[0.0, 0.0, -1.0]] * 4
    ids, _ = terrain.raycast([[5, 5, 20], [5, 9, 20], [5, 1.5, 20], [1.5, 8, 20]], down, 50)
    np.testing.assert_allclose(terrain.surface_heights(ids), [0.25, 0.25, 8.25, 8.25], atol=1e-6)


def test_a_face_of_too_many_corners_is_refused(tmp_path):
    path = tmp_path / "disc.obj"
    angle = np.linspace(0, 2 * np.pi, 1001, endpoint=False)
    lines = [f"v {x} {y} 0" for x, y in zip(np.cos(angle), np.sin(angle), strict=True)]
    path.write_text("\n".join([*lines, "f " + " ".join(map(str, range(1, 1002))), ""]))
    with pytest.raises(MapError, match="line 1002 gives a face 1001 corners, the bound is 1000"):
        open_terrain(path)
