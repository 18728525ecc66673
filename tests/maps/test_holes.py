"""Small holes of height models are bridged, the others stay, and all are counted; by hand."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from rasterio.transform import Affine, from_origin
from scipy import ndimage
from typer.testing import CliRunner

from crowdfence import Georeference, Terrain
from crowdfence.cli.app import app
from crowdfence.maps import MapError, MapHoles, geotiff, height_raster, read_map

pytestmark = pytest.mark.filterwarnings(
    "ignore::PendingDeprecationWarning", "ignore::rasterio.errors.NotGeoreferencedWarning"
)

Heights = NDArray[np.float64]
NAN = np.nan


def write_local(path: Path, heights: Heights, pixel_m: float = 1.0) -> Path:
    """Rows from north to south, pixels in local metres, the south-west corner at (0, 0)."""
    height, width = heights.shape
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "nodata": -9999.0}
    transform = from_origin(0.0, height * pixel_m, pixel_m, pixel_m)
    with rasterio.open(path, "w", width=width, height=height, transform=transform, **profile) as dataset:
        dataset.write(np.where(np.isnan(heights), -9999.0, heights).astype(np.float32), 1)
    return path


def tilted(rows: int = 12, columns: int = 14) -> Heights:
    """Falls by 1/2 m a row and rises by 1/4 m a column: exact in float32."""
    row, column = np.mgrid[:rows, :columns]
    return np.asarray(100 - row / 2 + column / 4, np.float64)


def tops(terrain: Terrain) -> dict[tuple[int, int], float]:
    """Top of the highest voxel of every column, by column."""
    indices = terrain.voxel_indices(np.arange(terrain.voxel_count))
    size, origin = terrain.voxel_size_m, np.array(terrain.origin)
    highest: dict[tuple[int, int], float] = {}
    for i, j, k in indices + np.round(origin / size).astype(int):
        highest[i, j] = max(highest.get((i, j), -np.inf), (k + 1) * size)
    return highest


@pytest.mark.parametrize("voxel_size_m", [1.0, 0.25])
def test_a_tilted_plane_goes_on_as_if_there_were_no_hole(tmp_path: Path, voxel_size_m: float) -> None:
    heights = tilted()
    options = {"assume_local": True, "voxel_size_m": voxel_size_m}
    whole = read_map(write_local(tmp_path / "whole.tif", heights), **options)
    heights[2, 3] = heights[5:8, 6:9] = NAN
    holed = read_map(write_local(tmp_path / "holed.tif", heights), **options)
    assert holed.holes == MapHoles(25.0, bridged=2, bridged_m2=10.0, open=0, open_m2=0.0)
    assert whole.holes == MapHoles(25.0, 0, 0.0, 0, 0.0)
    assert holed.terrain.fingerprint == whole.terrain.fingerprint
    assert str(holed.holes) == "2 bridged (10.0 m2), 0 left open (0.0 m2), limit 25 m2"


@pytest.mark.parametrize(
    ("limit_m2", "count", "open_m2", "told"),
    [
        (25.0, 1, 25.02, "1 left open (25.02 m2), limit 25 m2"),
        (25.0, 1, 25.0004, "1 left open (25.0004 m2), limit 25 m2"),
        (0.0, 1, 0.01, "1 left open (0.01 m2), limit 0 m2"),
        (25.0, 2, 1850.04, "2 left open (1,850.0 m2), limit 25 m2"),
        (25.0, 0, 0.0, "0 left open (0.0 m2), limit 25 m2"),
    ],
)
def test_a_hole_that_stays_open_is_told_as_larger_than_the_limit(
    limit_m2: float, count: int, open_m2: float, told: str
) -> None:
    """25 pixels of 1 m2 in UTM are more on the ground: "left open (25.0 m2), limit 25 m2" says nothing."""
    assert str(MapHoles(limit_m2, 1, 4.0, count, open_m2)) == f"1 bridged (4.0 m2), {told}"


def test_what_was_bridged_stays_known_as_not_measured(tmp_path: Path) -> None:
    heights = tilted()
    path = write_local(tmp_path / "a.tif", heights)
    assert read_map(path, assume_local=True).terrain.unmeasured.shape == (0, 2)
    heights[2, 3] = heights[5:7, 6:9] = NAN
    heights[0, 13] = NAN  # at the edge: no ground at all
    path = write_local(path, heights)
    bridged = {(3, 9)} | {(i, j) for i in (6, 7, 8) for j in (5, 6)}
    # As fine as the file: each pixel for itself.
    assert unmeasured(read_map(path, assume_local=True, voxel_size_m=1.0).terrain) == bridged
    # Finer: bilinear heights between the last pixel that was measured and one that was not are not either.
    fine = unmeasured(read_map(path, assume_local=True, voxel_size_m=0.5).terrain)
    assert fine == {
        (i, j) for a, b in bridged for i in range(2 * a - 1, 2 * a + 3) for j in range(2 * b - 1, 2 * b + 3)
    }
    # Coarser: every column that holds a part of one.
    coarse = unmeasured(read_map(path, assume_local=True, voxel_size_m=2.0).terrain)
    assert coarse == {(a // 2, b // 2) for a, b in bridged}
    assert len(read_map(path, assume_local=True, max_hole_m2=0).terrain.unmeasured) == 0


def unmeasured(terrain: Terrain) -> set[tuple[int, int]]:
    return {(int(i), int(j)) for i, j in terrain.unmeasured}


@pytest.mark.parametrize("voxel_size_m", [0.3, 1.0, 1.7, 4.0])
@pytest.mark.parametrize("turn_deg", [0.0, 20.0, 45.0])
def test_whatever_rests_on_a_bridge_is_marked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, turn_deg: float, voxel_size_m: float
) -> None:
    """On Earth, turned and on a slope: a column whose height another bridge would change is not measured."""
    random = np.random.default_rng(3)
    heights = 0.3 * np.add.outer(np.arange(30.0), np.arange(40.0)) + random.uniform(0, 0.3, (30, 40))
    heights[5:9, 8:12] = heights[20, 20] = heights[14:17, 30] = NAN
    path = tmp_path / "a.tif"
    transform = (
        Affine.translation(500_100.0, 5_100_000.0) @ Affine.rotation(turn_deg) @ Affine.scale(1.0, -1.0)
    )
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "nodata": -9999.0, "crs": "EPSG:32632"}
    with rasterio.open(path, "w", width=40, height=30, transform=transform, **profile) as dataset:
        dataset.write(np.where(np.isnan(heights), -9999.0, heights).astype(np.float32), 1)
    anchor = Georeference.from_projected("EPSG:32632", 500_100.0, 5_100_000.0, 0.0)

    def top() -> tuple[Terrain, dict[tuple[int, int], float]]:
        terrain = read_map(path, voxel_size_m=voxel_size_m, georeference=anchor).terrain
        i, j, _, k = terrain.columns().T
        ids = terrain.voxel_ids(np.column_stack([i, j, k]))
        return terrain, dict(
            zip(zip(i.tolist(), j.tolist(), strict=True), terrain.surface_heights(ids), strict=True)
        )

    terrain, as_bridged = top()
    bridge = geotiff.bridge_holes

    def higher(*arguments: Any) -> tuple[height_raster.Bridges, MapHoles]:
        bridges, holes = bridge(*arguments)
        return replace(bridges, height=bridges.height + 50.0), holes

    monkeypatch.setattr(geotiff, "bridge_holes", higher)
    changed = {place for place, height in top()[1].items() if abs(height - as_bridged[place]) > 1e-3}
    marked = unmeasured(terrain)
    assert changed <= marked and len(changed) >= 5
    # Three boxes of 4 x 4, 1 x 1 and 1 x 3 m, turned, and what lies beside them.
    sides_m = 1.42 * (np.array([[4, 4], [1, 1], [1, 3]]) + 2) + 3 * voxel_size_m
    assert len(marked) * voxel_size_m**2 <= sides_m.prod(axis=1).sum()


def test_water_and_the_edge_of_the_data_stay(tmp_path: Path) -> None:
    heights = np.full((60, 60), 50.0)
    heights[10:30, 10:30] = NAN  # a lake of 20 x 20 m
    heights[40, 40] = NAN
    heights[0, 5] = heights[50:53, 59] = heights[59, 0] = NAN
    found = read_map(write_local(tmp_path / "a.tif", heights), assume_local=True)
    assert found.holes == MapHoles(25.0, bridged=1, bridged_m2=1.0, open=1, open_m2=400.0)
    lake = {(column, 59 - row) for row in range(10, 30) for column in range(10, 30)}
    edge = {(5, 59), (0, 0)} | {(59, 59 - row) for row in (50, 51, 52)}
    everywhere = {(i, j) for i in range(60) for j in range(60)}
    assert tops(found.terrain).keys() == everywhere - lake - edge


def test_the_limit_is_an_area_and_can_be_set(tmp_path: Path) -> None:
    heights = np.full((20, 40), 7.5)
    heights[2:7, 2:7] = NAN  # 25 pixels
    heights[2:4, 10:23] = NAN  # 26 pixels
    path = write_local(tmp_path / "a.tif", heights)

    def counts(path: Path, **options: float) -> tuple[int, int]:
        found = read_map(path, assume_local=True, **options).holes
        assert found is not None
        return found.bridged, found.open

    assert counts(path) == (1, 1)
    assert counts(path, max_hole_m2=26) == (2, 0)
    assert counts(path, max_hole_m2=0) == (0, 2)
    coarse = write_local(tmp_path / "coarse.tif", heights, pixel_m=2.0)  # 100 and 104 m2
    assert counts(coarse) == (0, 2)
    assert counts(coarse, max_hole_m2=100) == (1, 1)
    for limit in (-1.0, NAN, np.inf):
        with pytest.raises(MapError, match=r"max_hole_m2 is .*, must be finite and >= 0"):
            read_map(path, assume_local=True, max_hole_m2=limit)


def test_pixels_that_touch_at_corners_are_one_hole(tmp_path: Path) -> None:
    """A staircase of 30 pixels, from the north-west and from the north-east, is no 30 dropouts."""
    heights = np.full((40, 80), 7.5)
    steps = np.arange(30)
    heights[5 + steps, 3 + steps] = heights[5 + steps, 75 - steps] = NAN
    found = read_map(write_local(tmp_path / "a.tif", heights), assume_local=True).holes
    assert found == MapHoles(25.0, 0, 0.0, open=2, open_m2=60.0)


def test_beside_a_wall_heights_stay_between_those_of_the_rim(tmp_path: Path) -> None:
    heights = np.full((9, 12), 10.0)
    heights[:, 6:] = 22.0
    expected = {(i, j): 23.0 if i >= 6 else 11.0 for i in range(12) for j in range(9)}
    heights[3:6, 4:8] = NAN
    found = tops(read_map(write_local(tmp_path / "a.tif", heights), assume_local=True).terrain)
    hole = {(i, j) for i in range(4, 8) for j in range(3, 6)}
    assert {place: top for place, top in found.items() if place not in hole} == {
        place: top for place, top in expected.items() if place not in hole
    }
    assert all(11.0 <= found[place] <= 23.0 for place in hole)


def test_holes_are_those_that_an_image_library_finds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Random dropouts, read in strips of three rows; scipy labels the whole image at once."""
    missing = np.random.default_rng(5).uniform(size=(50, 70)) < 0.35
    heights = np.where(missing, NAN, 300.0)
    labels, count = ndimage.label(missing, np.ones((3, 3)))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    edge = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    inner = np.setdiff1d(np.arange(1, count + 1), edge)
    small, large = inner[sizes[inner] <= 6], inner[sizes[inner] > 6]
    assert len(small) > 20 and len(large) > 5
    monkeypatch.setattr(height_raster, "_STRIP_PIXELS", 3 * 70)
    path = write_local(tmp_path / "a.tif", heights)
    found = read_map(path, assume_local=True, max_hole_m2=6)
    assert found.holes == MapHoles(6.0, len(small), sizes[small].sum(), len(large), sizes[large].sum())
    kept = ~missing | np.isin(labels, small)
    row, column = np.nonzero(kept)
    assert tops(found.terrain) == {(i, 49 - j): 301.0 for i, j in zip(column, row, strict=True)}


