"""What we last wrote to a vehicle, one small file each: how our shapes are told from those of others.

A fence item has no place for an owner. What stands on the vehicle exactly as we read it back last is ours;
everything else was drawn by somebody else and is kept. Where the file is lost, our old shapes count as those
of others: too much stays closed, nothing opens.

A list is remembered before it is sent, too: where the link is lost, or the program ends, after it was taken
and before it was read back, what stands there is ours all the same. So is what stands there of it where the
link was lost in its middle: older PX4 (v1.12) writes items over those of the list before as they come.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path

from crowdfence.atomic_file import write_bytes
from crowdfence.fence_sync.fence_error import FenceError
from crowdfence.fence_sync.fence_item import (
    FenceItem,
    FenceShape,
    are_same,
    is_circle,
    items_of,
    parted,
)
from crowdfence.fence_sync.ground_station import Vehicle

_FORMAT = "crowdfence fence memory"
_VERSION = 1


@dataclass(frozen=True, slots=True)
class VehicleMemory:
    """After the last list that was written and read back."""

    ours: tuple[FenceShape, ...] = ()
    others: tuple[FenceShape, ...] = ()
    """That stood beside them."""
    most: int | None = None
    """Items or bytes that the vehicle holds, where it refused more."""
    is_first: bool = True
    """Nothing that was written was ever read back."""
    sent: tuple[FenceShape, ...] | None = None
    """Of ours, as they were sent since, where nobody has read back whether they were taken."""
    beside: tuple[FenceShape, ...] = ()
    """Of others, as they were sent with them."""
    replaced: tuple[FenceShape, ...] = ()
    """All that stood there then."""

    def parted(
        self, there: Sequence[FenceShape]
    ) -> tuple[list[FenceShape], list[FenceShape], list[FenceShape]]:
        """Shapes that are there and ours, there and not ours, ours and no longer there. Of a list that was
        broken off all is ours but what others had there before."""
        if self.is_broken_off(there):
            return parted(there, self.beside)[1], list(self.beside), []
        found, unknown, missing = parted(there, self.ours)
        if self.sent is None:
            return found, unknown, missing
        unread, others = list(self.sent), []
        for shape in unknown:
            same = next((one for one in unread if are_same(one, shape)), None)
            if same is None:
                others.append(shape)
            else:
                unread.remove(same)
                found.append(shape)
        taken = all(any(are_same(one, shape) for shape in there) for one in self.sent)
        return found, others, [] if taken else missing

    def is_broken_off(self, there: Sequence[FenceShape]) -> bool:
        """Whether the first items are those of the list that was sent, and the others those of the one
        before."""
        if self.sent is None:
            return False
        now, old = items_of(there), items_of(self.replaced)
        new = items_of(sorted([*self.beside, *self.sent], key=is_circle))
        if len(now) != len(old) or are_same(now, old) or are_same(now, new):
            return False
        pairs = zip(now, new, strict=False)
        taken = next((at for at, (one, other) in enumerate(pairs) if not one.is_same(other)), len(new))
        return are_same(now[taken:], old[taken:])

    def before(
        self,
        sent: Sequence[FenceShape],
        found: Sequence[FenceShape],
        others: Sequence[FenceShape],
        there: Sequence[FenceShape],
    ) -> VehicleMemory:
        """What to remember before a list is sent, to a vehicle on which `found` of all that is `there` is
        ours now, and `others` are kept."""
        ours = self.ours if self.sent is None else tuple(found)
        return replace(self, ours=ours, sent=tuple(sent), beside=tuple(others), replaced=tuple(there))

    def is_of_another(self, kept: VehicleMemory) -> bool:
        """Whether somebody else wrote since, whose file is the same."""
        _, new, gone = parted(self.ours, kept.ours)
        return bool(new or gone) and not self.is_first


def default_folder() -> Path:
    """Where programs keep their state (XDG base directories)."""
    state = os.environ.get("XDG_STATE_HOME")
    return (Path(state) if state else Path.home() / ".local" / "state") / "crowdfence" / "fences"


def memory_file(folder: Path, vehicle: Vehicle) -> Path:
    """By the vehicle's own number where it says one, because many have the system id 1."""
    uid = "".join(character for character in vehicle.uid if character.isalnum())
    return folder / f"vehicle-{vehicle.system}{f'-{uid}' if uid else ''}.json"


def recall(path: Path) -> VehicleMemory:
    """What is in a file; of a vehicle without one nothing. FenceError for a file that is damaged."""
    if not path.exists():
        return VehicleMemory()
    try:
        told = json.loads(path.read_bytes())
        if (told["format"], told["version"]) != (_FORMAT, _VERSION):
            raise ValueError(f"it is {told['format']} version {told['version']}")
        ours, others = _shapes(told["ours"]), _shapes(told["others"])
        sent = None if told.get("sent") is None else _shapes(told["sent"])
        beside, replaced = (_shapes(told.get(name, ())) for name in ("beside", "replaced"))
        most = told["most"]
        if most is not None and not (isinstance(most, int) and most >= 0):
            raise ValueError(f"it holds {most!r} at most")
        return VehicleMemory(ours, others, most, told.get("is_first", False), sent, beside, replaced)
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise FenceError(
            f"{path} does not say what was written last ({type(error).__name__} {error}); remove it, then "
            "everything on the vehicle counts as somebody else's and is kept"
        ) from error


def remember(path: Path, memory: VehicleMemory) -> None:
    """Write the file. OSError where it cannot be written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    told = {
        "format": _FORMAT,
        "version": _VERSION,
        "ours": _lists(memory.ours),
        "others": _lists(memory.others),
        "most": memory.most,
        "is_first": memory.is_first,
        "sent": None if memory.sent is None else _lists(memory.sent),
        "beside": _lists(memory.beside),
        "replaced": _lists(memory.replaced),
    }
    write_bytes(path, (json.dumps(told) + "\n").encode())


def _shapes(lists: Sequence[Sequence[Sequence[float]]]) -> tuple[FenceShape, ...]:
    if not all(lists):
        raise ValueError("it has a shape of no items")
    return tuple(tuple(_item(values) for values in shape) for shape in lists)


def _item(values: Sequence[float]) -> FenceItem:
    command, param1, latitude_e7, longitude_e7, *rest, frame = values
    param2, param3, param4, z = map(float, rest)
    place = (int(latitude_e7), int(longitude_e7))
    return FenceItem(int(command), float(param1), *place, param2, param3, param4, z, int(frame))


def _lists(shapes: Sequence[FenceShape]) -> list[list[tuple[float, ...]]]:
    return [[astuple(item) for item in shape] for shape in shapes]
