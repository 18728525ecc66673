"""Ground that a drone looks at now, of a kind that its detector was not tested on: too far, too near, too
flat."""

from __future__ import annotations

from collections import deque
from threading import Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract
    from crowdfence.detector.ground_sampling import GroundSampling

_LOOKS = 50
"""Of a drone, the newest that saw ground: some seconds."""
_MOST_OUTSIDE = 0.5
"""Of the ground in them. Some of it, as the far ground of a camera that looks flat, always lies outside."""


class UntestedGround:
    """Takes what looks sample; may be shared between threads."""

    def __init__(self, contract: Contract | None) -> None:
        self._contract = None if contract is None or contract.validity is None else contract
        self._looks: dict[str, deque[GroundSampling]] = {}
        self._lock = Lock()

    @property
    def is_known(self) -> bool:
        """Whether the detector says what it was tested on."""
        return self._contract is not None

    def look(self, drone: str, sampling: GroundSampling) -> None:
        if self._contract is not None and sampling.sees_ground:
            with self._lock:
                self._looks.setdefault(drone, deque(maxlen=_LOOKS)).append(sampling)

    def mostly_untested(self, least: int) -> dict[str, str | None]:
        """Of drones with `least` such looks: one sentence where more than half of the ground in the newest of
        them is none that the detector was tested on."""
        from crowdfence.detector.validity import FlightSample, check_ranges

        if self._contract is None:
            return {}
        with self._lock:
            looks = {drone: list(some) for drone, some in self._looks.items() if len(some) >= least}
        name, told = self._contract.name, dict[str, str | None]()
        for drone in sorted(looks):
            checks = check_ranges(self._contract, FlightSample.of(looks[drone]))
            sentences = (
                sentence
                for check in checks
                for sentence in check.warnings(name, of="its newest looks", tolerated=_MOST_OUTSIDE)
            )
            told[drone] = next((f"{drone}, {sentence}" for sentence in sentences), None)
        return told
