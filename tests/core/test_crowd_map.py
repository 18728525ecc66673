"""`crowdfence.CrowdMap` from Python: files, threads, and input that is refused with nothing lost."""

import errno
import math
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Sequence
from multiprocessing import Pipe, get_all_start_methods, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence import (
    Camera,
    CrowdMap,
    Or,
    Paper,
    Rates,
    StampError,
    Terrain,
    View,
    VoxelState,
    atomic_file,
    project,
)

SECOND_NS = 1_000_000_000
START_NS = 1_700_000_000 * SECOND_NS
RATES = Rates(0.9, 0.05)
SIDE = 16
CAMERA = Camera.pinhole(8, 6, 8.0, 8.0, 4.0, 3.0)


def _floor(origin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Terrain:
    return Terrain.from_occupancy(np.ones((SIDE, SIDE, 1), bool), 1.0, origin)


def _pose(x: float = SIDE / 2, y: float = SIDE / 2, z: float = 9.0) -> NDArray[np.float64]:
    """Straight down."""
    world_from_camera = np.diag([1.0, -1.0, -1.0, 1.0])
    world_from_camera[:3, 3] = (x, y, z)
    return world_from_camera


def _view(
    drone: str = "a",
    after_s: float = 0.0,
    heatmap: Any = None,
    pose: Any = None,
    camera: Camera = CAMERA,
) -> View:
    heatmap = np.full((6, 8), 0.75, np.float32) if heatmap is None else heatmap
    return View(drone, _at(after_s), camera, _pose() if pose is None else pose, heatmap)


def _at(after_s: float) -> int:
    return START_NS + round(after_s * 1e9)


def _crowd_map(fleet_size: int = 3, **options: Any) -> CrowdMap:
    """Two drones, two instants, a second apart."""
    crowd_map = CrowdMap(_floor(), Paper(RATES, 0.2, fleet_size=fleet_size), **options)
    crowd_map.integrate([_view("a", 0.0), _view("b", 0.1, pose=_pose(x=4.0))], _at(0.0))
    crowd_map.integrate([_view("b", 1.0, np.zeros((6, 8), np.uint8))], _at(1.0))
    return crowd_map


# --- files


@pytest.mark.parametrize("method", [Paper(RATES, 0.2, alpha=0.3, fleet_size=2, initial="prior"), Or()])
def test_a_loaded_map_goes_on_as_the_saved_one(tmp_path: Path, method: Paper | Or) -> None:
    terrain = _floor((691_608.0, 5_334_760.0, 500.0))
    pose = _pose(691_616.0, 5_334_768.0, 509.0)
    rng = np.random.default_rng(1)
    heatmaps = rng.random((6, 6, 8), np.float32)
    saved = CrowdMap(terrain, method, max_range_m=50.0, coverage="full", max_gap_s=10.0)
    for second in range(3):
        saved.integrate([_view("a", second, heatmaps[second], pose)], _at(second))
    saved.save(tmp_path / "crowd.map")
    loaded = CrowdMap.load(tmp_path / "crowd.map", terrain)

    assert loaded.method == method
    assert (loaded.span_ns, loaded.instant_count) == (saved.span_ns, saved.instant_count)
    assert loaded.drones == saved.drones
    np.testing.assert_array_equal(loaded.last_seen_ns(), saved.last_seen_ns())
    for crowd_map in (saved, loaded):
        for second in range(3, 6):
            crowd_map.integrate([_view("b", second, heatmaps[second], pose)], _at(second))
    np.testing.assert_array_equal(loaded.probability(_at(60)), saved.probability(_at(60)))
    np.testing.assert_array_equal(loaded.state(_at(60)), saved.state(_at(60)))
    assert loaded.to_bytes() == saved.to_bytes()
    with pytest.raises(ValueError, match="max_gap_s is 10 s"):
        loaded.integrate([], _at(16))


def test_saving_replaces_the_file_in_one_step(tmp_path: Path) -> None:
    path = tmp_path / "crowd.map"
    crowd_map = _crowd_map()
    crowd_map.save(path)
    crowd_map.integrate([], _at(2.0))
    crowd_map.save(str(path))
    assert CrowdMap.load(str(path), crowd_map.terrain).to_bytes() == crowd_map.to_bytes()
    assert os.listdir(tmp_path) == ["crowd.map"]


@pytest.mark.parametrize("step", ["write_bytes", "fsync", "replace"])
def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    path = tmp_path / "crowd.map"
    crowd_map = _crowd_map()
    crowd_map.save(path)
    before = path.read_bytes()

    def disk_full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    crowd_map.integrate([], _at(2.0))
    with monkeypatch.context() as patch:
        if step == "write_bytes":
            patch.setattr(Path, "write_bytes", disk_full)
        else:
            patch.setattr(atomic_file.os, step, disk_full)
        with pytest.raises(OSError, match="No space left"):
            crowd_map.save(path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["crowd.map"]


def test_a_map_of_another_terrain_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "crowd.map"
    _crowd_map().save(path)
    one_voxel_less = np.ones((SIDE, SIDE, 1), bool)
    one_voxel_less[3, 3] = False
    for other in (_floor((0.5, 0.0, 0.0)), Terrain.from_occupancy(one_voxel_less, 1.0)):
        with pytest.raises(ValueError, match=re.escape(f"{path}: crowd map belongs to another terrain")):
            CrowdMap.load(path, other)


def test_a_truncated_file_is_refused_at_every_length(tmp_path: Path) -> None:
    terrain, data = _floor(), _crowd_map().to_bytes()
    path = tmp_path / "crowd.map"
    # All of the header and the tail, and steps in between.
    lengths = sorted({*range(260), *range(260, len(data), 97), *range(len(data) - 20, len(data))})
    for length in lengths:
        with pytest.raises(ValueError, match="crowd map"):
            CrowdMap.from_bytes(data[:length], terrain)
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(ValueError, match=re.escape(f"{path}: crowd map is damaged at byte {len(data) // 2}")):
        CrowdMap.load(path, terrain)


def test_one_flipped_bit_is_noticed_wherever_it_is() -> None:
    terrain, data = _floor(), _crowd_map().to_bytes()
    rng = np.random.default_rng(2)
    for byte in (*range(60), *rng.integers(60, len(data), 200).tolist(), len(data) - 1):
        flipped = bytearray(data)
        flipped[byte] ^= 1 << rng.integers(8)
        with pytest.raises(ValueError, match="crowd map"):
            CrowdMap.from_bytes(bytes(flipped), terrain)


def test_a_file_of_another_kind_version_or_place_says_so(tmp_path: Path) -> None:
    path = tmp_path / "crowd.map"
    newer = bytearray(_crowd_map().to_bytes())
    newer[8:12] = (9).to_bytes(4, "little")
    for content, message in (
        (b"", "not a crowd map: the file is too short"),
        (b"\x89PNG" + bytes(100), "not a crowd map: it does not begin with CROWDMAP"),
        (bytes(newer), "crowd map has format version 9; this build reads version 1"),
    ):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=re.escape(f"{path}: {message}")):
            CrowdMap.load(path, _floor())
    with pytest.raises(FileNotFoundError, match="missing.map"):
        CrowdMap.load(tmp_path / "missing.map", _floor())


# --- threads


def test_python_runs_while_a_view_is_projected() -> None:
    """The other thread gets its turn only when the interpreter is released; it is never taken by force."""
    camera = Camera.pinhole(640, 480, 300.0, 300.0, 320.0, 240.0)
    view = _view(heatmap=np.full((480, 640), 0.5, np.float32), camera=camera)
    terrain = Terrain.from_occupancy(np.ones((300, 300, 1), bool), 1.0 / 16.0)
    stop = threading.Event()
    turns = 0

    def count() -> None:
        nonlocal turns
        while not stop.is_set():
            turns += 1
            time.sleep(0)

    counter = threading.Thread(target=count)
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(1000.0)
    try:
        counter.start()
        turns_while_projecting = 0
        for _ in range(200):
            before = turns
            project(view, terrain, max_range_m=100.0)
            turns_while_projecting += turns - before
            if turns_while_projecting > 0:
                break
    finally:
        sys.setswitchinterval(interval_s)
        stop.set()
        counter.join()
    assert turns_while_projecting > 0


def test_a_reader_sees_whole_instants_while_another_thread_integrates() -> None:
    rng = np.random.default_rng(3)
    heatmaps = rng.random((40, 6, 8), np.float32)
    views = [[_view("a", second, heatmap)] for second, heatmap in enumerate(heatmaps)]
    read_at = _at(1000.0)
    method = Paper(RATES, 0.2, alpha=0.5, fleet_size=1)
    alone = CrowdMap(_floor(), method)
    after = [alone.probability(read_at)]
    for second, view in enumerate(views):
        alone.integrate(view, _at(second))
        after.append(alone.probability(read_at))

    shared = CrowdMap(_floor(), method)
    readings: list[NDArray[np.float64]] = []
    done = threading.Event()

    def read() -> None:
        while not done.is_set():
            readings.append(shared.probability(read_at))

    reader = threading.Thread(target=read)
    reader.start()
    for second, view in enumerate(views):
        shared.integrate(view, _at(second))
        time.sleep(0.0005)
    done.set()
    reader.join()
    instants = 0
    for reading in readings:
        while not np.array_equal(reading, after[instants]):
            instants += 1
            assert instants < len(after), "a reading between two instants, or older than the one before"
    assert len(readings) > 1


def _fly_forked(generations: int, answer: Connection) -> None:
    crowd_map = CrowdMap(_floor(), Or())
    crowd_map.integrate([_view("a", 0.0)], _at(0.0))
    answer.send(crowd_map.to_bytes())
    if generations > 1:
        child = get_context("fork").Process(target=_fly_forked, args=(generations - 1, answer))
        child.start()
        child.join()


@pytest.mark.skipif("fork" not in get_all_start_methods(), reason="this system does not fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_works_without_the_threads_of_its_parent() -> None:
    """It would wait for them for ever, and so would a child of it."""
    answers, answer = Pipe(duplex=False)
    crowd_map = CrowdMap(_floor(), Or())
    crowd_map.integrate([_view("a", 0.0)], _at(0.0))
    child = get_context("fork").Process(target=_fly_forked, args=(2, answer))
    child.start()
    try:
        for _ in range(2):
            assert answers.poll(60), "the forked process hangs"
            assert answers.recv() == crowd_map.to_bytes()
        child.join(60)
        assert child.exitcode == 0
    finally:
        child.kill()
        child.join()


# --- fleets


def test_drones_come_and_go() -> None:
    crowd_map = CrowdMap(_floor(), Paper(RATES, 0.2, fleet_size=3))
    for second, drones in enumerate((["a"], ["a", "b"], [], ["c"], ["c", "a"])):
        update = crowd_map.integrate([_view(drone, second) for drone in drones], _at(second))
        assert len(update.observations) == len(drones)
        assert (len(update.voxel_ids) > 0) == bool(drones)
    assert crowd_map.instant_count == 5


def test_terrain_and_views_that_do_not_overlap_leave_everything_unseen() -> None:
    crowd_map = CrowdMap(_floor(), Paper(RATES, 0.2, fleet_size=1), coverage="full")
    update = crowd_map.integrate([_view(pose=_pose(x=1e4))], _at(0.0))
    assert len(update.voxel_ids) == 0
    assert not crowd_map.seen().any()
    assert (crowd_map.state(_at(0.0)) == VoxelState.NEVER_SEEN).all()
    assert (crowd_map.last_seen_ns() == -1).all()


def test_states_through_python() -> None:
    crowd_map = CrowdMap(_floor(), Paper(RATES, 0.2, alpha=1.0, decay=0.0, fleet_size=1))
    heatmap = np.zeros((6, 8), np.float32)
    heatmap[0] = 1.0
    crowd_map.integrate([_view(heatmap=heatmap)], _at(0.0))
    # 8 m above the floor with f = 8 px, a pixel is 1 m: the image covers x 4 to 12, y 5 to 11, north first.
    state = crowd_map.state(_at(10.0), threshold=0.5)
    x, y, _ = crowd_map.terrain.voxel_indices(np.arange(SIDE * SIDE)).T
    in_view = (x >= 4) & (x < 12) & (y >= 5) & (y < 11)
    assert (state[~in_view] == VoxelState.NEVER_SEEN).all()
    assert (state[in_view & (y == 10)] == VoxelState.CROWD).all()
    assert (state[in_view & (y < 10)] == VoxelState.EMPTY).all()
    later = crowd_map.state(_at(31.0), threshold=0.5)
    assert (later[in_view & (y < 10)] == VoxelState.STALE).all()
    assert (crowd_map.state(_at(31.0), threshold=0.5, stale_after_s=31.0) == state).all()
    np.testing.assert_array_equal(crowd_map.seen(), in_view)
    np.testing.assert_array_equal(crowd_map.seen_ids(), np.flatnonzero(in_view))
    assert crowd_map.seen_count == np.count_nonzero(in_view)
    seen_ids, probability = crowd_map.seen_probability(_at(31.0))
    np.testing.assert_array_equal(seen_ids, np.flatnonzero(in_view))
    np.testing.assert_array_equal(probability, crowd_map.probability(_at(31.0), seen_ids))


# --- what is refused


def _scaled_pose() -> NDArray[np.float64]:
    pose = _pose()
    pose[:3, :3] *= 1.01
    return pose


def _changed(array: NDArray[Any], at: tuple[int, int], value: float) -> NDArray[Any]:
    array = array.copy()
    array[at] = value
    return array


FINE = np.full((6, 8), 0.5, np.float32)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: _view(heatmap=_changed(FINE, (2, 5), math.nan)), "heatmap value at row 2, column 5 is NaN"),
        (lambda: _view(heatmap=_changed(FINE, (2, 5), math.inf)), "heatmap value at row 2, column 5 is inf"),
        (lambda: _view(heatmap=_changed(FINE, (2, 5), -0.01)), "column 5 is -0.01; it must be inside [0, 1]"),
        (lambda: _view(heatmap=_changed(FINE, (2, 5), 1.5)), "column 5 is 1.5; it must be inside [0, 1]"),
        (lambda: _view(heatmap=np.full((6, 8), 255)), "row 0, column 0 is 255; it must be inside [0, 1]"),
        (lambda: _view(heatmap=np.zeros((6, 8, 1))), "heatmap has shape [6, 8, 1]; it must be [N, N]"),
        (lambda: _view(heatmap=np.zeros(48)), "heatmap has shape [48]; it must be [N, N]"),
        (lambda: _view(heatmap=np.zeros((0, 8))), "heatmap of 0 x 8 (rows x columns) is empty"),
        (lambda: _view(heatmap=np.zeros((0, 0), np.uint8)), "heatmap of 0 x 0 (rows x columns) is empty"),
        (
            lambda: _view(heatmap=np.zeros((8, 6))),
            "heatmap of 8 x 6 (rows x columns) is no reduction of an image",
        ),
        (lambda: _view(heatmap=np.zeros((12, 16))), "image of 6 x 8 by one stride"),
        (lambda: _view(heatmap=np.zeros((6, 8), complex)), "heatmap has elements of type complex128"),
        (lambda: _view(heatmap=[["x"]]), "heatmap has elements of type <U1"),
        (lambda: _view(pose=_scaled_pose()), "pose is not rigid: R^T R is off by 2.010e-2, bound 1e-4"),
        (lambda: _view(pose=np.diag([1.0, 1.0, -1.0, 1.0])), "pose is not rigid: det R is off by 2"),
        (lambda: _view(pose=np.zeros((4, 4))), "pose is not rigid: the last row is off by 1"),
        (lambda: _view(pose=np.diag([0.0, 0.0, 0.0, 1.0])), "pose is not rigid: R^T R is off by 1"),
        (lambda: _view(pose=_changed(_pose(), (1, 3), math.nan)), "pose holds NaN at row 1, column 3"),
        (lambda: _view(pose=_changed(_pose(), (0, 0), math.inf)), "pose holds inf at row 0, column 0"),
        (lambda: _view(pose=_pose()[:3]), "world_from_camera has shape [3, 4]; it must be [4, 4]"),
        (lambda: _view(drone=""), "drone name is empty"),
        (
            lambda: Camera.pinhole(8, 6, 0.0, 8.0, 4.0, 3.0),
            "focal length fx is 0 pixels: it must be positive",
        ),
        (lambda: Camera.pinhole(8, 6, 1e300, 8.0, 4.0, 3.0), "focal length fx is 1e300 pixels"),
        (lambda: Camera.pinhole(8, 6, 8.0, 8.0, 1e300, 3.0), "principal point cx is 1e300 pixels"),
        (
            lambda: Camera.pinhole(8, 6, 8.0, 8.0, 4.0, 3.0, (1e300, 0.0, 0.0, 0.0)),
            "distortion coefficient k1 is 1e300",
        ),
        (
            lambda: Camera.pinhole(8, 6, 8.0, -8.0, 4.0, 3.0),
            "focal length fy is -8 pixels: it must be positive",
        ),
        (lambda: Paper(RATES, 0.0, fleet_size=3), "prior is 0; it must be strictly between 0 and 1"),
        (lambda: Paper(RATES, 1.0, fleet_size=3), "prior is 1; it must be strictly between 0 and 1"),
        (lambda: Paper(RATES, 0.2, fleet_size=3, alpha=0.0), "alpha is 0; it must be in (0, 1]"),
        (
            lambda: Paper(RATES, 0.2, fleet_size=3, decay=-1.0),
            "decay is -1; it must be finite and >= 0",
        ),
        (
            lambda: Paper(RATES, 0.2, fleet_size=3, b_threshold=-0.5),
            "b_threshold is -0.5; it must be in [0, 1)",
        ),
        (
            lambda: Paper(RATES, 0.2, fleet_size=3, initial="one"),  # type: ignore[arg-type]
            'initial is "one"; it must be "zero", "prior" or "first"',
        ),
        (
            lambda: Paper(RATES, 0.2, fleet_size=3, decay_unit="hour"),  # type: ignore[arg-type]
            'decay_unit is "hour"; it must be "second" or "frame"',
        ),
        (lambda: Paper(RATES, 0.2, fleet_size=0), "fleet_size is 0; it must be in [1, 10000]"),
        (lambda: Paper(RATES, 0.2, fleet_size=-1), "fleet_size is -1; it must be in [1, 10000]"),
        (lambda: Paper(RATES, 0.2, fleet_size=10**4 + 1), "fleet_size is 10001; it must be in [1, 10000]"),
        (lambda: Paper(RATES, 0.2, fleet_size=10**30), f"fleet_size is {10**30}; it must be in [1, 10000]"),
        (lambda: Or(b_threshold=1.1), "b_threshold is 1.1; it must be in [0, 1)"),
        (lambda: Or(b_threshold=1.0), "b_threshold is 1; it must be in [0, 1): no value is above 1"),
        (
            lambda: CrowdMap(_floor(), Or(), max_range_m=0.0),
            "max_range_m is 0; it must be finite and > 0",
        ),
        (lambda: CrowdMap(_floor(), Or(), max_gap_s=0.0), "max_gap_s is 0; it must be > 0"),
        (
            lambda: CrowdMap(_floor(), Or(), max_gap_s=math.nan),
            "max_gap_s is NaN; it must be > 0",
        ),
    ],
)
def test_a_view_or_method_that_cannot_be_used_is_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        make()


