"""The zones of a whole mission, written and read again."""

import dataclasses
import json
import math
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy import ndimage

from crowdfence import Georeference, StampError
from crowdfence.zones import Zone
from crowdfence.zones.history import ZoneHistory, ZoneHistoryError
from support.damaged_files import damaged, outcome
from support.small_zones import SECOND_NS, DrawnZones


def flown(**options: object) -> ZoneHistory:
    zones, rng = DrawnZones((20, 20), **options), np.random.default_rng(9)
    sets = []
    for _ in range(5):
        wanted = (ndimage.gaussian_filter(rng.random((20, 20)), 1.5) * 3.0 - 1.0).clip(0.0, 1.0)
        sets.append(zones.step(np.where(rng.random((20, 20)) < 0.1, np.nan, wanted)))
    sets.append(zones.engine.step(5 * SECOND_NS))  # nothing new
    stamps_ns = [number * SECOND_NS for number in range(6)]
    return ZoneHistory(
        stamps_ns, sets, Georeference(46.5, 8.0, 1200.0), {"mission": "räce", "threshold": 0.5}
    )


@pytest.mark.parametrize("options", [{}, {"buffer_m": 1.0, "close_unseen": True}])
def test_what_is_read_is_what_was_written(tmp_path: Path, options: dict[str, object]) -> None:
    history = flown(**options)
    assert sum(len(zones) for zones in history.sets) > 10
    history.write(tmp_path / "history.jsonl")
    again = ZoneHistory.read(tmp_path / "history.jsonl")
    assert again.stamps_ns == history.stamps_ns
    assert (again.georeference, again.description) == (history.georeference, history.description)
    for new, old in zip(again.sets, history.sets, strict=True):
        assert new.events == old.events and len(new.closed) == len(old.closed)
        assert (new.dropped_count, new.threshold) == (old.dropped_count, old.threshold)
        for zone, other in zip(new.closed, old.closed, strict=True):
            for field in dataclasses.fields(zone):
                value, expected = getattr(zone, field.name), getattr(other, field.name)
                if field.name in ("polygon", "crowd_outline"):
                    assert value is expected is None or value.equals_exact(expected)
                else:
                    assert value == expected or value != value, field.name


@pytest.mark.parametrize("name", ["format", "version", "anchor_wgs84", "ground", "instants"])
def test_a_description_says_nothing_in_the_place_of_the_file(tmp_path: Path, name: str) -> None:
    """It was written, and could not be read again, or lay nowhere on Earth."""
    told = dataclasses.replace(flown(), description={"mission": "race", name: None})
    with pytest.raises(ValueError, match=f"description has '{name}', which is the file's own"):
        told.write(tmp_path / "history.jsonl")
    assert not (tmp_path / "history.jsonl").exists()


def test_the_ground_of_the_map_is_written_too(tmp_path: Path) -> None:
    ground = shapely.union_all([shapely.box(0, 0, 3, 1), shapely.box(5, 0, 6, 1 / 3)])
    dataclasses.replace(flown(), ground=ground).write(tmp_path / "history.jsonl")
    again = ZoneHistory.read(tmp_path / "history.jsonl")
    assert again.ground is not None and again.ground.equals(ground)
    assert again.description == flown().description
    text = (tmp_path / "history.jsonl").read_text()
    header, _, rest = text.partition("\n")
    before = {name: value for name, value in json.loads(header).items() if name != "ground"}
    (tmp_path / "history.jsonl").write_text(json.dumps(before) + "\n" + rest)
    assert ZoneHistory.read(tmp_path / "history.jsonl").ground is None


def test_an_outline_that_did_not_change_is_written_once(tmp_path: Path) -> None:
    flown().write(tmp_path / "history.jsonl")
    lines = [json.loads(line) for line in (tmp_path / "history.jsonl").read_text().splitlines()]
    *_, changed, same = lines
    assert all("polygon" in zone for zone in changed["zones"]) and same["zones"]
    assert not any("polygon" in zone for zone in same["zones"])


def test_zones_of_others_are_written_when_they_changed(tmp_path: Path) -> None:
    """A national file is thousands of zones: named at every instant they were a megabyte each time."""
    one, two = (Zone.of_no_look(id, shapely.box(0, 0, 9, 9), "static", "given") for id in ("A", "B"))
    given = [(one,), (one,), (one, two), (one, two), (), ()]
    history = flown()
    sets = [dataclasses.replace(zones, static=own) for zones, own in zip(history.sets, given, strict=True)]
    path = tmp_path / "history.jsonl"
    dataclasses.replace(history, sets=sets).write(path)
    lines = [json.loads(line) for line in path.read_text().splitlines()[1:]]
    named = [[zone["id"] for zone in line["static"]] if "static" in line else None for line in lines]
    assert named == [["A"], None, ["A", "B"], None, [], None]
    again = ZoneHistory.read(path)
    assert [[zone.id for zone in zones.static] for zones in again.sets] == [
        [zone.id for zone in zones] for zones in given
    ]
    assert again.sets[3].static[1].polygon.equals(two.polygon)
    again.write(tmp_path / "again.jsonl")
    assert (tmp_path / "again.jsonl").read_bytes() == path.read_bytes()


