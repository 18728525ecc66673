"""Which detector looks at a recording: the one that was named, or of the shipped ones the one that suits its
pictures."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crowdfence.errors import FrameError
from crowdfence.sources.layers import CROWD
from crowdfence.sources.recording import Recording

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector
    from crowdfence.detector.execution_device import Device
    from crowdfence.detector.inference.picture_parts import Enlarge

_RECORDED = "the heatmaps here are the recorded ones"
PICTURES_LOOKED_AT = 12
"""Evenly over a flight, which tell what looks at it."""


def choose_detector(
    recording: Recording,
    choice: str | Sequence[str],
    *,
    contract: Path | None = None,
    threads: int = 1,
    device: Device = "cpu",
    enlarge: Enlarge = "always",
    far_every_s: float = 0.0,
) -> Detector | None:
    """`choice` "auto", "recorded" or the path of a model -> what `pipeline.run` takes; several models are
    combined. The name of the shipped model stands for its path.

    "auto" is the shipped model that suits the pictures (`suitable_model`), where that loses no frame: every
    frame that has a heatmap also has a picture. The shipped models find crowds: of another layer "auto" takes
    the recorded heatmaps. ValueError when a model cannot be used, or the shipped one is missing.
    """
    named = partial(named_detector, threads=threads, device=device, enlarge=enlarge, far_every_s=far_every_s)
    choices = [choice] if isinstance(choice, str) else list(choice)
    if len(choices) > 1:
        return named(choices, contract=contract)
    choice = choices[0]
    if recording.layer != CROWD:
        _check_layer(recording, choice)
        choice = "recorded" if choice == "auto" else choice
    if choice == "recorded" or (choice == "auto" and not _pictures_suffice(recording)):
        if contract is not None:
            raise ValueError(f"--contract {contract} belongs to a model; {_RECORDED}")
        if enlarge != "always":
            raise ValueError(f"--enlarge {enlarge} is for a model; {_RECORDED}")
        if device != "cpu":
            raise ValueError(f"--device {device} is for a model; {_RECORDED}")
        if far_every_s:
            raise ValueError(f"--far-every {far_every_s:g} is for a model; {_RECORDED}")
        return None
    if choice != "auto":
        return named([choice], contract=contract)
    if contract is not None:
        raise ValueError(f"--contract {contract} belongs to a model: name it with --detector")
    try:
        return named([suitable_model(recording)])
    except FileNotFoundError as error:
        raise ValueError(
            f"{recording.name} has pictures, but the detector that comes with crowdfence is missing "
            "from this copy: install it again, name a model with --detector MODEL.onnx, or take the recorded "
            "heatmaps with --detector recorded"
        ) from error


def suitable_model(recording: Recording) -> str:
    """Name of the shipped model that suits the pictures of a recording: where more than half of
    `PICTURES_LOOKED_AT` look unlike everything that the first one was tested on, as those of real cameras
    do, the one for photographs (figures: training/README.md).

    FileNotFoundError when this copy of the package lacks the first one.
    """
    from crowdfence.detector.blank_picture import blank_reason
    from crowdfence.detector.detector import Detector
    from crowdfence.detector.shipped import PHOTOGRAPH_MODEL, SHIPPED_MODEL

    tested = Detector(SHIPPED_MODEL).contract.pictures
    frames = [frame for frame in recording.frames if frame.pixels.image is not None]
    if tested is None or not frames:
        return SHIPPED_MODEL
    unlike = []
    for index in np.unique(np.linspace(0, len(frames) - 1, PICTURES_LOOKED_AT).round().astype(int)):
        try:
            image = frames[index].image()
        except FrameError:
            continue  # told when its turn comes
        if blank_reason(image) is None:
            unlike.append(tested.is_unlike(image))
    return PHOTOGRAPH_MODEL if 2 * sum(unlike) > len(unlike) else SHIPPED_MODEL


def _check_layer(recording: Recording, choice: str) -> None:
    """ValueError where nothing makes the heatmaps of a layer."""
    from crowdfence.detector.shipped import FILES

    if choice in FILES:
        raise ValueError(f"--detector {choice} finds crowds, not the layer {recording.layer!r}")
    if choice in ("auto", "recorded") and recording.layer not in recording.layers:
        raise ValueError(
            f"{recording.name} holds no heatmaps of the layer {recording.layer!r}; name a model that makes "
            "them with --detector MODEL.onnx"
        )


def named_detector(
    models: Sequence[str | Path],
    *,
    contract: Path | None = None,
    threads: int = 1,
    device: Device = "cpu",
    enlarge: Enlarge = "always",
    far_every_s: float = 0.0,
) -> Detector:
    """The detector of one model, or the combination of several; shipped ones go by their names. ValueError
    for words that mean no model here, for one contract of several, and for `far_every_s` of what looks at
    every picture as a whole."""
    from crowdfence.detector.detector import Detector
    from crowdfence.detector.shipped import SHIPPED_MODEL, model_path

    if word := next((model for model in models if len(models) > 1 and model in ("auto", "recorded")), None):
        raise ValueError(f"--detector {word} cannot be combined; name {SHIPPED_MODEL} or a model's file")
    if contract is not None and len(models) > 1:
        raise ValueError(f"--contract {contract}: several detectors have one each, beside or inside them")
    files = [model_path(model, device).resolve() for model in models]  # one file may have several names
    if twice := [model for number, model in enumerate(models) if files[number] in files[:number]]:
        raise ValueError(f"--detector {twice[0]} is given twice: its opinion would count double")
    detectors = [
        Detector(model, contract, threads=threads, device=device, enlarge=enlarge, far_every_s=far_every_s)
        for model in models
    ]
    detector = detectors[0] if len(detectors) == 1 else Detector.combined(detectors)
    if far_every_s and not detector.far_every_s:
        why = "it does not say how far it sees" if len(detectors) == 1 else "several detectors"
        raise ValueError(f"--far-every {far_every_s:g}: {why}, so every picture is looked at as a whole")
    return detector


def frames_without_picture(recording: Recording) -> int:
    """How many frames hold a heatmap and no picture, which keeps a detector from the pictures of the others;
    0 where there are no pictures at all."""
    if not _has_pictures(recording):
        return 0
    return sum(frame.pixels.heatmap is not None and frame.pixels.image is None for frame in recording.frames)


def _pictures_suffice(recording: Recording) -> bool:
    return _has_pictures(recording) and frames_without_picture(recording) == 0


def _has_pictures(recording: Recording) -> bool:
    return any(frame.pixels.image is not None for frame in recording.frames)
