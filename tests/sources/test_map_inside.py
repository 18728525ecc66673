"""A map that goes into a mission file is the same map wherever that is opened."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from crowdfence import open_recording, open_terrain
from crowdfence.sources.convert import convert
from crowdfence.sources.ground_contact import on_ground
from crowdfence.sources.mission.writer import MissionWriter
from support.command_line import crowdfence
from support.foreign_recordings import write_dem, write_photographs
from support.small_recordings import ORIGIN, flight, write_folder

SIDE, WEST, NORTH = 40, 423_160.0, 5_150_180.0
"""Around `ORIGIN` in UTM 32N."""
HOLE = (slice(10, 25), slice(10, 25))
AT = from_origin(WEST, NORTH, 1.0, 1.0)


def write_tif(path: Path, heights: np.ndarray, *, nodata: float | None = None, at: object = AT) -> Path:
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=SIDE,
        height=SIDE,
        count=1,
        dtype=heights.dtype,
        crs="EPSG:32632",
        nodata=nodata,
        **({} if at is None else {"transform": at}),
    ) as file:
        file.write(heights, 1)
    return path


def hills() -> np.ndarray:
    rows, columns = np.mgrid[:SIDE, :SIDE]
    return (1150.0 + np.round(rows / 2) / 10 + columns / 10).astype(np.float32)


def with_a_mask(path: Path) -> None:
    """Whoever reads the file alone finds ground where there is a hole."""
    write_tif(path, hills())
    shown = np.full((SIDE, SIDE), 255, np.uint8)
    shown[HOLE] = 0
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False), rasterio.open(path, "r+") as file:
        file.write_mask(shown)


def with_a_mark_of_missing_data(path: Path) -> None:
    heights = hills()
    heights[HOLE] = 1000.0
    write_tif(path, heights)
    notes = '<PAMDataset><PAMRasterBand band="1"><NoDataValue>1000</NoDataValue></PAMRasterBand></PAMDataset>'
    path.with_name(f"{path.name}.aux.xml").write_text(notes)


def with_a_scale(path: Path) -> None:
    """Whole decimetres above 1000 m."""
    write_tif(path, np.round((hills() - 1000.0) * 10.0).astype(np.int16))
    notes = '<PAMRasterBand band="1"><Offset>1000</Offset><Scale>0.1</Scale></PAMRasterBand>'
    path.with_name(f"{path.name}.aux.xml").write_text(f"<PAMDataset>{notes}</PAMDataset>")


def with_a_world_file(path: Path) -> None:
    write_tif(path, hills(), at=None)
    path.with_suffix(".tfw").write_text(f"1\n0\n0\n-1\n{WEST + 0.5}\n{NORTH - 0.5}\n")


@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
@pytest.mark.parametrize("name", ["dem.tif", "my dem.TIFF"])
@pytest.mark.parametrize(
    ("write", "whole"),
    [
        (with_a_mask, False),
        (with_a_mark_of_missing_data, False),
        (with_a_scale, True),
        (with_a_world_file, True),
    ],
)
def test_what_lies_beside_a_height_model_goes_with_it(
    tmp_path: Path, write: Callable[[Path], None], whole: bool, name: str
) -> None:
    """A mask, a mark of missing data or a scale was left behind: holes were ground, and heights others."""
    (tmp_path / "maps").mkdir()
    dem = tmp_path / "maps" / name
    write(dem)
    recording = open_recording(write_folder(tmp_path / "flight", flight(frames=1)))
    before = open_terrain(recording, dem, voxel_size_m=1.0)
    known = sum(np.isfinite(before.surface_heights(np.arange(before.voxel_count))))
    assert known == before.voxel_count > 0
    columns = len(np.unique(before.voxel_indices(np.arange(before.voxel_count))[:, :2], axis=0))
    assert (columns > SIDE**2 * 0.95) is whole
    convert(recording, tmp_path / "flight.mcap", terrain=dem)
    for path in (tmp_path / "maps").iterdir():
        path.unlink()
    after = open_terrain(open_recording(tmp_path / "flight.mcap"), voxel_size_m=1.0)
    assert after.fingerprint == before.fingerprint
    convert(open_recording(tmp_path / "flight.mcap"), tmp_path / "again.mcap")
    assert (
        open_terrain(open_recording(tmp_path / "again.mcap"), voxel_size_m=1.0).fingerprint
        == before.fingerprint
    )


def test_a_file_beside_the_map_leads_to_no_other(tmp_path: Path) -> None:
    """GDAL follows a virtual raster that is called a mask, and an overview that its notes name."""
    secret = write_tif(tmp_path / "secret.tif", np.full((SIDE, SIDE), 255, np.uint8))
    source = f"<SimpleSource><SourceFilename>{secret}</SourceFilename></SimpleSource>"
    band = f'<VRTRasterBand dataType="Byte" band="1">{source}</VRTRasterBand>'
    size = f'rasterXSize="{SIDE}" rasterYSize="{SIDE}"'
    overview = f'<Metadata domain="OVERVIEWS"><MDI key="OVERVIEW_FILE">{secret}</MDI></Metadata>'
    recording = open_recording(write_folder(tmp_path / "flight", flight(frames=1)))
    for beside, text in (
        ("dem.tif.msk", f"<VRTDataset {size}>{band}</VRTDataset>"),
        ("dem.tif.aux.xml", f"<PAMDataset>{overview}</PAMDataset>"),
    ):
        folder = tmp_path / Path(beside).suffix
        folder.mkdir()
        dem = write_tif(folder / "dem.tif", hills())
        (folder / beside).write_text(text)
        with pytest.raises(ValueError, match=f"{beside}, beside the map, names further files"):
            convert(recording, tmp_path / "flight.mcap", terrain=dem)
        assert not (tmp_path / "flight.mcap").exists()
        with MissionWriter(tmp_path / "hostile.mcap") as writer:
            for path in (folder / beside, dem):
                kind = "application/x-crowdfence-map" + ("" if path is dem else "-beside")
                writer._mcap.add_attachment(0, 0, path.name, kind, path.read_bytes())
            writer.add_pose("uav1", 1, ORIGIN, (1.0, 0.0, 0.0, 0.0))
        hostile = open_recording(tmp_path / "hostile.mcap")
        assert hostile.terrain is None
        assert any(f"{beside}, beside the map, names further files" in line for line in hostile.warnings)


def test_a_map_is_read_as_it_was_when_heights_were_settled_on_it(tmp_path: Path) -> None:
    """Heights above the take-off were put on a map that counts from the sea, which a run then lifted by the
    geoid's 48 m: cameras stood so much too low above it."""
    photographs = write_photographs(tmp_path / "photographs")
    dem = write_dem(tmp_path / "dem.tif")
    with rasterio.open(dem, "r+") as file:
        file.write(file.read(1) - 48.0, 1)
    flown = open_recording(photographs)
    lifted = open_terrain(flown, dem, height_offset_m=48.0)
    settled = on_ground(flown, lifted)
    copy, again = tmp_path / "a.mcap", tmp_path / "b.mcap"
    done = crowdfence("convert", photographs, "-t", dem, "--terrain-option", "height_offset_m=48", "-o", copy)
    assert done.returncode == 0 and "height_offset_m=48" in done.stdout, done.stderr
    assert crowdfence("convert", copy, "-o", again).returncode == 0
    dem.unlink()
    for path in (copy, again):
        found = open_recording(path)
        for one, other in zip(found.frames, settled.frames, strict=True):
            assert np.array_equal(one.world_from_camera, other.world_from_camera)
        assert open_terrain(found).fingerprint == lifted.fingerprint
        assert open_terrain(found, height_offset_m=48.0).fingerprint == lifted.fingerprint
        assert open_terrain(found, height_offset_m=0.0).fingerprint != lifted.fingerprint
        done = crowdfence("inspect", path, "--quick", "--json")
        assert json.loads(done.stdout)["terrain"]["read_with"] == {"height_offset_m": 48}


