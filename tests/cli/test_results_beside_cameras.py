"""`convert --results` and `export --format mcap`: one file for a viewer."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

from crowdfence import Camera, CrowdMap, Georeference, Terrain, open_recording
from crowdfence.cli.app import app
from crowdfence.exports.octomap import write_terrain_octomap
from crowdfence.sources.mission.writer import MissionWriter
from crowdfence.zones.history import ZoneHistory
from support.small_crowd_maps import SURE, look
from support.small_zones import SECOND_NS, DrawnZones

START_NS = 1_767_225_600 * SECOND_NS
ANCHOR = Georeference(46.5, 8.0, 1200.0)
CAMERA = Camera.pinhole(32, 24, 19.0, 19.5, 16.25, 11.75)


def invoked(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.stdout, str(done.exception)


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    """Three frames, a second apart, with heatmaps of a quarter of the picture's size and depth in whole
    centimetres."""
    path = tmp_path / "flight.mcap"
    with MissionWriter(path, georeference=ANCHOR) as writer:
        writer.add_camera("uav1", CAMERA)
        for second in range(3):
            stamp_ns = START_NS + second * SECOND_NS
            writer.add_pose("uav1", stamp_ns, [second, 0, 10], (1.0, 0.0, 0.0, 0.0))
            depth_m = np.full((24, 32), 12.25, dtype=np.float32)
            writer.add_frame("uav1", stamp_ns, heatmap=np.full((6, 8), 9, np.uint8), depth_m=depth_m)
    return path


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Crowd on the western half of 6 x 4 m, of which the eastern third was never seen."""
    drawn = DrawnZones((6, 4))
    crowd = np.zeros((6, 4))
    crowd[:3] = 1.0
    sets = [drawn.step(crowd) for _ in range(3)]
    terrain: Terrain = drawn.terrain
    crowd_map = CrowdMap(terrain, SURE)
    last_ns = START_NS + 2 * SECOND_NS
    west = np.flatnonzero(terrain.voxel_indices(np.arange(24))[:, 0] < 4)
    is_crowd = terrain.voxel_indices(west)[:, 0] < 3
    look(crowd_map, "uav1", last_ns, west, np.where(is_crowd, 1.0, 0.5))
    folder = tmp_path / "run"
    folder.mkdir()
    stamps_ns = [START_NS + second * SECOND_NS for second in range(3)]
    ZoneHistory(stamps_ns, sets, ANCHOR, {"stale_after_s": 30.0}).write(folder / "zone_history.jsonl")
    crowd_map.save(folder / "crowd_map.crowdmap")
    write_terrain_octomap(folder / "terrain.bt", terrain)
    return folder


def test_heatmaps_that_a_detector_made_for_the_run_are_told_missing(
    mission: Path, run: Path, tmp_path: Path
) -> None:
    """The file holds the recorded ones; a run keeps none."""
    for heatmaps, told in (("model", True), ("recorded", False)):
        detector = {"heatmaps": heatmaps, "name": "crowdnet-s"}
        (run / "summary.json").write_text(json.dumps({"detector": detector}))
        words = ["convert", str(mission), "--results", str(run), "-o", str(tmp_path / f"{heatmaps}.mcap")]
        done = CliRunner().invoke(app, words)
        said = " ".join(done.stderr.split())
        assert done.exit_code == 0, done.exception
        assert ("the recorded heatmaps are in the file, not those that crowdnet-s made" in said) is told