def test_a_file_that_names_zones_of_others_at_every_instant_is_read(tmp_path: Path) -> None:
    """As builds of before wrote it."""
    path = tmp_path / "history.jsonl"
    flown().write(path)
    header, *lines = path.read_text().splitlines()
    named = [json.dumps({"static": [], **json.loads(line)}) for line in lines]
    path.write_text("\n".join([header.replace('"version": 2', '"version": 1'), *named, ""]))
    assert len(ZoneHistory.read(path)) == 6
    path.write_text("\n".join([header.replace('"version": 2', '"version": 1'), *lines, ""]))
    with pytest.raises(ZoneHistoryError, match="is damaged in line 3: it lacks 'static'"):
        ZoneHistory.read(path)


def test_writing_takes_the_memory_of_an_instant_not_of_a_mission(tmp_path: Path) -> None:
    """A run writes its history at its end: one that needs more than there is would lose all of it."""
    (zones,) = flown().sets[-1:]
    history = ZoneHistory(list(range(400)), [zones] * 400, None, {})
    path = tmp_path / "history.jsonl"
    history.write(path)  # what is imported on the way is there now
    tracemalloc.start()
    history.write(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert path.stat().st_size > 400 * 1000 and peak < path.stat().st_size / 4


def test_a_stamp_shows_the_instant_before_it() -> None:
    history = flown()
    assert history.at(2 * SECOND_NS) is history.at(3 * SECOND_NS - 1) is history.sets[2]
    assert history.at(10**18) is history.sets[-1]
    with pytest.raises(StampError, match="is before the first instant, 1970-01-01T00:00:00"):
        history.at(-1)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (1, "was cut: it holds 0 of 6 instants, and what is closed after the last is missing"),
        (4, "was cut: it holds 3 of 6 instants, and what is closed after the last, 1970-01-01T00:00:02"),
        (6, "was cut: it holds 5 of 6 instants"),
    ],
)
def test_a_file_of_fewer_instants_than_it_says_is_refused(tmp_path: Path, lines: int, said: str) -> None:
    path = tmp_path / "history.jsonl"
    flown().write(path)
    header, *instants = path.read_text().splitlines(keepends=True)
    path.write_text("".join([header, *instants][:lines]))
    with pytest.raises(ZoneHistoryError, match=said):
        ZoneHistory.read(path)


@pytest.mark.parametrize("left_out", [1, 40])
def test_a_last_line_that_is_torn_is_refused_whoever_wrote_it(tmp_path: Path, left_out: int) -> None:
    path = tmp_path / "history.jsonl"
    flown().write(path)
    text = path.read_text()
    path.write_text(text[:-left_out])
    with pytest.raises(ZoneHistoryError, match="was cut: it holds 5 of 6 instants"):
        ZoneHistory.read(path)
    path.write_text(text.replace(', "instants": 6}', "}", 1)[:-left_out])
    with pytest.raises(ZoneHistoryError, match="was cut: it holds 5 instants"):
        ZoneHistory.read(path)


def test_a_file_that_does_not_say_how_many_instants_it_has_is_read(tmp_path: Path) -> None:
    path = tmp_path / "history.jsonl"
    flown().write(path)
    path.write_text(path.read_text().replace(', "instants": 6}', "}", 1))
    again = ZoneHistory.read(path)
    assert len(again) == 6 and "instants" not in again.description


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("empty", "is no zone history: it is cut off, or no JSON; give the folder that a run wrote"),
        ("other", "is no zone history: it does not begin with the header of a crowdfence zone history"),
        ("list", r"is no zone history: it .*; give the folder that a run wrote, or its zone_history\.jsonl"),
        ("version", "is a zone history of version 9; up to 2 is read here"),
        ("bytes", "is no zone history: it is no text in UTF-8; give the folder that a run wrote"),
        ("header alone", "is no zone history: it holds no instant"),
        ("no zones", "is damaged in line 3: it lacks 'zones'"),
        ("no rings", "is damaged in line 2: "),
        ("no polygon", "is damaged in line 2: it does not hold what an instant has"),
        ("twice", "is damaged in line 3: its instant is not after the one before"),
        ("more", "is damaged in line 7: 6 instants where its first line says 5"),
    ],
)
def test_a_file_that_is_no_history_is_refused(tmp_path: Path, damage: str, message: str) -> None:
    path = tmp_path / "history.jsonl"
    flown().write(path)
    text = path.read_text()
    header, first, *_ = text.splitlines(keepends=True)
    no_rings = json.loads(first)
    no_rings["zones"][0]["polygon"] = [[]]
    no_polygon = json.loads(first)
    no_polygon["zones"][0]["polygon"] = None
    path.write_bytes(
        {
            "empty": "",
            "other": '{"type": "FeatureCollection"}',
            "list": "[]",
            "version": text.replace('"version": 2', '"version": 9', 1),
            "bytes": "",
            "header alone": header.replace(', "instants": 6}', "}"),
            "no zones": header + first + '{"stamp_ns": 10000000000}\n',
            "no rings": header + json.dumps(no_rings) + "\n",
            "no polygon": header + json.dumps(no_polygon) + "\n",
            "twice": header + first + first,
            "more": text.replace('"instants": 6', '"instants": 5', 1),
        }[damage].encode()
        + (b"\xff" if damage == "bytes" else b"")
    )
    with pytest.raises(ZoneHistoryError, match=rf"history\.jsonl {message}"):
        ZoneHistory.read(path)


