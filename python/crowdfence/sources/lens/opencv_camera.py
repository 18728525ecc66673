"""A `Camera` from the numbers that OpenCV, ROS and kalibr write of it.

All of them count pixels with the centre of the first one at (0, 0), ours is at (0.5, 0.5): half a pixel is
added to cx and cy.
"""

from __future__ import annotations

from collections.abc import Sequence

from crowdfence._core import Camera

HALF_PIXEL = 0.5
_MOST_SKEW_PX = 1.0
"""At the height of the focal length beside the middle: fits of square pixels have some tenths."""
_RADIAL = {"plumb_bob", "radtan", "rational_polynomial", "brown_conrady", ""}
_FISHEYE = {"equidistant", "fisheye", "kannala_brandt"}


def focal_and_centre(matrix: Sequence[float], name: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """(fx, fy) and (cx, cy) of a camera matrix of 9 values, by rows. ValueError for one with skew, or turned
    over as MATLAB writes it, with the principal point in the last row."""
    fx, skew, cx, _, fy, cy, *_ = matrix
    if abs(skew) > _MOST_SKEW_PX or [matrix[3], *matrix[6:]] != [0.0, 0.0, 0.0, 1.0]:
        raise ValueError(
            f"{name} is {', '.join(f'{value:g}' for value in matrix)}; it must be fx, 0, cx, 0, fy, cy, 0, "
            "0, 1, in this order and without skew"
        )
    return (fx, fy), (cx, cy)


def opencv_camera(
    size: tuple[int, int],
    focal_px: tuple[float, float],
    centre_px: tuple[float, float],
    model: str,
    coefficients: Sequence[float],
) -> Camera:
    """`size` (width, height) of the picture, `centre_px` as they count it; coefficients of plumb_bob (radtan)
    or equidistant, of which the last that are 0 may be missing. rational_polynomial is plumb_bob where its
    denominator is 1, and OpenCV's drivers write it so.

    ValueError for another distortion model, for coefficients beyond k1, k2, p1, p2, k3 or k1 to k4, and for
    intrinsics that the core refuses.
    """
    (width, height), (fx, fy) = size, focal_px
    cx, cy = (pixels + HALF_PIXEL for pixels in centre_px)
    values = [float(value) for value in coefficients]
    if model in _FISHEYE:
        if any(values[4:]):
            raise ValueError(f"{len(values)} distortion coefficients: only k1, k2, k3, k4 are supported")
        return Camera.fisheye(width, height, fx, fy, cx, cy, (values + [0.0] * 4)[:4])
    if model not in _RADIAL:
        raise ValueError(f"distortion model {model!r} is not supported (plumb_bob, radtan, equidistant)")
    if any(values[5:]):
        raise ValueError(f"{len(values)} distortion coefficients: only k1, k2, p1, p2, k3 are supported")
    radial = (values + [0.0] * 5)[:5]
    return Camera.pinhole(width, height, fx, fy, cx, cy, radial if any(radial) else None)
