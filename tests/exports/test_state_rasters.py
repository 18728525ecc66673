"""The map's states with colours, and as a navigation map."""

import errno
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
import yaml
from PIL import Image

from crowdfence import Georeference, SurfaceGrid, VoxelState
from crowdfence.exports.colours import CLOSED_COLOUR, STATE_COLOURS
from crowdfence.exports.geotiff import write_geotiff
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.state_rasters import write_costmap, write_state_geotiff
from crowdfence.zones import Zone, find_zones
from support.small_crowd_maps import flat_crowd_map


def written(tmp_path: Path) -> tuple[Path, SurfaceGrid, object]:
    """4 x 2 columns of 2 m from (10, -6): crowd, empty, never seen, stale in the southern row."""
    probability = np.array([[0.9, 0.0], [0.1, 0.0], [np.nan, 0.0], [0.1, 0.0]])
    seen_ns = np.array([[99, 99], [99, 99], [0, 99], [0, 99]]) * 10**9
    crowd_map = flat_crowd_map(probability, 2.0, (10.0, -6.0, 0.0), seen_ns)
    grid = SurfaceGrid.from_crowd_map(crowd_map, 99 * 10**9, threshold=0.5, margin_m=0.0)
    path = tmp_path / "crowd_map.tif"
    write_geotiff(path, grid, MapDescription(99 * 10**9, 0.5, "paper"), None)
    return path, grid, find_zones(crowd_map, 99 * 10**9, threshold=0.5)


def test_states_have_their_colours(tmp_path: Path) -> None:
    path, grid, _ = written(tmp_path)
    assert write_state_geotiff(tmp_path / "state.tif", path, ()) == []
    with rasterio.open(tmp_path / "state.tif") as raster, rasterio.open(path) as whole:
        np.testing.assert_array_equal(raster.read(1), grid.state.T[::-1])
        colours = raster.colormap(1)
        assert {known: colours[known.value][:3] for known in VoxelState} == dict(STATE_COLOURS)
        assert raster.transform == whole.transform and raster.dtypes == ("uint8",)
    # Programs that know no maps show the same colours.
    with Image.open(tmp_path / "state.tif") as picture:
        assert picture.mode == "P"
        shown = np.asarray(picture.convert("RGB"))
    wanted = np.array([STATE_COLOURS[VoxelState(value)] for value in grid.state.T[::-1].ravel()])
    np.testing.assert_array_equal(shown.reshape(-1, 3), wanted)


def test_what_zones_close_is_in_every_raster(tmp_path: Path) -> None:
    """A zone around the crowd that reaches into its neighbours, and one of others that leaves the map."""
    path, _, zones = written(tmp_path)
    (crowd,) = zones  # type: ignore[misc]
    wide = replace(crowd, polygon=shapely.box(10.0, -6.0, 13.0, -3.5))
    given = replace(crowd, id="S1", kind="static", polygon=shapely.box(17.9, -5.0, 30.0, -4.5))
    assert write_state_geotiff(tmp_path / "state.tif", path, [wide, given]) == ["S1"]
    with rasterio.open(tmp_path / "state.tif") as raster:
        # Northern row: closed, closed, empty, empty; southern one: crowd, closed, never seen, closed.
        assert raster.read(1).tolist() == [[6, 6, 2, 2], [4, 6, 0, 6]]
        assert raster.colormap(1)[6][:3] == CLOSED_COLOUR and "6 = CLOSED" in raster.tags()["VALUES"]
    assert write_costmap(tmp_path / "nav.yaml", path, [wide, given]) == ["S1"]
    with Image.open(tmp_path / "nav.pgm") as picture:
        assert np.asarray(picture).tolist() == [[0, 0, 254, 254], [0, 0, 205, 0]]
    # The exact outline of the crowd closes its cell alone.
    write_state_geotiff(tmp_path / "state.tif", path, [crowd])
    with rasterio.open(tmp_path / "state.tif") as raster, rasterio.open(path) as whole:
        np.testing.assert_array_equal(raster.read(1), whole.read(3))


def test_of_a_zone_set_all_that_it_closes_is_in_every_raster(tmp_path: Path) -> None:
    """The cell beside the crowd, which was seen empty, is closed by somebody else."""
    path, _, zones = written(tmp_path)
    (crowd,) = zones  # type: ignore[misc]
    given = replace(crowd, id="S1", kind="static", polygon=shapely.box(12.0, -6.0, 14.0, -4.0))
    closed = replace(zones, static=(given,))  # type: ignore[type-var]
    assert write_state_geotiff(tmp_path / "state.tif", path, closed) == []
    assert write_costmap(tmp_path / "map.yaml", path, closed) == []
    with rasterio.open(tmp_path / "state.tif") as raster:
        assert raster.read(1)[1].tolist() == [4, 6, 0, 3]
    with Image.open(tmp_path / "map.pgm") as picture:
        assert np.asarray(picture)[1].tolist() == [0, 0, 205, 205]


