"""Intrinsics that no usual camera has: of another size of the picture, in other units, or exchanged.

They make valid rays, so that nothing is refused, and zones lie beside their crowds.
"""

from __future__ import annotations

import math

from crowdfence._core import Camera

MOST_OFF_THE_MIDDLE = 0.1
"""Of the picture's width or height. Real lenses are off by some hundredths."""

WIDEST_PINHOLE_DEG = 150.0
"""Across the longer side. A lens that shows more bends lines, and has a model of its own."""


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
    return None
