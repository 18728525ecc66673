"""A video that stands still: the same picture again and again, with stamps and poses that go on.

A stream whose encoder hangs, or a decoder that repeats its last picture, goes on giving pictures. Put where
the camera is by now, they are looks at ground that nobody looked at: crowd would move along with the drone,
and what lies below would be called free. No camera that moves takes the same picture twice, so that no two
heatmaps are the same either, but for those that show next to nothing, and masks of nobody. A view that shows
the heatmap of the one before, from elsewhere, is therefore refused; where heatmaps have too few values to be
told apart, one that shows the very picture. Where a detector of ours made the heatmaps either is enough: it
looks at pictures at sizes that go with the pose, and not always at all of them, so that the same picture need
not give the same heatmap; and the same picture may come in other bytes, with a stamp in its tags.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import View
from crowdfence.errors import FrameError
from crowdfence.sources.recording import Instant, InstantViews, RefusedFrame
from crowdfence.sources.rotation_angle import angle_between_deg

FEWEST = 3
"""Views of a drone that are refused one after the other before it counts as standing still."""
_FEWEST_VALUES = 16
"""Different values of a heatmap that can be told from another one."""
_MOVED_M, _TURNED_DEG = 0.5, 1.0

Picture = Callable[[], bytes | None]
"""The bytes of a picture as they came, None where there is none; read where they are needed only."""


@dataclass(slots=True)
class _Drone:
    """The newest heatmap of one drone."""

    world_from_camera: NDArray[np.float64]
    """Where it came first."""
    digest: bytes
    heatmap: NDArray[np.float32] | None
    """None after a restart, which keeps no more than the digest."""
    picture: bytes | None
    """Digest of its picture; None where there is none, or where the heatmap alone tells enough."""
    repeated: int = 0
    """How often it has come again since, from elsewhere."""

    @property
    def shown(self) -> str:
        return "heatmaps" if self.picture is None else "pictures"

    def shows(self, heatmap: NDArray[np.float32]) -> bool:
        if self.heatmap is None:
            return _digest(heatmap) == self.digest
        return np.array_equal(heatmap, self.heatmap)


class StillVideo:
    """Looks at the views as they pass, those of each drone in the order of their stamps."""

    def __init__(self) -> None:
        self._drones: dict[str, _Drone] = {}

    def refusal_of(
        self, view: View, picture: Picture = lambda: None, *, of_picture: bool = False
    ) -> RefusedFrame | None:
        """Of a view that shows the heatmap of its drone's view before, or the picture where heatmaps have few
        values or were made `of_picture`, though the camera has moved by half a metre or turned by a degree
        since that came first."""
        heatmap, known = view.heatmap, self._drones.get(view.drone)
        tells = _tells(heatmap)
        encoded = picture() if of_picture or not tells else None
        shown = None if encoded is None else _digest_of(encoded)
        by_picture = of_picture and known is not None and known.picture == shown is not None
        if known is None or not (by_picture or (known.shows(heatmap) and (tells or known.picture == shown))):
            self._drones[view.drone] = _Drone(view.world_from_camera, b"", heatmap, shown)
            return None
        known.heatmap, known.picture = heatmap, shown
        moved = _moved(known.world_from_camera, view.world_from_camera)
        if moved is None or not (tells or (encoded is not None and _shows_something(encoded, view))):
            return None
        known.repeated += 1
        what = (
            "picture is the one before"
            if by_picture or not tells
            else "heatmap is that of the picture before"
        )
        reason = f"its {what}, though the camera {moved}: the video stands still"
        return RefusedFrame(view.drone, view.stamp_ns, reason)

    def moving(self, found: InstantViews, instant: Instant, *, of_pictures: bool = False) -> InstantViews:
        """The views of an instant, those of videos that stand still among the refused. `of_pictures`: a
        detector made their heatmaps."""
        views, refused = list[View](), list(found.refused)
        for view in found.views:
            picture = partial(_picture, instant, view.drone)
            refusal = self.refusal_of(view, picture, of_picture=of_pictures)
            if refusal is None:
                views.append(view)
            else:
                refused.append(refusal)
        return InstantViews(views, refused)

    def standing(self) -> dict[str, str | None]:
        """What is wrong with the video of each drone by now; None where it moves."""
        return {
            name: f"the last {drone.repeated} {drone.shown} of {name} are the same, though its camera moved: "
            "its video stands still, its views are refused, zones stay"
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
                "picture": None if drone.picture is None else drone.picture.hex(),
                "repeated": drone.repeated,
            }
            for name, drone in sorted(self._drones.items())
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """What `to_json` gave."""
        self._drones = {
            name: _Drone(
                np.array(kept["pose"]),
                bytes.fromhex(kept["digest"]),
                None,
                bytes.fromhex(kept["picture"]) if kept.get("picture") else None,  # builds of before had none
                kept["repeated"],
            )
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
    parts = (heatmap[:: max(1, len(heatmap) // 8)], heatmap)  # a few rows are enough as a rule
    return any(len(np.unique(part)) >= _FEWEST_VALUES for part in parts)


def _digest(heatmap: NDArray[np.float32]) -> bytes:
    shape = np.array(heatmap.shape, np.int64).tobytes()
    return _digest_of(shape + np.ascontiguousarray(heatmap).tobytes())


def _digest_of(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=16).digest()


def _shows_something(encoded: bytes, view: View) -> bool:
    """A black picture is no evidence: the heatmap beside it may be of another sensor."""
    from crowdfence.detector.blank_picture import blank_reason
    from crowdfence.sources.pictures.decoding import decode_rgb

    try:
        return blank_reason(decode_rgb(encoded, (view.camera.width, view.camera.height))) is None
    except (OSError, ValueError):
        return False


def _picture(instant: Instant, drone: str) -> bytes | None:
    """What was recorded of a drone at an instant."""
    frame = next(one for one in instant.frames if one.drone == drone)
    if frame.pixels.image is None:
        return None
    try:
        return frame.encoded_image()
    except FrameError:  # then the heatmap came from elsewhere
        return None