def test_one_file_shows_the_cameras_and_what_was_found(mission: Path, run: Path, tmp_path: Path) -> None:
    both = tmp_path / "both.mcap"
    code, stdout, error = invoked("convert", mission, "--results", run, "-o", both, "--json")
    assert code == 0, error
    assert json.loads(stdout)["frames"] == {"uav1": 3}
    # It is still the recording.
    for before, after in zip(open_recording(mission).frames, open_recording(both).frames, strict=True):
        assert (before.stamp_ns, before.heatmap().tobytes()) == (after.stamp_ns, after.heatmap().tobytes())
        np.testing.assert_array_equal(before.depth_m(), after.depth_m())
    with AnyReader([both]) as reader:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        times = [stamp_ns for _, stamp_ns, _ in reader.messages()]
    assert times == sorted(times)
    assert kinds["/uav1/truth/depth"] == "sensor_msgs/msg/Image"  # no PNG, which viewers do not draw
    assert kinds["/crowdfence/zones"] == "visualization_msgs/msg/MarkerArray"
    with both.open("rb") as file:
        messages = [
            (channel.topic, decoded)
            for _, channel, _, decoded in make_reader(
                file, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages()
        ]
    told = Counter(topic for topic, _ in messages)
    assert (told["/crowdfence/zones"], told["/uav1/heatmap"], told["/tf_static"]) == (3, 3, 1)
    closed = [message for topic, message in messages if topic == "/crowdfence/closed"]
    rows = np.array(closed[-1].data).reshape(4, 6)
    # Crowd, known to be empty (or touched by the zone's edge), never seen.
    assert (rows[:, :3] == 100).all() and -1 not in rows[:, 3] and (rows[:, 4:] == -1).all()


def test_a_heatmap_has_a_camera_of_its_size(mission: Path) -> None:
    with AnyReader([mission]) as reader:
        latest = {
            connection.topic: reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
        }
    heatmap, info = latest["/uav1/heatmap"], latest["/uav1/heatmap/camera_info"]
    assert (info.width, info.height) == (heatmap.width, heatmap.height) == (8, 6)
    matrix = info.k.reshape(3, 3)
    ray = np.array([0.2, -0.1, 1.0])
    column, row, _ = matrix @ ray
    # A cell is 4 pixels wide; ROS counts from the middle of the first one.
    np.testing.assert_allclose(np.array([column, row]) + 0.5, CAMERA.project([ray])[0] / 4, atol=1e-12)


def test_results_of_another_flight_are_refused(mission: Path, run: Path, tmp_path: Path) -> None:
    history = ZoneHistory.read(run / "zone_history.jsonl")
    later = [stamp_ns + 3600 * SECOND_NS for stamp_ns in history.stamps_ns]
    between = [stamp_ns + SECOND_NS // 3 for stamp_ns in history.stamps_ns]  # as of another simulated flight
    elsewhere = Georeference(47.0, 8.0, 1200.0)
    for stamps_ns, anchor, reason in (
        (later, ANCHOR, "no frame of it has the stamp of an instant"),
        (between, ANCHOR, "no frame of it has the stamp of an instant"),
        (history.stamps_ns, elsewhere, "its local frame lies elsewhere"),
    ):
        ZoneHistory(stamps_ns, history.sets, anchor, {}).write(run / "zone_history.jsonl")
        both = tmp_path / "both.mcap"
        code, _, error = invoked("convert", mission, "--results", run, "-o", both)
        assert code != 0 and reason in error and not both.exists()


def test_a_run_without_its_map_shows_zones_alone(run: Path, tmp_path: Path) -> None:
    whole, alone = tmp_path / "whole.mcap", tmp_path / "alone.mcap"
    told = json.loads(invoked("export", run, "-f", "mcap", "-o", whole, "--json")[1])
    assert told["messages"]["/crowdfence/zones"] == 3 and told["messages"]["/crowdfence/belief"] == 1
    (run / "crowd_map.crowdmap").unlink()
    told = json.loads(invoked("export", run, "-f", "mcap", "-o", alone, "--json")[1])
    assert set(told["messages"]) == {"/crowdfence/zones", "/tf_static"}


def test_what_the_messages_leave_out_is_told(run: Path, tmp_path: Path) -> None:
    """Zones of others that close no ground, and ground that lies beyond the grids."""
    square = np.array([[8.0, 46.5], [8.001, 46.5], [8.001, 46.501], [8.0, 46.501], [8.0, 46.5]])
    shapes = [
        {"type": "Point", "coordinates": [8.0, 46.5]},
        {"type": "Polygon", "coordinates": [square.tolist()]},
    ]
    others = tmp_path / "others.geojson"
    others.write_text(json.dumps({"type": "GeometryCollection", "geometries": shapes}))
    words = ["export", str(run), "-f", "mcap", "-o", str(tmp_path / "m.mcap"), "--static-zones", str(others)]
    done = CliRunner().invoke(app, words)
    told = " ".join(done.stderr.split())
    assert done.exit_code == 0 and "not all of S1 lies within it" in told
    assert "others.geojson: feature 1: a Point closes no ground" in told
    features = [
        {"type": "Feature", "id": f"A{n}", "properties": {}, "geometry": shapes[1]} for n in range(14)
    ]
    others.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    done = CliRunner().invoke(app, [*words, "--force"])
    assert "not all of A0, A1, A2" in done.stderr
    assert "A11 and 2 more lies within it" in " ".join(done.stderr.split())
    done = CliRunner().invoke(app, [*words, "--force", "--json"])
    assert len(json.loads(done.stdout)["beyond_raster"]) == 14