def test_windows_of_the_raster_hold_the_bridges_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heights = tilted(40, 40)
    path = write_local(tmp_path / "whole.tif", heights)
    heights[7:10, 15:17] = heights[31, 31] = NAN
    holed = write_local(tmp_path / "holed.tif", heights)
    monkeypatch.setattr(geotiff, "_WINDOW_SIDE", 8)
    fingerprints = {read_map(one, assume_local=True).terrain.fingerprint for one in (path, holed)}
    assert len(fingerprints) == 1


def test_inspect_and_maps_that_are_no_height_models(tmp_path: Path) -> None:
    heights = tilted()
    heights[2, 3] = NAN
    path = write_local(tmp_path / "a.tif", heights)
    local = ["--terrain-option", "assume_local=true"]
    done = CliRunner().invoke(app, ["inspect", str(path), *local, "--json"])
    assert json.loads(done.stdout)["holes"]["bridged"] == 1
    arguments = ["inspect", str(path), *local, "--terrain-option", "max_hole_m2=0"]
    assert "0 bridged (0.0 m2), 1 left open (1.0 m2), limit 0 m2" in CliRunner().invoke(app, arguments).stdout
    mesh = tmp_path / "plain.obj"
    mesh.write_text("v 0 0 0\nv 20 0 0\nv 20 20 0\nf 1 2 3\n")
    assert read_map(mesh).holes is None