def _integrate(
    drones: Sequence[str], instant_s: float, view_s: float | None = None
) -> Callable[[CrowdMap], object]:
    def call(crowd_map: CrowdMap) -> object:
        stamp_s = instant_s if view_s is None else view_s
        return crowd_map.integrate([_view(drone, stamp_s) for drone in drones], _at(instant_s))

    return call


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (_integrate(["a"], 0.5), f"stamp {_at(0.5)} ns is not after the last instant, {_at(1.0)} ns"),
        (_integrate(["a"], 1.0), f"stamp {_at(1.0)} ns is not after the last instant, {_at(1.0)} ns"),
        (_integrate(["a"], 3602.0), "is 3601 s after the last instant; the bound max_gap_s is 3600 s"),
        (_integrate(["a"], 2.0, view_s=7202.0), "view of drone 'a' is stamped 7200 s away from its instant"),
        (
            _integrate(["a"], 2.0, view_s=-7198.0),
            "view of drone 'a' is stamped -7200 s away from its instant",
        ),
        (_integrate(["a", "b", "a"], 2.0), "drone 'a' appears twice in one instant"),
        (_integrate(["a", "c", "d"], 2.0), "drone 'd' makes the fleet 4 drones large; fleet_size is 3"),
        (lambda crowd_map: crowd_map.probability(_at(0.9)), "a crowd map cannot be read in its past"),
        (lambda crowd_map: crowd_map.state(_at(0.9)), "a crowd map cannot be read in its past"),
        (lambda crowd_map: crowd_map.probability(_at(2.0), [256]), "voxel id 256 does not exist"),
        (lambda crowd_map: crowd_map.probability(_at(2.0), [0.5]), "ids has elements of type float64"),
        (
            lambda crowd_map: crowd_map.seen_by(crowd_map.seen()),
            "ids has elements of type bool; they must be int64: np.flatnonzero gives the places of a mask",
        ),
        (lambda crowd_map: crowd_map.state(_at(2.0), threshold=0.0), "threshold is 0; it must be in (0, 1]"),
        (
            lambda crowd_map: crowd_map.state(_at(2.0), threshold=math.nan),
            "threshold is NaN; it must be in (0, 1]",
        ),
        (
            lambda crowd_map: crowd_map.state(_at(2.0), stale_after_s=-1.0),
            "stale_after_s is -1; it must be >= 0",
        ),
    ],
)
def test_what_a_map_refuses_leaves_it_as_it_was(call: Callable[[CrowdMap], object], message: str) -> None:
    crowd_map = _crowd_map()
    before = crowd_map.to_bytes()
    with pytest.raises(ValueError, match=re.escape(message)):
        call(crowd_map)
    assert crowd_map.to_bytes() == before
    # Nothing of the refused instant lingers: all of the fleet may still come.
    crowd_map.integrate([_view(drone, 2.0) for drone in ("a", "b", "c")], _at(2.0))


