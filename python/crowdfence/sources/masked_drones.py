"""Recordings of drones that see parts of themselves, or whose pictures have writing laid over them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike

from crowdfence.errors import quoted
from crowdfence.sources.camera_mask import CameraMask
from crowdfence.sources.recording import Recording


def camera_masks(
    given: Mapping[str, str | PathLike[str] | ArrayLike | CameraMask],
) -> dict[str, CameraMask]:
    """By drone: a file, a bool array [h, w] that is True where nothing can be seen, or a mask."""
    return {drone: _mask(drone, one) for drone, one in given.items()}


def _mask(drone: str, given: str | PathLike[str] | ArrayLike | CameraMask) -> CameraMask:
    if isinstance(given, CameraMask):
        return given
    if isinstance(given, (str, PathLike)):
        return CameraMask.open(given)
    try:
        return CameraMask(np.asarray(given))
    except ValueError as error:
        raise ValueError(f"{drone}: {error}") from error


def with_camera_masks(recording: Recording, masks: Mapping[str, CameraMask]) -> Recording:
    """The recording whose heatmaps say nothing of what the masks hide; the manifest tells how much that is.

    ValueError for a drone that the recording has not, and for pictures of other proportions.
    """
    for drone in masks:
        if drone not in recording.drones:
            raise ValueError(
                f"a camera mask is for {quoted(drone)}; {recording.name} holds "
                f"{', '.join(recording.drones) or 'no drone'}"
            )
    frames = tuple(
        replace(frame, mask=masks[frame.drone]) if frame.drone in masks else frame
        for frame in recording.frames
    )
    for drone, width, height in sorted({(one.drone, one.camera.width, one.camera.height) for one in frames}):
        try:
            if drone in masks:
                masks[drone].require_fit(width, height)
        except ValueError as error:
            raise ValueError(f"{drone}: {error}") from error
    hidden = {drone: round(mask.share, 4) for drone, mask in masks.items()}
    return replace(recording, frames=frames, manifest={**recording.manifest, "hidden_by_camera_mask": hidden})
