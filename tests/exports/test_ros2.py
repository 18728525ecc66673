"""What a run found as ROS 2 messages, read back by two readers that are not ours."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from scipy.spatial.transform import Rotation

from crowdfence import Georeference, SurfaceGrid, VoxelState
from crowdfence.exports.colours import STATE_COLOURS
from crowdfence.exports.ros2 import topics, write_results_mcap
from crowdfence.exports.ros2.earth_frame import earth_from_map
from crowdfence.exports.ros2.grids import FREE, OCCUPIED, UNKNOWN, belief_cells, closed_cells
from crowdfence.exports.ros2.ground import height_at, terrain_mesh
from crowdfence.exports.ros2.zone_markers import zone_markers
from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.history import ZoneHistory
from support.small_grids import flat_grid
from support.small_zones import SECOND_NS, DrawnZones
from support.wgs84_by_hand import earth_centred, local_axes

ANCHOR = Georeference(46.5, 8.0, 1200.0)
RING = """
.......
.#####.
.#...#.
.#####.
.......
"""
SPOT = """
.......
.......
...#...
.......
.......
"""


def states_grid() -> SurfaceGrid:
    """One column of 2 m per state from (10, -6), in the order of their numbers; P = 0.301 everywhere."""
    states = np.array([state.value for state in sorted(VoxelState)])
    indices = np.column_stack([np.arange(len(states)), np.zeros((len(states), 2), dtype=int)])
    return SurfaceGrid.from_voxels(indices, 2.0, (10.0, -6.0, 5.0), np.full(len(states), 0.301), states)


def small_run(georeference: Georeference | None = ANCHOR) -> tuple[ZoneHistory, SurfaceGrid]:
    """A ring of crowd around a yard for two instants, then a single column; the last map knows all of it."""
    drawn = DrawnZones((7, 5))
    sets = [drawn.drawn(RING), drawn.drawn(RING), drawn.drawn(SPOT)]
    stamps_ns = [number * SECOND_NS for number in range(3)]
    grid = SurfaceGrid.from_crowd_map(drawn.crowd_map, stamps_ns[-1], threshold=0.5)
    return ZoneHistory(stamps_ns, sets, georeference, {"method": "paper"}), grid


@pytest.fixture
def written(tmp_path: Path) -> Path:
    path = tmp_path / "results.mcap"
    write_results_mcap(path, *small_run())
    return path


def by_rosbags(path: Path) -> list[tuple[str, int, object]]:
    with AnyReader([path]) as reader:
        return [
            (connection.topic, stamp_ns, reader.deserialize(raw, connection.msgtype))
            for connection, stamp_ns, raw in reader.messages()
        ]


def by_mcap(path: Path) -> list[tuple[str, int, object]]:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [
            (channel.topic, message.log_time, decoded)
            for _, channel, message, decoded in reader.iter_decoded_messages()
        ]


@pytest.mark.parametrize("read", [by_rosbags, by_mcap])
def test_two_other_readers_find_the_zones_and_the_map(written: Path, read) -> None:
    history, _ = small_run()
    messages = read(written)
    arrays = [(stamp_ns, message) for topic, stamp_ns, message in messages if topic == topics.ZONES]
    assert [stamp_ns for stamp_ns, _ in arrays] == list(history.stamps_ns)
    for (_, array), zones in zip(arrays, history.sets, strict=True):
        first, *drawn = array.markers
        assert first.action == 3  # DELETEALL: each array says everything
        (zone,) = zones
        outline = next(marker for marker in drawn if marker.ns == "crowd outline")
        ends = {(point.x, point.y) for point in outline.points}
        assert ends == {tuple(corner) for corner in shapely.get_coordinates(zone.polygon).tolist()}
        assert {point.z for point in outline.points} == {1.3}  # 0.3 m above the top of the voxels
        (text,) = (marker.text for marker in drawn if marker.type == 9)
        assert text.startswith(f"{zone.id}  P 1.00\n{zone.polygon.area:.0f} m2")
    grids = {topic: message for topic, _, message in messages if topic in (topics.CLOSED, topics.BELIEF)}
    for message in grids.values():
        info = message.info
        assert (info.resolution, info.width, info.height) == (1.0, 7, 5)
        assert (info.origin.position.x, info.origin.position.y) == (0.0, 0.0)
        # Row by row from the south-west; the crowd is the middle column.
        cells = np.array(message.data).reshape(5, 7)
        assert cells[2, 3] == OCCUPIED and cells[0, 0] == FREE
    assert not {UNKNOWN} & set(np.unique(grids[topics.BELIEF].data))  # all of it was seen just now


def test_closed_ground_of_earlier_instants_frees_nothing(written: Path) -> None:
    stamps_ns, cells = zip(
        *(
            (stamp_ns, np.array(message.data).reshape(5, 7))
            for topic, stamp_ns, message in by_rosbags(written)
            if topic == topics.CLOSED
        ),
        strict=True,
    )
    # The second instant closes what the first did: nothing new is said.
    assert stamps_ns == (0, 2 * SECOND_NS)
    ring = np.zeros((5, 7), dtype=bool)
    ring[1:4, 1:6] = True
    ring[2, 2:5] = False
    # What an edge only touches may be closed too; the other cells are not known.
    assert (cells[0][ring] == OCCUPIED).all() and set(np.unique(cells[0])) == {UNKNOWN, OCCUPIED}
    assert (cells[0][[0, 0, 4, 4], [0, 6, 0, 6]] == UNKNOWN).all()


@pytest.mark.parametrize("read", [by_rosbags, by_mcap])
def test_the_points_hold_state_and_probability(written: Path, read) -> None:
    (cloud,) = (message for topic, _, message in read(written) if topic == topics.GROUND)
    offsets = {field.name: field.offset for field in cloud.fields}
    layout = np.dtype(
        {
            "names": list(offsets),
            "formats": ["u1" if name == "state" else "<u4" if name == "rgb" else "<f4" for name in offsets],
            "offsets": list(offsets.values()),
            "itemsize": cloud.point_step,
        }
    )
    table = np.frombuffer(bytes(cloud.data), layout)
    assert len(table) == cloud.width == 35
    (crowd,) = table[table["state"] == VoxelState.CROWD]
    assert (crowd["x"], crowd["y"], crowd["z"]) == (3.5, 2.5, 1.0) and crowd["probability"] == 1.0
    assert set(table["state"]) == {VoxelState.CROWD, VoxelState.EMPTY}


def test_only_what_is_known_to_be_empty_is_free() -> None:
    grid = states_grid()
    belief, closed = belief_cells(grid)[:, 0], closed_cells((), grid, with_state=True)[:, 0]
    for state in VoxelState:
        # P = 0.301 is rounded up.
        wanted = 31 if state in (VoxelState.EMPTY, VoxelState.CROWD) else UNKNOWN
        assert belief[state] == wanted
        assert closed[state] == {VoxelState.EMPTY: FREE, VoxelState.CROWD: OCCUPIED}.get(state, UNKNOWN)
    assert (closed_cells((), grid) == UNKNOWN).all()


corners = st.lists(st.tuples(st.floats(-3, 13), st.floats(-3, 9)), min_size=3, max_size=8)


@settings(max_examples=60)
@given(corners)
def test_a_zone_closes_every_cell_that_it_reaches_into(places: list[tuple[float, float]]) -> None:
    outline = shapely.MultiPoint(places).convex_hull.buffer(0.05)
    grid = flat_grid(np.zeros((10, 6)))
    cells = closed_cells([drawn_zone(outline)], grid)
    boxes = [[shapely.box(i, j, i + 1, j + 1) for j in range(6)] for i in range(10)]
    reached = shapely.area(shapely.intersection(np.array(boxes), outline)) > 1e-9
    assert (cells[reached] == OCCUPIED).all()


def drawn_zone(outline: shapely.Polygon, **changes: object) -> Zone:
    values = {
        "id": "Z1",
        "polygon": outline,
        "cell_count": 1,
        "area_m2": 1.0,
        "probability_max": 0.9,
        "probability_mean": 0.9,
        "lower_m": 2.0,
        "upper_m": 4.0,
        "last_seen_ns": 0,
        "oldest_look_ns": 0,
        "seen_by": (),
    }
    return Zone(**{**values, **changes})


def test_the_ground_of_a_zone_is_filled_and_its_holes_are_not() -> None:
    yard = shapely.Polygon(shapely.box(0, 0, 10, 8).exterior, [shapely.box(3, 3, 6, 5).exterior])
    zones = ZoneSet((drawn_zone(yard),), 0.5, 0.0, 0, 0.0)
    markers = {marker["ns"]: marker for marker in zone_markers(zones, 0, None)["markers"][1:]}
    corners = np.array([[point["x"], point["y"]] for point in markers["crowd ground"]["points"]])
    filled = shapely.union_all([shapely.Polygon(triangle) for triangle in corners.reshape(-1, 3, 2)])
    assert filled.symmetric_difference(yard).area == pytest.approx(0.0, abs=1e-9)
    heights = {point["z"] for point in markers["crowd band"]["points"]}
    assert heights == {2.0, 124.0}  # from its lowest ground to 120 m above its highest


def test_zones_of_others_have_no_band_and_unseen_ground_no_probability() -> None:
    outline = shapely.box(0, 0, 2, 2)
    others = drawn_zone(outline, id="S1", kind="static", probability_max=float("nan"))
    unseen = drawn_zone(outline, id="UNSEEN", kind="unseen", probability_max=float("nan"))
    zones = ZoneSet((), 0.5, 0.0, 0, 0.0, unseen=(unseen,), static=(others,))
    markers = zone_markers(zones, 0, None)["markers"]
    assert [marker["ns"] for marker in markers[1:]] == [
        *(f"unseen {part}" for part in ("ground", "outline", "band", "label")),
        *(f"static {part}" for part in ("ground", "outline", "label")),
    ]
    labels = [marker["text"] for marker in markers[1:] if "text" in marker]
    assert labels == ["UNSEEN (unseen)\n4 m2", "S1 (static)\n4 m2"]
    # Nor has one whose ground the map lacks in part.
    beyond = ZoneSet((drawn_zone(outline, leaves_map=True),), 0.5, 0.0, 0, 0.0)
    assert "crowd band" not in [marker["ns"] for marker in zone_markers(beyond, 0, None)["markers"][1:]]


def test_zones_of_others_are_written_once_and_closed_at_every_instant(tmp_path: Path) -> None:
    """At every instant, those of a national file took ten minutes and a gigabyte for a flight of seconds."""
    history, grid = small_run()
    others = drawn_zone(shapely.box(5, 3, 7, 5), id="S1", kind="static", probability_max=float("nan"))
    sets = [replace(zones, static=(others,)) for zones in history.sets]
    counts = write_results_mcap(tmp_path / "results.mcap", replace(history, sets=sets), grid)
    assert (counts[topics.ZONES], counts[topics.OTHERS]) == (3, 1)
    messages = by_rosbags(tmp_path / "results.mcap")
    drawn = {
        topic: [
            sorted({marker.ns.split()[0] for marker in array.markers[1:]})
            for name, _, array in messages
            if name == topic
        ]
        for topic in (topics.ZONES, topics.OTHERS)
    }
    assert drawn == {topics.ZONES: [["crowd"]] * 3, topics.OTHERS: [["static"]]}
    with AnyReader([tmp_path / "results.mcap"]) as reader:
        (profile,) = (
            one.ext.offered_qos_profiles for one in reader.connections if one.topic == topics.OTHERS
        )
    assert profile[0].durability == QosDurability.TRANSIENT_LOCAL
    grids = [np.array(one.data).reshape(5, 7) for topic, _, one in messages if topic == topics.CLOSED]
    assert all((cells[3:, 5:] == OCCUPIED).all() for cells in grids)


def test_the_local_frame_lies_where_its_anchor_is() -> None:
    message = earth_from_map(ANCHOR, 7)
    assert (message["header"]["frame_id"], message["child_frame_id"]) == ("earth", "map")
    turn, place = message["transform"]["rotation"], message["transform"]["translation"]
    earth = [place[axis] for axis in "xyz"]
    np.testing.assert_allclose(earth, earth_centred(46.5, 8.0, 1200.0), atol=1e-6)
    rotation = Rotation.from_quat([turn[axis] for axis in "xyzw"])
    np.testing.assert_allclose(rotation.as_matrix().T, local_axes(46.5, 8.0), atol=1e-12)


def test_what_is_sent_once_is_kept_for_latecomers(written: Path) -> None:
    with AnyReader([written]) as reader:
        kept = {
            connection.topic
            for connection in reader.connections
            if any(
                qos.durability == QosDurability.TRANSIENT_LOCAL for qos in connection.ext.offered_qos_profiles
            )
        }
    assert kept == {topics.TF_STATIC, topics.TERRAIN, topics.CLOSED, topics.BELIEF, topics.GROUND}


def test_zones_alone_where_a_run_kept_no_map(tmp_path: Path) -> None:
    history, _ = small_run(georeference=None)
    assert write_results_mcap(tmp_path / "zones.mcap", history, None) == {topics.ZONES: 3}
    assert {topic for topic, _, _ in by_mcap(tmp_path / "zones.mcap")} == {topics.ZONES}


def test_the_terrain_is_where_its_voxels_are_and_stays_small() -> None:
    heights = np.add.outer(np.arange(300), np.zeros(200)).astype(int)
    indices = np.stack([*np.nonzero(np.ones(heights.shape)), heights.ravel()], axis=1)
    flat = np.zeros(heights.size)
    grid = SurfaceGrid.from_voxels(
        indices, 1.0, (0.0, 0.0, 0.0), flat, np.full(heights.size, VoxelState.EMPTY.value)
    )
    (marker,) = terrain_mesh(grid, 0)["markers"]
    assert 0 < len(marker["points"]) <= 6 * 20_000 and len(marker["colors"]) == len(marker["points"])
    for point in marker["points"][::997]:
        # A slope of 1 in 1, at the middle of whose columns the tops lie half a voxel higher.
        assert point["z"] == pytest.approx(point["x"] + 0.5, abs=1e-9)
    found = height_at(grid)(np.array([[0.5, 0.5], [299.5, 199.5], [-5.0, 3.0]]))
    np.testing.assert_array_equal(found, [1.0, 300.0, 150.5])


LAYOUT = Path(__file__).parents[2] / "docs" / "foxglove-layout.json"


def test_the_layout_names_topics_that_exist() -> None:
    text = LAYOUT.read_text()
    layout = json.loads(text)
    assert set(layout) >= {"configById", "layout", "globalVariables"}
    parts = {"camera/image/compressed", "camera/camera_info", "heatmap", "heatmap/camera_info", "truth/depth"}
    ours = {getattr(topics, name) for name in ("ZONES", "OTHERS", "CLOSED", "BELIEF", "GROUND", "TERRAIN")}
    ours |= {f"/uav{number}/{part}" for number in (1, 2, 3) for part in parts}
    named = {word for word in text.split('"') if word.startswith("/")}
    assert named and named <= ours and {topics.ZONES, topics.OTHERS} <= named
    # The grids have the colours of our other pictures.
    assert "#{:02x}{:02x}{:02x}".format(*STATE_COLOURS[VoxelState.CROWD]) in text
