"""What has to be known and written before the first frame, done in a process of its own.

Building the voxels of a large map takes a gigabyte for some seconds. A process that ends gives it back; the
one that records would keep much of it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from crowdfence.simulation.recording.frame_maker import FrameMaker, FrameOptions
from crowdfence.simulation.recording.helping_process import HelperKilled, HelpingProcess
from crowdfence.simulation.recording.terrain_files import TerrainFiles, write_terrain_files
from crowdfence.simulation.scene import Scene

_T = TypeVar("_T")


class Preparation:
    """A process that prepares the recording of a scene (this one for `apart=False`); a context manager."""

    def __init__(self, scene: Scene, options: FrameOptions, *, apart: bool) -> None:
        self._scene, self._options = scene, options
        self._process = HelpingProcess() if apart else None

    def __enter__(self) -> Preparation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None:
            self._process.close()

    def renderer(self) -> str:
        """What will make the frames. NoOpenGL or ScenarioError when nothing here can."""
        return self._call(_describe, self._scene, self._options)

    def write_map(self, folder: Path, stem: str, dem_stem: str | None = None) -> TerrainFiles:
        """`write_terrain_files` of the scene."""
        return self._call(write_terrain_files, self._scene, folder, stem, dem_stem)

    def _call(self, function: Callable[..., _T], *arguments: Any) -> _T:
        if self._process is None:
            return function(*arguments)
        try:
            return self._process.call(function, *arguments)
        except HelperKilled as error:
            raise HelperKilled(
                "the process that makes the map was killed (out of memory?); choose larger voxels"
            ) from error


def _describe(scene: Scene, options: FrameOptions) -> str:
    with FrameMaker(scene, options) as maker:
        return maker.description
