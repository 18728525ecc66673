"""Whether a recording says where people were."""

from __future__ import annotations

from crowdfence.sources.recording import Recording


def require_people(recording: Recording, instead: str = "") -> None:
    """ValueError where it does not, with why, where that is known, and what to do `instead`."""
    if len(recording.people.stamps_ns):
        return
    said = f"{recording.name} does not record where people are"
    raise ValueError("; ".join(filter(None, (said, recording.people.unreadable, instead))))
