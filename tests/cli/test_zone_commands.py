"""`export`, `explain` and `route` on the zones that a run left."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import shapely
from PIL import Image
from typer.testing import CliRunner

from crowdfence import CrowdMap, Georeference, SurfaceGrid, Terrain, VoxelState
from crowdfence.cli.app import app
from crowdfence.cli.explain import _until
from crowdfence.cli.export import ExportFormat
from crowdfence.cli.run import _left_out
from crowdfence.cli.wording import in_options
from crowdfence.exports.geotiff import write_geotiff
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.octomap import write_terrain_octomap
from crowdfence.static_zones import read_static_zones
from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.history import ZoneHistory, with_static
from crowdfence.zones.known_ground import known_ground
from support.small_zones import SECOND_NS, DrawnZones

START_NS = 1_767_225_600 * SECOND_NS  # 2026-01-01
GATE_NOT_MET = 3
EAST_M_PER_DEGREE = 76_700.0


def command(*arguments: object) -> str:
    """What a command prints; it must succeed."""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.exception
    return done.stdout


def refused(*arguments: object) -> str:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert done.exit_code != 0 and done.exception is not None
    return str(done.exception)


def history(georeference: Georeference | None) -> ZoneHistory:
    """Two crowds of 2 x 4 m, 6 m apart, that a drone sees; a second later they are one; then it is over."""
    zones = DrawnZones((20, 10))
    sets, stamps_ns = [], []
    apart = np.zeros((20, 10))
    apart[5:7, 3:7] = apart[13:15, 3:7] = 1.0
    one = apart.copy()
    one[5:15, 3:7] = 1.0
    for crowd in (apart, one, np.zeros((20, 10))):
        sets.append(zones.step(crowd, evidence_of="uav1"))
        stamps_ns.append(START_NS + zones.stamp_ns)
    told = {"mission": "small", "drones": ["uav1"], "method": "paper", "threshold": 0.5, "parameters": {}}
    return ZoneHistory(stamps_ns, sets, georeference, told, known_ground(zones.terrain))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    folder.mkdir()
    history(Georeference(46.5, 8.0, 1200.0)).write(folder / "zone_history.jsonl")
    return folder


def test_a_history_that_was_cut_closes_nothing_less_in_silence(run: Path, tmp_path: Path) -> None:
    path = run / "zone_history.jsonl"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:3]))
    said = "was cut: it holds 2 of 3 instants, and what is closed after the last, 2026-01-01T00:00:01"
    for arguments in (
        ("export", run, "-f", "kml", "-o", tmp_path / "zones.kml"),
        ("explain", run, "--zone", "Z1", "--at", "first"),
        ("route", run, "--from", "0,0", "--to", "10,0", "--local"),
    ):
        assert said in refused(*arguments)
    assert not (tmp_path / "zones.kml").exists()


@pytest.mark.parametrize(
    "kind", [kind.value for kind in ExportFormat if kind.value not in ("state", "costmap", "mcap")]
)
def test_every_format_is_written_at_every_instant(run: Path, tmp_path: Path, kind: str) -> None:
    country = ("--country", "GRC") if kind in ("ed318", "ed269", "ed269-list") else ()
    for at, count in (("first", 2), ("+1.5", 1), ("2026-01-01T00:00:01Z", 1), ("last", 0)):
        output = tmp_path / f"{at[:2]}.{kind}"
        report = json.loads(command("export", run, "-f", kind, "--at", at, *country, "-o", output, "--json"))
        assert (report["zones"], report["file"]) == (count, str(output))
        assert output.stat().st_size > 10
    message = refused("export", run, "-f", kind, *country, "-o", output)
    assert "exists; --force replaces it" in message


@pytest.mark.parametrize("at", ["2026-01-01T00:00:00,9Z", "2026-01-01T00:00:00,999999999", "+0.9"])
def test_a_fraction_of_a_second_is_none_of_the_next_one(run: Path, tmp_path: Path, at: str) -> None:
    """A comma before it, as ISO 8601 has it too, was rounded away: the zones were those of a second later."""
    arguments = ("export", run, "-f", "csv", "--at", at, "-o", tmp_path / "zones.csv", "--json")
    assert json.loads(command(*arguments))["stamp_ns"] == START_NS


@pytest.mark.parametrize("kind", ["state", "costmap"])
def test_rasters_need_the_map_of_the_run(run: Path, tmp_path: Path, kind: str) -> None:
    arguments = ("export", run, "-f", kind, "-o", tmp_path / "map")
    assert "holds no crowd_map.tif" in refused(*arguments)
    (run / "crowd_map.tif").touch()
    assert "is of the last instant only" in refused(*arguments, "--at", "first")


@pytest.mark.parametrize("kind", ["state", "costmap"])
def test_a_raster_shows_every_zone_that_the_summary_counts(tmp_path: Path, kind: str) -> None:
    """A crowd of 2 x 2 m, held below the threshold, and a zone of others that is half off the map."""
    zones, anchor = DrawnZones((12, 8), off_threshold=0.3), Georeference(46.5, 8.0, 1200.0)
    picture = np.zeros((12, 8))
    picture[2:4, 3:5] = 1.0
    zones.step(picture)
    held = zones.step(picture * 0.4)
    assert [(zone.reason, zone.area_m2) for zone in held] == [("held", 4.0)]
    grid = SurfaceGrid.from_crowd_map(zones.crowd_map, zones.stamp_ns, threshold=0.5, margin_m=0.0)
    assert not (grid.state == VoxelState.CROWD).any()
    write_geotiff(tmp_path / "crowd_map.tif", grid, MapDescription(zones.stamp_ns, 0.5, "paper"), anchor)
    ZoneHistory([zones.stamp_ns], [held], anchor, {}).write(tmp_path / "zone_history.jsonl")
    west, east = 8 + 10.5 / EAST_M_PER_DEGREE, 8 + 15 / EAST_M_PER_DEGREE
    south, north = 46.5 + 1.5 / 111_170, 46.5 + 3.5 / 111_170
    ring = [[west, south], [east, south], [east, north], [west, north], [west, south]]
    (tmp_path / "given.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    output = tmp_path / "out.tif"
    given = ("--static-zones", tmp_path / "given.geojson")
    done = CliRunner().invoke(
        app, [str(one) for one in ("export", tmp_path, "-f", kind, "-o", output, *given)]
    )
    assert done.exit_code == 0 and "2 zones" in done.stdout
    assert "not all of S1 lies within it" in " ".join(done.stderr.split())
    with rasterio.open(output if kind == "state" else tmp_path / "out.pgm") as raster:
        cells = raster.read(1)[::-1].T
    closed = np.zeros((12, 8), dtype=bool)
    closed[2:4, 3:5] = closed[10:12, 1:4] = True
    np.testing.assert_array_equal(cells == (6 if kind == "state" else 0), closed)


def test_zones_of_others_join_an_export(run: Path, tmp_path: Path) -> None:
    ring = [[8.0, 46.5], [8.001, 46.5], [8.001, 46.501], [8.0, 46.5]]
    (tmp_path / "others.json").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    output = tmp_path / "zones.geojson"
    command(
        "export",
        run,
        "-f",
        "geojson",
        "--static-zones",
        tmp_path / "others.json",
        "--at",
        "first",
        "-o",
        output,
    )
    features = json.loads(output.read_text())["features"]
    assert [feature["properties"]["kind"] for feature in features] == ["crowd", "crowd", "static"]


def test_zones_of_others_are_put_on_the_ground_of_the_run(run: Path, tmp_path: Path) -> None:
    """The anchor lies at 1200 m, the ground 300 to 301 m above it."""
    ring = [[8.0001, 46.50001], [8.0002, 46.50001], [8.0002, 46.5001], [8.0001, 46.5001], [8.0001, 46.50001]]
    (tmp_path / "given.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    places = np.stack([*np.nonzero(np.ones((30, 30))), np.full(900, 300)], axis=1)

    def heights() -> list[float]:
        done = ("export", run, "-f", "f3548", "-o", tmp_path / "out", "--static-zones")
        command(*done, tmp_path / "given.geojson", "--at", "first", "--force")
        zones = json.loads((tmp_path / "out").read_text())["constraints"]
        volume = zones[-1]["details"]["volumes"][0]["volume"]
        return [volume[name]["value"] for name in ("altitude_lower", "altitude_upper")]

    assert heights() == [-500.0, 100_000.0]
    write_terrain_octomap(run / "terrain.bt", Terrain.from_indices(places, 1.0))
    assert heights() == [pytest.approx(1500.0, abs=2e-3), 100_000.0]


def test_zones_of_others_never_take_an_id_of_the_run(run: Path, tmp_path: Path) -> None:
    """The run has a zone of others named S1 already, at its last instant alone."""
    ring = [[8.0, 46.5], [8.0002, 46.5], [8.0002, 46.5002], [8.0, 46.5]]
    square = {"type": "Polygon", "coordinates": [ring]}
    (tmp_path / "one.geojson").write_text(json.dumps({"type": "Feature", "id": "S1", "geometry": square}))
    done = history(Georeference(46.5, 8.0, 1200.0))
    static, _ = read_static_zones([tmp_path / "one.geojson"], done.georeference)
    sets = [*done.sets[:-1], replace(done.sets[-1], static=static)]
    replace(done, sets=sets).write(run / "zone_history.jsonl")
    given = ("--static-zones", tmp_path / "one.geojson", "-f", "f3548", "-o", tmp_path / "out", "--force")
    command("export", run, *given)
    constraints = json.loads((tmp_path / "out").read_text())["constraints"]
    assert len({one["reference"]["id"] for one in constraints}) == len(constraints) == 2
    command("export", run, *given, "--at", "first")
    assert len(json.loads((tmp_path / "out").read_text())["constraints"]) == 3


def test_a_fence_says_what_it_closes_for_nothing(run: Path, tmp_path: Path) -> None:
    arguments = ("export", run, "-f", "qgc", "--at", "first", "-o", tmp_path / "a.plan")
    assert "a fence of 8 items closes 0 m2 more than the zones" in command(*arguments)
    tight = json.loads(command(*arguments, "--force", "--max-items", 1, "--json"))
    # One circle around 10 x 4 m: pi * (5^2 + 2^2) = 91.1 m2, of which 16 are crowd.
    assert tight["fence_items"] == 1 and tight["over_coverage_m2"] == pytest.approx(75.1, abs=0.5)


@pytest.mark.parametrize(("kind", "country"), [("ed269", ("--country", "GRC")), ("f3548", ())])
def test_a_hole_that_a_format_closes_is_told(tmp_path: Path, kind: str, country: tuple[str, ...]) -> None:
    """With --close-unseen these are all of the ground that was seen empty."""
    whole = history(Georeference(46.5, 8.0, 1200.0))
    (zone,) = whole.sets[1].zones
    ring = replace(zone, polygon=shapely.box(0, 0, 20, 10) - shapely.box(2, 2, 6, 6))
    sets = [replace(zones, zones=(ring,)) for zones in whole.sets]
    replace(whole, sets=sets).write(tmp_path / "zone_history.jsonl")
    arguments = ["export", tmp_path, "-f", kind, *country, "-o", tmp_path / "out"]
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert f"16 m2 more than the zones are closed: in {kind}, holes of zones are closed" in done.output


@pytest.mark.parametrize("kind", ["ed318", "ed269", "ed269-list", "f3548", "kml", "csv", "geojson", "qgc"])
def test_zones_that_begin_only_later_for_who_reads_them_are_told(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """A film's subtitles show local time, taken for UTC: two hours east of Greenwich a flight of just now
    closed its crowds two hours later."""
    country = ("--country", "GRC") if kind.startswith("ed") else ()
    arguments = ("export", run, "-f", kind, *country, "--at", "first", "-o", tmp_path / "zones", "--force")
    for now_ns, told in ((START_NS - 7200 * SECOND_NS, True), (START_NS, False)):
        monkeypatch.setattr("time.time_ns", lambda now_ns=now_ns: now_ns)
        done = CliRunner().invoke(app, [str(argument) for argument in arguments])
        said = " ".join(done.output.split())
        assert done.exit_code == 0
        assert ("the zones begin 7,200 s from now" in said) == (told and kind not in ("geojson", "qgc"))
        report = json.loads(command(*arguments, "--json"))
        assert report.get("begins_in_s", 0.0) == (7200.0 if told and kind not in ("geojson", "qgc") else 0.0)


@pytest.mark.parametrize("kind", ["ed318", "ed269", "f3548", "kml", "csv", "geojson", "qgc"])
def test_zones_that_a_forecast_has_ended_for_who_reads_them_now_are_told(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """`paper` forgets: an hour after the flight its files closed nothing; `route` went round the zones."""
    whole = ZoneHistory.read(run / "zone_history.jsonl")
    one, other = whole.sets[0]
    end_ns = START_NS + 3600 * SECOND_NS
    zones = (replace(one, valid_until_ns=end_ns), replace(other, valid_until_ns=end_ns + 1))
    sets = [replace(whole.sets[0], zones=zones), *whole.sets[1:]]
    replace(whole, sets=sets).write(run / "zone_history.jsonl")
    country = ("--country", "GRC") if kind.startswith("ed") else ()
    arguments = ("export", run, "-f", kind, *country, "--at", "first", "-o", tmp_path / "zones", "--force")
    for now_ns, told in ((end_ns - 1, False), (end_ns, True)):
        monkeypatch.setattr("time.time_ns", lambda now_ns=now_ns: now_ns)
        done = CliRunner().invoke(app, [str(argument) for argument in arguments])
        said = " ".join(done.output.split())
        assert done.exit_code == 0
        assert ("1 zone ended before now by the forecast" in said) == (
            told and kind not in ("geojson", "qgc")
        )


@pytest.mark.parametrize("is_over", [False, True])
def test_zones_that_f3548_ends_before_anybody_opens_them_are_told(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_over: bool
) -> None:
    """Its constraints last a day: of a recording of last week no reader held any of them closed."""
    a_day_on = START_NS + 24 * 3600 * SECOND_NS
    monkeypatch.setattr("time.time_ns", lambda: a_day_on + (1 if is_over else -1))
    arguments = ("export", run, "-f", "f3548", "--at", "first", "-o", tmp_path / "zones.json")
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    said = " ".join(done.output.split())
    told = "ended in this file at" if is_over else "will be open from"
    assert f"2 zones that stand longer {told} 2026-01-02T00:00:00" in said
    report = json.loads(command(*arguments, "--force", "--json"))
    assert (report["cut_short"], report["cut_short_ns"]) == (2, a_day_on)
    # A forecast that ends them within the day is what the file says, too.
    whole = ZoneHistory.read(run / "zone_history.jsonl")
    ends = tuple(replace(zone, valid_until_ns=a_day_on) for zone in whole.sets[0])
    replace(whole, sets=[replace(whole.sets[0], zones=ends), *whole.sets[1:]]).write(
        run / "zone_history.jsonl"
    )
    done = CliRunner().invoke(app, [*map(str, arguments), "--force"])
    assert done.exit_code == 0 and "stand" not in done.output


def test_a_plan_that_exists_leaves_less_room(run: Path, tmp_path: Path) -> None:
    full = tmp_path / "full.plan"
    arguments = ("export", run, "-f", "qgc", "--at", "first", "--json")
    alone = json.loads(command(*arguments, "-o", full, "--max-items", 20))
    beside = json.loads(command(*arguments, "-o", tmp_path / "both.plan", "--plan", full, "--max-items", 10))
    assert alone["fence_items"] == 8 and beside["fence_items"] <= 2
    assert beside["over_coverage_m2"] > alone["over_coverage_m2"] == 0.0
    full.write_text("{")
    assert "full.plan is no plan" in refused(*arguments, "-o", tmp_path / "x.plan", "--plan", full)


def test_local_runs_are_written_as_local_metres_only(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    history(None).write(tmp_path / "run" / "zone_history.jsonl")
    output = tmp_path / "zones"
    message = refused("export", tmp_path / "run", "-f", "kml", "-o", output)
    assert "no place on Earth; only --format geojson" in message and not output.exists()
    command("export", tmp_path / "run", "-f", "geojson", "--at", "first", "-o", output)
    assert json.loads(output.read_text())["crs"] is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--at", "yesterday"], "'yesterday' is no stamp; give last, first"),
        (["--at", "+1e308"], "'+1e308' is no stamp"),
        (["--at", "9" * 20], "beyond the year 2262"),
        (["--at", "9999-01-01T00:00:00Z"], "beyond the year 2262"),
        (["--at", "-5"], "is before the first instant, 2026-01-01T00:00:00"),
        (
            ["-f", "ed318"],
            "no country is given; this format needs three letters of ISO 3166, such as --country",
        ),
        (["--plan", "nowhere.plan", "-f", "qgc"], "nowhere.plan"),
        (["--static-zones", "nowhere.json"], "nowhere.json"),
    ],
)
def test_what_cannot_be_exported_leaves_nothing(
    run: Path, tmp_path: Path, arguments: list[str], message: str
) -> None:
    output = tmp_path / "zones"
    assert message in in_options(refused("export", run, "-f", "kml", "-o", output, *arguments))
    assert not output.exists()


@pytest.mark.parametrize("name", ["zone_history.jsonl", "crowd_map.tif", "terrain.bt"])
def test_a_file_of_the_run_that_is_read_is_never_written(run: Path, tmp_path: Path, name: str) -> None:
    if not (run / name).exists():
        (run / name).write_bytes(b"not touched")
    before = (run / name).read_bytes()
    (tmp_path / "link").symlink_to(run / name)
    for output in (run / name, tmp_path / "link"):
        message = refused("export", run, "-f", "kml", "--force", "-o", output)
        assert f"{output} is read for this, and would be lost" in message
        way = ("route", run, "--local", "--from", "1,5", "--to", "2,5")
        for option in ("-o", "--picture"):
            assert "is read for this, and would be lost" in refused(*way, option, output)
    assert (run / name).read_bytes() == before


@pytest.mark.parametrize(
    "words",
    [
        ["route", "--local", "--from", "1,5", "--to", "2,5", "-o"],
        ["export", "-f", "kml", "-o"],
        ["export", "-f", "mcap", "-o"],
    ],
)
def test_a_run_that_is_replaced_while_it_is_read_is_no_mixture(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    """The zones of one run lay on the ground of the other."""
    read = ZoneHistory.read

    def replaced_afterwards(path: Path) -> ZoneHistory:
        found = read(path)
        run.rename(tmp_path / "old")
        shutil.copytree(tmp_path / "old", run)
        return found

    monkeypatch.setattr(ZoneHistory, "read", replaced_afterwards)
    output = tmp_path / ("out.mcap" if "mcap" in words else "out.tif")
    message = refused(words[0], run, *words[1:], output)
    assert message == f"{run} was replaced by another run while it was read; give the command again"
    assert not output.exists()


def test_what_others_drew_and_plans_are_never_written_either(run: Path, tmp_path: Path) -> None:
    given = tmp_path / "given.json"
    given.write_text(json.dumps({"type": "Point", "coordinates": [8.0, 46.5]}))
    out = ("export", run, "--force", "-o", given)
    assert "is read for this" in refused(*out, "-f", "kml", "--static-zones", given)
    assert "is read for this" in refused(*out, "-f", "qgc", "--plan", given)


def test_the_picture_of_a_costmap_is_not_replaced_unasked(run: Path, tmp_path: Path) -> None:
    (tmp_path / "nav.pgm").write_text("mine")
    message = refused("export", run, "-f", "costmap", "-o", tmp_path / "nav.yaml")
    assert "nav.pgm exists; --force replaces it" in message
    message = refused("export", run, "-f", "costmap", "-o", tmp_path / "nav.pgm", "--force")
    assert "a costmap is a YAML file" in message and (tmp_path / "nav.pgm").read_text() == "mine"


def test_a_pipe_is_no_place_for_an_export(run: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "zones.kml")
    message = refused("export", run, "-f", "kml", "--force", "-o", tmp_path / "zones.kml")
    assert "is a device or a pipe" in message and (tmp_path / "zones.kml").is_fifo()


@pytest.mark.parametrize(
    "at", ["2026-01-01T00:00:01.5Z", "2026-01-01T02:00:01.5+02:00", "2025-12-31T18:30:01.500000001-05:30"]
)
def test_an_instant_may_be_told_in_the_time_of_a_place(run: Path, tmp_path: Path, at: str) -> None:
    """With a fraction of a second, too: that was no stamp."""
    told = command("export", run, "-f", "csv", "--at", at, "-o", tmp_path / "a.csv", "--json")
    assert json.loads(told)["stamp_ns"] == START_NS + SECOND_NS


def test_an_instant_after_the_last_one_is_told(run: Path, tmp_path: Path) -> None:
    """Two seconds of history; an hour after its beginning nothing is known that was not known at its end."""
    commands = (
        ("export", run, "-f", "kml", "-o", tmp_path / "zones.kml", "--force"),
        ("route", run, "--local", "--from", "1,5", "--to", "2,5"),
        ("explain", run, "--zone", "Z1"),
    )
    for words in commands:
        done = CliRunner().invoke(app, [str(word) for word in (*words, "--at", "+3600")])
        said = " ".join(done.stderr.split())
        assert "--at +3600 is 3,598.0 s after the last instant, 2026-01-01T00:00:02" in said
        for at in ("last", "+2", "+1.5"):
            done = CliRunner().invoke(app, [str(word) for word in (*words, "--at", at)])
            assert "after the last instant" not in done.stderr


def test_seconds_that_were_meant_from_the_first_instant_are_told_from_nanoseconds(run: Path) -> None:
    said = refused("explain", run, "--zone", "Z1", "--at", "5")
    assert said.startswith("--at 5 is so many nanoseconds since 1970, before the first instant, 2026-01-01T")
    assert said.endswith("such as --at +5")


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    assert "holds no zone_history.jsonl" in refused("explain", tmp_path, "--zone", "Z1")


def test_a_zone_is_explained(run: Path) -> None:
    text = command("explain", run, "--zone", "Z1", "--at", "+1")
    for part in ("a drone saw crowd in it at this instant", "40 m2 in 40 columns", "uav1", "40 m", "0.90"):
        assert part in text
    assert "Z2 went into it" in text and "appeared" in text
    told = json.loads(command("explain", run, "--zone", "Z1", "--at", "+1", "--json"))
    assert told["reason"] == "seen" and told["crowd_m2"] == 40.0
    (look,) = told["evidence"]
    assert (look["drone"], look["value"], look["range_m"], look["looks"]) == ("uav1", 0.9, 40.0, 2)
    assert [event["kind"] for event in told["events"]] == ["created", "merged", "updated"]
    message = refused("explain", run, "--zone", "Z2", "--at", "last")
    assert "there is no zone Z2" in message and "went into Z1" in message


def test_a_wrong_name_beside_a_national_file_is_told_in_a_few_words(tmp_path: Path) -> None:
    of_others = [
        Zone.of_no_look(f"N{number}", shapely.box(0, 0, 1, 1), "static", "given") for number in range(3000)
    ]
    with_static(history(None), of_others).write(tmp_path / "zones.jsonl")
    message = refused("explain", tmp_path / "zones.jsonl", "--zone", "nope", "--at", "first")
    assert "zones then: Z1, Z2, N0" in message and message.endswith("and 2990 more")


def test_what_drones_look_at_is_not_called_forgotten() -> None:
    """Where one drone shows a crowd that another does not see, the probability is below the threshold: it
    was "not known any more" beside "a drone saw crowd in it at this instant"."""
    nobody = Zone.of_no_look("Z1", shapely.box(0, 0, 1, 1), "crowd", "not_looked_at")
    zone = replace(nobody, forgotten_ns=5)
    assert _until(zone, 5).endswith("it is not known any more whether anybody is there")
    assert _until(replace(zone, reason="seen"), 5) == "none of its own: only a look can open it"
    assert _until(replace(zone, reason="held"), 5) == "none of its own: only a look can open it"


def test_a_way_round_the_zones(run: Path, tmp_path: Path) -> None:
    common = ("route", run, "--local", "--from", "0,5", "--to", "20,5")
    through = json.loads(command(*common, "--at", "last", "--json"))
    assert through["length_m"] == through["direct_m"] == 20.0
    # Round the crowd from (5, 3) to (15, 7): to a corner, 10 m along, and down again.
    files = ("-o", tmp_path / "way.geojson", "--picture", tmp_path / "way.png")
    around = json.loads(command(*common, "--at", "+1", "--json", *files))
    assert around["length_m"] == pytest.approx(10 + 2 * np.hypot(5, 2), abs=0.2)
    feature = json.loads((tmp_path / "way.geojson").read_text())
    assert feature["geometry"]["coordinates"][0] == pytest.approx([8.0, 46.5 + 5 / 111_200], abs=1e-6)
    with Image.open(tmp_path / "way.png") as picture:
        assert len(np.unique(np.asarray(picture).reshape(-1, 4), axis=0)) > 10
    done = CliRunner().invoke(app, [*map(str, common), "--at", "+1", "--clearance-m", "9"])
    assert done.exit_code == GATE_NOT_MET and "from zone Z1; the clearance is 9 m" in done.stderr
    told = refused(*common, "--clearance-m", "nan")
    assert in_options(told) == "--clearance-m is nan; it must lie between 0 and 1e+06"


def test_a_way_and_its_picture_are_two_files(run: Path, tmp_path: Path) -> None:
    common = ("route", run, "--local", "--from", "0,5", "--to", "20,5")
    message = refused(*common, "-o", tmp_path / "way", "--picture", tmp_path / "." / "way", "--force")
    assert "one would take the other's place" in message
    assert not (tmp_path / "way").exists()


def test_a_way_stays_over_the_ground_of_the_map(run: Path, tmp_path: Path) -> None:
    """The map reaches from (0, 0) to (20, 10); a zone of others closes it from its south to 9.96 m north."""

    def asked(*arguments: object) -> tuple[int, str, str]:
        done = CliRunner().invoke(app, [str(one) for one in ("route", run, "--local", *arguments)])
        return done.exit_code, done.stdout, done.stderr

    code, _, said = asked("--from", "1,5", "--to", "50,5")
    assert code == GATE_NOT_MET and "the goal (50.0, 5.0) lies outside the ground of the map" in " ".join(
        said.split()
    )
    assert "--beyond-map may leave it" in " ".join(said.split())
    code, told, said = asked("--from", "1,5", "--to", "50,5", "--beyond-map", "--json")
    assert code == 0 and json.loads(told)["beyond_map_m"] == pytest.approx(30.0)
    assert "30.0 m of the way lie beyond the map" in " ".join(said.split())
    across = ("--from", "1,5", "--to", "19,5", "--json")
    code, told, said = asked(*across)
    assert code == 0 and json.loads(told)["beyond_map_m"] == 0.0 and "beyond the map" not in said

    north = 46.5 + 9.99 / 111_170
    west, east = 8 + 8 / EAST_M_PER_DEGREE, 8 + 12 / EAST_M_PER_DEGREE
    ring = [[west, 46.4], [east, 46.4], [east, north], [west, north], [west, 46.4]]
    (tmp_path / "wall.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    wall = ("--static-zones", tmp_path / "wall.geojson")
    code, _, said = asked(*across, *wall)
    assert code == GATE_NOT_MET and "no way within the ground of the map" in " ".join(said.split())
    code, told, _ = asked(*across, *wall, "--beyond-map")
    assert code == 0 and json.loads(told)["beyond_map_m"] > 0.0


def with_states(run: Path, state: np.ndarray) -> Path:
    """The run with a map of 20 x 10 columns of 1 m, in these states [20, 10]."""
    i, j = np.indices(state.shape).reshape(2, -1)
    indices = np.stack([i, j, np.zeros_like(i)], axis=1)
    grid = SurfaceGrid.from_voxels(indices, 1.0, (0.0, 0.0, 0.0), np.zeros(state.size), state.ravel())
    description = MapDescription(START_NS, 0.5, "paper")
    write_geotiff(run / "crowd_map.tif", grid, description, Georeference(46.5, 8.0, 1200.0))
    return run


def test_a_way_over_ground_that_nobody_has_seen_empty_is_told(run: Path, tmp_path: Path) -> None:
    """From (1, 5) to (19, 5): 4 m seen empty, 5 m not cleared, 3 m stale, 2 m hidden, 4 m never seen."""
    state = np.full((20, 10), VoxelState.EMPTY, dtype=np.uint8)
    state[5:10], state[10:13] = VoxelState.NOT_CLEARED, VoxelState.STALE
    state[13:15], state[15:] = VoxelState.OCCLUDED, VoxelState.NEVER_SEEN
    with_states(run, state)
    way = ("route", run, "--local", "--from", "1,5.5", "--to", "19,5.5")
    output = ("-o", tmp_path / "way.geojson", "--picture", tmp_path / "way.png")
    done = CliRunner().invoke(app, [str(one) for one in (*way, *output)])
    assert done.exit_code == 0 and "18.0 m over 0 turns" in done.stdout
    assert (
        "14.0 of 18.0 m of the way lie over ground that is not known to be empty: 4.0 m never seen "
        "or beyond the map, 2.0 m hidden, 3.0 m seen empty too long ago, 5.0 m looked at and not cleared; no "
        "zone only means that no crowd was seen. --known-empty keeps off such ground"
    ) in " ".join(done.stderr.split())
    told = json.loads(command(*way, "--json"))
    metres = {"empty": 4, "not_cleared": 5, "stale": 3, "occluded": 2, "never_seen": 4, "crowd": 0}
    assert told["over_m"] == pytest.approx(metres) and told["not_known_empty_m"] == pytest.approx(14)
    properties = json.loads((tmp_path / "way.geojson").read_text())["properties"]
    assert properties["over_m"] == told["over_m"] and properties["not_known_empty_m"] == pytest.approx(14)
    # A run keeps the map of its last instant only.
    done = CliRunner().invoke(app, [str(one) for one in (*way, "--at", "+1.5", "--json")])
    earlier = json.loads(done.stdout)
    assert (earlier["over_m"], earlier["not_known_empty_m"]) == (None, None)
    assert "holds no map of that instant" in done.stderr
    assert "holds no map of that instant" in refused(*way, "--at", "+1.5", "--known-empty")


def test_a_way_over_ground_seen_empty_alone(run: Path) -> None:
    """The middle was not cleared but for a lane in the north, 7 to 9 m north."""
    state = np.full((20, 10), VoxelState.EMPTY, dtype=np.uint8)
    state[5:15] = VoxelState.NOT_CLEARED
    state[5:15, 7:9] = VoxelState.EMPTY
    with_states(run, state)
    way = ["route", str(run), "--local", "--from", "0.5,5", "--to", "19.5,5", "--known-empty"]
    done = CliRunner().invoke(app, [*way, "--json"])
    told = json.loads(done.stdout)
    assert done.exit_code == 0 and done.stderr == "" and told["not_known_empty_m"] == 0.0
    assert told["length_m"] == pytest.approx(10 + 2 * np.hypot(4.5, 2), abs=0.3)
    done = CliRunner().invoke(app, [*way, "--clearance-m", "1.5"])
    assert done.exit_code == GATE_NOT_MET and "there is no way" in done.stderr
    done = CliRunner().invoke(app, [*way[:-2], "10,5", "--known-empty"])
    said = " ".join(done.stderr.split())
    assert done.exit_code == GATE_NOT_MET
    assert "the goal (10.0, 5.0) lies over ground that is not known to be empty" in said
    assert "contradict each other" in refused(*way, "--beyond-map")
    state[5:15, 7:9] = VoxelState.STALE
    with_states(run, state)
    assert CliRunner().invoke(app, way).exit_code == GATE_NOT_MET


def test_ground_that_was_seen_empty_is_not_so_for_ever(tmp_path: Path) -> None:
    """All of it was seen empty at the last instant; looks are stale after 30 s."""
    zones = DrawnZones((20, 10))
    none, stamp_ns = zones.step(np.zeros((20, 10))), zones.stamp_ns
    ground = known_ground(zones.terrain)
    ZoneHistory([stamp_ns], [none], None, {"stale_after_s": 30.0}, ground).write(
        tmp_path / "zone_history.jsonl"
    )
    grid = SurfaceGrid.from_crowd_map(zones.crowd_map, stamp_ns, threshold=0.5)
    write_geotiff(tmp_path / "crowd_map.tif", grid, MapDescription(stamp_ns, 0.5, "paper"), None)
    way = ["route", str(tmp_path), "--local", "--from", "1,5.5", "--to", "19,5.5", "--json", "--at"]
    last = CliRunner().invoke(app, [*way, "last", "--known-empty"])
    assert json.loads(last.stdout)["over_m"]["empty"] == pytest.approx(18.0)
    # Of a later moment nothing is known without the map itself.
    assert "holds no map of that instant" in refused(*way, "+29", "--known-empty")
    assert json.loads(CliRunner().invoke(app, [*way, "+29"]).stdout)["over_m"] is None
    zones.crowd_map.save(tmp_path / "crowd_map.crowdmap")
    write_terrain_octomap(tmp_path / "terrain.bt", zones.terrain)
    for at, state in (("+29", "empty"), ("+31", "stale"), ("+3600", "stale")):
        done = CliRunner().invoke(app, [*way, at])
        assert done.exit_code == 0 and json.loads(done.stdout)["over_m"][state] == pytest.approx(18.0)
    assert "18.0 m seen empty too long ago" in " ".join(done.stderr.split())
    assert CliRunner().invoke(app, [*way, "+29", "--known-empty"]).exit_code == 0
    done = CliRunner().invoke(app, [*way, "+31", "--known-empty"])
    assert done.exit_code == GATE_NOT_MET and "not known to be empty" in done.stderr
    # It departs after 20 s, and arrives after 38 s, or 29 s.
    for speed_m_s, aged_m in ((1, 18.0), (2, 0.0)):
        done = CliRunner().invoke(app, [*way, "+20", "--known-empty", "--speed-m-s", str(speed_m_s)])
        report = json.loads(done.stdout)
        assert report["not_known_empty_m"] == 0.0
        assert report["not_known_empty_on_arrival_m"] == pytest.approx(aged_m)
        told = "by the arrival 18.0 of 18.0 m lie over ground that is not known to be empty"
        assert (told in " ".join(done.stderr.split())) == (aged_m > 0.0)


def way_over_ageing_ground(folder: Path) -> list[str]:
    """It begins 20 s after the run, whose ground was all seen empty then, and takes 18 s; looks are stale
    after 30 s."""
    zones = DrawnZones((20, 10))
    none, stamp_ns = zones.step(np.zeros((20, 10))), zones.stamp_ns
    ground = known_ground(zones.terrain)
    folder.mkdir()
    ZoneHistory([stamp_ns], [none], None, {"stale_after_s": 30.0}, ground).write(
        folder / "zone_history.jsonl"
    )
    zones.crowd_map.save(folder / "crowd_map.crowdmap")
    write_terrain_octomap(folder / "terrain.bt", zones.terrain)
    way = ["route", str(folder), "--local", "--from", "1,5.5", "--to", "19,5.5", "--json"]
    return [*way, "--at", "+20", "--speed-m-s", "1"]


def test_the_map_is_read_once_for_departure_and_arrival(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[object] = []

    class Counted:
        @staticmethod
        def load(*what: object) -> CrowdMap:
            read.append(what)
            return CrowdMap.load(*what)  # type: ignore[arg-type]

    monkeypatch.setattr("crowdfence.result_folder.CrowdMap", Counted)
    told = json.loads(command(*way_over_ageing_ground(tmp_path / "run")))
    assert told["over_m"]["empty"] == told["not_known_empty_on_arrival_m"] == pytest.approx(18.0)
    assert len(read) == 1


def test_a_run_that_is_replaced_while_a_way_is_sought_is_no_mixture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """How old looks are on arrival was read from the other run."""
    from crowdfence.planner import safe_route

    run = tmp_path / "run"

    def replaced_before(*what: Any, **how: Any) -> Any:
        run.rename(tmp_path / "old")
        shutil.copytree(tmp_path / "old", run)
        return safe_route(*what, **how)

    words = way_over_ageing_ground(run)
    monkeypatch.setattr("crowdfence.planner.safe_route", replaced_before)
    assert "was replaced by another run while it was read" in refused(*words)


def test_a_way_over_no_empty_ground_cannot_age(run: Path) -> None:
    """The terrain and the whole map were read for it; here they are not there."""
    with_states(run, np.full((20, 10), VoxelState.STALE, dtype=np.uint8))
    way = ["route", str(run), "--local", "--from", "1,5.5", "--to", "19,5.5", "--speed-m-s", "1", "--json"]
    done = CliRunner().invoke(app, way)
    told = json.loads(done.stdout)
    assert done.exit_code == 0 and told["not_known_empty_on_arrival_m"] == pytest.approx(18.0)
    assert "by the arrival" not in done.stderr


def test_a_way_through_a_run_without_a_map_says_so(run: Path) -> None:
    done = CliRunner().invoke(app, ["route", str(run), "--local", "--from", "1,5", "--to", "19,5"])
    assert done.exit_code == 0 and "holds no map of that instant" in done.stderr


def test_a_run_that_does_not_say_how_far_its_map_reaches(run: Path) -> None:
    """Written before histories said so: its terrain does, where it was written."""
    replace(history(None), ground=None).write(run / "zone_history.jsonl")
    inside = ("route", run, "--local", "--from", "1,5", "--to", "19,5")
    message = refused(*inside)
    assert "does not say how far its map reaches; --beyond-map" in message
    assert "18.0 m" in command(*inside, "--beyond-map")
    write_terrain_octomap(run / "terrain.bt", DrawnZones((20, 10)).terrain)
    assert "18.0 m" in command(*inside)
    done = CliRunner().invoke(app, [*map(str, inside[:-1]), "50,5"])
    assert done.exit_code == GATE_NOT_MET


def test_a_way_across_the_antimeridian_does_not_go_round_the_earth(tmp_path: Path) -> None:
    history(Georeference(-17.0, 180.0, 0.0)).write(tmp_path / "zone_history.jsonl")
    ends = ("--from", "-17.00005,179.9995", "--to", "-16.99995,-179.9995")
    command("route", tmp_path, *ends, "--beyond-map", "--at", "first", "-o", tmp_path / "way.geojson")
    way = shapely.geometry.shape(json.loads((tmp_path / "way.geojson").read_text())["geometry"])
    west, east = way.geoms
    assert west.coords[0] == (179.9995, -17.00005) and west.coords[-1][0] == 180.0
    assert east.coords[0] == (-180.0, west.coords[-1][1]) and east.coords[-1] == (-179.9995, -16.99995)
    assert west.length == pytest.approx(0.0005, rel=0.1) and east.length == pytest.approx(0.0005, rel=0.1)


def test_a_way_with_a_departure(run: Path) -> None:
    common = ("route", run, "--local", "--from", "0,5", "--to", "20,5", "--at", "+1", "--speed-m-s", 2)
    told = json.loads(command(*common, "--json"))
    assert told["waypoints"][0]["at"].startswith("2026-01-01T00:00:01")
    # 20.8 m at 2 m/s.
    assert told["waypoints"][-1]["at"].startswith("2026-01-01T00:00:11.")
    # The zones of this run have no end, so that nothing opens.
    assert json.loads(command(*common, "--expires", "--json"))["length_m"] == told["length_m"]
    assert "--expires needs --speed-m-s: a zone" in refused(
        "route", run, "--local", "--from", "0,5", "--to", "1,5", "--expires"
    )


def test_a_file_of_a_way_past_zones_that_end_says_when_it_is_where(run: Path, tmp_path: Path) -> None:
    """The crowd from 5 m east on ends 60 s after the departure, a wall of others leaves a lane through it
    alone. At 2 m/s what is kept clear, from 4.49 m east on, is reached after 2.25 s, the goal after 10 s."""
    whole = history(Georeference(46.5, 8.0, 1200.0))
    (crowd,) = whole.sets[1].zones
    end_ns = whole.stamps_ns[1] + 60 * SECOND_NS
    walls = [
        Zone.of_no_look(name, shapely.box(8, south, 12, north), "static", "given")
        for name, south, north in (("A", -1, 4), ("B", 6, 11))
    ]
    closed = replace(whole.sets[1], zones=(replace(crowd, valid_until_ns=end_ns),), static=tuple(walls))
    replace(whole, stamps_ns=whole.stamps_ns[1:2], sets=[closed]).write(run / "zone_history.jsonl")
    way = ("route", run, "--local", "--from", "0,5", "--to", "20,5", "--speed-m-s", 2, "--clearance-m", "0.5")
    assert CliRunner().invoke(app, [str(one) for one in way]).exit_code == GATE_NOT_MET
    told = command(*way, "--expires", "-o", tmp_path / "way.geojson", "--json")
    properties = json.loads((tmp_path / "way.geojson").read_text())["properties"]
    assert properties["times"] == [place["at"] for place in json.loads(told)["waypoints"]]
    assert [time[11:21] for time in properties["times"]] == ["00:00:01.0", "00:00:58.7", "00:01:08.7"]
    assert (properties["expires"], properties["clearance_m"]) == (True, 0.5)
    assert properties["zones_at"].startswith("2026-01-01T00:00:01")
    # Whoever reads a screen is told too: a run of yesterday looks like a fresh one.
    (told,) = [line for line in command(*way, "--expires").splitlines() if "as the crow flies" in line]
    assert told.endswith(f"by the zones of {properties['zones_at']}")


def test_crowd_below_a_way_past_zones_that_end_is_not_said_to_be_in_none(run: Path) -> None:
    """The zone from 5 to 15 m east is crowd on the map, and ends before the way comes there."""
    whole = history(Georeference(46.5, 8.0, 1200.0))
    (crowd,) = whole.sets[1].zones
    ends = replace(crowd, valid_until_ns=whole.stamps_ns[1] + SECOND_NS)
    closed = replace(whole.sets[1], zones=(ends,))
    replace(whole, stamps_ns=whole.stamps_ns[1:2], sets=[closed]).write(run / "zone_history.jsonl")
    state = np.full((20, 10), VoxelState.EMPTY, dtype=np.uint8)
    state[5:15] = VoxelState.CROWD
    with_states(run, state)
    way = [
        "route",
        str(run),
        "--local",
        "--from",
        "1,5.5",
        "--to",
        "19,5.5",
        "--speed-m-s",
        "0.5",
        "--expires",
    ]
    done = CliRunner().invoke(app, way)
    said = " ".join(done.stderr.split())
    assert done.exit_code == 0 and "10.0 of 18.0 m of the way lie over ground" in said
    assert "10.0 m crowd in zones that have ended by then, or in none" in said
    assert "that no zone closes" not in said


def test_places_on_earth(run: Path) -> None:
    told = json.loads(
        command(
            "route", run, "--from", "46.50001,8.0", "--to", f"46.50001,{8 + 19 / EAST_M_PER_DEGREE}", "--json"
        )
    )
    assert told["length_m"] == pytest.approx(19.0, abs=0.1)
    assert "must be two numbers" in refused("route", run, "--from", "here", "--to", "1,2")
    for text in ("-640,60", "46.5,200", "nan,8"):
        message = refused("route", run, "--from", text, "--to", "46.5,8")
        assert f"'{text}' is no latitude and longitude in degrees; local metres need --local" in message
    message = refused("route", run, "--from", "8,46.5", "--to", "46.5,8")
    assert message.startswith("'8,46.5' lies more than 100 km from the flight; the latitude comes first")


@pytest.mark.parametrize(("far_m", "ground_m"), [(1000, 1200.0), (3000, 1200.0), (3000, -400.0), (300, 0.0)])
def test_a_way_in_degrees_passes_the_zones_in_degrees(tmp_path: Path, far_m: int, ground_m: float) -> None:
    """Places on ground 1200 m above the anchor and 4.2 km from it lie 4200 * 1200 / 6.37e6 = 80 cm away from
    those with the same local metres at its height."""
    frame = Georeference(46.5, 8.0, 600.0)
    (crowd,) = DrawnZones((1, 1)).drawn("#")
    square = shapely.box(far_m, far_m - 50, far_m + 40, far_m + 50)
    zone = replace(crowd, polygon=square, lower_m=ground_m - 1.0, upper_m=ground_m + 1.0)
    closed = ZoneSet((zone,), 0.5, 0.0, 0, 0.0)
    ground = shapely.box(far_m - 300, far_m - 300, far_m + 300, far_m + 300)
    path = tmp_path / "history.jsonl"
    ZoneHistory([0], [closed], frame, {}, ground).write(path)

    def place(north_m: float) -> str:
        latitude, longitude, _ = frame.geodetic_from_local([[far_m + 20.0, far_m + north_m, ground_m]])
        return f"{latitude[0]:.9f},{longitude[0]:.9f}"

    ends = place(-150.0), place(150.0)
    told = json.loads(command("route", path, "--from", ends[0], "--to", ends[1], "--json"))
    command("export", path, "-f", "geojson", "-o", tmp_path / "zones.geojson")
    (feature,) = json.loads((tmp_path / "zones.geojson").read_text())["features"]
    way = [(corner["longitude"], corner["latitude"]) for corner in told["waypoints"]]
    assert not shapely.LineString(way).intersects(shapely.geometry.shape(feature["geometry"]))
    # It begins where it was asked to, and is no longer than it must be: two corners, 10 cm beside them.
    assert way[0] == pytest.approx([float(part) for part in ends[0].split(",")][::-1], abs=2e-8)
    assert told["length_m"] == pytest.approx(100.0 + 2 * np.hypot(100.0, 20.0), abs=0.2)


@pytest.mark.parametrize("with_others", [False, True])
def test_a_way_without_zones_is_told_at_the_height_of_its_ground(tmp_path: Path, with_others: bool) -> None:
    """On ground 1200 m above the anchor and 4.2 km from it: its rim lies 80 cm away from places with the same
    local metres at the anchor's height. A zone of others elsewhere changes nothing."""
    frame, far_m, ground_m = Georeference(46.5, 8.0, 600.0), 3000.0, 1200.0
    corner = (far_m, far_m, ground_m)
    terrain = Terrain.from_height_map(np.zeros((40, 40)), cell_size_m=1.0).with_origin(corner)
    path = tmp_path / "run"
    path.mkdir()
    none = ZoneSet((), 0.5, 0.0, 0, 0.0)
    ZoneHistory([0], [none], frame, {}, known_ground(terrain)).write(path / "zone_history.jsonl")
    write_terrain_octomap(path / "terrain.bt", terrain)
    latitude, longitude, _ = frame.geodetic_from_local(
        [[far_m + 0.3, far_m + 20.0, ground_m], [far_m + 39.7, far_m + 20.0, ground_m]]
    )
    ends = [f"{north:.9f},{east:.9f}" for north, east in zip(latitude, longitude, strict=True)]
    others: tuple[object, ...] = ()
    if with_others:
        ring = [[8.1, 46.5], [8.11, 46.5], [8.11, 46.51], [8.1, 46.5]]
        (tmp_path / "others.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
        others = ("--static-zones", tmp_path / "others.geojson")
    told = json.loads(command("route", path, "--from", ends[0], "--to", ends[1], "--json", *others))
    assert told["beyond_map_m"] == 0.0
    places = [(place["east_m"] - far_m, place["north_m"] - far_m) for place in told["waypoints"]]
    assert places == [pytest.approx((0.3, 20.0), abs=2e-3), pytest.approx((39.7, 20.0), abs=2e-3)]


def test_crowd_too_small_for_a_zone_is_told(tmp_path: Path) -> None:
    """By `run`, from its summary, and by `export`, from the history: 2 x 2 m of crowd beside 4 x 4 m."""
    zones = DrawnZones((12, 12), min_area_m2=10.0)
    crowd = np.zeros((12, 12))
    crowd[1:5, 1:5] = crowd[8:10, 8:10] = 1.0
    drawn = zones.step(crowd)
    assert (len(drawn), drawn.dropped_count, drawn.dropped_area_m2) == (1, 1, 4.0)
    told = ZoneHistory([START_NS], [drawn], Georeference(46.5, 8.0, 1200.0), {"method": "paper"})
    told.write(tmp_path / "zone_history.jsonl")
    done = CliRunner().invoke(app, ["export", str(tmp_path), "-f", "kml", "-o", str(tmp_path / "zones.kml")])
    assert "4 m2 of crowd are in no zone: below min_area_m2" in done.stderr
    summary = {"dropped_regions": 1, "dropped_area_m2": 4.0, "min_area_m2": 10.0, "unseen_closed_m2": 0.0}
    assert _left_out(summary) == ", of it 4 m2 in 1 region below 10 m2: in no zone"
    # Where unseen ground is closed, it closes this too.
    closed = replace(drawn, unseen=(replace(drawn[0], id="UNSEEN", kind="unseen"),))
    ZoneHistory([START_NS], [closed], told.georeference, told.description).write(
        tmp_path / "zone_history.jsonl"
    )
    done = CliRunner().invoke(app, ["export", str(tmp_path), "-f", "csv", "-o", str(tmp_path / "zones.csv")])
    assert done.exit_code == 0 and "no zone" not in done.stderr
    assert "not known to be empty" in _left_out({**summary, "unseen_closed_m2": 140.0})
