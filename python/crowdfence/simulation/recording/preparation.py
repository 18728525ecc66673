"""What has to be known and written before the first frame, done in a process of its own.

Building the voxels of a large map takes a gigabyte for some seconds. A process that ends gives it back; the
one that records would keep much of it.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from crowdfence.simulation.recording.frame_maker import FrameMaker, FrameOptions
from crowdfence.simulation.recording.frame_pool import WorkerKilled
from crowdfence.simulation.recording.interrupts import end_with_parent, ignore_interrupts, interrupts_ignored
from crowdfence.simulation.recording.terrain_files import TerrainFiles, write_terrain_files
from crowdfence.simulation.scene import Scene

_T = TypeVar("_T")


class Preparation:
    """A process that prepares the recording of a scene (this one for `apart=False`); a context manager."""

    def __init__(self, scene: Scene, options: FrameOptions, *, apart: bool) -> None:
        self._scene, self._options = scene, options
        self._executor: ProcessPoolExecutor | None = None
        if apart:
            self._executor = ProcessPoolExecutor(
                1, get_context("spawn"), initializer=_start, initargs=(scene, options)
            )

    def __enter__(self) -> Preparation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)

    def renderer(self) -> str:
        """What will make the frames. NoOpenGL or ScenarioError when nothing here can."""
        if self._executor is None:
            return _describe(self._scene, self._options)
        return self._result(_describe_own)

    def write_map(self, folder: Path, stem: str, dem_stem: str | None = None) -> TerrainFiles:
        """`write_terrain_files` of the scene."""
        if self._executor is None:
            return write_terrain_files(self._scene, folder, stem, dem_stem)
        return self._result(_write_own_map, folder, stem, dem_stem)

    def _result(self, function: Callable[..., _T], *arguments: Any) -> _T:
        assert self._executor is not None
        with interrupts_ignored():  # while the process starts
            future: Future[_T] = self._executor.submit(function, *arguments)
        try:
            return future.result()
        except BrokenProcessPool as error:
            raise WorkerKilled(
                "the process that makes the map was killed (out of memory?); choose larger voxels"
            ) from error


_own: tuple[Scene, FrameOptions] | None = None


def _start(scene: Scene, options: FrameOptions) -> None:
    global _own
    ignore_interrupts()
    end_with_parent()
    _own = (scene, options)


def _describe(scene: Scene, options: FrameOptions) -> str:
    with FrameMaker(scene, options) as maker:
        return maker.description


def _describe_own() -> str:
    assert _own is not None
    return _describe(*_own)


def _write_own_map(folder: Path, stem: str, dem_stem: str | None) -> TerrainFiles:
    assert _own is not None
    return write_terrain_files(_own[0], folder, stem, dem_stem)
