"""Names that somebody else chose: of drones, zones and files, on the terminal and in what is written."""

import csv
import json
from pathlib import Path

import pytest

from crowdfence.cli.demo import RECORDING
from crowdfence.legible import legible, shown, table_cell, unreadable
from support.command_line import FEW_FILES, crowdfence
from support.near_ground import write_near_ground
from support.painted_flights import circling, paint, write_flight
from support.small_recordings import flight, write_folder

OBJ = "v -60 -60 -2.5\nv 60 -60 -2.5\nv 60 60 -2.5\nv -60 60 -2.5\nf 1 2 3\nf 1 3 4\n"


def named(folder: Path, name: str) -> Path:
    """The small flight, whose first drone is called `name`."""
    write_folder(folder, flight())
    table = folder / "poses.csv"
    table.write_text(table.read_text().replace("uav1,", f"{name},"), encoding="utf-8")
    for heatmap in sorted((folder / "heatmaps").glob("uav1_*")):
        heatmap.rename(heatmap.with_name(heatmap.name.replace("uav1", name, 1)))
    return folder


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("uav_2\u200b", "U+200B"),
        ("uav\u2060_2", "U+2060"),
        ("uav_2\ufeff", "U+FEFF"),
        ("\u202e2_vau", "U+202E"),
        ("uav\x1b[2J", "U+001B"),
    ],
)
def test_a_drone_whose_name_nobody_can_read_is_refused(name: str, told: str, tmp_path: Path) -> None:
    """uav_2 flies, too: the two would look like one."""
    recording = named(tmp_path / "plain", name)
    for command in (("inspect", recording), ("run", recording, "-o", tmp_path / "out")):
        done = crowdfence(*command, columns=300)
        assert done.returncode == 1 and name not in done.stderr
        (line,) = done.stderr.splitlines()
        assert f"has the character {told}, which nobody can see: leave it out" in line


def test_a_table_begins_no_formula_and_brackets_are_no_style(tmp_path: Path) -> None:
    """A name, and a folder, that would be a formula of a spreadsheet and a style of the terminal's."""
    name, place = "=1+1[b]", tmp_path / "[" / "out]"
    place.parent.mkdir()
    recording = named(tmp_path / "plain", name)
    (tmp_path / "plain.obj").write_text(OBJ)
    common = (
        "--terrain-option",
        "unit_m=10",
        "--voxel-size-m",
        5,
        "--prior",
        0.2,
        "--min-area-m2",
        0,
        *FEW_FILES,
    )
    done = crowdfence("run", recording, "-t", tmp_path / "plain.obj", *common, "-o", place, columns=300)
    assert done.returncode == 0, done.stderr
    assert f"results in {place}" in done.stdout
    with open(place / "frames.csv", newline="", encoding="utf-8") as file:
        cells = [row["drones"] for row in csv.DictReader(file)]
    assert cells and set(cells) == {f"'{name} uav_2 uav3"}
    seen = json.loads((place / "summary.json").read_text())["frames"]
    assert name in seen  # what programs read has the name as it is
    history = json.dumps(name)[1:-1]
    assert history in (place / "zone_history.jsonl").read_text()


def test_names_of_zones_are_legible_everywhere(tmp_path: Path) -> None:
    ring = [[8.0, 46.5], [8.0002, 46.5], [8.0002, 46.5002], [8.0, 46.5]]
    names = ["@SUM(1)", "W\n\u202e7\u202c \x1b[2J"]
    features = [
        {"type": "Feature", "properties": {"name": name}, "geometry": {"type": kind, "coordinates": at}}
        for name in names
        for kind, at in (("Polygon", [ring]), ("Point", ring[0]))
    ]
    (tmp_path / "others.json").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    common = ("-t", write_near_ground(tmp_path), "--detector", "recorded", *FEW_FILES)
    run = crowdfence("run", RECORDING, *common, "-o", tmp_path / "run", "--json")
    assert run.returncode == 0, run.stderr
    given = ("--static-zones", tmp_path / "others.json")
    told = crowdfence("export", tmp_path / "run", "-f", "csv", *given, "-o", tmp_path / "z.csv", columns=300)
    assert told.returncode == 0 and not any(c in told.stderr for c in "\x1b\u202e\u202c")
    assert "others.json: W 7 [2J: a Point closes no ground" in told.stderr
    with open(tmp_path / "z.csv", newline="", encoding="utf-8") as file:
        ids = [row["id"] for row in csv.DictReader(file) if row["kind"] == "static"]
    assert ids == ["'@SUM(1)", "W 7 [2J"]


def test_a_file_whose_name_a_terminal_would_obey_is_told_by_number(tmp_path: Path) -> None:
    done = crowdfence("inspect", tmp_path / "a\x1b[2J.mcap", columns=300)
    assert done.returncode == 1 and "\x1b" not in done.stderr and "a<U+001B>[2J.mcap" in done.stderr


def test_an_alignment_tells_names_as_they_are(tmp_path: Path) -> None:
    folder = write_flight(tmp_path / "flight", circling, paint(), frames=3)
    table = folder / "poses.csv"
    table.write_text(table.read_text().replace("uav1", "[/b]"))
    for picture in sorted((folder / "images").iterdir()):
        picture.rename(picture.with_name(picture.name.replace("uav1", "[_b]")))
    done = crowdfence("align", folder, "-o", tmp_path / "offsets.json")
    assert "Traceback" not in done.stderr


def test_what_is_read_and_what_is_not() -> None:
    for name in ("uav-1", "Zürich Süd", "飛行禁止", "مطار", "TMA 1/2 (A) 🚁"):
        assert unreadable(name) is None and shown(name) == name
    assert unreadable("a\u00a0b") == "U+00A0" and shown("a\u00a0b") == "a\u00a0b"
    for character in "\x00\x1b\x7f\x85\u00ad\u034f\u200b\u200e\u202e\u2028\u2060\u2066\u3164\ufeff\ud800":
        assert unreadable(f"a{character}") == f"U+{ord(character):04X}"
    assert shown("a\u200bb\nc") == "a<U+200B>b\nc"
    assert legible(" a\t b\u2028\u200bc\n") == "a b c"
    cells = ["=1", "+1", "-1", "@a", "\uff1d1", "a=1", ""]
    assert [table_cell(text) for text in cells] == ["'=1", "'+1", "'-1", "'@a", "'\uff1d1", "a=1", ""]