def test_an_observation_of_a_larger_terrain_is_refused() -> None:
    crowd_map = _crowd_map()
    before = crowd_map.to_bytes()
    larger = Terrain.from_occupancy(np.ones((2 * SIDE, 2 * SIDE, 1), bool), 1.0)
    observation = project(_view(pose=_pose(28.0, 28.0)), larger, max_range_m=100.0)
    with pytest.raises(ValueError, match="observation belongs to another terrain"):
        crowd_map.integrate_observations([observation], _at(2.0))
    assert crowd_map.to_bytes() == before


def test_stamps_are_whole_nanoseconds() -> None:
    with pytest.raises(StampError, match="must be an integer"):
        View("a", 1.5, CAMERA, _pose(), FINE)  # type: ignore[arg-type]
    with pytest.raises(StampError, match="must fit in 64 bits"):
        View("a", 2**63, CAMERA, _pose(), FINE)


# --- clocks


@pytest.mark.parametrize(("unit", "per_second", "step"), [("seconds", 1, 1), ("milliseconds", 1000, 100)])
def test_stamps_in_another_unit_are_refused_by_name(unit: str, per_second: int, step: int) -> None:
    crowd_map = CrowdMap(_floor(), Paper(RATES, 0.2, fleet_size=1))
    now = 1_763_780_000 * per_second
    crowd_map.integrate([], now)
    with pytest.raises(StampError, match=f"look like {unit}"):
        crowd_map.integrate([], now + step)


