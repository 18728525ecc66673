"""The camera of each frame of a film: pilots zoom, and change from lens to lens.

A log that tells the focal length tells it over time. Without a calibration every frame has the intrinsics of
its own focal length; a calibration is of one, and frames of another are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.sources.film.flight_log import FlightLog
from crowdfence.sources.lens.focal_length import (
    alike,
    calibration_doubt,
    camera_from_35mm,
    focal_35mm_of,
    is_of_a_lens,
    scaled_camera,
)
from crowdfence.sources.place_camera import UnplacedFrame


@dataclass(frozen=True, slots=True)
class FilmCameras:
    """Cameras over time."""

    usual: Camera
    """That of most of the film."""
    remark: str = ""
    zoom: _Zoom | None = None
    """None: there is one camera, whatever the time."""
    calibrated_35mm: float | None = None
    """The focal length whose calibration `usual` is; None: there is no calibration."""
    _estimates: dict[float, Camera] = field(default_factory=dict, repr=False)

    def at(self, time_s: float) -> tuple[Camera | None, str | None]:
        """The camera at a time of the log, or why nobody knows it."""
        if self.zoom is None:
            return self.usual, None
        before, after, length = self.zoom.at(time_s)
        if not alike(before, after):
            return None, f"the camera zooms there: the log has {before:g} mm before it and {after:g} mm after"
        if self.calibrated_35mm is not None:
            if alike(length, self.calibrated_35mm):
                return self.usual, None
            return (
                None,
                f"the camera is at {length:g} mm there, its calibration at {self.calibrated_35mm:g} mm",
            )
        if length not in self._estimates:
            self._estimates[length] = _estimated(self.usual.width, self.usual.height, length)
        return self._estimates[length], None

    def said(self, frames: Sequence[UnplacedFrame]) -> str:
        """What to tell of the intrinsics, with the number of `frames` that have none."""
        refused = sum(frame.camera is None for frame in frames)
        return (
            f"{self.remark}; {refused} of {len(frames)} frames are refused for it" if refused else self.remark
        )


@dataclass(frozen=True, slots=True)
class _Zoom:
    """Seconds [N], rising, and focal lengths [N], millimetres on 35 mm film."""

    time_s: NDArray[np.float64]
    focal_35mm: NDArray[np.float64]

    def at(self, time_s: float) -> tuple[float, float, float]:
        """The lengths of the rows before and after (or at) a time, and the one between them; outside that of
        the nearest row."""
        last = len(self.time_s) - 1
        before = max(int(np.searchsorted(self.time_s, time_s, side="right")) - 1, 0)
        after = min(int(np.searchsorted(self.time_s, time_s, side="left")), last)
        between = float(np.interp(time_s, self.time_s, self.focal_35mm))
        return float(self.focal_35mm[before]), float(self.focal_35mm[after]), between


def film_cameras(
    path: Path, size: tuple[int, int], log: FlightLog, calibration: Camera | None
) -> FilmCameras:
    """ValueError when nothing says how wide the camera of the film `path` sees or how large its pictures are,
    or a calibration is for another part of the sensor."""
    width, height = size
    if not (width > 0 and height > 0):
        raise ValueError(f"{path} does not say how large its pictures are: it is damaged")
    if log.focal_35mm is None:
        if calibration is None:
            raise ValueError(
                f"{path}: nothing says how wide its camera sees, the log has no focal length: give "
                "--calibration"
            )
        return FilmCameras(scaled_camera(calibration, width, height))
    usable = np.array([is_of_a_lens(length) for length in log.focal_35mm])
    lengths = log.focal_35mm[usable]
    varies = len(lengths) > 0 and not alike(float(lengths.min()), float(lengths.max()))
    if calibration is not None:
        camera = scaled_camera(calibration, width, height)
        if varies:
            return _calibrated(camera, _zoom(log, usable))
        doubt = calibration_doubt(camera, float(np.median(lengths))) if len(lengths) else ""
        return FilmCameras(camera, doubt)
    most = float(np.nanmedian(lengths if len(lengths) else log.focal_35mm))
    usual = camera_from_35mm(width, height, most, film=True)
    if not varies:
        return FilmCameras(usual.camera, usual.said)
    return FilmCameras(
        usual.camera,
        f"the camera zooms, {_range(lengths)}: every frame has intrinsics of its own, estimates within about "
        "10 %",
        _zoom(log, usable),
    )


def _calibrated(camera: Camera, zoom: _Zoom) -> FilmCameras:
    # Electronic stabilisation cuts films, so that a calibration need not be of exactly what the log says.
    ratios = np.abs(np.log(zoom.focal_35mm / focal_35mm_of(camera)))
    length = float(zoom.focal_35mm[np.argmin(ratios)])
    remark = (
        f"the camera zooms, {_range(zoom.focal_35mm)}; its calibration is of one focal length, taken as "
        f"{length:g} mm"
    )
    if doubt := calibration_doubt(camera, length):
        remark = f"{remark}; {doubt}"
    return FilmCameras(camera, remark, zoom, length)


def _zoom(log: FlightLog, usable: NDArray[np.bool_]) -> _Zoom:
    assert log.focal_35mm is not None
    time_s, first = np.unique(log.time_s[usable], return_index=True)
    return _Zoom(time_s, log.focal_35mm[usable][first])


def _estimated(width: int, height: int, length: float) -> Camera:
    return camera_from_35mm(width, height, length, film=True).camera


def _range(lengths: NDArray[np.float64]) -> str:
    return f"from {lengths.min():g} to {lengths.max():g} mm on 35 mm film"
