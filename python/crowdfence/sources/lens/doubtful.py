"""Intrinsics that no usual camera has: of another size of the picture, in other units or another order.

They make valid rays, so that nothing is refused, and zones lie beside their crowds.
"""

from __future__ import annotations

import math

from crowdfence._core import Camera

MOST_OFF_THE_MIDDLE = 0.1
"""Of the picture's width or height. Real lenses are off by some hundredths."""

WIDEST_PINHOLE_DEG = 150.0
"""Across the longer side. A lens that shows more bends lines, and has a model of its own."""

MOST_ASPECT = 1.05
"""fy / fx, or its inverse. Pixels are square but for some thousandths."""

MOST_TANGENTIAL = 0.02
"""p1 and p2 of real lenses are some thousandths; k3 may be anything."""


def lens_doubt(camera: Camera) -> str | None:
    """What is doubtful about a camera, as the end of a sentence that begins with whose it is; None for a
    usual one."""
    width, height = camera.width, camera.height
    off = max(abs(camera.cx / width - 0.5), abs(camera.cy / height - 0.5))
    if off > MOST_OFF_THE_MIDDLE:
        return (
            f"the principal point ({camera.cx:g}, {camera.cy:g}) is far from the middle of pictures of "
            f"{width} x {height}: are cx and cy in pixels, of this size of the picture, and in this order? "
            "Else zones are shifted"
        )
    widest_deg = math.degrees(2.0 * math.atan(max(width / camera.fx, height / camera.fy) / 2.0))
    if camera.model == "pinhole" and widest_deg > WIDEST_PINHOLE_DEG:
        return (
            f"a focal length of {camera.fx:g} x {camera.fy:g} in pictures of {width} x {height} is a field "
            f"of view of {widest_deg:.0f} degrees: are fx and fy in pixels? Else zones are anywhere"
        )
    if not 1 / MOST_ASPECT <= camera.fy / camera.fx <= MOST_ASPECT:
        return (
            f"focal lengths of {camera.fx:g} x {camera.fy:g} are of pixels that are not square: are both of "
            f"this size of the picture, {width} x {height}? Else zones are too near the middle of what it "
            "sees, or too far; and if the pictures are squeezed, detectors see people squeezed"
        )
    tangential = camera.distortion[2:4] if camera.model == "brown_conrady" else []
    if max(map(abs, tangential), default=0.0) > MOST_TANGENTIAL:
        p1, p2 = tangential
        return (
            f"its distortion has p1 = {p1:g} and p2 = {p2:g}, which no usual lens has: are the coefficients "
            "in the order k1, k2, p1, p2, k3? Others write k1, k2, k3, p1, p2, and zones are beside their "
            "crowds"
        )
    return None
