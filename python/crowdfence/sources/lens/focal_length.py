"""Intrinsics of a camera that nobody calibrated, and how far off they may be.

A focal length "as on 35 mm film" compares diagonals (CIPA DCG-001): 43.27 mm there. Makers round it to whole
millimetres, and a film may use less than the whole width of its sensor, so such intrinsics are some percent
off: a point at the edge of the picture lands that share of its distance from the middle of the view away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from crowdfence._core import Camera

_DIAGONAL_35MM = math.hypot(36.0, 24.0)
_LENGTHS_35MM = (4.0, 4000.0)
"""Millimetres that lenses have."""
_WIDEST_STILL = 1.55
"""Pictures wider than 3:2 are cut from a sensor of 4:3 or 3:2 at their full width."""
_SENSOR_ASPECT = 4 / 3
_ALIKE = 1.03
"""Focal lengths up to this ratio are taken for one: with 3 % a point at the edge of the picture lands 3 % of
its distance from the middle of the view away, little beside the 5 or 10 % of an estimate."""
_MOST_CUT = 1.4
"""Stabilised films show less than their lens by about a quarter, and makers round; a zoom is more."""

SENSORS_MM = {
    "FC220": (6.17, 4.63),  # Mavic Pro, 1/2.3"
    "FC2103": (6.17, 4.63),  # Mavic Air
    "FC2204": (6.17, 4.63),  # Mavic 2 Zoom
    "FC3170": (6.4, 4.8),  # Mavic Air 2, 1/2"
    "FC3411": (13.2, 8.8),  # Air 2S, 1"
    "FC3582": (9.68, 7.26),  # Mini 3 Pro, 1/1.3": 4032 pixels of 2.4 um
    "FC8482": (9.68, 7.26),  # Mini 4 Pro
    "FC8282": (9.68, 7.26),  # Air 3, the wide camera
    "FC8284": (9.68, 7.26),  # and the medium tele, of 1/1.3" too
    "FC7203": (6.17, 4.63),  # Mavic Mini
    "FC7303": (6.17, 4.63),  # Mini 2
    "FC300S": (6.17, 4.63),  # Phantom 3 Professional
    "FC300X": (6.17, 4.63),  # Phantom 3
    "FC330": (6.17, 4.63),  # Phantom 4
    "FC6310": (13.2, 8.8),  # Phantom 4 Pro, 1"
    "FC6310S": (13.2, 8.8),
    "FC6310R": (13.2, 8.8),  # Phantom 4 RTK
    "FC6510": (13.2, 8.8),  # Zenmuse X4S
    "FC6520": (17.3, 13.0),  # Zenmuse X5S, 4/3"
    "L1D-20C": (13.2, 8.8),  # Mavic 2 Pro
    "L2D-20C": (17.3, 13.0),  # Mavic 3
    "M3E": (17.3, 13.0),
    "ZENMUSEP1": (35.9, 24.0),
    "S.O.D.A.": (12.75, 8.5),  # senseFly
    "ANAFI": (5.92, 4.45),
    "XT705": (13.2, 8.8),  # Autel EVO II Pro
    "ILCE-5100": (23.5, 15.6),  # Sony, APS-C
    "ILCE-6000": (23.5, 15.6),
    "ILCE-7R": (35.9, 24.0),
}
"""Width and height of the sensor by the model that EXIF names, in capitals: the makers' data sheets."""


@dataclass(frozen=True, slots=True)
class EstimatedCamera:
    """Intrinsics, what they come from and their error."""

    camera: Camera
    said: str


def is_of_a_lens(focal_35mm: float) -> bool:
    """Whether there are lenses of this focal length, millimetres on 35 mm film; not for NaN."""
    return _LENGTHS_35MM[0] <= focal_35mm <= _LENGTHS_35MM[1]


def alike(one: float, other: float) -> bool:
    """Whether two focal lengths count as one."""
    return max(one, other) <= _ALIKE * min(one, other)


def calibration_doubt(calibration: Camera, told_mm: float) -> str:
    """What is doubtful about a calibration of pictures that were taken at a focal length on 35 mm film; empty
    where it may be theirs."""
    of_mm = focal_35mm_of(calibration)
    if max(of_mm, told_mm) <= _MOST_CUT * min(of_mm, told_mm):
        return ""
    return (
        f"its calibration is of {of_mm:.0f} mm on 35 mm film, and {told_mm:.0f} mm are recorded: is it of "
        "another lens, or zoom? Then everything is put too far from the middle of what it sees, or too near"
    )


def focal_35mm_of(camera: Camera) -> float:
    """The focal length, millimetres on 35 mm film, that `camera_from_35mm` would make `camera` of."""
    return camera.fx * _DIAGONAL_35MM / _sensor_diagonal_px(camera.width, camera.height)


def camera_from_35mm(width: int, height: int, focal_35mm: float, *, film: bool) -> EstimatedCamera:
    """ValueError for a focal length that no lens has."""
    if not is_of_a_lens(focal_35mm):
        raise ValueError(f"a focal length of {focal_35mm:g} mm (35 mm film) is not that of a lens")
    error = 10 if film else 5
    focal_px = focal_35mm / _DIAGONAL_35MM * _sensor_diagonal_px(width, height)
    said = f"{focal_35mm:g} mm on 35 mm film: {focal_px:.0f} px, within about {error} %"
    return _camera(width, height, focal_px, said)


def camera_from_sensor(width: int, height: int, focal_mm: float, model: str) -> EstimatedCamera | None:
    """By the table of sensors; None for a model that is not in it."""
    sensor_mm = SENSORS_MM.get(_plain(model))
    if sensor_mm is None or not 0.5 <= focal_mm <= 1000:
        return None
    # A picture of other proportions is cut from the whole width or the whole height.
    px_per_mm = max(max(width, height) / sensor_mm[0], min(width, height) / sensor_mm[1])
    focal_px = focal_mm * px_per_mm
    sensor = f"the {sensor_mm[0]:g} mm sensor of {model.strip()}"
    said = f"{focal_mm:g} mm before {sensor}: {focal_px:.0f} px, within about 3 %"
    return _camera(width, height, focal_px, said)


def scaled_camera(camera: Camera, width: int, height: int) -> Camera:
    """A calibration for pictures of another size but the same field of view.

    ValueError when the sides have another proportion: a cut picture needs a calibration of its own.
    """
    if (camera.width, camera.height) == (width, height):
        return camera
    scale = width / camera.width
    if abs(camera.height * scale - height) > 1.0:
        raise ValueError(
            f"the calibration is for {camera.width}x{camera.height} pixels, the pictures have "
            f"{width}x{height}: another proportion, so another part of the sensor; calibrate this mode"
        )
    rows = height / camera.height
    values = (width, height, camera.fx * scale, camera.fy * rows, camera.cx * scale, camera.cy * rows)
    if camera.model == "kannala_brandt":
        return Camera.fisheye(*values, camera.distortion)
    return Camera.pinhole(*values, list(camera.distortion) or None)


def _camera(width: int, height: int, focal_px: float, said: str) -> EstimatedCamera:
    camera = Camera.pinhole(width, height, focal_px, focal_px, width / 2, height / 2)
    return EstimatedCamera(camera, f"intrinsics are an estimate from {said}; --calibration is better")


def _sensor_diagonal_px(width: int, height: int) -> float:
    long, short = max(width, height), min(width, height)
    if long / short > _WIDEST_STILL:
        short = round(long / _SENSOR_ASPECT)
    return math.hypot(long, short)


def _plain(model: str) -> str:
    return "".join(letter for letter in model.upper() if letter.isalnum() or letter in "-.")
