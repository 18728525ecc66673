"""Boxes around people -> heatmap.

A low camera looks along the ground: a body covers ground far behind its feet, and all that its box hides
would be called crowd. `contact` marks the ground that people stand on instead: a disc around where the middle
of the box's lower side meets it.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from crowdfence.sources.multi_camera.calibration import FixedCamera

Boxes = Literal["contact", "bodies"]
STRIDE = 4
"""Pixels of the picture per heatmap cell."""
CONTACT_RADIUS_M = 0.5
_CORNERS = 16


def box_heatmap(fixed: FixedCamera, boxes: NDArray[np.float64], kind: Boxes) -> NDArray[np.uint8]:
    """[h, w], 255 where people are; boxes [B, 4] as in `Annotated`."""
    camera = fixed.camera
    canvas = Image.new("L", (-(-camera.width // STRIDE), -(-camera.height // STRIDE)))
    draw = ImageDraw.Draw(canvas)
    for left, top, right, bottom in boxes:
        if kind == "bodies":
            draw.rectangle([left / STRIDE, top / STRIDE, right / STRIDE, bottom / STRIDE], fill=255)
            continue
        outline = _contact(fixed, np.array([(left + right) / 2.0, bottom]))
        if outline is not None:
            draw.polygon([(x / STRIDE, y / STRIDE) for x, y in outline], fill=255, outline=255)
    return np.asarray(canvas)


def _contact(fixed: FixedCamera, pixel: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Image points [16, 2] of the disc around a person's feet; None where they are not on the ground."""
    pose = fixed.world_from_camera
    ray = pose[:3, :3] @ np.asarray(fixed.camera.unproject(pixel[None]))[0]
    if ray[2] >= -1e-6:
        return None
    feet = pose[:3, 3] - ray * (pose[2, 3] / ray[2])
    angles = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    rim = feet + CONTACT_RADIUS_M * np.stack([np.cos(angles), np.sin(angles), np.zeros(_CORNERS)], axis=-1)
    in_camera = (rim - pose[:3, 3]) @ pose[:3, :3]
    if (in_camera[:, 2] <= 0.1).any():
        return None
    return np.asarray(fixed.camera.project(in_camera))
