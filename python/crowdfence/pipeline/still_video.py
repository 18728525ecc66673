"""A video that stands still: the same picture again and again, with stamps and poses that go on.

A stream whose encoder hangs, or a decoder that repeats its last picture, goes on giving pictures. Put where
the camera is by now, they are looks at ground that nobody looked at: crowd moves along with the drone, and
what lies below is called free. No camera that moves takes the same picture twice, so that no two heatmaps are
the same either, but for those that show next to nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import View
from crowdfence.sources.rotation_angle import angle_between_deg

FEWEST = 3
"""Views of a drone that are like the one before, although it moved, before it is said."""
_FEWEST_VALUES = 16
"""Different values of a heatmap that can be told from another one."""
_MOVED_M, _TURNED_DEG = 0.5, 1.0


@dataclass(slots=True)
class _Drone:
    """What one drone has given so far."""

    heatmap: NDArray[np.float32]
    """The newest."""
    world_from_camera: NDArray[np.float64]
    """Where that came first."""
    views: int = 1
    repeated: int = 0
    """Of those, how often it was like the one before, although the camera had moved."""
    standing: int = 0
    """The same, since another one came."""


class StillVideo:
    """Looks at the views as they pass."""

    def __init__(self) -> None:
        self._drones: dict[str, _Drone] = {}

    def look(self, view: View) -> None:
        heatmap = view.heatmap
        drone = self._drones.get(view.drone)
        if drone is None:
            self._drones[view.drone] = _Drone(heatmap, view.world_from_camera)
            return
        drone.views += 1
        if not np.array_equal(heatmap, drone.heatmap):
            drone.heatmap, drone.world_from_camera, drone.standing = heatmap, view.world_from_camera, 0
        elif _moved(drone.world_from_camera, view.world_from_camera) and _tells(heatmap):
            drone.repeated += 1
            drone.standing += 1

    @property
    def warnings(self) -> list[str]:
        """One sentence for each drone whose video stood still."""
        return [
            f"{name}: {drone.repeated} of its {drone.views} heatmaps are those of the picture before, though "
            "its camera had moved: its video stood still, and old pictures count as looks at other ground"
            for name, drone in sorted(self._drones.items())
            if drone.repeated >= FEWEST
        ]

    def standing(self) -> dict[str, str | None]:
        """The same by drone, of how things stand now; None where the video moves."""
        return {
            name: f"the last {drone.standing} heatmaps of {name} are the same, though its camera moved: its "
            "video stands still, and old pictures count as looks at other ground"
            if drone.standing >= FEWEST
            else None
            for name, drone in sorted(dict(self._drones).items())
        }


def _moved(before: NDArray[np.float64], after: NDArray[np.float64]) -> bool:
    if np.linalg.norm(after[:3, 3] - before[:3, 3]) > _MOVED_M:
        return True
    return angle_between_deg(after[:3, :3], before[:3, :3]) > _TURNED_DEG


def _tells(heatmap: NDArray[np.float32]) -> bool:
    return len(np.unique(heatmap)) >= _FEWEST_VALUES
