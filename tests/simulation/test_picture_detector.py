"""The heatmaps of simulated pictures are those of the shipped detector."""

import io
from typing import Any

import numpy as np
from PIL import Image

from crowdfence import Camera, Detector
from crowdfence.simulation.picture_detector import (
    detected_heatmap,
    picture_detector,
    picture_detector_manifest,
)

CAMERA = Camera.pinhole(160, 128, 100.0, 100.0, 80.0, 64.0)


def encoded(pixels: np.ndarray) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


def pixels() -> np.ndarray:
    return np.random.default_rng(3).integers(0, 256, (128, 160, 3), dtype=np.uint8)


def levels(heatmap: np.ndarray) -> Any:
    return np.rint(heatmap * 255).astype(np.uint8)


def test_the_shipped_detector_sees_the_picture_at_the_scale_of_its_depth() -> None:
    """10 m over 100 pixels is 0.1 m per pixel; 2 m is 0.02, which is shown smaller."""
    detector, image = picture_detector(), pixels()
    for depth_m in (10.0, 2.0):
        found = detected_heatmap(detector, encoded(image), np.full((128, 160), depth_m), CAMERA)
        np.testing.assert_array_equal(found, levels(Detector()(image, depth_m / 100.0)))
    assert found.shape == (32, 40) and found.dtype == np.uint8


def test_a_picture_of_the_sky_is_seen_as_it_is() -> None:
    image = pixels()
    found = detected_heatmap(picture_detector(), encoded(image), np.full((128, 160), np.inf), CAMERA)
    np.testing.assert_array_equal(found, levels(Detector()(image, as_it_is=True)))


def test_the_manifest_names_the_model() -> None:
    assert picture_detector_manifest()["made_by"].startswith("crowdnet-s")
