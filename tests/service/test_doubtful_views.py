"""What a run would warn of, the service tells too: frames without a pose, heatmaps in the wrong units."""

import base64
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from crowdfence import Camera, View
from crowdfence.detector.detector import Detector
from crowdfence.service.alerts import Alert
from crowdfence.service.opening import replayed
from crowdfence.service.service import Service
from crowdfence.service.view_message import ViewMessage
from crowdfence.service.watch import Watch
from crowdfence.sources.recording import RefusedFrame
from support.crowd_of_two import seen_by_two
from support.onnx_models import contract, write_map_model
from support.small_service import (
    CONFIG,
    SETTINGS,
    asked,
    heatmap,
    message,
    plain,
    recording,
    running,
    settle,
    sharp,
    view,
    views,
    wait_for_end,
)

HEAT = np.zeros((6, 8), np.float32)


def alerts(service: Service, kind: str) -> list[Alert]:
    """The oldest first."""
    return [one for one in service.alerts.all() if one.kind == kind][::-1]


def as_mask(one: View) -> View:
    """Crowd as 1 of 255, which was meant as sure."""
    marked = np.where(one.heatmap > 0.5, np.float32(1 / 255), np.float32(0))
    return View(one.drone, one.stamp_ns, one.camera, one.world_from_camera, marked)


def test_a_replay_tells_which_frames_have_no_pose() -> None:
    flown = recording(views())
    first_ns = flown.frames[0].stamp_ns
    lost = tuple(RefusedFrame("uav4", first_ns + k, "the log has a gap") for k in range(3))
    lost += (RefusedFrame("uav5", first_ns, "the log has a gap"),)
    with replayed(
        replace(flown, refused=lost), plain(), CONFIG, speed=float("inf"), settings=SETTINGS
    ) as service:
        wait_for_end(service)
        told, of_one = alerts(service, "refused_views")
        assert (told.level, told.drone, told.cleared_ns) == ("warning", "uav4", None)
        assert told.text.startswith("3 frames of uav4 cannot be used, the first: ")
        assert of_one.text.startswith("a frame of uav5 cannot be used: ")
        assert told.text.endswith("the log has a gap")


def test_a_replay_tells_which_frames_could_not_be_used_on_the_way() -> None:
    flown = recording(views())
    halved = [
        replace(one, pixels=replace(one.pixels, heatmap=lambda: np.zeros((7, 5), np.float32)))
        if one.drone == "uav2"
        else one
        for one in flown.frames
    ]
    with replayed(
        replace(flown, frames=tuple(halved)), plain(), CONFIG, speed=float("inf"), settings=SETTINGS
    ) as service:
        wait_for_end(service)
        (told,) = alerts(service, "refused_views")
        assert told.drone == "uav2" and "a view of uav2 could not be used: " in told.text


def test_a_recording_without_a_usable_frame_is_no_empty_mission() -> None:
    flown = recording(views())
    lost = RefusedFrame("uav1", flown.frames[0].stamp_ns, "the log has a gap")
    empty = replace(flown, frames=(), refused=(lost,))
    with (
        pytest.raises(ValueError, match=r"no frame of plain can be used; the first of 1 refusals: uav1 at"),
        replayed(empty, plain(), CONFIG, settings=SETTINGS),
    ):
        pass


def test_masks_of_one_raise_an_alarm_in_a_replay() -> None:
    masks = [as_mask(one) if one.drone != "uav3" else one for one in views()]
    with replayed(recording(masks), plain(), CONFIG, speed=float("inf"), settings=SETTINGS) as service:
        wait_for_end(service)
        told = alerts(service, "heatmap_units")
        # The third drone's crowds are told in the right units.
        assert {(one.level, one.drone) for one in told} == {("alarm", "uav1"), ("alarm", "uav2")}
        assert all("look like masks of 0 and 1" in one.text for one in told)


def test_a_drone_that_sees_nobody_where_another_shows_a_crowd_is_an_alarm_until_it_sees_one(
    tmp_path: Path,
) -> None:
    with running(tmp_path / "data") as service, asked(service) as http:

        def give(instants: range, blind: bool) -> list[Alert]:
            for number in instants:
                for drone in ("uav1", "uav2"):
                    one = sharp(view(drone, number), blind=blind and drone == "uav2")
                    assert http.post("/api/v1/views", content=message(one)).status_code == 202
            settle(service)
            Watch(service).look()
            return alerts(service, "denied_crowd")

        assert not give(range(10), blind=True), "two seconds prove nothing"
        (told,) = give(range(10, 20), blind=True)
        assert (told.level, told.drone, told.cleared_ns) == ("alarm", "uav2", None)
        assert told.text.startswith("uav2 saw nobody in ")
        (told,) = give(range(20, 24), blind=False)
        assert told.cleared_ns is not None


