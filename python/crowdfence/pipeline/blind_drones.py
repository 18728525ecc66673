"""Drones that took part and showed nothing: what they should have looked at was seen by nobody.

A camera that looks at the sky, or past the map, refuses nothing and shows no crowd that could be missed: its
views count as used, and only their sum tells.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from crowdfence._core import Observation, View


class BlindDrones:
    """Looks at the views of a run as they pass."""

    def __init__(self) -> None:
        self._views: Counter[str] = Counter()
        self._upward: Counter[str] = Counter()
        """Those of them whose optical axis points above the horizon."""
        self._seeing: set[str] = set()

    def look(self, views: Sequence[View], observations: Sequence[Observation]) -> None:
        """The views of one instant, and what they say of the terrain."""
        for view in views:
            self._views[view.drone] += 1
            self._upward[view.drone] += bool(view.world_from_camera[2, 2] > 0.0)
        for observation in observations:
            if observation.drone not in self._seeing and len(observation.voxel_ids) > 0:
                self._seeing.add(observation.drone)

    def warnings(self, drones: Sequence[str], max_range_m: float) -> list[str]:
        """One sentence for each of `drones` none of whose views showed ground of the map."""
        return [self._sentence(drone, max_range_m) for drone in drones if drone not in self._seeing]

    def upward_line(self) -> str | None:
        """One line where most cameras look above the horizon; None where they do not."""
        count, of = self._upward.total(), self._views.total()
        return _upward(count, of) if count > of / 2 else None

    def _sentence(self, drone: str, max_range_m: float) -> str:
        count = self._views[drone]
        if count == 0:
            return f"{drone}: no frame of it was used"
        upward = self._upward[drone]
        why = f": {_upward(upward, count)}" if upward > count / 2 else ""
        return f"{drone}: none of its {count} views shows ground of the map within {max_range_m:g} m{why}"


def _upward(count: int, of: int) -> str:
    looks = f"the camera looks above the horizon in {count} of {of} views"
    return f"{looks}; straight down is a pitch of -90 degrees"
