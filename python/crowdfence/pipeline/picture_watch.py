"""How many pictures of a flight are unlike everything that its detector was tested on, and which; whether the
detector sees them at all; and what their ground is like."""

from __future__ import annotations

from collections import Counter
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.same_answer import SameAnswer
from crowdfence.detector.shipped import PHOTOGRAPH_MODEL, SHIPPED_MODEL
from crowdfence.pipeline.untested_ground import UntestedGround

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract

_MOST_NAMED = 1000


class PictureWatch:
    """Looks at the pictures as they pass; may be shared between threads."""

    def __init__(self, contract: Contract | None = None) -> None:
        self._name = "" if contract is None else contract.name
        self._tested = None if contract is None else contract.pictures
        self._answer = SameAnswer(contract)
        self._lock = Lock()
        self._unlike: list[str] = []
        self._of_drones = Counter[tuple[str, bool]]()
        """Pictures by drone, and whether they are unlike the tested ones."""
        self.ground = UntestedGround(contract)
        self.looked_at = 0
        self.unlike = 0
        """Pictures unlike the tested ones."""

    def look(self, name: str, image: NDArray[np.uint8], drone: str | None = None) -> bool | None:
        """Whether a picture [H, W, 3] is unlike the tested ones; None where the model does not say."""
        if self._tested is None:
            return None
        unlike = self._tested.is_unlike(image)
        with self._lock:
            self.looked_at += 1
            self.unlike += unlike
            if drone is not None:
                self._of_drones[drone, unlike] += 1
            if unlike and len(self._unlike) < _MOST_NAMED:
                self._unlike.append(name)
        return unlike

    def answered(self, heatmap: NDArray[np.float32]) -> None:
        """Take note of what the detector gave for a picture."""
        with self._lock:
            self._answer.add(heatmap)

    def same_answer(self, least: int = 1) -> tuple[bool, str | None]:
        """Whether the detector answered for `least` pictures, and one sentence where all answers are the
        same."""
        with self._lock:
            return self._answer.looked_at >= least, self._answer.warning

    def mostly_unlike(self, least: int) -> dict[str, str | None]:
        """Of drones that gave `least` pictures: one sentence where more than half of them are unlike the
        tested ones."""
        with self._lock:
            counts = self._of_drones.copy()
        told: dict[str, str | None] = {}
        for drone in sorted({drone for drone, _ in counts}):
            unlike, looked_at = counts[drone, True], counts[drone, True] + counts[drone, False]
            if looked_at >= least:
                told[drone] = self._sentence(unlike, looked_at, drone) if 2 * unlike > looked_at else None
        return told

    @property
    def warnings(self) -> list[str]:
        """One sentence where there are such pictures, and one where all answers are the same."""
        _, same = self.same_answer()
        return [*self._unlike_tested(), *(() if same is None else (same,))]

    def _unlike_tested(self) -> list[str]:
        return [self._sentence(self.unlike, self.looked_at)] if self.unlike else []

    def _sentence(self, unlike: int, looked_at: int, drone: str | None = None) -> str:
        of_drone = "" if drone is None else f" of {drone}"
        better = f"; {PHOTOGRAPH_MODEL} does better on pictures of real cameras"
        return (
            f"{unlike} of {looked_at} pictures{of_drone} look unlike everything that {self._name} was tested "
            f"on: nobody has measured what it misses there{better if self._name == SHIPPED_MODEL else ''}"
        )

    def to_json(self) -> dict[str, Any]:
        return {"looked_at": self.looked_at, "unlike_tested": self.unlike, "unlike": sorted(self._unlike)}