def test_zones_lie_on_their_cells_far_from_the_anchor_too(tmp_path: Path) -> None:
    """2 km away and 1200 m up a map projection is 38 cm narrower than the ground: most of a cell."""
    probability = np.zeros((6, 6))
    crowd_map = flat_crowd_map(probability, 0.5, (2000.0, 0.0, 0.0), np.full((6, 6), 99 * 10**9))
    grid = SurfaceGrid.from_crowd_map(crowd_map, 99 * 10**9, threshold=0.5, margin_m=0.0)
    shape = shapely.box(2001.0, 1.0, 2001.5, 1.5)
    zone = Zone("Z1", shape, 1, 0.25, 0.9, 0.9, 0.0, 0.5, 0, 0, ())
    path, anchor = tmp_path / "crowd_map.tif", Georeference(46.5, 8.0, 1200.0)
    write_geotiff(path, grid, MapDescription(99 * 10**9, 0.5, "paper"), anchor, [zone])
    expected = np.full((6, 6), int(VoxelState.EMPTY))
    expected[3, 2] = 6
    with rasterio.open(path) as raster:
        np.testing.assert_array_equal(raster.read(2), expected)
        assert (raster.read(3) == VoxelState.EMPTY).all()
    assert write_state_geotiff(tmp_path / "state.tif", path, [zone]) == []
    with rasterio.open(tmp_path / "state.tif") as raster:
        np.testing.assert_array_equal(raster.read(1), expected)
    # A navigation map knows no projection: it has the metres in which vehicles fly and zones are drawn.
    write_costmap(tmp_path / "nav.yaml", path, [zone])
    assert "resolution: 0.5\norigin: [2000.0, 0.0, 0.0]\n" in (tmp_path / "nav.yaml").read_text()


def test_a_navigation_map_frees_what_is_known_to_be_empty_and_nothing_else(tmp_path: Path) -> None:
    path, _, zones = written(tmp_path)
    write_costmap(tmp_path / "nav.yaml", path, ())
    with Image.open(tmp_path / "nav.pgm") as picture:
        grey = np.asarray(picture)
    # Occupied, free, unknown (never seen), unknown (stale); the northern row is all free.
    assert grey.tolist() == [[254, 254, 254, 254], [0, 254, 205, 205]]
    text = (tmp_path / "nav.yaml").read_text()
    assert "image: nav.pgm\nresolution: 2.0\norigin: [10.0, -6.0, 0.0]\n" in text
    (zone,) = zones  # type: ignore[misc]
    wide = replace(zone, polygon=zone.polygon.buffer(1.0))
    write_costmap(tmp_path / "nav.yaml", path, [wide])
    with Image.open(tmp_path / "nav.pgm") as picture:
        # What the fence around the crowd touches is closed.
        assert np.asarray(picture).tolist() == [[0, 0, 254, 254], [0, 0, 205, 205]]


@pytest.mark.parametrize("name", ["north: site #3", "- [a]", "'x", "Platz über", "7"])
def test_a_navigation_map_names_its_picture_whatever_that_is_called(tmp_path: Path, name: str) -> None:
    path, _, _ = written(tmp_path)
    write_costmap(tmp_path / f"{name}.yaml", path, ())
    told = yaml.safe_load((tmp_path / f"{name}.yaml").read_text())
    assert told["image"] == f"{name}.pgm" and (tmp_path / told["image"]).exists()


def test_a_navigation_map_that_cannot_be_written_leaves_the_one_before_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its picture at the place of another map would free cells elsewhere."""
    path, _, zones = written(tmp_path)
    write_costmap(tmp_path / "nav.yaml", path, ())
    before = [(tmp_path / name).read_bytes() for name in ("nav.yaml", "nav.pgm")]
    write = Path.write_bytes

    def full_after_the_picture(self: Path, data: bytes) -> int:
        if data.startswith(b"image"):
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(self, data)

    monkeypatch.setattr(Path, "write_bytes", full_after_the_picture)
    (zone,) = zones  # type: ignore[misc]
    with pytest.raises(OSError, match="No space left"):
        write_costmap(tmp_path / "nav.yaml", path, [replace(zone, polygon=zone.polygon.buffer(1.0))])
    assert [(tmp_path / name).read_bytes() for name in ("nav.yaml", "nav.pgm")] == before