def test_a_map_that_needs_an_option_can_go_with_heights_above_the_take_off(tmp_path: Path) -> None:
    """`convert` said to pass crs, and took no such option."""
    photographs = write_photographs(tmp_path / "photographs")
    dem = write_dem(tmp_path / "dem.tif")
    flown = open_recording(photographs)
    known = open_terrain(flown, dem)
    with rasterio.open(dem) as file:
        heights, at = file.read(1), file.transform
    height, width = heights.shape
    with rasterio.open(
        dem, "w", driver="GTiff", width=width, height=height, count=1, dtype="float32", transform=at
    ) as file:
        file.write(heights, 1)
    command = ("convert", photographs, "-t", dem, "-o", tmp_path / "a.mcap")
    assert crowdfence(*command).returncode == 1
    done = crowdfence(*command, "--terrain-option", "crs=EPSG:32632")
    assert done.returncode == 0, done.stderr
    assert open_terrain(open_recording(tmp_path / "a.mcap")).fingerprint == known.fingerprint


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("heigth_offset_m=48", "has no option 'heigth_offset_m'"),
        ("height_offset_m=high", "height_offset_m is 'high'; it must be a number"),
        ("assume_local=true", "--assume-local is no option of a map that goes with a recording"),
    ],
)
def test_options_that_no_run_could_use_are_refused_at_once(tmp_path: Path, option: str, said: str) -> None:
    flown = write_folder(tmp_path / "flight", flight(frames=1))
    dem = write_tif(tmp_path / "dem.tif", hills())
    done = crowdfence("convert", flown, "-t", dem, "--terrain-option", option, "-o", tmp_path / "a.mcap")
    assert done.returncode == 1 and said in done.stderr
    assert not (tmp_path / "a.mcap").exists()


def test_options_of_no_map_are_refused(tmp_path: Path) -> None:
    flown = write_folder(tmp_path / "flight", flight(frames=1))
    done = crowdfence("convert", flown, "--terrain-option", "up=y", "-o", tmp_path / "a.mcap")
    assert done.returncode == 1 and "there is none; give one with --terrain" in done.stderr