def test_one_crowd_at_two_places_is_an_alarm_until_it_is_at_one(tmp_path: Path) -> None:
    """Also over a restart, after which nobody knows until they look at one crowd again."""

    def give(service: Service, off_m: float, seconds: range) -> list[bool]:
        assert service.live is not None
        for one in seen_by_two(off_m, seconds):
            service.live.intake.give_view(message(one))
        settle(service)
        Watch(service).look()
        return [one.cleared_ns is None for one in alerts(service, "crowds_apart")]

    with running(tmp_path / "data") as service:
        assert give(service, 12.0, range(3)) == []
        assert give(service, 12.0, range(3, 6)) == [True]
        (told,) = alerts(service, "crowds_apart")
        assert (told.level, told.drone) == ("alarm", None) and "zones lie beside their crowds" in told.text
    with running(tmp_path / "data") as service:
        Watch(service).look()
        assert give(service, 12.0, range(6, 8)) == [True]
        assert give(service, 0.5, range(8, 10)) == [False]


def test_a_restart_does_not_take_back_that_a_drone_sees_nobody(tmp_path: Path) -> None:
    """Its first look after it did, though that denied the crowd as all before: of few looks nobody knows."""

    def give(service: Service, instants: range, blind: bool) -> list[bool]:
        assert service.live is not None
        for number in instants:
            for drone in ("uav1", "uav2"):
                one = sharp(view(drone, number % 20), blind=blind and drone == "uav2")
                later_ns = one.stamp_ns + number // 20 * 20 * 200_000_000
                moved = View(one.drone, later_ns, one.camera, one.world_from_camera, one.heatmap)
                service.live.intake.give_view(message(moved))
        settle(service)
        Watch(service).look()
        return [one.cleared_ns is None for one in alerts(service, "denied_crowd")]

    with running(tmp_path / "data") as service:
        assert give(service, range(20), blind=True) == [True]
    for more in (range(20, 22), range(22, 40)):
        with running(tmp_path / "data") as service:
            assert give(service, more, blind=True) == [True]
    with running(tmp_path / "data") as service:
        assert give(service, range(40, 44), blind=False) == [False]


def test_who_acknowledged_that_a_drone_sees_nobody_is_told_when_it_happens_again(tmp_path: Path) -> None:
    """The first time the others were wrong, say; the second time its lens is covered."""
    with running(tmp_path / "data") as service, asked(service) as http:
        assert service.live is not None
        watch = Watch(service)

        def give(instants: range) -> list[tuple[str | None, bool]]:
            for number in instants:
                for drone in ("uav1", "uav2"):
                    one = sharp(view(drone, number % 20), blind=drone == "uav2")
                    later_ns = one.stamp_ns + number // 20 * 20 * 200_000_000
                    moved = View(one.drone, later_ns, one.camera, one.world_from_camera, one.heatmap)
                    assert http.post("/api/v1/views", content=message(moved)).status_code == 202
            settle(service)
            watch.look()
            return [(one.acknowledged_by, one.cleared_ns is None) for one in alerts(service, "denied_crowd")]

        assert give(range(20)) == [(None, True)]
        (told,) = alerts(service, "denied_crowd")
        service.alerts.acknowledge(told.id, "ana", service.now_ns())
        assert give(range(20, 40)) == [("ana", True)], "it goes on"
        assert give(range(100, 120)) == [("ana", False), (None, True)]


def test_masks_of_one_raise_an_alarm_live_until_a_heatmap_is_none(tmp_path: Path) -> None:
    flown = [one for one in views(16) if one.drone == "uav1"]
    with running(tmp_path / "data") as service, asked(service) as http:

        def give(one: View) -> None:
            assert http.post("/api/v1/views", content=message(one)).status_code == 202

        for one in flown[:9]:
            give(as_mask(one))
        settle(service)
        assert not alerts(service, "heatmap_units"), "nine prove nothing"
        for one in flown[9:15]:
            give(as_mask(one))
        settle(service)
        (told,) = alerts(service, "heatmap_units")
        assert (told.drone, told.cleared_ns) == ("uav1", None)
        last = flown[15]
        right = np.maximum(heatmap("uav1", 0.0), np.float32(0.5))
        give(View(last.drone, last.stamp_ns, last.camera, last.world_from_camera, right))
        settle(service)
        assert service.live is not None
        service.live.finish()
        (told,) = alerts(service, "heatmap_units")
        assert told.cleared_ns is not None


def with_picture(number: int, red: int) -> bytes:
    """Noise in green and blue; `red` in one corner."""
    levels = np.random.default_rng(number).integers(0, 256, (12, 16, 3), np.uint8)
    levels[:, :, 0] = 0
    levels[:4, :4, 0] = red
    file = io.BytesIO()
    Image.fromarray(levels).save(file, format="PNG")
    told = ViewMessage.model_validate_json(message(view("uav1", number)))
    image = base64.b64encode(file.getvalue()).decode()
    return told.model_copy(update={"heatmap": None, "image": image}).model_dump_json().encode()


