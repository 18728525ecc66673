"""The cameras of a recording in numbers that a pilot can check."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from crowdfence._core import Camera


@dataclass(frozen=True, slots=True)
class CameraReport:
    """Intrinsics of one camera and what they mean."""

    width: int
    height: int
    model: str
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...]
    hfov_deg: float | None
    """Angle between the left and the right edge of the picture at the height of the principal point; None
    where the distortion cannot be inverted at the edges."""
    blind_pixels: int
    """Pixels without a ray, because the distortion cannot be inverted there: they show nothing."""

    @staticmethod
    def of(camera: Camera) -> CameraReport:
        return CameraReport(
            width=camera.width,
            height=camera.height,
            model=camera.model,
            fx=camera.fx,
            fy=camera.fy,
            cx=camera.cx,
            cy=camera.cy,
            distortion=tuple(camera.distortion),
            hfov_deg=_hfov_deg(camera),
            blind_pixels=camera.blind_pixel_count(),
        )


def distinct_cameras(cameras: Iterable[Camera]) -> list[Camera]:
    """One of each, in the order of their first appearance (a flight repeats the same camera per frame)."""
    known: dict[tuple[object, ...], Camera] = {}
    for camera in cameras:
        size = (camera.width, camera.height, camera.model, *camera.distortion)
        known.setdefault((*size, camera.fx, camera.fy, camera.cx, camera.cy), camera)
    return list(known.values())


def _hfov_deg(camera: Camera) -> float | None:
    try:
        rays = camera.unproject([(0.0, camera.cy), (float(camera.width), camera.cy)])
    except ValueError:
        return None
    # Signed angles from the optical axis, so that a view of more than half a turn comes out right.
    left, right = (math.atan2(ray[0], ray[2]) for ray in rays)
    return math.degrees(right - left)
