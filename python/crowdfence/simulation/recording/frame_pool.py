"""Frames made by several processes, one per core, handed back in the order in which they were asked for."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from types import TracebackType
from typing import Protocol, TypeVar

from crowdfence.simulation.recording.frame_maker import FrameMaker, FrameOptions
from crowdfence.simulation.recording.frame_summary import FrameSummary
from crowdfence.simulation.recording.interrupts import (
    end_between_tasks,
    end_if_wanted,
    end_with_parent,
    ignore_interrupts,
    interrupts_ignored,
)
from crowdfence.simulation.scene import Scene
from crowdfence.simulation.schedule import Capture
from crowdfence.sources.mission.messages import FrameContent

_T = TypeVar("_T")

MOST_WORKERS = 8
_WORKER_MEMORY_BYTES = 900e6


class WorkerKilled(RuntimeError):
    """A helping process ended without being asked to."""


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
    that is killed ends the pool with WorkerKilled.
    """

    def __init__(self, scene: Scene, options: FrameOptions, encoder: FrameEncoder, workers: int) -> None:
        self.workers = worker_count(workers)
        self._job = (scene, options, encoder)
        self._own: _Worker | None = None
        self._executor: ProcessPoolExecutor | None = None

    def __enter__(self) -> FramePool:
        if self.workers == 1:
            self._own = _Worker(*self._job)
            return self
        self._executor = ProcessPoolExecutor(
            self.workers, get_context("spawn"), initializer=_start_worker, initargs=self._job
        )
        try:
            # Processes start as they are needed; an interrupt that meets one on its way would kill it.
            with interrupts_ignored():
                starts = [self._executor.submit(_this_worker_is_ready) for _ in range(self.workers)]
            _outcome(starts[0].result)
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
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
            self._executor = None

    def begin(self, capture: Capture, *, footprint: bool) -> Callable[[], MadeFrame]:
        """Begin a frame; the function returned waits for it."""
        task = _Task(capture, footprint)
        if self._own is not None:
            own = self._own
            return lambda: own.make(task)
        assert self._executor is not None, "the pool was not entered"
        future = self._executor.submit(_make, task)
        return lambda: _outcome(future.result)


def worker_count(asked: int | None) -> int:
    """As many processes as asked for; None: as this machine has cores and memory for. ValueError for none of
    them, and for more than could be of use."""
    if asked is None:
        return _usable_workers()
    most = max(MOST_WORKERS, _cores())
    if not 1 <= asked <= most:
        raise ValueError(f"workers must be between 1 and {most}, got {asked}")
    return asked


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _usable_workers() -> int:
    cores = _cores()
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


_job: tuple[Scene, FrameOptions, FrameEncoder] | None = None
_worker: _Worker | None = None


def _start_worker(scene: Scene, options: FrameOptions, encoder: FrameEncoder) -> None:
    global _job
    ignore_interrupts()
    end_between_tasks()
    end_with_parent()
    # One core each: more threads of the software rasteriser would fight for them.
    os.environ.setdefault("LP_NUM_THREADS", "1")
    _job = (scene, options, encoder)


def _this_worker() -> _Worker:
    # Made by the first task, not by the initializer: what goes wrong there would be lost.
    global _worker
    if _worker is None:
        assert _job is not None
        _worker = _Worker(*_job)
    return _worker


def _this_worker_is_ready() -> bool:
    return _this_worker() is not None


def _make(task: _Task) -> MadeFrame:
    end_if_wanted()
    return _this_worker().make(task)


def _outcome(wait: Callable[[], _T]) -> _T:
    try:
        return wait()
    except BrokenProcessPool as error:
        raise WorkerKilled(
            "a process that makes frames was killed (out of memory?); go on with --resume and fewer --workers"
        ) from error
