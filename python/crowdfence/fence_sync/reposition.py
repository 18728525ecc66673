"""A vehicle sent to a place, and whether it really goes.

PX4 acknowledges a place in a fence as accepted, says "Reposition is outside geofence" and stays where it is.
"""

from __future__ import annotations

from crowdfence.fence_sync.conversation import Clock, Conversation, Patience, Waiting, ask
from crowdfence.fence_sync.messages import Command, CommandAck, Message, StatusText

REPOSITION = 192
"""MAV_CMD_DO_REPOSITION."""
ACCEPTED = 0
LISTEN_S = 1.0
"""After an answer, for what the vehicle says of it."""
_WARNING = 4


def reposition(
    latitude_deg: float, longitude_deg: float, height_m: float, clock: Clock, patience: Patience
) -> Conversation[str | None]:
    """Send a vehicle to a place, metres above the sea; None where it goes, else why it does not. Silence."""
    said: list[str] = []

    def answer(heard: Message) -> int | None:
        _listen(heard, said)
        return heard.result if isinstance(heard, CommandAck) and heard.command == REPOSITION else None

    question = Command(REPOSITION, latitude_deg, longitude_deg, height_m)
    result = yield from ask(question, answer, clock, patience)
    until_s = clock() + LISTEN_S
    while (heard := (yield Waiting((), until_s))) is not None:
        _listen(heard, said)
    if result != ACCEPTED:
        return "; ".join([f"the vehicle answers result {result}", *said])
    return "; ".join(said) or None


def _listen(heard: Message, said: list[str]) -> None:
    if isinstance(heard, StatusText) and heard.severity <= _WARNING and "fence" in heard.text.lower():
        said.append(heard.text)
