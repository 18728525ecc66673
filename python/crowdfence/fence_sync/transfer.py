"""The mission protocol for fences: read the whole list, replace the whole list.

There is no part of a list, and no word of a change that somebody else makes: the vehicle takes a list when
its last item has arrived, and keeps the one before until then. Packets may be lost, come twice and out
of order.
https://mavlink.io/en/services/mission.html
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from crowdfence.fence_sync.conversation import Clock, Conversation, Patience, Waiting, ask
from crowdfence.fence_sync.fence_error import FenceError, Silence
from crowdfence.fence_sync.fence_item import FenceItem
from crowdfence.fence_sync.messages import (
    Ack,
    Count,
    Item,
    Message,
    MissionResult,
    RequestItem,
    RequestList,
    result_name,
)

_UNREADABLE: Mapping[int, str] = {
    MissionResult.UNSUPPORTED: "does its firmware take fences over the mission protocol?",
    MissionResult.DENIED: "ArduPilot says so while another ground station writes it: try again later",
}
_READINGS = 8
"""Times that a list is begun to read, which changes meanwhile or falls silent in the middle."""
_ITEM_TRIES = 3
"""PX4 says nothing more of a list of which it was asked out of order."""
_BUSY = 4
"""Times that a list is offered to a vehicle which says "error" to its first word."""


def upload(items: Sequence[FenceItem], clock: Clock, patience: Patience) -> Conversation[int]:
    """Replace the list; the `MissionResult` of the vehicle. The vehicle asks for the items, in its order.

    Silence after which it is not known whether the list was taken: the last answer may be what was lost.
    """
    asked: set[int] = set()
    last: Message = Count(len(items))
    say: tuple[Message, ...] = (last,)
    give_up_s = clock() + patience.longest_s
    until_s, silent, busy, refusal = clock() + patience.retry_s, 0, 0, None
    while silent < patience.tries and clock() < give_up_s:
        heard = yield Waiting(say, until_s)
        say = ()
        if heard is None and refusal is not None:
            busy += 1
            if asked or busy == _BUSY:
                return refusal
            # PX4 is busy until it hears that its list was read, and that word may have been lost.
            say, until_s, refusal = (Ack(MissionResult.ACCEPTED),), clock() + patience.retry_s, None
            continue
        elif heard is None:
            silent += 1
        elif isinstance(heard, RequestItem) and heard.seq < len(items):
            asked.add(heard.seq)
            last, silent, refusal = Item(heard.seq, items[heard.seq]), 0, None
        elif isinstance(heard, Ack) and heard.result == MissionResult.ERROR:
            # PX4 says so of a first word that comes twice, and goes on.
            refusal, until_s = heard.result, clock() + patience.retry_s
            continue
        elif isinstance(heard, Ack) and _ends(heard, asked, items):
            return heard.result
        else:
            continue
        say, until_s = (last,), clock() + patience.retry_s
    raise Silence(
        f"the vehicle fell silent after {len(asked)} of {len(items)} items were sent; check the link"
    )


def _ends(ack: Ack, asked: set[int], items: Sequence[FenceItem]) -> bool:
    """An old answer that comes twice does not accept what was not asked for yet, and ArduPilot says "invalid
    sequence" of an item that comes twice and goes on."""
    if ack.result == MissionResult.ACCEPTED:
        return len(asked) == len(items)
    return ack.result != MissionResult.INVALID_SEQUENCE


def download(clock: Clock, patience: Patience) -> Conversation[tuple[FenceItem, ...]]:
    """The list as the vehicle holds it. Its length is asked for before and after, so that an old answer that
    comes late is not taken for it. Silence; FenceError for a vehicle that refuses, or a list that keeps
    changing."""
    for _ in range(_READINGS):
        count = yield from ask(RequestList(), _count, clock, patience)
        items = yield from _items(count, clock, patience)
        if items is None or (yield from ask(RequestList(), _count, clock, patience)) != count:
            continue
        yield Waiting((Ack(MissionResult.ACCEPTED),), clock())
        return items
    raise FenceError(
        f"the fence could not be read in {_READINGS} tries: it changes meanwhile, or the link brings packets "
        "late and out of order; is another ground station writing it?"
    )


def _items(count: int, clock: Clock, patience: Patience) -> Conversation[tuple[FenceItem, ...] | None]:
    """None where the vehicle says another length meanwhile, an error, or nothing."""
    items: list[FenceItem] = []
    few = replace(patience, tries=min(patience.tries, _ITEM_TRIES))
    give_up_s = clock() + patience.longest_s
    for seq in range(count):
        if clock() > give_up_s:
            raise FenceError(
                f"the fence could not be read: {seq} of its {count} items came in {patience.longest_s:g} s; "
                "check the link, and whether the vehicle holds so many"
            )

        def answer(heard: Message, seq: int = seq) -> Message | None:
            _require_readable(heard)
            # PX4 ends a reading with an error where it is asked out of order.
            is_over = isinstance(heard, Ack) and heard.result == MissionResult.ERROR
            if is_over or (isinstance(heard, Count) and heard.count != count):
                return heard
            return heard if isinstance(heard, Item) and heard.seq == seq else None

        try:
            found = yield from ask(RequestItem(seq), answer, clock, few)
        except Silence:
            return None
        if not isinstance(found, Item):
            return None
        items.append(found.item)
    return tuple(items)


def _count(heard: Message) -> int | None:
    _require_readable(heard)
    return heard.count if isinstance(heard, Count) else None


def _require_readable(heard: Message) -> None:
    """Old answers to an upload are no refusal to read, but that it has no fences is, or that it is busy."""
    hint = _UNREADABLE.get(heard.result) if isinstance(heard, Ack) else None
    if isinstance(heard, Ack) and hint is not None:
        raise FenceError(f"the vehicle does not give its fence away: {result_name(heard.result)}; {hint}")