def test_a_stamp_before_the_epoch_is_refused() -> None:
    with pytest.raises(StampError, match="stamp -1 ns is negative"):
        View("a", -1, CAMERA, _pose(), FINE)
    with pytest.raises(StampError, match="stamp -5 ns is negative"):
        CrowdMap(_floor(), Or()).integrate([], -5)


def test_an_old_view_counts_at_its_own_age() -> None:
    crowd_map = CrowdMap(_floor(), Paper(RATES, 0.2, alpha=1.0, decay=0.0, fleet_size=1))
    crowd_map.integrate([_view("a", 0.0, np.zeros((6, 8), np.uint8))], _at(1000.0))
    seen = crowd_map.seen()
    assert (crowd_map.last_seen_ns()[seen] == _at(0.0)).all()
    assert (crowd_map.state(_at(1000.0), threshold=0.5)[seen] == VoxelState.STALE).all()


def test_or_takes_a_late_instant_and_paper_does_not() -> None:
    late = [_view("a", 0.0)]
    anyhow = CrowdMap(_floor(), Or())
    anyhow.integrate([], _at(5.0))
    update = anyhow.integrate(late, _at(0.0))
    assert (update.probability == 1.0).all() and anyhow.span_ns == (_at(0.0), _at(5.0))
    in_order = CrowdMap(_floor(), Paper(RATES, 0.2, fleet_size=1))
    in_order.integrate([], _at(5.0))
    with pytest.raises(StampError, match="not after the last instant"):
        in_order.integrate(late, _at(0.0))
