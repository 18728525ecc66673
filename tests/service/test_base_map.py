"""The operator's own map of the surroundings: given to who may read, piece by piece, and where it belongs."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image
from starlette.testclient import TestClient

from crowdfence import Georeference
from crowdfence.service.base_map import BaseMap
from support.small_service import asked, running
from support.tile_archive import write_pictures

ANCHOR = Georeference(46.5, 8.0, 1200.0)
RED, GREEN, BLUE = (200, 10, 10), (10, 200, 10), (10, 10, 200)
UTM = "EPSG:32632"
PIXEL_M = 0.5


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    def grey(latitude: np.ndarray, longitude: np.ndarray) -> np.ndarray:
        return np.full((*latitude.shape, 3), 90, np.uint8)

    return write_pictures(
        tmp_path_factory.mktemp("base") / "base.pmtiles", (7.99, 46.49, 8.01, 46.51), 14, grey
    )


@pytest.fixture(scope="module")
def photograph(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Blue; red within 10 m of the place 60 m east and 30 m south of the anchor, by PROJ's own coordinates of
    the two places in UTM, which is turned against local north there; green from 100 m north on."""
    (x, y, _), (_, y_north, _) = ANCHOR.projected_from_local(UTM, [[60.0, -30.0, 0.0], [0.0, 100.0, 0.0]])
    side = 1000
    transform = rasterio.transform.from_origin(x - 250.0, y + 250.0, PIXEL_M, PIXEL_M)
    east, north = np.meshgrid(
        x - 250.0 + (np.arange(side) + 0.5) / 2, y + 250.0 - (np.arange(side) + 0.5) / 2
    )
    pixels = np.empty((side, side, 3), np.uint8)
    pixels[:] = BLUE
    pixels[north > y_north] = GREEN
    pixels[np.hypot(east - x, north - y) < 10.0] = RED
    path = tmp_path_factory.mktemp("photograph") / "ortho.tif"
    profile = {"driver": "GTiff", "count": 3, "dtype": "uint8", "crs": UTM, "transform": transform}
    with rasterio.open(path, "w", width=side, height=side, **profile) as raster:
        raster.write(np.moveaxis(pixels, -1, 0))
    return path


def over(path: Path, bounds: tuple[float, float, float, float], shape: tuple[int, int]) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(BaseMap.open(path).over(ANCHOR, bounds, shape))))


@pytest.fixture(scope="module")
def http(archive: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with running(tmp_path_factory.mktemp("data"), georeference=ANCHOR) as service, asked(service) as http:
        service.base_map = BaseMap.open(archive)
        yield http


def test_an_archive_is_read_piece_by_piece(http: TestClient, archive: Path) -> None:
    whole = archive.read_bytes()
    assert http.get("/api/v1/scene").json()["base_map"] == "tiles"
    piece = http.get("/api/v1/base-map", headers={"Range": "bytes=100-355"})
    assert piece.status_code == 206 and piece.content == whole[100:356]
    assert piece.headers["content-range"] == f"bytes 100-355/{len(whole)}"
    assert "default-src 'self'" in piece.headers["content-security-policy"]
    behind = http.get("/api/v1/base-map", headers={"Range": f"bytes={len(whole)}-"})
    assert behind.status_code == 416


def test_an_archive_is_no_picture(http: TestClient) -> None:
    box = "west=0&south=0&east=9&north=9&rows=4&columns=4"
    assert http.get(f"/api/v1/base-map/picture?{box}").status_code == 404


def test_a_picture_lies_where_its_coordinates_say(photograph: Path) -> None:
    """In local metres the red disc is round and where it was put, though the file's grid is turned."""
    seen = over(photograph, (30.0, -60.0, 90.0, 0.0), (240, 240))
    east, north = np.meshgrid(30.0 + (np.arange(240) + 0.5) / 4, -(np.arange(240) + 0.5) / 4)
    from_the_middle = np.hypot(east - 60.0, north + 30.0)
    assert (seen[from_the_middle < 10.0 - PIXEL_M] == (*RED, 255)).all()
    assert (seen[from_the_middle > 10.0 + PIXEL_M] == (*BLUE, 255)).all()


def test_beyond_its_edge_a_picture_is_transparent(photograph: Path) -> None:
    """It ends 310 m east and 220 m north of the anchor, give or take what the grid is turned by."""
    seen = over(photograph, (-1000.0, -1000.0, 1000.0, 1000.0), (200, 200))
    assert (seen[:, 135:, 3] == 0).all() and (seen[:75, :, 3] == 0).all()
    assert (seen[85:115, 85:125, 3] == 255).all()
    assert (over(photograph, (5000.0, 0.0, 5100.0, 100.0), (8, 8)) == 0).all()
    assert tuple(seen[84, 100]) == (*GREEN, 255)


def test_a_browser_keeps_ground_and_map_of_this_service_only(http: TestClient) -> None:
    # Another one at the same address may have other ground: it would be drawn below new zones for an hour.
    run = http.get("/api/v1/scene").json()["run"]
    for path in ("terrain", "base-map"):
        kept = [
            http.get(f"/api/v1/{path}{query}").headers["cache-control"]
            for query in ("", "?run=0", f"?run={run}")
        ]
        assert kept == ["private, no-cache", "private, no-cache", "private, max-age=3600"]


@pytest.mark.parametrize("query", ["west=5&east=1", "west=nan", "rows=0", "rows=99999"])
def test_nonsense_is_refused_with_its_bound(http: TestClient, photograph: Path, query: str) -> None:
    service = http.app.state.service
    archive, service.base_map = service.base_map, BaseMap.open(photograph)
    try:
        asked_for = {"west": "0", "south": "0", "east": "9", "north": "9", "rows": "4", "columns": "4"}
        asked_for |= dict(pair.split("=") for pair in query.split("&"))
        assert http.get("/api/v1/base-map/picture", params=asked_for).status_code == 422
    finally:
        service.base_map = archive


def test_files_of_other_kinds_are_refused_at_the_start(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no map")
    with pytest.raises(ValueError, match=r"notes\.txt is neither"):
        BaseMap.open(tmp_path / "notes.txt")
    profile = {"driver": "GTiff", "count": 1, "width": 4, "height": 4}
    placed = {"crs": UTM, "transform": rasterio.transform.from_origin(400_000.0, 5_150_000.0, 1.0, 1.0)}
    with rasterio.open(tmp_path / "dem.tif", "w", dtype="float32", **profile, **placed) as raster:
        raster.write(np.zeros((1, 4, 4), np.float32))
    with pytest.raises(ValueError, match="holds float32"):
        BaseMap.open(tmp_path / "dem.tif")
    with rasterio.open(tmp_path / "scan.tif", "w", dtype="uint8", **profile) as raster:
        raster.write(np.zeros((1, 4, 4), np.uint8))
    with pytest.raises(ValueError, match="does not say where on Earth"):
        BaseMap.open(tmp_path / "scan.tif")
    with pytest.raises(FileNotFoundError):
        BaseMap.open(tmp_path / "none.pmtiles")
