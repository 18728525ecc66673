"""Labels on a scene small enough to work out by hand: a plain, a camera that looks straight down, people."""

import errno
import json
import multiprocessing
import os
import shutil
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from crowdfence import Camera, Terrain
from crowdfence.detector_training.frame_store import _Arrays, _stored, store_missions
from crowdfence.detector_training.labels import training_labels
from crowdfence.errors import FrameError
from crowdfence.sources import open_recording
from crowdfence.sources.recorded_truth import CameraPose, FrameTruth, PeopleLog, RecordedPeople
from crowdfence.sources.recording import Frame, PixelSources, Recording
from crowdfence.truth.ground_labels import ground_cells
from support.small_recordings import flight, write_airsim

# 20 m above the plain with a focal length of 80 px, a cell of 4 px covers 1 m; the image covers 40 x 30 m and
# cell (row, column) lies 40 + column east and 75 - row north (its lower edge at 74 - row).
CAMERA = Camera.pinhole(160, 120, 80.0, 80.0, 80.0, 60.0)
EYE = np.array([60.0, 60.0, 20.0])
LOOKING_DOWN = np.array([0.0, 1.0, 0.0, 0.0])  # half a turn about x: y south, z down
PLAIN = Terrain.from_height_map(np.full((240, 240), -0.25), 0.5, origin=(0.0, 0.0, 0.0))
STAMP = 1_000_000_000


def people_at(*east_north: tuple[float, float], up: float = 0.0) -> RecordedPeople:
    position = np.array([[e, n, up] for e, n in east_north], np.float32).reshape(-1, 3)
    count = len(position)
    return RecordedPeople(
        STAMP, position, np.arange(1, count + 1, dtype=np.uint32), np.ones(count, np.uint32)
    )


def recording(
    people: RecordedPeople | None,
    depth_m: np.ndarray | float = 20.0,
    instances: np.ndarray | int = 0,
    regions: np.ndarray | int = 0,
    pose: CameraPose | None = None,
) -> Recording:
    def picture(values: np.ndarray | float, kind: type) -> np.ndarray:
        return np.broadcast_to(np.asarray(values, kind), (120, 160))

    pose = pose or CameraPose(EYE, LOOKING_DOWN)
    frame = Frame(
        "uav1",
        STAMP,
        CAMERA,
        pose.world_from_camera(),
        PixelSources(
            depth_m=lambda: picture(depth_m, np.float32),
            instances=lambda: picture(instances, np.uint16),
            regions=lambda: picture(regions, np.uint16),
        ),
        FrameTruth(pose=lambda: pose, exposure_ns=lambda: STAMP),
    )
    log = PeopleLog() if people is None else PeopleLog([STAMP], lambda stamp: people)
    return Recording("hand", ("uav1",), (frame,), None, None, (), (), {}, {}, log)


def ground(of: Recording) -> tuple[np.ndarray, np.ndarray]:
    cells = ground_cells(of.frames[0], of, PLAIN)
    return cells.share, cells.known


def test_the_ground_under_a_crowd_appears_where_the_camera_sees_it():
    # Three people on one line, a metre apart: the middle of cell (9, 20) is at (60.5, 65.5).
    crowd, known = ground(recording(people_at((59.5, 65.5), (60.5, 65.5), (61.5, 65.5))))
    assert known.all()
    assert crowd[9, 19:22].tolist() == [1.0] * 3
    # Ground reaches a metre around each person: 0.5 m into the cells beside the three, 0.5 m into the rows
    # above and below. Rays go through the quarters of a cell, 0.25 and 0.75 m from its edges.
    rows, columns = np.nonzero(crowd)
    assert rows.min() == 8 and rows.max() == 10
    assert columns.min() == 18 and columns.max() == 22
    assert crowd[9, 18] == crowd[9, 22] == crowd[8, 20] == crowd[10, 20] == 0.5


