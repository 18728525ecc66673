"""Image -> input tensor: cut out, resized, padded, colours made stronger, normalised, laid out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import vibrant
from crowdfence.detector.contract.model_input import ModelInput
from crowdfence.detector.inference.patches import Patch
from crowdfence.errors import DetectorError

LETTERBOX_GREY = 114
"""What YOLO models are trained with around the picture."""

Image = NDArray[np.uint8]


def check_image(image: object) -> Image:
    """uint8 [H, W, 3], at least one pixel; DetectorError says what it is instead."""
    if not isinstance(image, np.ndarray):
        raise DetectorError(f"an image is a numpy array uint8 [H, W, 3] RGB, got {type(image).__name__}")
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
        raise DetectorError(f"an image is uint8 [H, W, 3] RGB, got {image.dtype} {list(image.shape)}")
    return image


def patch_pixels(image: Image, patch: Patch) -> Image:
    """Pixels [model height, model width, 3] that the model sees of a patch."""
    rows, columns = patch.rows, patch.columns
    cut = image[rows.start : rows.stop, columns.start : columns.stop]
    if patch.is_native:
        below, right = rows.model - cut.shape[0], columns.model - cut.shape[1]
        # Repeated borders look like more of the same ground; black ones would be an edge to detect.
        return cut if below == right == 0 else np.pad(cut, ((0, below), (0, right), (0, 0)), mode="edge")
    from PIL import Image as Pillow

    inside = (
        round((columns.stop - columns.start) * columns.scale),
        round((rows.stop - rows.start) * rows.scale),
    )
    resized = np.asarray(
        Pillow.fromarray(np.ascontiguousarray(cut)).resize(inside, Pillow.Resampling.BILINEAR)
    )
    if inside == (columns.model, rows.model):
        return resized
    framed = np.full((rows.model, columns.model, 3), LETTERBOX_GREY, np.uint8)
    top, left = int(rows.low), int(columns.low)
    framed[top : top + inside[1], left : left + inside[0]] = resized
    return framed


class InputTensor:
    """Pixels [N, h, w, 3] -> the tensor that the contract describes."""

    def __init__(self, model: ModelInput) -> None:
        self._channels_first = model.layout == "NCHW"
        self._reversed = model.color == "BGR"
        self._levels = None if model.dtype == "uint8" else _levels(model)
        self._vibrance = model.vibrance
        self.is_native = model.dtype == "uint8" and not self._channels_first and not self._reversed
        """The tensor is the pixels as they lie in memory."""

    def __call__(self, pixels: Image) -> NDArray[np.generic]:
        if self._vibrance != 1.0:
            rows = pixels.reshape(-1, *pixels.shape[2:])
            pixels = vibrant(rows, self._vibrance).reshape(pixels.shape)
        if self.is_native:
            return np.ascontiguousarray(pixels)
        if self._reversed:
            pixels = pixels[..., ::-1]
        if self._levels is None:
            return np.ascontiguousarray(pixels.transpose(0, 3, 1, 2) if self._channels_first else pixels)
        shape = pixels.shape
        if self._channels_first:
            tensor: NDArray[np.float32] = np.empty((shape[0], 3, shape[1], shape[2]), np.float32)
            for channel, levels in enumerate(self._levels):
                tensor[:, channel] = levels[pixels[..., channel]]
        else:
            tensor = np.empty(shape, np.float32)
            for channel, levels in enumerate(self._levels):
                tensor[..., channel] = levels[pixels[..., channel]]
        return tensor


def _levels(model: ModelInput) -> NDArray[np.float32]:
    """Normalised value of each of the 256 levels per channel [3, 256]: one look-up a pixel, rounded once."""
    level = np.arange(256, dtype=np.float64) * model.scale
    mean, std = np.array(model.mean)[:, None], np.array(model.std)[:, None]
    return ((level - mean) / std).astype(np.float32)
