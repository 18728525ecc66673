"""A recording of which no frame can be used, and why."""

from __future__ import annotations

from collections.abc import Sequence

from crowdfence.sources.recording import Recording, RefusedFrame


def no_frame_line(recording: Recording, refused: Sequence[RefusedFrame]) -> str:
    """What the reader met, then the first frame that was refused: the one is often why the other was."""
    first = "".join(f": {sentence}" for sentence in recording.warnings[:1])
    more = f" (and {len(recording.warnings) - 1} more warnings)" if len(recording.warnings) > 1 else ""
    last = f"; the first of {len(refused)} refusals: {refused[0]}" if refused else ""
    return f"no frame of {recording.name} can be used{first}{more}{last}"
