"""Frames made by several processes, one per core, handed back in the order in which they were asked for."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from queue import SimpleQueue
from types import TracebackType
from typing import Any, Protocol, TypeVar

from crowdfence.simulation.recording.frame_maker import FrameMaker, FrameOptions
from crowdfence.simulation.recording.frame_summary import FrameSummary
from crowdfence.simulation.recording.helping_process import HelperKilled, HelpingProcess
from crowdfence.simulation.scene import Scene
from crowdfence.simulation.schedule import Capture
from crowdfence.sources.mission.messages import FrameContent
from crowdfence.usable_cores import usable_cores

_T = TypeVar("_T")

MOST_WORKERS = 8
_WORKER_MEMORY_BYTES = 900e6


class FrameEncoder(Protocol):
    """Turns a frame into the pieces that a recording stores; must be picklable."""

    def __call__(self, content: FrameContent, capture: Capture) -> Mapping[str, bytes]: ...


@dataclass(frozen=True, slots=True, eq=False)
class MadeFrame:
    """A frame as the recording stores it."""

    pieces: Mapping[str, bytes]
    summary: FrameSummary


@dataclass(frozen=True, slots=True)
class _Task:
    capture: Capture
    footprint: bool


class FramePool:
    """Makes frames of a scene in `workers` processes (1: in this one). Use as a context manager.

    Entering starts the workers and raises what keeps them from working: NoOpenGL, ScenarioError. A worker
    that is killed ends the pool with HelperKilled.
    """

    def __init__(self, scene: Scene, options: FrameOptions, encoder: FrameEncoder, workers: int) -> None:
        self.workers = worker_count(workers)
        self._job = (scene, options, encoder)
        self._own: _Worker | None = None
        self._processes: list[HelpingProcess] = []
        self._idle: SimpleQueue[HelpingProcess] = SimpleQueue()
        self._threads: ThreadPoolExecutor | None = None

    def __enter__(self) -> FramePool:
        if self.workers == 1:
            self._own = _Worker(*self._job)
            return self
        # A thread for each process: a frame is read as soon as it is made, whatever this one does meanwhile.
        self._threads = ThreadPoolExecutor(self.workers, thread_name_prefix="frames")
        try:
            for _ in range(self.workers):
                process = HelpingProcess()
                self._processes.append(process)
                self._idle.put(process)
            start = partial(self._call, _start_worker, *self._job)
            for started in [self._threads.submit(start) for _ in self._processes]:
                started.result()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._own is not None:
            self._own.maker.__exit__(kind, error, trace)
            self._own = None
        for process in self._processes:
            process.kill()  # nobody waits for what it still makes
        if self._threads is not None:
            self._threads.shutdown(wait=True, cancel_futures=True)
            self._threads = None
        for process in self._processes:
            process.close()
        self._processes.clear()

    def begin(self, capture: Capture, *, footprint: bool) -> Callable[[], MadeFrame]:
        """Begin a frame; the function returned waits for it."""
        task = _Task(capture, footprint)
        if self._own is not None:
            own = self._own
            return lambda: own.make(task)
        assert self._threads is not None, "the pool was not entered"
        return self._threads.submit(self._call, _make, task).result

    def _call(self, function: Callable[..., _T], *arguments: Any) -> _T:
        process = self._idle.get()
        try:
            return process.call(function, *arguments)
        except HelperKilled as error:
            raise HelperKilled(
                "a process that makes frames was killed (out of memory?); go on with --resume and fewer "
                "--workers"
            ) from error
        finally:
            self._idle.put(process)


def worker_count(asked: int | None) -> int:
    """As many processes as asked for; None: as this machine has cores and memory for. ValueError for none of
    them, and for more than could be of use."""
    if asked is None:
        return _usable_workers()
    most = max(MOST_WORKERS, usable_cores())
    if not 1 <= asked <= most:
        raise ValueError(f"workers must be between 1 and {most}, got {asked}")
    return asked


def _usable_workers() -> int:
    cores = usable_cores()
    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return max(1, min(cores, 2))
    return max(1, min(cores, MOST_WORKERS, int(memory / 2 / _WORKER_MEMORY_BYTES)))


class _Worker:
    """What one process holds."""

    def __init__(self, scene: Scene, options: FrameOptions, encoder: FrameEncoder) -> None:
        self.maker, self._encoder = FrameMaker(scene, options), encoder

    def make(self, task: _Task) -> MadeFrame:
        content = self.maker.make(task.capture)
        summary = self.maker.summary(content, footprint=task.footprint)
        return MadeFrame(self._encoder(content, task.capture), summary)


_worker: _Worker | None = None
"""Of a helping process."""


def _start_worker(scene: Scene, options: FrameOptions, encoder: FrameEncoder) -> None:
    global _worker
    # One core each: more threads of the software rasteriser would fight for them.
    os.environ.setdefault("LP_NUM_THREADS", "1")
    _worker = _Worker(scene, options, encoder)


def _make(task: _Task) -> MadeFrame:
    assert _worker is not None
    return _worker.make(task)
