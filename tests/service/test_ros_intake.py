"""Messages of ROS on their way into the service: whose intrinsics a picture gets, without a network."""

import json
import time
from collections import Counter
from threading import Timer
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from crowdfence import Camera
from crowdfence.service.ros.intake import Intake
from crowdfence.service.ros.intrinsics import Intrinsics
from crowdfence.service.store import StoreError

STORE = get_typestore(Stores.ROS2_HUMBLE)
T = STORE.types
INFO, IMAGE = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/Image"
SECOND_NS = 1_000_000_000
WIDE, TELE = Camera.pinhole(8, 6, 8.0, 8.0, 4.0, 3.0), Camera.pinhole(8, 6, 32.0, 32.0, 4.0, 3.0)


def header(stamp_ns: int, frame: str = "optical") -> Any:
    sec, nanosec = divmod(stamp_ns, SECOND_NS)
    return T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](sec, nanosec), frame)


def info(stamp_ns: int, camera: Camera, **changes: Any) -> bytes:
    k = [camera.fx, 0.0, camera.cx - 0.5, 0.0, camera.fy, camera.cy - 0.5, 0.0, 0.0, 1.0]
    fields = {"d": np.zeros(5), "k": k, "r": np.eye(3).reshape(-1), "p": np.zeros(12), **changes}
    message = T[INFO](
        header(stamp_ns),
        camera.height,
        camera.width,
        "plumb_bob",
        *(np.array(fields[name], np.float64) for name in ("d", "k", "r", "p")),
        0,
        0,
        T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False),
    )
    return bytes(STORE.serialize_cdr(message, INFO))


def heatmap(stamp_ns: int, frame: str = "optical") -> bytes:
    message = T[IMAGE](header(stamp_ns, frame), 6, 8, "mono8", 0, 8, np.zeros(48, np.uint8))
    return bytes(STORE.serialize_cdr(message, IMAGE))


class Given:
    """Stands for the service: what it was given."""

    def __init__(self, *, rectified: bool = False, poses: Any = None) -> None:
        self.views: list[dict[str, Any]] = []
        self.refused: Counter[str] = Counter()
        self.reasons: list[str] = []
        alerts = SimpleNamespace(raise_=lambda kind, level, text, *rest, **more: self.reasons.append(text))
        clock = SimpleNamespace(now_ns=lambda: 0)
        live: Any = SimpleNamespace(
            intake=SimpleNamespace(give_view=self.give_view), heard=SimpleNamespace(refused=self.refused)
        )
        self.intake = Intake("uav1", live, alerts, clock, poses, rectified=rectified)  # type: ignore[arg-type]

    def give_view(self, raw: bytes) -> None:
        self.views.append(json.loads(raw))

    def after(self, messages: list[tuple[str, str, bytes]], count: int) -> list[dict[str, Any]]:
        for role, kind, data in messages:
            self.intake.take(role, kind, data)
        if not self.intake._thread.is_alive():
            self.intake.start()
        give_up_s = time.monotonic() + 20.0
        while len(self.views) + len(self.reasons) < count and time.monotonic() < give_up_s:
            time.sleep(0.01)
        self.intake.stop()
        return self.views


def test_a_picture_that_waited_has_the_intrinsics_of_its_stamp() -> None:
    """Two pictures wait, for their poses say, while the camera zooms in between."""
    messages = [("info", INFO, info(1, WIDE)), ("info", INFO, info(2, TELE))]
    messages += [("heatmap", IMAGE, heatmap(1)), ("heatmap", IMAGE, heatmap(2))]
    found = Given().after(messages, 2)
    assert [(view["stamp_ns"], view["camera"]["fx"]) for view in found] == [(1, 8.0), (2, 32.0)]


