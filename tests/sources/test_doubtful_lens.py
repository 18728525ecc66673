"""Cameras whose numbers are of another size of the picture, in other units or another order, are doubted."""

import json
from pathlib import Path
from typing import Any

import pytest

from crowdfence import Camera, open_recording
from crowdfence.sources.lens.doubtful import lens_doubt
from support.small_recordings import EPOCH_NS, write_hovering


def camera(**changed: Any) -> Camera:
    """640 x 480 pixels, 67 degrees wide."""
    usual = {"width": 640, "height": 480, "fx": 480.0, "fy": 480.0, "cx": 320.0, "cy": 240.0}
    return Camera.pinhole(**{**usual, **changed})


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"cx": 240.0, "cy": 320.0}, "the principal point (240, 320) is far from the middle"),
        # Calibrated at 1280 x 960, used at half of it.
        ({"fx": 960.0, "fy": 960.0, "cx": 640.0, "cy": 480.0}, "the principal point (640, 480) is far"),
        # Shares of the width and height.
        ({"fx": 0.75, "fy": 1.0, "cx": 0.5, "cy": 0.5}, "the principal point (0.5, 0.5) is far"),
        # Millimetres: 2 atan(640 / 4.5 / 2) is 178.4 degrees.
        ({"fx": 4.5, "fy": 4.5}, "a field of view of 178 degrees: are fx and fy in pixels?"),
        # Of 1920 x 1080 pixels, each number scaled by its own side: 4:3 is another part of the sensor.
        ({"fx": 480.0, "fy": 640.0}, "focal lengths of 480 x 640 are of pixels that are not square"),
        # k1, k2, k3, p1, p2 of another program.
        ({"distortion": [-0.3, 0.12, -0.04, 0.0005, 0.0002]}, "p1 = -0.04 and p2 = 0.0005"),
    ],
)
def test_numbers_of_something_else_are_doubted(changed: dict[str, Any], said: str) -> None:
    doubt = lens_doubt(camera(**changed))
    assert doubt is not None and said in doubt


@pytest.mark.parametrize(
    "one",
    [
        camera(),
        camera(cx=350.0, cy=215.0),  # 4.7 % and 5.2 % off the middle
        camera(fx=160.0, fy=160.0),  # 127 degrees wide
        camera(fy=490.0),  # 2 %
        camera(distortion=[-0.4, 0.2, 0.004, -0.003, -0.06]),
        camera(fx=8000.0, fy=8000.0),  # a zoom lens, 4.6 degrees wide
        Camera.fisheye(640, 640, 200.0, 200.0, 320.0, 320.0),  # 183 degrees, by its own model
    ],
)
def test_usual_cameras_are_not(one: Camera) -> None:
    assert lens_doubt(one) is None


def test_a_recording_warns_of_the_drone_that_has_one(tmp_path: Path) -> None:
    folder = write_hovering(tmp_path / "rec", {"uav1": [EPOCH_NS], "uav2": [EPOCH_NS]})
    description = json.loads((folder / "recording.json").read_text())
    usual = description["cameras"]["*"]
    description["cameras"] = {"uav1": usual, "uav2": {**usual, "cx": 12.0, "cy": 16.0}}
    (folder / "recording.json").write_text(json.dumps(description))
    doubts = [one for one in open_recording(folder).warnings if "principal point" in one]
    assert len(doubts) == 1 and doubts[0].startswith("uav2: the principal point (12, 16) is far")
