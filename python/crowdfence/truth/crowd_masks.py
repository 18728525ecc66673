"""The label that a recording itself holds for a frame: its crowd pixels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.recording import Frame, Recording
from crowdfence.truth.crowd_regions import crowd_regions

MaskOf = Callable[[Frame], NDArray[np.bool_]]
"""Pixels [H, W] of a frame: those of crowds, or those that do not count."""

CLOSING_PX = 6.0
"""Radius in pixels with which silhouettes are merged where a recording holds no ready regions."""


def has_crowd_mask(frame: Frame) -> bool:
    return frame.pixels.regions is not None or frame.pixels.silhouettes is not None


def require_crowd_masks(recording: Recording) -> None:
    """ValueError when no frame has a label."""
    if not any(has_crowd_mask(frame) for frame in recording.frames):
        raise ValueError(
            f"{recording.name} holds no truth: no frame has crowd regions or a segmentation with crowd"
        )


def unlabelled_warning(recording: Recording) -> str | None:
    """One sentence where some frames have no label, which nobody can tell from one that shows no crowd."""
    without = Counter(frame.drone for frame in recording.frames if not has_crowd_mask(frame))
    if not without:
        return None
    of = Counter(frame.drone for frame in recording.frames)
    each = ", ".join(f"{drone} {without[drone]} of {of[drone]}" for drone in sorted(without))
    return (
        f"{without.total()} of {of.total()} frames have no label ({each}): crowd that is labelled in no "
        "other frame counts as a false alarm where they show it, and the IoU is lower for it"
    )


def crowd_mask(frame: Frame) -> NDArray[np.bool_]:
    """True crowd pixels [H, W]: recorded regions, or silhouettes merged and filled. FrameError without."""
    if frame.pixels.regions is not None:
        return frame.regions() > 0
    return crowd_regions(frame.silhouettes(), closing_px=CLOSING_PX)
