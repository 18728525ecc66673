"""The heatmaps of a simulated mission: what the shipped detector makes of its pictures."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from crowdfence._core import Camera
    from crowdfence.detector.detector import Detector

_GRID = 12, 16
"""Places at which the scale of a picture is read from its depth."""


def picture_detector() -> Detector:
    """The shipped detector. FileNotFoundError where this copy of the package lacks it."""
    from crowdfence.detector.detector import Detector

    return Detector()


def detected_heatmap(
    detector: Detector, image: bytes, depth_m: NDArray[np.floating[Any]], camera: Camera
) -> NDArray[np.uint8]:
    """Heatmap [H / stride, W / stride] (value / 255) of an encoded picture, as a flight would see it: from
    the picture as it was recorded, at the scale that the depth [H, W] tells (no depth: sky)."""
    from PIL import Image

    rgb = np.asarray(Image.open(io.BytesIO(image)).convert("RGB"))
    rows, columns = (
        ((np.arange(count) + 0.5) * side / count).astype(np.intp)
        for count, side in zip(_GRID, depth_m.shape, strict=True)
    )
    gsd_m = depth_m[np.ix_(rows, columns)].astype(np.float64) / np.sqrt(camera.fx * camera.fy)
    gsd_m[~(np.isfinite(gsd_m) & (gsd_m > 0.0))] = np.nan
    seen = np.isfinite(gsd_m).any()
    heatmap = detector(rgb, gsd_m) if seen else detector(rgb, as_it_is=True)
    return np.rint(heatmap * np.float32(255)).astype(np.uint8)


def picture_detector_manifest() -> dict[str, Any]:
    """Ready for JSON."""
    contract = picture_detector().contract
    return {"made_by": f"{contract.name} {contract.version or ''}".strip(), "stride": contract.output.stride}
