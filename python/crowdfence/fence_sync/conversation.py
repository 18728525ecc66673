"""Conversations with a vehicle, as generators: what to say and until when to wait out, what was heard in.

No socket, no thread, no clock of their own: whoever holds the conversation sends what it yields and sends
back the next message, or None when nothing was heard until then. Time is an argument.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TypeVar

from crowdfence.fence_sync.fence_error import Silence
from crowdfence.fence_sync.messages import Message

T = TypeVar("T")
AnswerT = TypeVar("AnswerT")
Clock = Callable[[], float]
"""Seconds that never go back."""


@dataclass(frozen=True, slots=True)
class Waiting:
    """Say this, then listen."""

    say: tuple[Message, ...]
    until_s: float


Conversation = Generator[Waiting, Message | None, T]


@dataclass(frozen=True, slots=True)
class Patience:
    """How long silence is borne."""

    retry_s: float = 0.5
    """Said again after so long."""
    tries: int = 10
    """Times that something is said before the vehicle counts as silent."""
    longest_s: float = 60.0
    """Of one transfer, however much is heard."""

    @property
    def silence_s(self) -> float:
        return self.retry_s * self.tries


def ask(
    question: Message, answer: Callable[[Message], AnswerT | None], clock: Clock, patience: Patience
) -> Conversation[AnswerT]:
    """Say something until something is heard of which `answer` makes an answer. Silence where it is not."""
    for _ in range(patience.tries):
        until_s = clock() + patience.retry_s
        say: tuple[Message, ...] = (question,)
        while (heard := (yield Waiting(say, until_s))) is not None:
            say = ()
            found = answer(heard)
            if found is not None:
                return found
    raise Silence(
        f"the vehicle did not answer {type(question).__name__} in {patience.silence_s:g} s; "
        "check that it is on and that the link reaches it"
    )