@pytest.mark.parametrize("corner", [math.nan, math.inf, 1e300, 0.5])
def test_an_outline_that_no_run_has_written_is_refused(tmp_path: Path, corner: float) -> None:
    """Of one that crosses itself nobody knows what it closes, and NaN was written into zone files."""
    path = tmp_path / "history.jsonl"
    flown().write(path)
    header, first, *others = path.read_text().splitlines(keepends=True)
    instant = json.loads(first)
    ring = max(instant["zones"], key=lambda zone: zone["area_m2"])["polygon"][0][0]
    ring[len(ring) // 2] = [corner, corner]
    path.write_text("".join([header, json.dumps(instant) + "\n", *others]))
    with pytest.raises(ZoneHistoryError, match=r"is damaged in line 2: zone Z\d+ (reaches to|is no area)"):
        ZoneHistory.read(path)


def test_a_damaged_history_is_refused_or_says_what_it_closes(tmp_path: Path) -> None:
    path = tmp_path / "history.jsonl"
    flown().write(path)
    refused = 0
    for data in damaged(path.read_bytes(), 300):
        (tmp_path / "damaged.jsonl").write_bytes(data)
        said = outcome(lambda: _require_areas(ZoneHistory.read(tmp_path / "damaged.jsonl")))
        assert not said or said.startswith(f"{tmp_path / 'damaged.jsonl'} ")
        refused += bool(said)
    assert refused > 100


def _require_areas(history: ZoneHistory) -> None:
    assert all(zone.polygon.is_valid for zones in history.sets for zone in zones.closed)


def test_sets_that_are_not_in_order_are_no_history() -> None:
    """At a stamp the set of an earlier instant would be told: here no zone, where one is closed."""
    zones = DrawnZones((6, 6))
    nothing = zones.step(np.zeros((6, 6)))
    crowd = zones.step(np.pad(np.ones((4, 4)), 1))
    assert (len(nothing), len(crowd)) == (0, 1)
    for stamps_ns in ([SECOND_NS, 0], [SECOND_NS, SECOND_NS], np.array([5, 4])):
        with pytest.raises(ValueError, match="stamps of zone sets must increase"):
            ZoneHistory(stamps_ns, [crowd, nothing], None, {})
    with pytest.raises(ValueError, match="stamps of zone sets are whole nanoseconds"):
        ZoneHistory([0.0, 1.76e9], [nothing, crowd], None, {})


def test_stamps_of_numpy_are_written_and_read(tmp_path: Path) -> None:
    zones = DrawnZones((6, 6))
    sets = [zones.step(np.zeros((6, 6))), zones.step(np.pad(np.ones((4, 4)), 1))]
    history = ZoneHistory(np.array([0, SECOND_NS]), sets, None, {})
    history.write(tmp_path / "history.jsonl")
    assert ZoneHistory.read(tmp_path / "history.jsonl").stamps_ns == [0, SECOND_NS]


def test_a_zone_that_no_look_made_is_the_same_when_it_comes_again() -> None:
    """It knows no probability, and no NaN is another: with Python 3.13 a fence was written to the vehicle
    once a second."""
    one, two = (Zone.of_no_look("CTR", shapely.box(0, 0, 9, 9), "static", "given") for _ in range(2))
    assert one == two and hash(one) == hash(two) and len({one, two}) == 1
    assert one == dataclasses.replace(two, probability_max=float("nan"))
    for changes in ({"probability_max": 0.5}, {"id": "Z1"}, {"polygon": shapely.box(0, 0, 9, 8)}):
        assert one != dataclasses.replace(two, **changes) and dataclasses.replace(two, **changes) != one
    assert one != "CTR"
