"""The intrinsics of one drone's pictures as its CameraInfo comes.

Each picture has those of its own stamp, also while the camera zooms. Most drivers send one with every
picture, some one now and then, or once for all.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from threading import Condition

from crowdfence._core import Camera

_KEPT = 256
"""Of pictures that wait for their poses: seconds of a film."""
_OVERTAKEN_NS = 1_000_000_000
"""Messages of one topic overtake each other by less: what is older is of a clock that was set back."""


class Intrinsics:
    """`heard` and `at` may be called from any thread."""

    def __init__(self, wait_s: float) -> None:
        """Topics have no order among each other: a picture waits so long for its own."""
        self._wait_s = wait_s
        self._cameras: dict[int, Camera] = {}
        """By stamp, in the order of their coming."""
        self._every_picture = False
        """Whether a picture had one of its own stamp."""
        self._without: deque[int] = deque(maxlen=_KEPT)
        """Pictures whose own had not come when they were asked for."""
        self._changed = Condition()

    def heard(self, stamp_ns: int, camera: Camera) -> None:
        with self._changed:
            if stamp_ns < max(self._cameras, default=0) - _OVERTAKEN_NS:
                self._cameras.clear()
            self._cameras.pop(stamp_ns, None)
            self._cameras[stamp_ns] = camera
            while len(self._cameras) > _KEPT:
                del self._cameras[next(iter(self._cameras))]
            self._every_picture |= stamp_ns in self._without  # behind its picture: the next one waits
            self._changed.notify_all()

    def at(self, stamp_ns: int) -> Camera:
        """Of a picture. ValueError where none has come, and where the camera changes around the picture and
        nothing says when."""
        with self._changed:
            self._wait(lambda: bool(self._cameras))
            if not self._cameras:
                raise ValueError("no camera_info has come")
            if self._every_picture:
                self._wait(
                    lambda: (
                        stamp_ns in self._cameras
                        or stamp_ns <= max(self._cameras) <= stamp_ns + _OVERTAKEN_NS
                    )
                )
            if (own := self._cameras.get(stamp_ns)) is not None:
                self._every_picture = True
                return own
            self._without.append(stamp_ns)
            before = max((at for at in self._cameras if at < stamp_ns), default=None)
            after = min((at for at in self._cameras if at > stamp_ns), default=None)
            around = [self._cameras[at] for at in (before, after) if at is not None]
            if self._every_picture and around[0] != around[-1]:
                raise ValueError(f"the camera changes, and no camera_info of {stamp_ns} has come")
            return around[0]

    def _wait(self, there: Callable[[], bool]) -> None:
        self._changed.wait_for(there, self._wait_s)
