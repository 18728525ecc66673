"""A recording of which no frame can be used, and why."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from crowdfence.sources.recording import Recording, RefusedFrame


def no_frame_line(recording: Recording, refused: Sequence[RefusedFrame]) -> str:
    """What the reader met, then a frame that was refused for what most were refused for: the one is often why
    the other was."""
    first = "".join(f": {sentence}" for sentence in recording.warnings[:1])
    more = f" (and {len(recording.warnings) - 1} more warnings)" if len(recording.warnings) > 1 else ""
    last = f"; {_most_refusals(refused)}" if refused else ""
    return f"no frame of {recording.name} can be used{first}{more}{last}"


def _most_refusals(refused: Sequence[RefusedFrame]) -> str:
    kinds = [re.sub(r"[0-9.]+", "", one.reason) for one in refused]  # one reason with numbers of each frame
    kind, count = Counter(kinds).most_common(1)[0]
    which = f"the first of {len(refused)}" if kind == kinds[0] else f"{count} of {len(refused)}"
    return f"{which} refusals: {refused[kinds.index(kind)]}"
