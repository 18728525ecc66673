"""Things that people made in rows, to lay upon crops: facades, road markings, panels, print.

From afar a row of windows, dashes or letters has the size and the spacing of a row of people. Each is drawn
flat, with straight edges and one or two colours of its own, and then seen askew.
"""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

_LETTERS = list("ABCDEFGHKLMNPRSTUVXYZ0123456789")
_SIDE = 256


def panels(rng: np.random.Generator, like: Tensor) -> tuple[Tensor, Tensor]:
    """Patterns [3, H, W] for an image of that shape, and the share [1, H, W] that they cover."""
    height, width = like.shape[1:]
    picture = np.zeros((height, width, 3), np.float32)
    cover = np.zeros((height, width), np.float32)
    for _ in range(int(rng.integers(1, 4))):
        drawn, own = _KINDS[int(rng.integers(len(_KINDS)))](rng)
        askew = _askew(rng, height, width)
        seen, share = _seen(drawn, askew, height, width), _seen(own, askew, height, width)
        seen /= np.maximum(_seen(np.ones_like(own), askew, height, width), 1e-6)[..., None]
        picture = seen * share[..., None] + picture * (1.0 - share[..., None])
        cover = np.maximum(cover, share)
    laid = torch.from_numpy(picture.transpose(2, 0, 1).copy()).to(like.device)
    return laid, torch.from_numpy(cover[None]).to(like.device)


def _facade(rng: np.random.Generator) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A wall, or a roof from above, with windows, doors or plates in rows and columns."""
    drawn = np.tile(_wall(rng), (_SIDE, _SIDE, 1))
    down, across = (int(rng.integers(6, 60)) for _ in range(2))
    share_down, share_across = (float(rng.uniform(0.25, 0.85)) for _ in range(2))
    colours = [_any_colour(rng) for _ in range(int(rng.integers(1, 3)))]
    left_out = rng.uniform(0.0, 0.3)
    for top in range(int(rng.integers(0, down)), _SIDE, down):
        for left in range(int(rng.integers(0, 4)), _SIDE, across):
            if rng.random() > left_out:
                corner = (left + round(share_across * across), top + round(share_down * down))
                cv2.rectangle(drawn, (left, top), corner, colours[int(rng.integers(len(colours)))], -1)
    return _shaded(drawn, rng), np.ones((_SIDE, _SIDE), np.float32)


def _dashes(rng: np.random.Generator) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Lines side by side, whole or dashed: lanes, crossings, bays. Ground shows between them or not."""
    drawn = np.tile(_grey(rng), (_SIDE, _SIDE, 1))
    own = np.full((_SIDE, _SIDE), float(rng.random() < 0.5), np.float32)
    paint = (1.0, 1.0, 1.0) if rng.random() < 0.75 else (0.95, 0.8, 0.2)
    apart, thick = int(rng.integers(10, 90)), int(rng.integers(2, 9))
    dash = int(rng.integers(4, 50)) if rng.random() < 0.7 else _SIDE
    gap = int(dash * rng.uniform(0.4, 2.0))
    for left in range(int(rng.integers(0, apart)), _SIDE, apart):
        for top in range(int(rng.integers(-gap, 1)), _SIDE, dash + gap):
            for canvas, value in ((drawn, paint), (own, 1.0)):
                cv2.rectangle(canvas, (left, max(0, top)), (left + thick, top + dash), value, -1)
    return _shaded(drawn, rng), own


def _print(rng: np.random.Generator) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Lines of letters on a board."""
    board, ink = (tuple(round(255 * one) for one in _any_colour(rng)) for _ in range(2))
    drawn = np.tile(np.array(board, np.uint8), (_SIDE, _SIDE, 1))
    scale = float(rng.uniform(0.4, 2.5))
    line = round(32 * scale)
    for bottom in range(line, _SIDE + line, line):
        words = "".join(rng.choice(_LETTERS, 40))
        face = int(rng.choice([cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_COMPLEX]))
        cv2.putText(drawn, words, (2, bottom), face, scale, ink, max(1, round(2 * scale)), cv2.LINE_AA)
    return drawn.astype(np.float32) / 255.0, np.ones((_SIDE, _SIDE), np.float32)


_KINDS = (_facade, _dashes, _print)


def _seen(
    flat: NDArray[np.float32], askew: NDArray[np.float64], height: int, width: int
) -> NDArray[np.float32]:
    """Warped at twice the size and averaged: a pixel sees all that falls into it."""
    twice = np.diag([2.0, 2.0, 1.0]) @ askew
    large = cv2.warpPerspective(flat, twice, (2 * width, 2 * height), flags=cv2.INTER_LINEAR)
    return cv2.resize(large, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)


def _askew(rng: np.random.Generator, height: int, width: int) -> NDArray[np.float64]:
    """Where the corners of what was drawn are seen: a rectangle, turned and tilted."""
    side = float(np.exp(rng.uniform(np.log(40.0), np.log(360.0))))
    corners = side * np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    corners *= (1.0, rng.uniform(0.25, 1.0))
    corners *= 1.0 + rng.uniform(-0.35, 0.35) * corners[:, 1:] / side  # what is far is narrow
    turn = rng.uniform(0.0, 2.0 * np.pi)
    cosine, sine = np.cos(turn), np.sin(turn)
    corners = corners @ np.array([[cosine, sine], [-sine, cosine]]) + rng.random(2) * (width, height)
    flat = np.array([[0, 0], [_SIDE, 0], [_SIDE, _SIDE], [0, _SIDE]], np.float32)
    return np.asarray(cv2.getPerspectiveTransform(flat, corners.astype(np.float32)), np.float64)


def _wall(rng: np.random.Generator) -> NDArray[np.float32]:
    return _grey(rng) if rng.random() < 0.6 else np.array(_any_colour(rng), np.float32)


def _grey(rng: np.random.Generator) -> NDArray[np.float32]:
    return (rng.uniform(0.15, 0.95) * (1.0 + rng.uniform(-0.08, 0.08, 3))).clip(0.0, 1.0).astype(np.float32)


def _any_colour(rng: np.random.Generator) -> tuple[float, float, float]:
    if rng.random() < 0.4:  # glass and paint are dark or white more often than not
        value = float(rng.choice([rng.uniform(0.02, 0.2), rng.uniform(0.75, 1.0)]))
        return (value, value, value)
    red, green, blue = (float(value) for value in rng.random(3))
    return (red, green, blue)


def _shaded(drawn: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Brighter on one side, with grain as stone and asphalt have it."""
    slope = rng.uniform(-0.3, 0.3, 2)
    v, u = np.mgrid[-0.5 : 0.5 : 1.0 / _SIDE, -0.5 : 0.5 : 1.0 / _SIDE]
    light = 1.0 + slope[0] * u + slope[1] * v + rng.uniform(0.0, 0.08) * rng.standard_normal(u.shape)
    return (drawn * light[..., None]).clip(0.0, 1.0).astype(np.float32)
