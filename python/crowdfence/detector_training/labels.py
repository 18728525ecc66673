"""What the network should mark in an image, finer than its output: crops move, turn and scale the labels."""

from __future__ import annotations

from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.block_means import block_means
from crowdfence.labelled_pictures.picture_recording import LabelledPictures
from crowdfence.sources.recording import Frame, Recording
from crowdfence.truth.frame_labels import Target
from crowdfence.truth.ground_labels import RAYS_PER_CELL, STRIDE, ground_rays

__all__ = [
    "LABELS_PER_CELL",
    "LABEL_STRIDE",
    "STRIDE",
    "TARGETS",
    "Target",
    "TrainingLabels",
    "picture_training_labels",
    "training_labels",
]

TARGETS: tuple[Target, ...] = get_args(Target)

LABELS_PER_CELL = RAYS_PER_CELL
"""Along each axis of an output cell. With one label per cell, the labels of a turned crop agree with the
pixels that they stand for only to an IoU of .95; with two, of .985."""

LABEL_STRIDE = STRIDE // LABELS_PER_CELL
"""Image pixels per label along each axis."""


class TrainingLabels(NamedTuple):
    """Labels of one image for one target."""

    crowd: NDArray[np.uint8]
    """[H, W] share of the label's pixels that is crowd, times 255."""
    known: NDArray[np.bool_]
    """[H, W] False where the truth cannot be told from the image: such places teach nothing."""


def training_labels(
    target: Target, frame: Frame, recording: Recording, terrain: Terrain | None
) -> TrainingLabels:
    """Labels of a frame at `LABEL_STRIDE`, whole output cells of them. FrameError when its truth cannot be
    read, ValueError when `ground` is wanted without a terrain."""
    if target == "silhouettes":
        return _silhouettes(frame)
    if target == "ground":
        if terrain is None:
            raise ValueError(f"{recording.name} comes without a map, which the target 'ground' needs")
        rays = ground_rays(frame, recording, terrain)
        return TrainingLabels(rays.crowd.astype(np.uint8) * np.uint8(255), ~rays.hidden)
    raise ValueError(f"target is {target!r}; it must be one of {', '.join(TARGETS)}")


def picture_training_labels(pictures: LabelledPictures, frame: Frame) -> TrainingLabels:
    """Labels of an annotated picture, unknown where somebody marked it so. FrameError when its annotations
    cannot be used."""
    ignored = _shares(pictures.ignored(frame))
    return TrainingLabels(_levels(pictures.crowd(frame)), ignored == 0.0)


def _silhouettes(frame: Frame) -> TrainingLabels:
    share = _levels(frame.regions() > 0)
    return TrainingLabels(share, np.ones(share.shape, np.bool_))


def _levels(crowd: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return np.asarray(np.rint(_shares(crowd) * 255.0), np.uint8)


def _shares(mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Share of each label's pixels [H, W] // LABEL_STRIDE, whole output cells of them."""
    height, width = (side // STRIDE * STRIDE for side in mask.shape)
    return block_means(mask[:height, :width], LABEL_STRIDE)
