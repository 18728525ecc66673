"""A vehicle's fence made equal to the zones: read, fit, replace, read back, compare, remember.

Whatever goes wrong, the vehicle keeps the list that it held, because it takes a new one only whole (an older
PX4 does not: `vehicle_memory`); and no list is replaced before it is known what others put into it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from crowdfence.atomic_file import writable_folder
from crowdfence.fence_sync.autopilot_capacity import Capacity, StorageCapacity, usual_capacity
from crowdfence.fence_sync.enforcement import NOT_OF_EVERY_VERSION, PARAMETERS, enforcement, flies_round
from crowdfence.fence_sync.fence_error import FenceError, Silence
from crowdfence.fence_sync.fence_event import FenceEvent
from crowdfence.fence_sync.fence_item import (
    FenceItem,
    FenceShape,
    are_same,
    is_circle,
    items_of,
    missing_corners,
    parted,
    shapes_of,
)
from crowdfence.fence_sync.ground_station import GroundStation
from crowdfence.fence_sync.inside import inside
from crowdfence.fence_sync.messages import (
    Home,
    MissionResult,
    Position,
    StatusText,
    Version,
    result_name,
)
from crowdfence.fence_sync.placement import NOTHING, PlacedFence, placed
from crowdfence.fence_sync.questions import OPTIONAL_TRIES, optional, parameters
from crowdfence.fence_sync.read_back import (
    Rewritten,
    Rounded,
    are_of_neither,
    are_rounded,
    differs,
    require_same,
)
from crowdfence.fence_sync.transfer import download, upload
from crowdfence.fence_sync.vehicle_memory import VehicleMemory, memory_file, recall, remember
from crowdfence.georeference import Georeference
from crowdfence.zones import Zone
from crowdfence.zones.zone import closed_of

POSITION_AGE_S = 4.0
"""An older position is asked for again. Longer than it takes to see that the vehicle is silent."""
TEXTS_S = 1.0
"""Autopilots say what they think of a fence after they took it."""
_UPLOADS = 4
"""Of one list over a link that loses packets."""
_LONG_S = 1.0
"""After which what was read is read again before it is replaced: in it somebody else may have written."""
_REFUSALS = 12
"""Each asks for a quarter less: 12 lead from 63 items to 1."""
_SILENCES = 3
"""After which a vehicle does not know a parameter: to ask again would wait every time."""
_PAUSE_S = 0.3
"""In which an answer that comes twice has come."""
_WARNING = 4
"""MAV_SEVERITY; lower numbers are worse."""
_ABOUT_FENCES = ("fence", "reposition")
_HINTS: Mapping[int, str] = {
    MissionResult.NO_SPACE: "; give a smaller --capacity",
    MissionResult.DENIED: "; another ground station may be writing it: send again in some seconds",
}
_MAYBE_TAKEN = (
    "a list was sent, so it holds the one before or that one (an older PX4, such as v1.12, some corners of "
    "each); send again once it answers"
)


@dataclass(frozen=True, slots=True)
class FenceReport:
    """What a vehicle holds now, and what is to be said of it."""

    shapes: tuple[FenceShape, ...]
    """All of it, as read back."""
    ours: tuple[FenceShape, ...]
    written: bool
    """False where it held that already."""
    placed: PlacedFence
    capacity: str
    events: tuple[FenceEvent, ...]

    @property
    def alarms(self) -> tuple[FenceEvent, ...]:
        return tuple(event for event in self.events if event.alarm)

    def to_json(self) -> dict[str, Any]:
        fence = self.placed.fence
        return {
            "written": self.written,
            "items": len(items_of(self.shapes)),
            "our_items": len(items_of(self.ours)),
            "polygons": sum(len(shape) > 1 for shape in self.ours),
            "circles": sum(len(shape) == 1 for shape in self.ours),
            "shapes_of_others": len(self.shapes) - len(self.ours),
            "capacity": self.capacity,
            "zone_area_m2": fence.zone_area_m2,
            "over_coverage_m2": fence.over_coverage_m2,
            "events": [event.to_json() for event in self.events],
        }


class FenceKeeper:
    """Keeps the fence of one vehicle."""

    def __init__(self, station: GroundStation, folder: Path, capacity: Capacity | None = None) -> None:
        """`folder` holds what was written last, one file a vehicle; `capacity` where it is known. FenceError
        where two vehicles have one system id."""
        self.station = station
        self._folder = folder
        self._given = capacity
        # By its number its shapes are known again: a lossy link must not pass for a vehicle that has none.
        for stranger in self.strangers(most_tries=station.patience.tries):
            raise FenceError(stranger.text)
        self.memory_path = memory_file(folder, station.vehicle)
        self._kept: VehicleMemory | None = None
        """What this one remembered last; in the file stands what anybody did."""
        self._rare: dict[str, float] = {}
        """Parameters that not every version has, as last heard: an answer that is lost says nothing."""
        self._unheard: Counter[str] = Counter()
        """How often the vehicle was silent when it was asked for one of them."""

    def read(self) -> tuple[tuple[FenceShape, ...], tuple[FenceShape, ...]]:
        """All shapes that the vehicle holds, and those of them that are ours."""
        there = tuple(shapes_of(self._download()))
        ours, _, _ = recall(self.memory_path).parted(there)
        return there, tuple(ours)

    def put(self, zones: Sequence[Zone], georeference: Georeference) -> FenceReport:
        """Make our part of the fence cover the zones, of a `ZoneSet` all that it closes, and nothing else.
        FenceError or ValueError where it could not be done; the fence is then as it was."""
        zones = closed_of(zones)
        with writable_folder(self._folder, parents=True):
            return _unless_rewritten(lambda again: self._put(zones, georeference, again))

    def _put(self, zones: Sequence[Zone], georeference: Georeference, again: bool) -> FenceReport:
        station, events = self.station, list(_of_zones(zones))
        events += self.enforcement() if zones else []
        self._locate()
        memory, before = recall(self.memory_path), self._download()
        there, read_s = shapes_of(before), station.clock()
        found, others, missing = memory.parted(there)
        events += [*_of_others(others, missing, memory), *_of_a_second(memory, self._kept)]
        was_sent = again and memory.sent is not None  # and what the vehicle said of it counts still
        if not was_sent:
            station.vehicle.texts.clear()
        capacity = self._capacity(memory)
        for _ in range(_REFUSALS):
            fence = placed(zones, georeference, capacity, others)
            wanted = sorted([*others, *fence.shapes], key=is_circle)
            # Wherever in the list: two stations that both put theirs last would write in turn for ever.
            written = not are_same(items_of(found), items_of(fence.shapes)) or (
                bool(fence.shapes) and there != sorted(there, key=is_circle)
            )
            if written or fence.shapes:
                _require_whole(others)
            if written:
                if station.clock() - read_s > _LONG_S:
                    require_same(before, self._download())
                self._remember(memory.before(fence.shapes, found, others, there))
            try:
                result, held = (
                    self._replace(items_of(wanted), before) if written else (MissionResult.ACCEPTED, before)
                )
            except Rounded as error:  # it stands there, and is not to stay beside what is sent next
                ours = _as_read(fence.shapes, wanted, shapes_of(error.held))
                self._remember(VehicleMemory(ours, tuple(others), memory.most, is_first=False))
                raise
            read_s = station.clock()
            if result == MissionResult.ACCEPTED:
                break
            stays = _what_stays(before, held)
            capacity = self._smaller(capacity, result, wanted, stays)
            events.append(FenceEvent("capacity_learned", f"the vehicle has no space; trying {capacity}"))
            memory = replace(memory, most=_size(capacity))
        else:
            raise FenceError(f"the vehicle refuses every fence for want of space; {stays}")
        now_ours = _as_read(fence.shapes, wanted, shapes_of(held)) if written else tuple(found)
        self._remember(VehicleMemory(now_ours, tuple(others), memory.most, is_first=False))
        written |= was_sent
        station.listen(TEXTS_S if written else 0.0)
        events += _of_texts(station.vehicle.texts)
        events += self._places(shapes_of(held), zones, georeference)
        events += _of_fence(fence, zones, written)
        return FenceReport(tuple(shapes_of(held)), now_ours, written, fence, str(capacity), tuple(events))

    def clear(self, *, everything: bool = False) -> FenceReport:
        """Remove our part of the fence, or all of it."""
        return _unless_rewritten(lambda again: self._clear(everything, again))

    def _clear(self, everything: bool, again: bool) -> FenceReport:
        memory, before = recall(self.memory_path), self._download()
        found, others, missing = memory.parted(shapes_of(before))
        kept = [] if everything else others
        _require_whole(kept)
        wanted = items_of(kept)
        written = not are_same(before, wanted)
        events = [] if everything else list(_of_others(others, missing, memory))
        if written:
            self._remember(memory.before((), found, kept, shapes_of(before)))
            result, held = self._replace(wanted, before)
            if result != MissionResult.ACCEPTED:
                raise FenceError(self._refused(result, _what_stays(before, held)))
        self._remember(VehicleMemory((), tuple(kept), memory.most, is_first=False))
        if again and memory.sent == ():  # they went with the first list
            found, written = list(memory.ours), True
        removed = len(shapes_of(before)) if everything else len(found)
        events.append(FenceEvent("cleared", f"{removed} shapes removed, {len(kept)} stay"))
        return FenceReport(tuple(kept), (), written, NOTHING, "", tuple(events))

    def whereabouts(
        self, shapes: Sequence[FenceShape], zones: Sequence[Zone], georeference: Georeference
    ) -> Iterator[FenceEvent]:
        """Whether the vehicle, its home or its way home is in what it holds, now."""
        self._find_position()
        yield from self._places(shapes, zones, georeference)

    def _places(
        self, shapes: Sequence[FenceShape], zones: Sequence[Zone], georeference: Georeference
    ) -> Iterator[FenceEvent]:
        returns_round = flies_round(self._rare)
        return inside(self.station.vehicle, shapes, zones, georeference, returns_round=returns_round)

    def enforcement(self) -> list[FenceEvent]:
        """What the vehicle will not do at its fence. FenceError as of `enforcement`."""
        station = self.station
        autopilot = station.vehicle.autopilot
        names = PARAMETERS.get(autopilot, ())
        values = station.hold(parameters(names, autopilot, station.clock, station.patience))
        if values:
            rare = [
                name
                for name in NOT_OF_EVERY_VERSION.get(autopilot, ())
                if name in self._rare or self._unheard[name] < _SILENCES
            ]
            few = parameters(rare, autopilot, station.clock, station.patience, most_tries=OPTIONAL_TRIES)
            self._rare |= (heard := station.hold(few))
            self._unheard.update(name for name in rare if name not in heard)
            values |= self._rare
        return list(enforcement(station.vehicle, values))

    def strangers(self, *, most_tries: int = OPTIONAL_TRIES) -> list[FenceEvent]:
        """Whether others than this vehicle answer under its system id, as far as vehicles say a number of
        their own: what one of them says would be taken for what the other does."""
        station, vehicle = self.station, self.station.vehicle
        vehicle.strangers.clear()
        station.hold(optional(Version, station.clock, station.patience, most_tries=most_tries))
        station.listen(_PAUSE_S)
        if not vehicle.strangers:
            return []
        numbers = ", ".join((vehicle.uid, *sorted(vehicle.strangers)))
        text = (
            f"several vehicles have the system id {vehicle.system} (their own numbers: {numbers}): when one "
            "falls silent or loses its fence the other answers for it; give each an id of its own "
            "(MAV_SYS_ID of PX4, SYSID_THISMAV of ArduPilot) or a link of its own, and start again"
        )
        return [FenceEvent("several_vehicles", text, alarm=True)]

    def find_home(self) -> None:
        """Ask where home is, which is set anew where a vehicle takes off; what was known stays where it does
        not say."""
        self.station.hold(optional(Home, self.station.clock, self.station.patience))

    def _remember(self, memory: VehicleMemory) -> None:
        remember(self.memory_path, memory)
        self._kept = memory

    def _download(self) -> tuple[FenceItem, ...]:
        return self.station.hold(download(self.station.clock, self.station.patience))

    def _replace(
        self, wanted: Sequence[FenceItem], before: Sequence[FenceItem]
    ) -> tuple[int, tuple[FenceItem, ...]]:
        """Upload until the vehicle says something of it, and what it holds then. After silence its list tells
        whether it was taken, and after a refusal: ArduPilot says "error" where its last item comes again, as
        it does after an "accepted" that was lost. Over a link that brings old packets late, some of another
        list may have been taken. `Rewritten` where items stand there that nobody of us sent: the list of
        somebody else, who wrote after ours was taken and whose shapes a second upload would remove."""
        station = self.station
        for attempt in range(_UPLOADS):
            silence = None
            try:
                result = station.hold(upload(wanted, station.clock, station.patience))
            except Silence as error:
                silence, result = error, MissionResult.ACCEPTED
            try:
                held = self._download()
            except Silence as error:
                raise Silence(f"{error}; {_MAYBE_TAKEN}") from error
            if are_same(held, wanted):
                return MissionResult.ACCEPTED, held
            is_last = attempt == _UPLOADS - 1
            is_of_neither = are_of_neither(held, [*before, *wanted])
            # What was rounded before is rounded to the same again.
            if (is_of_neither or is_last) and are_rounded(held, wanted):
                raise Rounded(wanted, held)
            if is_of_neither:
                raise Rewritten(str(differs(wanted, held)))
            if result != MissionResult.ACCEPTED:
                return result, held
            if is_last:
                raise silence or differs(wanted, held)
        raise AssertionError("the last upload returns or raises")

    def _smaller(self, capacity: Capacity, result: int, shapes: Sequence[FenceShape], stays: str) -> Capacity:
        """The next capacity to try. FenceError where the refusal is not for want of space."""
        self.station.listen(_PAUSE_S)
        is_full = result == MissionResult.NO_SPACE or any(
            "exceeds storage" in text.text.lower() for text in self.station.vehicle.texts
        )
        if not is_full or self._given is not None:
            raise FenceError(self._refused(result, stays))
        self.station.vehicle.texts.clear()
        return capacity.after_refusal(shapes)

    def _refused(self, result: int, stays: str) -> str:
        said = "; ".join(dict.fromkeys(text.text for text in self.station.vehicle.texts))
        hint = _HINTS.get(result, "")
        why = f"{result_name(result)}{f' ({said})' if said else ''}"
        return f"the vehicle refused the fence: {why}; {stays}{hint}"

    def _capacity(self, memory: VehicleMemory) -> Capacity:
        if self._given is not None:
            return self._given
        usual = usual_capacity(self.station.vehicle.autopilot)
        return usual if memory.most is None else type(usual)(memory.most)  # type: ignore[call-arg]

    def _find_position(self) -> None:
        station = self.station
        if station.clock() - station.vehicle.position_s > POSITION_AGE_S:
            station.vehicle.position = None
            station.hold(optional(Position, station.clock, station.patience))

    def _locate(self) -> None:
        self._find_position()
        if self.station.vehicle.home is None:
            self.find_home()


def _unless_rewritten(write: Callable[[bool], FenceReport]) -> FenceReport:
    """Written; again from its beginning, which `write` is told, where somebody else wrote meanwhile, whose
    shapes are kept."""
    for attempt in range(_UPLOADS):
        try:
            return write(attempt > 0)
        except Rewritten:
            if attempt == _UPLOADS - 1:
                raise
    raise AssertionError("the last one returns or raises")


def _size(capacity: Capacity) -> int:
    return capacity.bytes if isinstance(capacity, StorageCapacity) else capacity.items  # type: ignore[attr-defined]


def _require_whole(others: Sequence[FenceShape]) -> None:
    """FenceError for a polygon of others that ends early: whatever stands behind it would be read wrong."""
    for shape in others:
        if missing_corners(shape):
            raise FenceError(
                f"others have a polygon of {shape[0].param1:g} corners of which {len(shape)} are there: "
                "whoever sent it was broken off, and the autopilot reads everything behind it wrong; have it "
                "sent again, or remove all with crowdfence fence clear --all"
            )


def _as_read(
    ours: Sequence[FenceShape], wanted: Sequence[FenceShape], held: Sequence[FenceShape]
) -> tuple[FenceShape, ...]:
    """Those of the shapes that the vehicle holds which were sent as ours: it may round them."""
    numbers = set(map(id, ours))
    return tuple(read for sent, read in zip(wanted, held, strict=True) if id(sent) in numbers)


def _what_stays(before: Sequence[FenceItem], held: Sequence[FenceItem]) -> str:
    """After a refusal, by what was read back: a vehicle that started anew may have lost its fence."""
    if are_same(before, held):
        return "the one before stays"
    if len(held) == len(before):
        return "it has replaced some corners of the one before, as an older PX4 does; send again"
    return (
        f"the one before is gone: {len(held)} items stand there, {len(before)} did; did the vehicle start "
        "anew? Send again"
    )


def _of_zones(zones: Sequence[Zone]) -> Iterator[FenceEvent]:
    for zone in zones:
        if zone.polygon.is_empty:
            yield FenceEvent(
                "zone_without_ground", f"zone {zone.id} has no ground and is not in the fence", alarm=True
            )


def _of_others(
    others: Sequence[FenceShape], missing: Sequence[FenceShape], memory: VehicleMemory
) -> Iterator[FenceEvent]:
    if others:
        yield FenceEvent(
            "kept_others", f"{len(others)} shapes ({len(items_of(others))} items) of others are kept"
        )
    _, new, gone = parted(others, memory.others)
    if memory.is_first or not (missing or new or gone):
        return
    said = [
        f"{len(missing)} of our shapes changed or gone" if missing else "",
        f"{len(new)} shapes new" if new else "",
        f"{len(gone)} of theirs gone" if gone else "",
    ]
    yield FenceEvent(
        "changed_by_others",
        f"somebody else changed the fence since it was written last: {', '.join(filter(None, said))}",
        alarm=bool(missing),
        details={"ours_missing": len(missing), "new": len(new), "gone": len(gone)},
    )


def _of_a_second(memory: VehicleMemory, kept: VehicleMemory | None) -> Iterator[FenceEvent]:
    """Whether somebody else wrote with the same memory: all that it wrote counts as ours, and is replaced."""
    if kept is None or not memory.is_of_another(kept):
        return
    yield FenceEvent(
        "changed_by_others",
        "another crowdfence that shares our --state wrote the fence since: what it wrote is replaced, as it "
        "replaced ours; stop one of them, or give each a --state of its own, then both stay",
        alarm=True,
    )


def _of_texts(texts: Sequence[StatusText]) -> Iterator[FenceEvent]:
    for text in dict.fromkeys(texts):
        if text.severity <= _WARNING and any(word in text.text.lower() for word in _ABOUT_FENCES):
            yield FenceEvent(
                "refused_by_text",
                f"the vehicle took the fence, but says: {text.text}",
                alarm=True,
                details={"statustext": text.text},
            )


def _of_fence(fence: PlacedFence, zones: Sequence[Zone], written: bool) -> Iterator[FenceEvent]:
    if zones:
        yield FenceEvent("no_heights", "a fence has no heights: its ground is closed at every height")
    over_m2 = fence.fence.over_coverage_m2
    if round(over_m2) > 0:
        yield FenceEvent(
            "over_coverage",
            f"{over_m2:.0f} m2 more than the zones ({fence.fence.zone_area_m2:.0f} m2) are closed, because "
            "the vehicle has no room to leave them open",
        )
    if written:
        yield FenceEvent("written", f"{len(zones)} zones in {fence.items} items, read back and equal")
    else:
        yield FenceEvent("unchanged", f"{len(zones)} zones in {fence.items} items stand there already")