def test_a_detector_that_gives_the_same_everywhere_is_an_alarm_until_an_answer_differs(
    tmp_path: Path,
) -> None:
    """One that looks at red alone, of which there is none: by hand, sigmoid(-6) = 0.0025 everywhere, and with
    red of 255 in a cell sigmoid(-6 + 255 / 255) = 0.0067 there, a logit more."""
    model = write_map_model(tmp_path / "red.onnx", contract("logits"), offset=-6.0)

    def given(service: Service, numbers: range, red: int = 0) -> list[tuple[str, bool]]:
        assert service.live is not None
        for number in numbers:
            service.live.intake.give_view(with_picture(number, red))
        service.live.finish()
        Watch(service).look()
        return [(one.level, one.cleared_ns is None) for one in alerts(service, "same_answer")]

    with running(tmp_path / "data", detector=Detector(model)) as service:
        assert not given(service, range(9)), "nine prove nothing"
        assert given(service, range(9, 12)) == [("alarm", True)]
        (told,) = alerts(service, "same_answer")
        assert told.text.startswith("test model gives P = 0.0025 everywhere in all 12 pictures, whatever is")
        assert service.live is not None and not service.live.heard.refused
    with running(tmp_path / "data", detector=Detector(model)) as service:
        assert given(service, range(12, 14)) == [("alarm", True)], "a restart mends nothing"
        assert given(service, range(14, 22), 255) == [("alarm", False)]


def alerts_after(service: Service, kind: str, numbers: range) -> list[Alert]:
    """Once so many pictures were given."""
    assert service.live is not None
    for number in numbers:
        service.live.intake.give_view(with_picture(number, number))
    service.live.finish()
    Watch(service).look()
    return alerts(service, kind)


def test_pictures_unlike_all_that_the_detector_was_tested_on_are_told_of_each_drone(tmp_path: Path) -> None:
    """Noise, which no renderer made, before the shipped detector."""

    with running(tmp_path / "data", detector=Detector()) as service:
        assert not alerts_after(service, "unlike_pictures", range(9)), "nine prove nothing"
        (told,) = alerts_after(service, "unlike_pictures", range(9, 12))
        assert (told.level, told.drone, told.cleared_ns) == ("warning", "uav1", None)
        assert told.text == (
            "12 of 12 pictures of uav1 look unlike everything that crowdnet-s was tested on: nobody has "
            "measured what it misses there; crowdnet-s-wide does better on pictures of real cameras"
        )
    with running(tmp_path / "data", detector=Detector()) as service:
        (told,) = alerts_after(service, "unlike_pictures", range(12, 14))
        assert told.cleared_ns is None, "a restart mends nothing"


def test_ground_that_the_detector_was_not_tested_on_is_told_of_each_drone(tmp_path: Path) -> None:
    """As a run tells it of a whole flight: a camera of 12 pixels' focal length, metres from the ground, has
    far more than 0.05 m to a pixel."""
    tested = {**contract(), "validity": {"gsd_m": [0.01, 0.05]}}
    model = write_map_model(tmp_path / "red.onnx", tested)

    with running(tmp_path / "data", detector=Detector(model)) as service:
        assert not alerts_after(service, "untested_ground", range(9)), "nine prove nothing"
        (told,) = alerts_after(service, "untested_ground", range(9, 12))
        assert (told.level, told.drone, told.cleared_ns) == ("warning", "uav1", None)
        assert told.text.startswith(
            "uav1, metres per pixel: 100% of the ground seen lies above 0.05 m, where the detector test "
            "model was not tested (the middle 90 % of its newest looks: "
        )
    with running(tmp_path / "data", detector=Detector(model)) as service:
        (told,) = alerts_after(service, "untested_ground", range(12, 14))
        assert told.cleared_ns is None, "a restart mends nothing"


def test_a_detector_that_sees_pictures_far_smaller_than_they_are_is_told(tmp_path: Path) -> None:
    """32 x 24 pixels at a quarter; a run says so before its first frame, of live views nobody knows then."""
    document = contract(name="small", input__size=[8, 8], input__resize="letterbox")
    model = write_map_model(tmp_path / "small.onnx", document)
    camera = Camera.pinhole(32, 24, 24.0, 24.0, 16.0, 12.0)
    with running(tmp_path / "data", detector=Detector(model)) as service:
        assert service.live is not None
        for number, size in ((0, (24, 32, 3)), (1, (12, 16, 3))):
            file = io.BytesIO()
            levels = np.random.default_rng(number).integers(0, 256, size, np.uint8)
            Image.fromarray(levels).save(file, format="PNG")
            one = view("uav1", number)
            shown = View("uav1", one.stamp_ns, one.camera if number else camera, one.world_from_camera, HEAT)
            told = ViewMessage.model_validate_json(message(shown))
            image = base64.b64encode(file.getvalue()).decode()
            given = told.model_copy(update={"heatmap": None, "image": image}).model_dump_json().encode()
            service.live.intake.give_view(given)
            service.live.finish()
            Watch(service).look()
            (alert,) = alerts(service, "shrunk_pictures")
            assert (alert.level, alert.drone) == ("warning", "uav1")
            assert alert.text.startswith(
                "uav1: the detector small is shown pictures of 32 x 24 pixels shrunk to 8 x 6: where people"
            )
            assert (alert.cleared_ns is None) is (number == 0), "half of 16 x 12 is not so little"
