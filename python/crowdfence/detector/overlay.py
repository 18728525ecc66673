"""A heatmap on top of its picture, for people to look at."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

_RAMP = np.array([(255, 226, 60), (255, 140, 30), (245, 30, 90), (225, 0, 140)], dtype=np.float64)
"""From 0 to 1. Yellow to magenta: grass, rock, tarmac and snow have none of it."""
_MOST_OPAQUE = 0.5
_INSIDE, _OUTSIDE = (255, 255, 255), (0, 0, 0)


def overlay(image: ArrayLike, heatmap: ArrayLike, threshold: float = 0.5) -> NDArray[np.uint8]:
    """The picture with the heatmap as a colour, the more opaque the higher, and an outline at `threshold`.

    image uint8 [H, W, 3] RGB; heatmap [h, w] at any stride of it, float in [0, 1] or uint8 (value / 255).
    Returns uint8 [H, W, 3]. The outline is white with a black rim, so that one of the two stands out on any
    ground; a value equal to `threshold` lies outside, as in b = [m > threshold] of equation 1.

    ValueError for arrays of another kind, and for values outside [0, 1].
    """
    picture = np.asarray(image)
    if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3 or picture.size == 0:
        raise ValueError(f"image must be uint8 [H, W, 3], got {picture.dtype} {list(picture.shape)}")
    height, width = picture.shape[:2]
    values = _at_picture_size(heatmap, width, height)
    # Levels and tables: floating point over every channel of a 4K picture takes several times as long.
    level = (values * np.float32(255) + np.float32(0.5)).astype(np.uint8)
    keep, paint = _tables()
    painted = (picture * keep[level][..., None] + paint[level]) >> 8
    result = painted.astype(np.uint8)
    crowd = values > threshold
    line_px = max(1, round(min(width, height) / 480))
    result[_grown(crowd, line_px) & ~crowd] = _OUTSIDE
    result[crowd & _grown(~crowd, line_px)] = _INSIDE
    return result


def caption(image: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    """The picture [H, W, 3] with one small line of text in its lower left corner, white with a black rim."""
    height = image.shape[0]
    size_px = max(10, round(height / 40))
    canvas = Image.fromarray(image)
    ImageDraw.Draw(canvas).text(
        (size_px // 2, height - size_px // 2),
        text,
        font=ImageFont.load_default(size_px),
        anchor="ld",
        fill=_INSIDE,
        stroke_fill=_OUTSIDE,
        stroke_width=max(1, size_px // 8),
    )
    return np.asarray(canvas)


def _at_picture_size(heatmap: ArrayLike, width: int, height: int) -> NDArray[np.float32]:
    values = np.asarray(heatmap)
    if values.ndim != 2 or values.size == 0:
        raise ValueError(f"heatmap must be [h, w] with at least one cell, got shape {list(values.shape)}")
    if values.dtype == np.uint8:
        values = values / np.float32(255)
    elif values.dtype.kind != "f":
        raise ValueError(f"heatmap must be floating point or uint8, got {values.dtype}")
    wrong = ~((values >= 0.0) & (values <= 1.0))  # also true for NaN
    if wrong.any():
        row, column = (int(index) for index in np.argwhere(wrong)[0])
        raise ValueError(
            f"heatmap value {values[row, column]} at row {row}, column {column} is not in [0, 1]"
        )
    cells = Image.fromarray(np.ascontiguousarray(values, dtype=np.float32))
    enlarged = np.asarray(cells.resize((width, height), Image.Resampling.BILINEAR))
    return np.clip(enlarged, np.float32(0), np.float32(1))


def _tables() -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Per heatmap level: how much of the picture stays [256], and what is added [256, 3], in 1/256."""
    value = np.linspace(0.0, 1.0, 256)
    opacity = _MOST_OPAQUE * np.sqrt(value) * (value > 0.02)  # a faint veil over everything says nothing
    stops = np.linspace(0.0, 1.0, len(_RAMP))
    colour = np.stack([np.interp(value, stops, _RAMP[:, channel]) for channel in range(3)], axis=-1)
    keep = np.round(256 * (1 - opacity))
    return keep.astype(np.uint16), ((256 - keep)[:, None] * colour).astype(np.uint16)


def _grown(mask: NDArray[np.bool_], steps: int) -> NDArray[np.bool_]:
    """The mask and its four neighbours, `steps` times; nothing enters from outside the picture."""
    for _ in range(steps):
        grown = mask.copy()
        grown[1:] |= mask[:-1]
        grown[:-1] |= mask[1:]
        grown[:, 1:] |= mask[:, :-1]
        grown[:, :-1] |= mask[:, 1:]
        mask = grown
    return mask
