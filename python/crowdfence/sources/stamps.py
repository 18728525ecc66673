"""Which stamps of one drone's clock can be believed.

Fusion assumes that a drone's frames follow one another in time. Where they do not (a clock that was set in
flight, a frame written twice, one frame stamped 1970), the fewest frames are refused that leave a strictly
increasing sequence, and each refusal says why.
"""

from bisect import bisect_left
from collections.abc import Iterable, Sequence

LAST_STAMP_NS = 2**31 * 10**9 - 1
"""ROS 2 stores seconds as int32: the last stamp that a mission file can hold (January 2038)."""
LONGEST_ABSENCE_S = 86_400.0
"""A drone that lands and is charged is back within a day; a clock that is set jumps by years."""


def stamp_faults(stamps_ns: Sequence[int], max_jump_s: float) -> list[str | None]:
    """Why each stamp must be refused, None = it can be used. The stamps come in the order of recording.

    1. A stamp outside [0, LAST_STAMP_NS], or one that was there before, is refused.
    2. Stamps separated by more than `max_jump_s` belong to different stretches; the largest stretch stays,
       and what a drone took that was away for less than a day.
    3. Of the rest a longest increasing subsequence stays.
    """
    faults: list[str | None] = [None] * len(stamps_ns)
    _refuse_unusable(stamps_ns, faults)
    _refuse_far_stretches(stamps_ns, faults, max_jump_s)
    _refuse_disorder(stamps_ns, faults)
    return faults


def longest_pause_s(frames: Iterable[tuple[str, int]]) -> float:
    """Longest time between two frames of one drone; `frames`: drone and stamp, by stamp."""
    newest_ns: dict[str, int] = {}
    longest_ns = 0
    for drone, stamp_ns in frames:
        longest_ns = max(longest_ns, stamp_ns - newest_ns.get(drone, stamp_ns))
        newest_ns[drone] = stamp_ns
    return longest_ns / 1e9


def _good(faults: Sequence[str | None]) -> list[int]:
    return [index for index, fault in enumerate(faults) if fault is None]


def _refuse_unusable(stamps_ns: Sequence[int], faults: list[str | None]) -> None:
    known: set[int] = set()
    for index, stamp in enumerate(stamps_ns):
        if not 0 <= stamp <= LAST_STAMP_NS:
            faults[index] = f"stamp {stamp} is outside [0, {LAST_STAMP_NS}] ns"
        elif stamp in known:
            faults[index] = f"stamp {stamp} repeats an earlier frame of this drone"
        known.add(stamp)


def _refuse_far_stretches(stamps_ns: Sequence[int], faults: list[str | None], max_jump_s: float) -> None:
    order = sorted(_good(faults), key=lambda index: stamps_ns[index])
    stretches: list[list[int]] = []
    for index in order:
        if stretches and stamps_ns[index] - stamps_ns[stretches[-1][-1]] <= max_jump_s * 1e9:
            stretches[-1].append(index)
        else:
            stretches.append([index])
    if len(stretches) < 2:
        return
    kept = _with_returns(stretches, stamps_ns)
    first_ns, last_ns = stamps_ns[kept[0]], stamps_ns[kept[-1]]
    for index in set(order).difference(kept):
        # Its nearest: what was kept need not be one stretch.
        away_s = max(first_ns - stamps_ns[index], stamps_ns[index] - last_ns) / 1e9
        if away_s < 0.0:
            away_s = min(abs(stamps_ns[index] - stamps_ns[other]) for other in kept) / 1e9
        faults[index] = (
            f"stamp {stamps_ns[index]} jumps {_duration(away_s)} away from the {len(kept)} frames of "
            f"this drone that belong together (limit max_jump_s = {max_jump_s:g} s)"
        )


def _with_returns(stretches: Sequence[list[int]], stamps_ns: Sequence[int]) -> list[int]:
    """The largest stretch and those before and after it between which the drone was away, by stamp."""
    largest = max(range(len(stretches)), key=lambda number: len(stretches[number]))
    kept = list(stretches[largest])
    for later in stretches[largest + 1 :]:
        if _returned(kept, later, stamps_ns):
            kept = kept + later
    for earlier in reversed(stretches[:largest]):
        if _returned(earlier, kept, stamps_ns):
            kept = earlier + kept
    return kept


def _returned(before: Sequence[int], after: Sequence[int], stamps_ns: Sequence[int]) -> bool:
    """Whether a drone was away in between, rather than its clock wrong: within a day, recorded in this order,
    and no single frame, which a damaged stamp explains as well."""
    in_order = max(before) < min(after)
    away_ns = stamps_ns[after[0]] - stamps_ns[before[-1]]
    return in_order and min(len(before), len(after)) > 1 and away_ns <= LONGEST_ABSENCE_S * 1e9


def _refuse_disorder(stamps_ns: Sequence[int], faults: list[str | None]) -> None:
    good = _good(faults)
    kept = {good[i] for i in _longest_increasing([stamps_ns[index] for index in good])}
    newest_ns = -1
    for index in good:
        stamp = stamps_ns[index]
        if index in kept:
            newest_ns = stamp
        elif stamp < newest_ns:
            faults[index] = (
                f"stamp {stamp} goes back {_duration((newest_ns - stamp) / 1e9)} behind the frame before"
            )
        else:
            faults[index] = f"stamp {stamp} runs ahead of the frames recorded after it"


def _longest_increasing(values: Sequence[int]) -> list[int]:
    """Indices of a longest strictly increasing subsequence (patience sorting)."""
    tails: list[int] = []
    tail_indices: list[int] = []
    previous = [-1] * len(values)
    for index, value in enumerate(values):
        place = bisect_left(tails, value)
        previous[index] = tail_indices[place - 1] if place else -1
        tails[place : place + 1] = [value]
        tail_indices[place : place + 1] = [index]
    chain = []
    index = tail_indices[-1] if tail_indices else -1
    while index >= 0:
        chain.append(index)
        index = previous[index]
    return chain[::-1]


def _duration(seconds: float) -> str:
    return f"{seconds:.3f} s" if seconds < 120 else f"{seconds / 3600:.2f} h"
