"""What a vehicle is asked besides its fence: which one it is, where it is, where its home is, parameters."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import cast

from crowdfence.fence_sync.conversation import Clock, Conversation, Patience, ask
from crowdfence.fence_sync.fence_error import Silence
from crowdfence.fence_sync.messages import (
    HOME_MESSAGE,
    POSITION_MESSAGE,
    VERSION_MESSAGE,
    Autopilot,
    Home,
    Message,
    Parameter,
    Position,
    ReadParameter,
    RequestMessage,
    Version,
)

OPTIONAL_TRIES = 4
"""Of what a vehicle may not know: a position without satellites, a number of its own."""
_Optional = type[Position] | type[Home] | type[Version]
_NUMBERS: dict[_Optional, int] = {
    Position: POSITION_MESSAGE,
    Home: HOME_MESSAGE,
    Version: VERSION_MESSAGE,
}


def optional(
    kind: _Optional, clock: Clock, patience: Patience, *, most_tries: int = OPTIONAL_TRIES
) -> Conversation[Message | None]:
    """A `Position`, `Home` or `Version`; None where the vehicle does not say it."""
    few = _few(patience, most_tries)

    def answer(heard: Message) -> Message | None:
        return heard if isinstance(heard, kind) else None

    try:
        found = yield from ask(RequestMessage(_NUMBERS[kind]), answer, clock, few)
    except Silence:
        return None
    return cast("Message", found)


def parameters(
    names: Iterable[str], autopilot: int, clock: Clock, patience: Patience, *, most_tries: int | None = None
) -> Conversation[dict[str, float]]:
    """Values by name, of those that the vehicle says; `most_tries` for those that it may not know."""
    patience = patience if most_tries is None else _few(patience, most_tries)
    values = {}
    for name in names:

        def answer(heard: Message, name: str = name) -> float | None:
            if not isinstance(heard, Parameter) or heard.name != name:
                return None
            return heard.value_of_bytes if autopilot == Autopilot.PX4 else heard.value

        try:
            values[name] = yield from ask(ReadParameter(name), answer, clock, patience)
        except Silence:
            continue
    return values


def _few(patience: Patience, most_tries: int) -> Patience:
    return replace(patience, tries=min(patience.tries, most_tries))