def test_rectified_pictures_have_the_camera_of_p() -> None:
    p = [TELE.fx, 0, TELE.cx - 0.5, 0, 0, TELE.fy, TELE.cy - 0.5, 0, 0, 0, 1, 0]
    messages = [("info", INFO, info(1, WIDE, d=[-0.3, 0.1, 0, 0, 0], p=p)), ("heatmap", IMAGE, heatmap(1))]
    (found,) = Given(rectified=True).after(messages, 1)
    assert (found["camera"]["fx"], found["camera"]["distortion"]) == (32.0, [])


def test_intrinsics_that_are_sent_once_hold_for_all() -> None:
    known = Intrinsics(0.0)
    with pytest.raises(ValueError, match="no camera_info has come"):
        known.at(5)
    known.heard(7, WIDE)
    assert [known.at(stamp_ns) for stamp_ns in (3, 9)] == [WIDE, WIDE]
    known.heard(20, TELE)  # and once more, after a change: from then on
    assert [known.at(stamp_ns) for stamp_ns in (9, 25)] == [WIDE, TELE]


def test_a_picture_whose_own_are_lost_while_the_camera_changes_is_refused() -> None:
    known = Intrinsics(0.0)
    for stamp_ns, camera in ((1, WIDE), (2, WIDE), (4, WIDE), (6, TELE), (7, TELE)):
        known.heard(stamp_ns, camera)
    assert known.at(2) == WIDE and known.at(7) == TELE
    assert known.at(3) == WIDE  # what was before and after it is one camera
    with pytest.raises(ValueError, match="the camera changes, and no camera_info of 5 has come"):
        known.at(5)


def test_intrinsics_that_come_behind_their_pictures_are_waited_for() -> None:
    """Where those of an earlier picture were there first, each had those of the picture before."""
    known = Intrinsics(5.0)
    known.heard(0, WIDE)  # of a picture that was told before we came
    assert known.at(10) == WIDE
    known.heard(10, WIDE)
    later = Timer(0.1, known.heard, (20, TELE))
    later.start()
    assert known.at(20) == TELE
    later.join()


def test_a_clock_that_was_set_back_gives_no_picture_the_intrinsics_of_before() -> None:
    """The camera zoomed meanwhile, and its intrinsics come behind their pictures: those of before lie ahead
    of all that come, and the first picture had them."""
    known, second = Intrinsics(5.0), 1_000_000_000
    for number in range(5):
        known.heard(100 * second + number, WIDE)
        assert known.at(100 * second + number) == WIDE
    for number in range(3):
        later = Timer(0.1, known.heard, (60 * second + number, TELE))
        later.start()
        assert known.at(60 * second + number) == TELE
        later.join()
    known.heard(59 * second + 500_000_000, TELE)  # overtaken on its way: nothing begins anew
    assert known.at(60 * second) == TELE


def test_pictures_of_a_camera_that_calls_itself_uncalibrated_are_refused() -> None:
    """As where it zoomed to where nobody calibrated it: they had the intrinsics of before."""
    messages = [("info", INFO, info(1, WIDE)), ("info", INFO, info(2, TELE, k=np.zeros(9)))]
    messages += [("heatmap", IMAGE, heatmap(1)), ("heatmap", IMAGE, heatmap(2))]
    given = Given()
    found = given.after(messages, 2)
    assert [(view["stamp_ns"], view["camera"]["fx"]) for view in found] == [(1, 8.0)]
    (reason,) = given.reasons
    assert "its camera_info cannot be used: K in camera_info is all 0" in reason
    assert given.refused["uav1"] == 1


def test_a_camera_that_zoomed_and_tells_nothing_more_is_not_taken_as_it_was_last() -> None:
    known = Intrinsics(0.0)
    for stamp_ns, camera in ((1, WIDE), (2, TELE)):
        known.heard(stamp_ns, camera)
        assert known.at(stamp_ns) == camera
    with pytest.raises(ValueError, match="the camera changes, and no camera_info of 3 has come"):
        known.at(3)
    known.heard(4, TELE)
    assert known.at(3) == TELE  # that of the picture behind it says that it did not change


