"""A video that stands still: the same picture again and again, with stamps and poses that go on.

A stream whose encoder hangs, or a decoder that repeats its last picture, goes on giving pictures. Put where
the camera is by now, they are looks at ground that nobody looked at: crowd would move along with the drone,
and what lies below would be called free. No camera that moves takes the same picture twice, so that no two
heatmaps are the same either, but for those that show next to nothing. A view that shows the heatmap of the
one before, from elsewhere, is therefore refused.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import View
from crowdfence.sources.recording import InstantViews, RefusedFrame
from crowdfence.sources.rotation_angle import angle_between_deg

FEWEST = 3
"""Views of a drone that are refused one after the other before it counts as standing still."""
_FEWEST_VALUES = 16
"""Different values of a heatmap that can be told from another one."""
_MOVED_M, _TURNED_DEG = 0.5, 1.0


@dataclass(slots=True)
class _Drone:
    """The newest heatmap of one drone."""

    world_from_camera: NDArray[np.float64]
    """Where it came first."""
    digest: bytes
    heatmap: NDArray[np.float32] | None
    """None after a restart, which keeps no more than the digest."""
    repeated: int = 0
    """How often it has come again since, from elsewhere."""

    @staticmethod
    def of(view: View, heatmap: NDArray[np.float32]) -> _Drone:
        return _Drone(view.world_from_camera, b"", heatmap)

    def shows(self, heatmap: NDArray[np.float32]) -> bool:
        if self.heatmap is None:
            return _digest(heatmap) == self.digest
        return np.array_equal(heatmap, self.heatmap)


class StillVideo:
    """Looks at the views as they pass, those of each drone in the order of their stamps."""

    def __init__(self) -> None:
        self._drones: dict[str, _Drone] = {}

    def refusal_of(self, view: View) -> RefusedFrame | None:
        """Of a view that shows the heatmap of its drone's view before, though the camera has moved by half a
        metre or turned by a degree since that came first."""
        heatmap, known = view.heatmap, self._drones.get(view.drone)
        if known is None or not known.shows(heatmap):
            self._drones[view.drone] = _Drone.of(view, heatmap)
            return None
        known.heatmap = heatmap
        moved = _moved(known.world_from_camera, view.world_from_camera)
        if moved is None or not _tells(heatmap):
            return None
        known.repeated += 1
        reason = (
            f"its heatmap is that of the picture before, though the camera {moved}: the video stands still"
        )
        return RefusedFrame(view.drone, view.stamp_ns, reason)

    def moving(self, found: InstantViews) -> InstantViews:
        """The views of an instant, those of videos that stand still among the refused."""
        views, refused = list[View](), list(found.refused)
        for view in found.views:
            refusal = self.refusal_of(view)
            if refusal is None:
                views.append(view)
            else:
                refused.append(refusal)
        return InstantViews(views, refused)

    def standing(self) -> dict[str, str | None]:
        """What is wrong with the video of each drone by now; None where it moves."""
        return {
            name: f"the last {drone.repeated} heatmaps of {name} are the same, though its camera moved: its "
            "video stands still, its views are refused, zones stay"
            if drone.repeated >= FEWEST
            else None
            for name, drone in sorted(dict(self._drones).items())
        }

    def to_json(self) -> dict[str, Any]:
        """All that later refusals depend on."""
        return {
            name: {
                "pose": drone.world_from_camera.tolist(),
                "digest": (drone.digest if drone.heatmap is None else _digest(drone.heatmap)).hex(),
                "repeated": drone.repeated,
            }
            for name, drone in sorted(self._drones.items())
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """What `to_json` gave."""
        self._drones = {
            name: _Drone(np.array(kept["pose"]), bytes.fromhex(kept["digest"]), None, kept["repeated"])
            for name, kept in state.items()
        }


def _moved(before: NDArray[np.float64], after: NDArray[np.float64]) -> str | None:
    """How a camera did, in words; None where it did not to speak of."""
    if (moved_m := float(np.linalg.norm(after[:3, 3] - before[:3, 3]))) > _MOVED_M:
        return f"has moved by {moved_m:.1f} m since"
    if (turned_deg := angle_between_deg(after[:3, :3], before[:3, :3])) > _TURNED_DEG:
        return f"has turned by {turned_deg:.1f} degrees since"
    return None


def _tells(heatmap: NDArray[np.float32]) -> bool:
    return len(np.unique(heatmap)) >= _FEWEST_VALUES


def _digest(heatmap: NDArray[np.float32]) -> bytes:
    shape = np.array(heatmap.shape, np.int64).tobytes()
    return hashlib.blake2b(shape + np.ascontiguousarray(heatmap).tobytes(), digest_size=16).digest()
