"""Frames of a film that are not there, until the turn of each comes to be shown, and what builds on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from av.video.frame import VideoFrame


class BrokenFrame:
    """A frame that is not there."""

    def __init__(self, pts: int | None, reason: str) -> None:
        self.pts = pts
        self.reason = reason


class BrokenFrames:
    """Broken frames until their turn comes, and how far their damage reaches."""

    def __init__(self) -> None:
        self._waiting: list[BrokenFrame] = []
        self._last: BrokenFrame | None = None
        """The newest broken frame whose damage no key frame has ended yet."""
        self._refused: set[int | None] = set()
        """Met by the decoder, which may show its own version of them later."""
        self._shown_pts: int | None = None

    def add(self, broken: BrokenFrame) -> None:
        """Met by the decoder, which runs ahead of what is shown."""
        self._waiting.append(self.seen(broken))
        self._refused.add(broken.pts)

    def seen(self, broken: BrokenFrame) -> BrokenFrame:
        self._last = broken
        return broken

    def reach(self, pts: int | None) -> None:
        """What is shown now. Where films were put one behind the other, times begin anew, and those of broken
        frames before say nothing of those that follow."""
        if pts is not None and self._shown_pts is not None and pts < self._shown_pts:
            self._refused.clear()
            self._last = None if self._last is None else BrokenFrame(None, self._last.reason)
        self._shown_pts = pts if pts is not None else self._shown_pts

    def before(self, pts: int | None) -> list[BrokenFrame]:
        """Those that would have been shown before `pts`; all for None."""
        due = [gap for gap in self._waiting if pts is None or gap.pts is None or gap.pts <= pts]
        self._waiting = [gap for gap in self._waiting if gap not in due]
        return sorted(due, key=lambda gap: -1 if gap.pts is None else gap.pts)

    def repeats(self, pts: int | None) -> bool:
        if pts is None or pts not in self._refused:
            return False
        self._refused.remove(pts)
        return True

    def touch(self, frame: VideoFrame) -> bool:
        """Whether the frame builds on a broken one."""
        if self._last is None:
            return False
        behind = self._last.pts is None or frame.pts is None or frame.pts > self._last.pts
        if frame.key_frame and behind:
            self._last = None
            return False
        return True
