"""Zones of GeoJSON files: where they lie, until when they hold, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from crowdfence.fence_sync import ItemCapacity, ZoneFile, fence_geojson
from crowdfence.fence_sync.fence_item import CIRCLE_EXCLUSION, POLYGON_EXCLUSION, POLYGON_INCLUSION, FenceItem
from crowdfence.fence_sync.placement import ground_of, placed
from crowdfence.static_zones import StaticZoneError, open_static_zones
from support.fence_zones import written_zones


def corners_of(path: Path, items: int = 63) -> list[tuple[float, float]]:
    """Longitude and latitude of what is sent."""
    found = ZoneFile(path).read()
    shapes = placed(found.zones, found.georeference, ItemCapacity(items)).shapes
    return [(item.longitude_e7 / 1e7, item.latitude_e7 / 1e7) for shape in shapes for item in shape]


@pytest.mark.parametrize("spread_deg", [0.001, 0.05, 0.4])
def test_a_box_is_sent_where_it_lies_also_far_from_the_middle(tmp_path: Path, spread_deg: float) -> None:
    """At 0.4 degrees the ground lies 150 m below the local plane, which moves it by a metre if nobody
    thinks of it. What is sent covers, by at most two metres there and centimetres at home."""
    west, south, side = 8.0 + spread_deg, 47.0 + spread_deg, 0.0004
    boxes = [(8.0, 47.0, 8.0 + side, 47.0 + side), (west, south, west + side, south + side)]
    corners = np.array(corners_of(written_zones(tmp_path / "zones.geojson", *boxes)))
    margin_deg = 3e-7 if spread_deg < 0.01 else 2.0 / 76_000
    for box in boxes:
        middle = np.array(box).reshape(2, 2).mean(axis=0)
        own = corners[np.abs(corners - middle).max(axis=1) < 0.75 * side]
        low, high = own.min(axis=0), own.max(axis=0)
        assert (low <= np.array(box[:2])).all() and (low > np.array(box[:2]) - margin_deg - 1e-7).all()
        assert (high >= np.array(box[2:])).all() and (high < np.array(box[2:]) + margin_deg + 1e-7).all()


def test_files_that_follow_each_other_share_a_frame(tmp_path: Path) -> None:
    """A zone that stays is the same zone, though another one moves the middle of the file."""
    path = written_zones(tmp_path / "zones.geojson", (8.0, 47.0, 8.001, 47.001))
    source = ZoneFile(path)
    first = source.read()
    assert not source.has_changed()
    written_zones(path, (8.0, 47.0, 8.001, 47.001), (8.01, 47.01, 8.011, 47.011))
    assert source.has_changed()
    second = source.read()
    assert second.georeference == first.georeference
    assert second.zones[0].polygon.equals(first.zones[0].polygon)
    written_zones(path, (20.0, 47.0, 20.001, 47.001))
    assert source.read().georeference != first.georeference


def test_longitudes_may_count_on_beyond_the_antimeridian(tmp_path: Path) -> None:
    beyond = ZoneFile(written_zones(tmp_path / "a.json", (179.9995, -17.0, 180.0005, -16.999))).read()
    wrapped = ZoneFile(written_zones(tmp_path / "b.json", (-180.0005, -17.0, -179.9995, -16.999))).read()
    for found in (beyond, wrapped):
        (zone,) = found.zones
        # A thousandth of a degree at 17 degrees south: 106.5 m wide, 110.7 m high.
        assert zone.polygon.area == pytest.approx(106.5 * 110.66, rel=1e-3)
        assert abs(abs(found.georeference.longitude_deg) - 180.0) < 1e-9


def test_zones_end_by_themselves_where_they_say_so(tmp_path: Path) -> None:
    found = ZoneFile(written_zones(tmp_path / "a.json", (8, 47, 8.001, 47.001), valid_until_ns=1000)).read()
    assert [zone.id for zone in found.at(999)] == ["Z1"] and found.at(1000) == ()


@pytest.mark.parametrize(
    ("ends", "latest"), [((1000, 2000), 2000), ((2000, 1000), 2000), ((1000, None), None), ((None, 9), None)]
)
def test_zones_of_one_name_end_when_all_of_them_do(
    tmp_path: Path, ends: tuple[int | None, ...], latest: int | None
) -> None:
    """Files of two missions put together have a Z1 each: both ended with the one that stood last."""
    documents = []
    for number, end in enumerate(ends):
        path = written_zones(tmp_path / f"{number}.json", (8 + number / 10, 47, 8.001 + number / 10, 47.001))
        documents.append(json.loads(path.read_text()))
        documents[-1]["features"][0]["properties"] = {} if end is None else {"valid_until_ns": end}
    documents[0]["features"] += documents[1]["features"]
    (tmp_path / "both.json").write_text(json.dumps(documents[0]))
    assert [zone.valid_until_ns for zone in ZoneFile(tmp_path / "both.json").read().zones] == [latest] * 2


def test_a_file_that_could_not_be_read_is_read_once_it_can(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its zones were not taken up before somebody wrote it again."""
    source = ZoneFile(written_zones(tmp_path / "a.json", (8, 47, 8.001, 47.001)))
    with monkeypatch.context() as broken, pytest.raises(OSError, match="denied"):
        broken.setattr(Path, "read_bytes", lambda path: (_ for _ in ()).throw(OSError("denied")))
        source.read()
    assert source.has_changed() and len(source.read().zones) == 1 and not source.has_changed()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "a.geojson: Expecting"),
        ('{"type": "FeatureCollection"}', "'features' is missing"),
        ('{"type": "FeatureCollection", "crs": null, "features": []}', "local metres, not longitude"),
        (
            '{"type": "Polygon", "coordinates": [[[8, 47], [9, 47], [8, 48], [8, 47]]]}',
            "more than 100 km apart",
        ),
        ('{"type": "Polygon", "coordinates": [[[8, 47], [8, "x"], [8, 48], [8, 47]]]}', "a.geojson: "),
        (
            '{"type": "Polygon", "coordinates": []}',
            "zone 'feature 1' has no outline of at least three corners",
        ),
        ("[" * 100_000, "nested too deeply"),
        ('{"type": "Polygon", "coordinates": [[[8, 1' + "0" * 400 + "]]]}", "too large"),
        # Nothing to send would take the last fence away.
        ('{"type": "Point", "coordinates": [8, 47]}', "feature 1: a Point closes no ground"),
        (
            '{"features": [{"properties": {"identifier": "A", "variant": "COMMON"}, "geometry": null}]}',
            "it is ED-318: give it as --static-zones",
        ),
        ('{"UASZoneList": []}', "it is ED-269: give it as --static-zones"),
        ("[]", "it holds no JSON object with zones"),
        (
            '{"type": "Polygon", "coordinates": [[[8, 99], [8, 47], [9, 48], [8, 99]]]}',
            "a corner is no longitude and latitude: 8, 99",
        ),
    ],
)
def test_a_file_that_is_no_zones_is_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.geojson").write_text(text)
    with pytest.raises(StaticZoneError, match="a.geojson: ") as error:
        ZoneFile(tmp_path / "a.geojson").read()
    assert message in str(error.value)


