"""The intrinsics of one drone's pictures as its CameraInfo comes.

Each picture has those of its own stamp, also while the camera zooms. Most drivers send one with every
picture, some one now and then, or once for all; bridges thin them out on their way.
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
_NEXT_NS = 2_000_000_000
"""What is told every second or so settles what came in between, however it jitters."""


class Intrinsics:
    """`heard` and `at` may be called from any thread."""

    def __init__(self, wait_s: float) -> None:
        """Topics have no order among each other: a picture waits so long for its own."""
        self._wait_s = wait_s
        self._told: dict[int, Camera | str] = {}
        """By stamp, in the order of their coming; why one cannot be used."""
        self._with_pictures = False
        """Whether a picture had one of its own stamp."""
        self._waits = False
        """The same, and since then they came often enough to be waited for."""
        self._without: deque[int] = deque(maxlen=_KEPT)
        """Pictures whose own had not come when they were asked for."""
        self._changed = Condition()

    def heard(self, stamp_ns: int, camera: Camera | str) -> None:
        """A camera, or why what was told is none."""
        with self._changed:
            if stamp_ns < max(self._told, default=0) - _OVERTAKEN_NS:
                self._told.clear()
            self._told.pop(stamp_ns, None)
            self._told[stamp_ns] = camera
            while len(self._told) > _KEPT:
                del self._told[next(iter(self._told))]
            if stamp_ns in self._without:  # behind its picture: the next one waits
                self._with_pictures = self._waits = True
            self._changed.notify_all()

    def at(self, stamp_ns: int) -> Camera:
        """Of a picture. ValueError where none has come, or what has come is none, and where the camera
        changes around the picture and nothing says when."""
        with self._changed:
            self._wait(lambda: bool(self._told))
            if not self._told:
                raise ValueError("no camera_info has come")
            if self._waits:
                self._waits = self._wait(lambda: self._is_settled(stamp_ns))
            if (own := self._told.get(stamp_ns)) is not None:
                self._with_pictures = self._waits = True
                return _usable(own)
            self._without.append(stamp_ns)
            before = max((at for at in self._told if at < stamp_ns), default=None)
            after = min((at for at in self._told if at > stamp_ns), default=None)
            around = [self._told[at] for at in (before, after) if at is not None]
            # Where nothing newer has come, a camera that changed before may have changed again.
            seen = around if after is not None else list(self._told.values())
            if self._with_pictures and any(camera != around[0] for camera in seen):
                raise ValueError(f"the camera changes, and no camera_info of {stamp_ns} has come")
            return _usable(around[0])

    def _is_settled(self, stamp_ns: int) -> bool:
        """Whether its own has come, or one of a later picture."""
        newest_ns = max(self._told)
        return stamp_ns in self._told or stamp_ns <= newest_ns <= stamp_ns + _NEXT_NS

    def _wait(self, there: Callable[[], bool]) -> bool:
        return self._changed.wait_for(there, self._wait_s)


def _usable(told: Camera | str) -> Camera:
    if isinstance(told, str):
        raise ValueError(told)
    return told
