"""Frames as CSV, stamps as text, and what every writer promises about the folder."""

import csv
import os
import stat
from pathlib import Path

import numpy as np
import pytest

from crowdfence.atomic_file import atomic_path, write_bytes
from crowdfence.exports.frames_csv import FrameRow, write_frames_csv
from crowdfence.exports.map_description import MapDescription
from crowdfence.iso_time import iso_utc


def test_rows_read_back_without_losing_a_digit(tmp_path: Path) -> None:
    path = tmp_path / "frames.csv"
    rows = [
        FrameRow(
            1_760_000_000_499_514_525, ("uav1", "uav 2,b"), 1, 4000, 4000, 12, 0.1 + 0.2, 2, 7.25, 1 / 3
        ),
        FrameRow(
            1_760_000_000_600_000_000,
            (),
            0,
            0,
            4000,
            0,
            0.0,
            0,
            np.float64(0.1),
            crowd_hole=1 / 3,
            crowd_sky=0.0,
        ),
    ]
    write_frames_csv(path, iter(rows))
    with open(path, newline="", encoding="utf-8") as file:
        first, second = csv.DictReader(file)
    assert first["stamp_ns"] == "1760000000499514525"
    assert first["stamp_utc"] == "2025-10-09T08:53:20.499514525Z"
    assert first["drones"] == "uav1 uav 2,b"
    assert float(first["crowd_area_m2"]) == 0.1 + 0.2
    assert float(first["zones_area_m2"]) == 7.25 and float(first["iou"]) == 1 / 3
    assert (first["frames_refused"], first["voxels_seen_so_far"], first["zones"]) == ("1", "4000", "2")
    assert (second["drones"], second["iou"], second["zones_area_m2"]) == ("", "", "0.1")
    assert (float(second["crowd_hole"]), second["crowd_sky"], second["crowd_off_map"]) == (1 / 3, "0.0", "")


def test_no_rows_is_a_header(tmp_path: Path) -> None:
    write_frames_csv(tmp_path / "frames.csv", [])
    text = (tmp_path / "frames.csv").read_text()
    assert text.startswith("stamp_ns,stamp_utc,drones,") and len(text.splitlines()) == 1


def test_stamps_as_text() -> None:
    assert iso_utc(0) == "1970-01-01T00:00:00.000000000Z"
    assert iso_utc(951_782_400_000_000_001) == "2000-02-29T00:00:00.000000001Z"
    assert iso_utc(-1) == "1969-12-31T23:59:59.999999999Z"


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path: Path) -> None:
    path = tmp_path / "zones.geojson"
    write_bytes(path, b"old")
    with pytest.raises(RuntimeError, match="half way"), atomic_path(path) as temporary:
        temporary.write_bytes(b"half of the new")
        assert path.read_bytes() == b"old"
        raise RuntimeError("half way")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_new_file_has_the_permissions_of_any_other(tmp_path: Path) -> None:
    write_bytes(tmp_path / "by_us", b"")
    (tmp_path / "by_open").write_bytes(b"")
    modes = [stat.S_IMODE(os.stat(tmp_path / name).st_mode) for name in ("by_us", "by_open")]
    assert modes[0] == modes[1]


def test_only_the_output_folder_itself_is_created(tmp_path: Path) -> None:
    write_bytes(tmp_path / "out" / "a.csv", b"1")
    assert (tmp_path / "out" / "a.csv").read_bytes() == b"1"
    with pytest.raises(FileNotFoundError, match=r"typo/out/a\.csv.*typo does not exist; create it"):
        write_bytes(tmp_path / "typo" / "out" / "a.csv", b"1")
    with pytest.raises(NotADirectoryError, match=r"a\.csv is a file, not a folder"):
        write_bytes(tmp_path / "out" / "a.csv" / "b.csv", b"1")
    with pytest.raises(IsADirectoryError, match="out is a folder; name the file"):
        write_bytes(tmp_path / "out", b"1")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"threshold": 0.0}, "threshold must be above 0"),
        ({"threshold": float("nan")}, "threshold must be above 0"),
        ({"method": ""}, "method must not be empty"),
        ({"first_stamp_ns": 11}, "first_stamp_ns 11 is after stamp_ns 10"),
    ],
)
def test_a_description_that_cannot_be_true_is_refused(change: dict[str, object], message: str) -> None:
    good: dict[str, object] = {"stamp_ns": 10, "threshold": 0.5, "method": "paper"}
    with pytest.raises(ValueError, match=message):
        MapDescription(**(good | change))  # type: ignore[arg-type]