def test_a_fence_that_was_read_is_closed_again(tmp_path: Path) -> None:
    """Circles closed no ground, and what keeps drones in was closed to them."""
    corners = [(470000000, 80000000), (470010000, 80000000), (470010000, 80010000)]
    circle = (FenceItem(CIRCLE_EXCLUSION, 25.5, 470050000, 80050000),)
    triangle = tuple(FenceItem(POLYGON_EXCLUSION, 3.0, north, east) for north, east in corners)
    path = tmp_path / "fence.geojson"
    path.write_text(fence_geojson([circle, triangle], [circle], "vehicle 1 (PX4)"))
    found = ZoneFile(path).read()
    sent = placed(found.zones, found.georeference, ItemCapacity(63)).shapes
    ground = shapely.union_all([ground_of(shape, found.georeference) for shape in sent])
    for shape in (circle, triangle):
        before = ground_of(shape, found.georeference)
        assert before is not None and ground.buffer(1e-3).covers(before)
    assert len(open_static_zones(path, found.georeference).zones) == 2

    keeps_in = tuple(FenceItem(POLYGON_INCLUSION, 3.0, north, east) for north, east in corners)
    path.write_text(fence_geojson([circle, keeps_in], [], "vehicle 1 (PX4)"))
    with pytest.raises(StaticZoneError, match="feature 2: an inclusion fence"):
        ZoneFile(path).read()
    read = open_static_zones(path, found.georeference)
    assert [zone.name for zone in read.zones] == ["feature 1"]
    assert read.left_out == (
        "feature 2: an inclusion fence, which closes what lies around it; no zone does that",
    )


def test_a_file_without_zones_closes_nothing(tmp_path: Path) -> None:
    assert ZoneFile(written_zones(tmp_path / "a.geojson")).read().zones == ()
