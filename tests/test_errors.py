"""One exception tree: what is raised for what, and that it survives the way out of another process."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import crowdfence as cf
from crowdfence import errors
from crowdfence.errors import one_line, quoted
from crowdfence.maps import MapError
from crowdfence.sources.recording import Frame

CAMERA = cf.Camera.pinhole(64, 48, 40, 40, 32, 24)
FISHEYE = cf.Camera.fisheye(64, 48, 20, 20, 32, 24, [0.0, 0.0, -0.1, 0.0])
GROUND = cf.Terrain.from_occupancy(np.ones((4, 4, 1), bool), 1.0)
HEATMAP = np.zeros((48, 64), np.float32)
RATES = cf.Rates(0.9, 0.1)


def _view(drone="uav1", stamp_ns=0, pose=None, heatmap=HEATMAP):
    return cf.View(drone, stamp_ns, CAMERA, np.eye(4) if pose is None else pose, heatmap)


def _crowd_map(*stamps_ns):
    crowd_map = cf.CrowdMap(GROUND, cf.Paper(RATES, 0.2, fleet_size=1), max_gap_s=10.0)
    for stamp_ns in stamps_ns:
        crowd_map.integrate([_view(stamp_ns=stamp_ns)], stamp_ns)
    return crowd_map


MOVED = GROUND.with_origin((1.0, 0.0, 0.0))
SECOND_NS = 1_000_000_000

REFUSED = {
    errors.ViewError: {
        "camera": lambda: cf.Camera.pinhole(64, 48, 0.0, 40, 32, 24),
        "ray": lambda: CAMERA.unproject([[np.nan, 0.0]]),
        "drone": lambda: _view(drone=""),
        "pose": lambda: _view(pose=2 * np.eye(4)),
        "heatmap value": lambda: _view(heatmap=HEATMAP + 1.5),
        "heatmap shape": lambda: _view(heatmap=HEATMAP.T),
        "drone twice": lambda: _crowd_map().integrate([_view(), _view()], 0),
        "fleet too large": lambda: _crowd_map(0).integrate([_view("uav2", 1)], 1),
    },
    errors.StampError: {
        "in order": lambda: _crowd_map(1).integrate([_view(stamp_ns=1)], 1),
        "past": lambda: _crowd_map(SECOND_NS).probability(0),
        "jump": lambda: _crowd_map(0, 11 * SECOND_NS),
        "view's stamp": lambda: _crowd_map().integrate([_view(stamp_ns=11 * SECOND_NS)], 0),
        "float": lambda: _view(stamp_ns=0.5),
    },
    errors.MapFileError: {
        "octomap": lambda: cf.Terrain.from_octomap(b"no map"),
        "crowd map": lambda: cf.CrowdMap.from_bytes(b"no map", GROUND),
        "damaged": lambda: cf.CrowdMap.from_bytes(_crowd_map(0).to_bytes()[:-1] + b"!", GROUND),
        "other terrain": lambda: cf.CrowdMap.from_bytes(_crowd_map(0).to_bytes(), MOVED),
        "no file": lambda: cf.Terrain.open("nowhere.tif"),
    },
    errors.CrowdfenceError: {
        "parameter": lambda: cf.Rates(1.0, 0.1),
        "choice": lambda: cf.pool([[0.5]], [[True]], RATES, 0.2, unseen="nobody"),
        "shape": lambda: _view(pose=np.eye(3)),
        "element type": lambda: GROUND.voxel_centers([0.5]),
        "voxel": lambda: GROUND.voxel_centers([99]),
        "origin": lambda: cf.Terrain.from_occupancy(np.ones((1, 1, 1), bool), 1.0, origin=(0.0, 0.0)),
        "terrain": lambda: cf.Terrain.from_occupancy(np.zeros((2, 2, 2), bool), 1.0),
        "grid index": lambda: cf.Terrain.from_indices([[0, 0, 0], [0, 2**31, 0]], 1.0),
    },
}
CASES = [(kind, name) for kind, cases in REFUSED.items() for name in cases]


@pytest.mark.parametrize(("kind", "name"), CASES, ids=lambda case: getattr(case, "__name__", case))
def test_a_refusal_is_of_its_kind(kind: type[Exception], name: str) -> None:
    with pytest.raises(kind) as caught:
        REFUSED[kind][name]()
    exact = MapError if name == "no file" else kind
    assert type(caught.value) is exact


def test_the_tree() -> None:
    assert cf.CrowdfenceError.__bases__ == (ValueError,)
    children = [cf.ViewError, cf.StampError, cf.MapFileError, cf.FrameError, cf.DetectorError]
    assert all(child.__bases__ == (cf.CrowdfenceError,) for child in children)
    assert MapError.__bases__ == (cf.MapFileError,)
    assert set(errors.__all__) == {kind.__name__ for kind in [cf.CrowdfenceError, *children]}


NO_STAMPS = [
    (
        1763780000.25,
        r"stamp_ns is 1763780000\.25 \(a float\); it must be an integer: nanoseconds since the Unix epoch",
    ),
    (np.float64(2.0), r"stamp_ns is 2\.0 \(a float64\); it must be an integer"),
    (True, r"stamp_ns is True \(a bool\); it must be an integer"),
    (np.True_, r"stamp_ns is True \(a bool_?\); it must be an integer"),
    (None, r"stamp_ns is None \(a NoneType\); it must be an integer"),
    ("12", r"stamp_ns is 12 \(a str\); it must be an integer"),
    (2**63, r"stamp_ns is 9223372036854775808; it must fit in 64 bits: nanoseconds since the Unix epoch"),
    (-(2**63) - 1, r"stamp_ns is -9223372036854775809; it must fit in 64 bits"),
    (np.uint64(2**64 - 1), r"stamp_ns is 18446744073709551615; it must fit in 64 bits"),
    ("x" * 100, rf"stamp_ns is {'x' * 60} \(a str\)"),
]


@pytest.mark.parametrize(("stamp_ns", "message"), NO_STAMPS, ids=lambda case: str(case)[:30])
def test_what_is_no_stamp_is_named(stamp_ns: object, message: str) -> None:
    with pytest.raises(cf.StampError, match=message):
        _view(stamp_ns=stamp_ns)


@pytest.mark.parametrize(
    "stamp_ns", [5, np.int64(5), np.uint8(5), np.array(5)], ids=lambda s: type(s).__name__
)
def test_whatever_counts_as_an_index_is_a_stamp(stamp_ns: object) -> None:
    assert _view(stamp_ns=stamp_ns).stamp_ns == 5


REFUSALS = [
    cf.CrowdfenceError("prior is 2"),
    cf.ViewError("pose is not rigid"),
    cf.StampError("stamp"),
    cf.MapFileError("not a crowd map"),
    cf.DetectorError("the model has 2 inputs"),
    cf.FrameError("uav1", 12, "has no pose"),
    MapError(Path("dem.tif"), "no such file"),
]


@pytest.mark.parametrize("refusal", REFUSALS, ids=lambda refusal: type(refusal).__name__)
def test_exceptions_can_be_pickled_and_copied(refusal: Exception) -> None:
    copies = [
        pickle.loads(pickle.dumps(refusal, protocol)) for protocol in range(pickle.HIGHEST_PROTOCOL + 1)
    ]
    for other in [*copies, copy.copy(refusal), copy.deepcopy(refusal)]:
        assert type(other) is type(refusal)
        assert (str(other), vars(other)) == (str(refusal), vars(refusal))


def test_a_frame_error_says_which_frame() -> None:
    error = cf.FrameError("uav1", 12, "has no pose")
    assert str(error) == "frame of uav1 at 12: has no pose"
    assert (error.drone, error.stamp_ns, error.reason) == ("uav1", 12, "has no pose")


def test_an_error_is_one_line_that_names_the_file_that_the_system_names() -> None:
    assert one_line(FileNotFoundError(2, "No such file or directory", "a.tif")) == (
        "a.tif: No such file or directory"
    )
    assert one_line(ConnectionRefusedError(111, "Connection refused")) == "Connection refused"
    assert one_line(OSError("line 1\n  line 2")) == "line 1 line 2"
    assert one_line(KeyError()) == "KeyError"
    assert one_line(MemoryError()) == "it needs more memory than there is"


def test_what_a_library_says_may_be_as_long_as_the_file_what_we_say_is_told_whole() -> None:
    error = ValueError("x" * 1000)
    assert one_line(error) == "x" * 300 + "..."
    assert one_line(error, whole=True) == "x" * 1000


def test_a_value_of_somebodys_file_is_quoted_by_its_beginning() -> None:
    assert quoted("two\nlines") == "'two lines'"
    assert quoted({"a": [1, None]}) == "{'a': [1, None]}"
    assert quoted("x" * 81) == f"'{'x' * 80}...'"
    assert quoted([7] * 1000) == f"{str([7] * 1000)[:80]}..."
    assert quoted("x" * 80) == f"'{'x' * 80}'" and quoted(12345, 3) == "123..."


def test_exceptions_leave_another_process() -> None:
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as other_process:
        with pytest.raises(cf.ViewError, match="focal length fx is 0 pixels"):
            other_process.submit(cf.Camera.pinhole, 64, 48, 0.0, 40, 32, 24).result()
        frame = Frame("uav1", 12, cf.Camera.pinhole(4, 4, 4, 4, 2, 2), np.eye(4))
        with pytest.raises(cf.FrameError, match="frame of uav1 at 12: has no heatmap"):
            other_process.submit(Frame.heatmap, frame).result()
