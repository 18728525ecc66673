"""The detector that a command's options name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from crowdfence.cli import console, options
from crowdfence.cli.wording import counted
from crowdfence.detector.shipped import PHOTOGRAPH_MODEL, SHIPPED_MODEL

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector
    from crowdfence.sources.recording import Recording


def chosen_detector(recording: Recording, told: dict[str, Any]) -> Detector | None:
    """What `pipeline.run` takes. Heatmaps that somebody recorded, maybe with a detector of their own, are not
    left aside in silence because nobody named another one."""
    from crowdfence.pipeline.choose_detector import choose_detector, frames_without_picture

    detector = choose_detector(
        recording,
        told["detector"],
        contract=told["contract"],
        enlarge=told["enlarge"].value,
        device=told["device"].value,
        far_every_s=told.get("far_every_s", 0.0),
    )
    if told["detector"] == options.AUTO and detector is not None:
        if _holds_heatmaps(recording):
            console.warn(
                f"the recorded heatmaps are not used: {detector.contract.name} looks at the pictures; "
                "--detector recorded takes them"
            )
        tell_choice(detector)
    if (
        told["detector"] == options.AUTO
        and detector is None
        and (without := frames_without_picture(recording))
    ):
        console.warn(
            f"{without} of {counted(len(recording.frames), 'frame')} hold a heatmap and no picture, so the "
            "recorded heatmaps are taken of all: --detector NAME lets a detector look at the pictures that "
            "are there"
        )
    return detector


def tell_choice(detector: Detector) -> None:
    """Say it where the pictures decided against the model that looks by default."""
    if detector.contract.name == PHOTOGRAPH_MODEL:
        console.warn(
            f"most pictures are unlike those that {SHIPPED_MODEL} was tested on, as real cameras' are: "
            f"{PHOTOGRAPH_MODEL} looks at them; --detector {SHIPPED_MODEL} takes the other"
        )


def _holds_heatmaps(recording: Recording) -> bool:
    return any(frame.pixels.heatmap is not None for frame in recording.frames)