def test_pictures_between_intrinsics_that_are_thinned_out_are_not_lost() -> None:
    """A bridge lets one of ten pass, in step with its picture: every picture waited for one of its own, and
    those behind it had no room."""
    given, period_s, pictures = Given(), 0.02, 50
    given.intake.start()
    for number in range(pictures):
        stamp_ns = SECOND_NS + round(number * period_s * SECOND_NS)
        if number % 10 == 0:
            given.intake.take("info", INFO, info(stamp_ns, WIDE))
        given.intake.take("heatmap", IMAGE, heatmap(stamp_ns))
        time.sleep(period_s)
    given.intake.take("info", INFO, info(stamp_ns + 1, WIDE))
    assert len(given.after([], pictures)) == pictures and not given.reasons


def test_pictures_wait_once_for_intrinsics_that_come_too_seldom() -> None:
    """Told every ten pictures, which is longer than a picture waits: one waits in vain, and none after it."""
    known = Intrinsics(0.2)
    known.heard(0, WIDE)
    assert known.at(0) == WIDE
    began_s = time.monotonic()
    assert [known.at(stamp_ns) for stamp_ns in range(1, 10)] == [WIDE] * 9
    assert 0.2 <= time.monotonic() - began_s < 0.8  # nine waits are 1.8 s


def test_a_stream_keeps_the_newest_only() -> None:
    known = Intrinsics(0.0)
    for stamp_ns in range(1000):
        known.heard(stamp_ns, WIDE if stamp_ns < 900 else TELE)
    assert known.at(850) == WIDE and known.at(999) == TELE and known.at(10) == WIDE


@pytest.mark.parametrize(
    ("role", "kind", "needed"),
    [
        ("info", IMAGE, INFO),
        ("heatmap", "sensor_msgs/msg/CompressedImage", IMAGE),
        ("camera", "sensor_msgs/msg/NavSatFix", f"{IMAGE} or sensor_msgs/msg/CompressedImage"),
        ("pose", "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseStamped or nav_msgs/msg/Odometry or"),
    ],
)
def test_a_topic_of_another_type_is_named(role: str, kind: str, needed: str) -> None:
    """Where it was read, it failed at a field that it lacks, in a thread of Zenoh that told nobody."""
    given = Given()
    given.intake.take(role, kind, heatmap(1))
    (reason,) = given.reasons
    assert reason.startswith(f"a message of uav1 is {kind}; {role} needs {needed}")
    assert given.refused["uav1"] == 1


def test_a_disk_that_cannot_be_read_for_a_moment_ends_no_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread of the drone ended with it: no picture was taken any more, until the next start."""
    given = Given()
    take = given.give_view

    def once_unreadable(raw: bytes) -> None:
        monkeypatch.setattr(given.intake._live.intake, "give_view", take)
        raise StoreError("crowdfence.sqlite: disk I/O error")

    given.intake._live.intake.give_view = once_unreadable  # type: ignore[method-assign,assignment]
    messages = [("info", INFO, info(1, WIDE)), *(("heatmap", IMAGE, heatmap(stamp)) for stamp in (1, 1))]
    assert len(given.after(messages, 2)) == 1
    assert given.reasons == [
        f"a message of uav1 (heatmap, {IMAGE}) was not taken: crowdfence.sqlite: disk I/O error"
    ]


@pytest.mark.parametrize(("named", "frame"), [("", "optical"), ("link", "link")])
def test_a_picture_that_names_no_frame_is_in_that_of_its_camera_info(named: str, frame: str) -> None:
    """As in bags: no tf leads to a frame without a name, and all its views were refused."""
    poses = SimpleNamespace(camera_frame="")
    given = Given(poses=poses)
    given.after([("info", INFO, info(0, WIDE)), ("heatmap", IMAGE, heatmap(0, named))], 1)
    assert len(given.views) == 1 and poses.camera_frame == frame
