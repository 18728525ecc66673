"""Pictures on their way through the detector, in threads of their own."""

from __future__ import annotations

import logging
import time
from concurrent.futures import Future, ThreadPoolExecutor

from crowdfence.errors import FrameError
from crowdfence.pipeline.detect import HeatmapSource
from crowdfence.service.arrivals import Content
from crowdfence.sources.recording import Frame, RefusedFrame

_LOG = logging.getLogger(__name__)


class Detecting:
    """A picture that cannot be used becomes a refused frame, never an exception."""

    def __init__(self, heatmaps: HeatmapSource, threads: int) -> None:
        self._heatmaps = heatmaps
        self.far_looks = heatmaps.far_looks()
        self._threads = ThreadPoolExecutor(threads, thread_name_prefix="detector")
        self._since: dict[int, float] = {}
        """By place in the journal: seconds of a steady clock."""

    def __len__(self) -> int:
        return len(self._since)

    @property
    def oldest_s(self) -> float | None:
        """How long the oldest picture has waited."""
        oldest = min(list(self._since.values()), default=None)
        return None if oldest is None else time.monotonic() - oldest

    def leaves_far_out(self, frame: Frame) -> bool:
        """Whether the look at a frame is to be at near ground alone; to be asked in their order."""
        return self._heatmaps.leaves_far_out(frame, self.far_looks)

    def submit(self, frame: Frame, seq: int, *, near: bool) -> Future[Content]:
        self._since[seq] = time.monotonic()
        return self._threads.submit(self._detect, frame, seq, near)

    def stop(self) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _detect(self, frame: Frame, seq: int, near: bool) -> Content:
        try:
            return frame.view(self._heatmaps.look(frame, near=near))
        except FrameError as error:
            return RefusedFrame(frame.drone, frame.stamp_ns, error.reason)
        except Exception as error:
            _LOG.exception("the detector failed")
            return RefusedFrame(frame.drone, frame.stamp_ns, f"the detector failed: {error}")
        finally:
            self._since.pop(seq, None)
