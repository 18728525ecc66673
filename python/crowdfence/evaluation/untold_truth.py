"""Frames whose truth cannot be told: damaged labels, no true time, or people that cannot be read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import TypeVar

from crowdfence.errors import FrameError

ValueT = TypeVar("ValueT")


class UntoldTruth:
    """Collects them; each counts once, however often it is asked for."""

    def __init__(self) -> None:
        self._labels: dict[tuple[str, int], FrameError] = {}
        self._world: dict[tuple[str, int], FrameError] = {}

    def label(self, error: FrameError) -> None:
        """What is true of its picture is not known."""
        self._labels.setdefault((error.drone, error.stamp_ns), error)

    def world(self, error: FrameError) -> None:
        """What was true of the world then is not known."""
        self._world.setdefault((error.drone, error.stamp_ns), error)

    def tried(self, read: Callable[[], ValueT]) -> ValueT | None:
        """What is true of the world, by `read`; None where that raises a FrameError, which is collected."""
        try:
            return read()
        except FrameError as error:
            self.world(error)
            return None

    @property
    def labels(self) -> int:
        """How many frames have a label that cannot be read."""
        return len(self._labels)

    @property
    def first(self) -> str:
        """Why, of one of them; nothing where there is none."""
        return next((str(error) for error in (*self._labels.values(), *self._world.values())), "")

    @property
    def warnings(self) -> list[str]:
        """One sentence for labels, and one for the world."""
        warnings = []
        if self._labels:
            warnings.append(
                f"labels cannot be read for {_counted(self._labels)}: they are left out, and crowd that is "
                "labelled in no other frame counts as a false alarm where heatmaps show it"
            )
        if self._world:
            warnings.append(
                f"when or where people were cannot be told for {_counted(self._world)}: instants of which no "
                "other frame tells it are left out"
            )
        return warnings


def _counted(errors: dict[tuple[str, int], FrameError]) -> str:
    of = Counter(drone for drone, _ in errors)
    each = ", ".join(f"{drone} {of[drone]}" for drone in sorted(of))
    first = next(iter(errors.values()))
    return f"{len(errors)} frame{'s' if len(errors) > 1 else ''} ({each}), the first: {first}"