def test_the_outline_does_not_depend_on_the_voxels():
    """Ground at 0.2 m, in voxels that end at 0.25, 0.5 and 1 m. Seen at 20 degrees, the highest are met 2.2 m
    before the ground is."""
    crowd_at = [(60.0 + 1.2 * east, 90.0 + 1.2 * north) for east in range(6) for north in range(4)]
    tilt = np.radians(20.0)
    # x east, y down, z forward (north): turned about x by 90 degrees and then down by the tilt.
    half = (np.pi / 2 + tilt) / 2
    pose = CameraPose(np.array([63.0, 81.0, 4.0]), np.array([-np.cos(half), np.sin(half), 0.0, 0.0]))
    areas = []
    for size_m in (0.25, 0.5, 1.0):
        of = recording(people_at(*crowd_at, up=0.2), depth_m=1e3, pose=pose)
        count = int(120 / size_m)
        plain = Terrain.from_height_map(np.full((count, count), 0.2), size_m, origin=(0.0, 0.0, 0.0))
        areas.append(ground_cells(of.frames[0], of, plain).share)
    assert areas[0].sum() > 30
    for area in areas[1:]:
        assert np.minimum(area, areas[0]).sum() > 0.97 * np.maximum(area, areas[0]).sum()


def test_a_crowd_outside_the_image_labels_nothing():
    crowd, known = ground(recording(people_at((9.5, 65.5), (10.5, 65.5), (11.5, 65.5))))
    assert not crowd.any() and known.all()


def test_two_people_are_no_crowd():
    crowd, known = ground(recording(people_at((59.5, 65.5), (60.5, 65.5))))
    assert not crowd.any() and known.all()


def test_a_crowd_behind_a_tree_is_unknown_and_empty_ground_behind_it_is_not():
    depth_m = np.full((120, 160), 20.0)
    depth_m[:, :80] = 5.0  # a canopy over the western half
    crowd, known = ground(recording(people_at((59.5, 65.5), (60.5, 65.5), (61.5, 65.5)), depth_m))
    assert crowd[9, 19] == 1.0 and not known[9, 19]  # under the canopy
    assert crowd[9, 20] == 1.0 and known[9, 20]  # beside it
    assert known[0, 0] and crowd[0, 0] == 0  # under it, but nobody is there


def test_the_people_themselves_hide_nothing():
    depth_m = np.full((120, 160), 5.0)
    crowd, known = ground(
        recording(people_at((59.5, 65.5), (60.5, 65.5), (61.5, 65.5)), depth_m, instances=1)
    )
    assert crowd.any() and known.all()


def test_ground_labels_need_a_map_and_people():
    nobody_knows = recording(None)
    with pytest.raises(FrameError, match="nobody's position is recorded"):
        ground(nobody_knows)
    with pytest.raises(ValueError, match="without a map"):
        training_labels("ground", nobody_knows.frames[0], nobody_knows, None)


def test_training_wants_two_by_two_labels_in_a_cell():
    of = recording(people_at((59.5, 65.5), (60.5, 65.5), (61.5, 65.5)), np.full((120, 160), 20.0))
    labels, cells = training_labels("ground", of.frames[0], of, PLAIN), ground_cells(of.frames[0], of, PLAIN)
    assert labels.crowd.shape == labels.known.shape == (60, 80)
    # Half a metre into the row of cells above the three people is the lower half of those cells.
    assert labels.crowd[16:18, 40].tolist() == [0, 255]
    blocks = (labels.crowd / 255).reshape(30, 2, 40, 2)
    assert np.array_equal(blocks.mean(axis=(1, 3), dtype=np.float32), cells.share)


def test_silhouettes_are_shares_of_labels():
    regions = np.zeros((120, 160), int)
    regions[8:12, 21:22] = 3  # half of labels (4, 10) and (5, 10)
    regions[40, 40] = 1  # a quarter of label (20, 20)
    of = recording(None, regions=regions)
    crowd, known = training_labels("silhouettes", of.frames[0], of, None)
    assert crowd.shape == (60, 80)
    assert crowd[4:6, 10].tolist() == [128, 128] and crowd[20, 20] == 64
    assert np.count_nonzero(crowd) == 3 and known.all()


def test_the_missions_own_rule_says_what_a_crowd_is():
    of = recording(people_at((59.5, 65.5), (60.5, 65.5), (61.5, 65.5)))
    of.manifest["simulation"] = {"scenario": {"crowd_definition": {"min_people": 4, "radius_m": 2.0}}}
    crowd, _ = ground(of)
    assert not crowd.any()


DEMO = Path(__file__).parents[2] / "python" / "crowdfence" / "demo_data" / "race.mcap"


