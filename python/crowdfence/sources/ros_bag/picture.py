"""Pictures in ROS messages -> encoded pictures that everything else reads."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.pictures.decoding import LARGEST, picture_format

_CHANNELS = {"mono8": 1, "8UC1": 1, "rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4, "8UC4": 4}


def encoded_picture(message: Any, *, packed: bool) -> bytes:
    """A CompressedImage's file, or an Image's pixels as PPM or PGM. ValueError for what is neither JPEG nor
    PNG, and for encodings other than 8-bit grey and colour."""
    if packed:
        data = bytes(message.data)
        if picture_format(data) is None:
            raise ValueError(f"a CompressedImage of format {message.format!r} is neither JPEG nor PNG")
        if _is_mosaic(str(message.format)):
            raise ValueError(
                f"a CompressedImage of format {message.format!r} is the mosaic of a colour sensor, which "
                "looks like grey noise: record the colours that image_proc makes of it, as "
                "image_color/compressed"
            )
        return data
    pixels = image_pixels(message)
    header = b"P5" if pixels.ndim == 2 else b"P6"
    return b"%s %d %d 255\n" % (header, pixels.shape[1], pixels.shape[0]) + pixels.tobytes()


def _is_mosaic(told: str) -> bool:
    """Whether what was compressed is a Bayer pattern; "bayer_rggb8; jpeg compressed bgr8" is colours."""
    encoding, _, compressed = told.partition(";")
    return encoding.strip().startswith("bayer_") and not re.search(r"compressed\s+(bgr|rgb)", compressed)


def image_pixels(message: Any) -> NDArray[np.uint8]:
    """An 8-bit sensor_msgs/Image as grey [H, W] or RGB [H, W, 3]."""
    channels = _CHANNELS.get(message.encoding)
    if channels is None:
        raise ValueError(
            f"pictures encoded as {message.encoding!r} are not supported ({', '.join(_CHANNELS)}); "
            "record them with 8 bits a channel, such as rgb8, or compressed from such"
        )
    rows = _rows(message, channels)
    if channels == 1:
        return rows[..., 0]
    colours = rows[..., :3]
    return colours if message.encoding.startswith("rgb") else colours[..., ::-1]


def heatmap_pixels(message: Any) -> NDArray[Any]:
    """A heatmap as `PixelSources` wants it: mono8 or 32FC1 sensor_msgs/Image -> [h, w]."""
    if message.encoding in ("mono8", "8UC1"):
        return _rows(message, 1)[..., 0]
    if message.encoding != "32FC1":
        raise ValueError(f"a heatmap is mono8 or 32FC1, not {message.encoding!r}")
    order = ">f4" if message.is_bigendian else "<f4"
    values = np.ascontiguousarray(_rows(message, 4)).view(order)[..., 0]
    return values.astype(np.float32)


def _rows(message: Any, pixel_bytes: int) -> NDArray[np.uint8]:
    """[H, W, bytes of a pixel]; what fills up the rows is left out."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    # Decoders give bytes or arrays.
    data = np.frombuffer(message.data, np.uint8)
    if not (0 < width <= LARGEST[0] and 0 < height <= LARGEST[1]):
        raise ValueError(f"an image of {width}x{height} pixels")
    if step < width * pixel_bytes or data.size < height * step:
        raise ValueError(
            f"an image of {width}x{height} pixels, {message.encoding}, in {data.size} bytes of {step} a row"
        )
    return data[: height * step].reshape(height, step)[:, : width * pixel_bytes].reshape(height, width, -1)