def test_stored_frames_are_those_of_the_recording(tmp_path: Path):
    (stored,) = store_missions([DEMO], ["silhouettes"], tmp_path)
    recorded = open_recording(DEMO)
    assert len(stored) == len(recorded.frames)
    assert stored.skipped == tuple(str(frame) for frame in recorded.refused)
    for index in (0, len(stored) // 2, len(stored) - 1):
        frame = recorded.frames[index]
        assert np.array_equal(stored.images[index], frame.image())
        share = (frame.regions() > 0).reshape(120, 2, 160, 2).mean(axis=(1, 3))
        assert np.abs(stored.crowd[index, 0] / 255 - share).max() <= 0.5 / 255 + 1e-9
    written = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    store_missions([DEMO], ["silhouettes"], tmp_path)
    assert {
        path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()
    } == written  # nothing done twice


def test_stored_frames_are_as_vibrant_as_the_model_is_shown_them(tmp_path: Path):
    from crowdfence._core import vibrant

    (plain,) = store_missions([DEMO], ["silhouettes"], tmp_path)
    (strong,) = store_missions([DEMO], ["silhouettes"], tmp_path, vibrance=3.0)
    np.testing.assert_array_equal(strong.images[0], vibrant(np.array(plain.images[0]), 3.0))
    assert (strong.images[0] != plain.images[0]).any()
    pictures = annotated(tmp_path / "p", 90)
    (plain,) = store_missions([pictures], ["ground"], tmp_path / "store")
    (strong,) = store_missions([pictures], ["ground"], tmp_path / "store", vibrance=3.0)
    np.testing.assert_array_equal(strong.images[0], vibrant(np.array(plain.images[0]), 3.0))


def test_frames_of_several_sizes_say_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    recording = open_recording(DEMO)
    wide = Camera.pinhole(640, 240, 300.0, 300.0, 320.0, 120.0)
    frames = [replace(one, camera=wide) if one.drone == "uav2" else one for one in recording.frames]
    of_two = replace(recording, frames=tuple(frames))
    monkeypatch.setattr("crowdfence.sources.open_recording", lambda _: of_two)
    with pytest.raises(ValueError, match=r"320 x 240 of uav1, uav3; 640 x 240 of uav2\), .* --without DRONE"):
        _stored(DEMO, ("silhouettes",), {}, 1.0, tmp_path / "part")


def test_a_store_without_room_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The frames are written into mapped files: on a full disk the system killed the process that wrote."""
    sizes = []

    def no_room(handle: int, begin: int, size: int) -> None:
        sizes.append(size)
        if len(sizes) == 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", no_room)
    with pytest.raises(OSError, match=r"No space left on device for 2 MB; make room, .*--store") as caught:
        _Arrays.create(tmp_path / "race", 100, 1, 240, 320)
    assert caught.value.filename == str(tmp_path / "race.crowd.npy")
    assert sizes[0] > 100 * 240 * 320 * 3 and list(tmp_path.iterdir()) == []


def test_a_killed_process_that_decodes_is_one_line(tmp_path: Path):
    def kill_the_first() -> None:
        while not (children := multiprocessing.active_children()):
            time.sleep(0.01)
        children[0].kill()

    with ThreadPoolExecutor(1) as thread:
        thread.submit(kill_the_first)
        with pytest.raises(OSError, match=r"was killed \(out of memory\?\); .* fewer --workers goes on"):
            store_missions([DEMO], ["silhouettes"], tmp_path)


def test_what_a_recording_refuses_and_warns_of_is_kept(tmp_path: Path):
    """A frame 500 hours after the others of its drone, and a label of no frame; told again by a store."""
    flown = flight(frames=4)
    stamps = flown.frame_stamps_ns["uav1"]
    flown = flown.with_frames("uav1", [*stamps[:3], stamps[3] + 500 * 3_600_000_000_000])
    mission = write_airsim(tmp_path / "mission", flown)
    labels = sorted((mission / "truth" / "regions").iterdir())
    shutil.copyfile(labels[0], labels[0].with_name("region_uav1_1760000000999999999.png"))
    for _ in range(2):
        (stored,) = store_missions([mission], ["silhouettes"], tmp_path / "store")
        assert len(stored) == 11 and len(stored.skipped) == 1 and "jumps 500.00 h" in stored.skipped[0]
        assert len(stored.doubts) == 1 and "belong" in stored.doubts[0]


def test_an_interrupted_store_is_made_again(tmp_path: Path):
    store_missions([DEMO], ["silhouettes"], tmp_path)
    (description,) = tmp_path.glob("*.json")
    facts = json.loads(description.read_text())
    description.unlink()  # written last: without it the arrays may be half empty
    (images,) = tmp_path.glob("*.images.npy")
    images.write_bytes(images.read_bytes()[:1000])
    (stored,) = store_missions([DEMO], ["silhouettes"], tmp_path)
    assert len(stored) == facts["frames"]


def annotated(folder: Path, grey: int, *, sizes: Sequence[tuple[int, int]] = ((64, 48),)) -> Path:
    """Pictures (width, height) of one grey, 1.png and on; in each a crowd and a mark that means nothing."""
    folder.mkdir(exist_ok=True)
    images, annotations = [], []
    for number, (width, height) in enumerate(sizes, start=1):
        name = f"{number}.png"
        Image.new("RGB", (width, height), (grey, grey, grey)).save(folder / name)
        images.append({"id": number, "file_name": name, "width": width, "height": height})
        for category in (1, 2):
            annotations.append({"image_id": number, "category_id": category, "bbox": [0, 0, 2, 2]})
    categories = [{"id": 1, "name": "crowd"}, {"id": 2, "name": "rider"}]
    document = {"images": images, "annotations": annotations, "categories": categories}
    (folder / "annotations.json").write_text(json.dumps(document))
    return folder


def test_classes_that_mean_nothing_are_doubts_of_annotated_pictures(tmp_path: Path):
    (stored,) = store_missions([annotated(tmp_path / "p", 90)], ["ground"], tmp_path / "store")
    assert len(stored.doubts) == 1 and "that mean nothing here: rider" in stored.doubts[0]


def test_pictures_keep_their_sizes_and_those_of_less_than_a_cell_are_skipped(tmp_path: Path):
    pictures = annotated(tmp_path / "p", 90, sizes=[(97, 61), (70, 3), (64, 48)])
    (stored,) = store_missions([pictures], ["ground"], tmp_path / "store")
    assert [stored.size_of(frame) for frame in range(len(stored))] == [(60, 96), (48, 64)]
    assert (
        len(stored.skipped) == 1
        and "2.png" in stored.skipped[0]
        and "less than 4 pixels" in stored.skipped[0]
    )


def test_a_picture_that_was_changed_is_decoded_again(tmp_path: Path):
    """A damaged picture that was mended stayed out, and one that was replaced was learned as it had been."""
    pictures = annotated(tmp_path / "p", 90, sizes=[(64, 48)] * 2)
    whole = (pictures / "2.png").read_bytes()
    (pictures / "2.png").write_bytes(b"damaged")
    (stored,) = store_missions([pictures], ["ground"], tmp_path / "store")
    assert len(stored) == 1 and len(stored.skipped) == 1
    (pictures / "2.png").write_bytes(whole)
    (stored,) = store_missions([pictures], ["ground"], tmp_path / "store")
    assert len(stored) == 2 and stored.skipped == ()
    Image.new("RGB", (64, 48), (30, 30, 30)).save(pictures / "1.png")
    (stored,) = store_missions([pictures], ["ground"], tmp_path / "store")
    assert stored.images[0].max() == 30
    description = next((tmp_path / "store").glob("*.json"))
    made_ns = description.stat().st_mtime_ns
    store_missions([pictures], ["ground"], tmp_path / "store")
    assert description.stat().st_mtime_ns == made_ns


def test_a_map_that_was_changed_labels_the_ground_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = tmp_path / "f"
    folder.mkdir()
    for path in (DEMO, *DEMO.parent.glob("race.*")):
        shutil.copyfile(path, folder / path.name)
    mission = open_recording(folder / DEMO.name)
    assert mission.terrain is not None and mission.terrain.parent == folder
    few = replace(mission, frames=mission.frames[:2])
    monkeypatch.setattr("crowdfence.sources.open_recording", lambda path: few)
    part = tmp_path / "part"

    def store() -> int:
        _stored(folder / DEMO.name, ("ground",), {}, 1.0, part)
        return part.with_suffix(".json").stat().st_mtime_ns

    made_ns = store()
    assert store() == made_ns
    os.utime(mission.terrain, (1, 1))
    assert store() > made_ns


def test_a_store_of_which_a_part_is_gone_is_made_again(tmp_path: Path):
    pictures = annotated(tmp_path / "p", 90)
    store_missions([pictures], ["ground"], tmp_path / "store")
    next((tmp_path / "store").glob("*.known.npy")).unlink()
    (stored,) = store_missions([pictures], ["ground"], tmp_path / "store")
    assert len(stored) == 1
    next((tmp_path / "store").glob("*.json")).write_text('{"name": ')
    (stored,) = store_missions([pictures], ["ground"], tmp_path / "store")
    assert len(stored) == 1
