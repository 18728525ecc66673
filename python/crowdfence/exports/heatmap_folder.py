"""Heatmaps of pictures as a folder: one grey PNG each, and a table of them."""

from __future__ import annotations

import csv
import re
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from crowdfence.atomic_file import atomic_path, require_replaceable
from crowdfence.atomic_folder import whole_folder
from crowdfence.legible import table_cell

HEATMAPS, INDEX = "heatmaps", "index.csv"
COLUMNS = ("frame", "source", "time_s", "file", "crowd_share", "largest", "unlike_tested")
CROWD_FROM = 0.5
_FRAME = "frame_{:06d}.png"


class _Frames:
    """The names of files that this writes, of any number."""

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and re.fullmatch(r"frame_\d{6,}\.png", name) is not None


class HeatmapFolder:
    """Writes `heatmaps/frame_<number>.png` (8-bit grey, value / 255) and `index.csv`; a context manager.

    The columns of the table: number in the stream, file name of the picture, seconds since the beginning of a
    video, file of the heatmap, share of its cells above 0.5, largest value, and 1 where the picture is unlike
    everything that the detector was tested on (0: alike; empty: unknown). Everything appears when the block
    succeeds; after an error in it the folder is as it was.
    """

    def __init__(self, folder: Path, *, replace: bool = False) -> None:
        """FileExistsError when the folder holds heatmaps or a table, unless they are to be replaced, and
        within the block when something else lies among these heatmaps."""
        self.folder = folder
        self._replace = replace
        for name in (HEATMAPS, INDEX):
            require_replaceable(folder / name, force=replace)
        self._stack = ExitStack()

    def __enter__(self) -> HeatmapFolder:
        with ExitStack() as stack:
            table = stack.enter_context(atomic_path(self.folder / INDEX))
            file = stack.enter_context(open(table, "w", newline="", encoding="utf-8"))
            heatmaps = whole_folder(self.folder / HEATMAPS, contents=_Frames(), force=self._replace)
            self._part = stack.enter_context(heatmaps)
            self._rows = csv.writer(file)
            self._rows.writerow(COLUMNS)
            self._stack = stack.pop_all()
        return self

    def add(
        self,
        number: int,
        source: str,
        time_s: float | None,
        heatmap: NDArray[np.float32],
        *,
        unlike_tested: bool | None = None,
    ) -> None:
        """Heatmap float [h, w] in [0, 1] of picture `number`."""
        name = _FRAME.format(number)
        Image.fromarray(np.rint(heatmap * np.float32(255)).astype(np.uint8)).save(self._part / name)
        share = float(np.mean(heatmap > CROWD_FROM))
        self._rows.writerow(
            [
                number,
                table_cell(source),
                "" if time_s is None else f"{time_s:.6f}",
                f"{HEATMAPS}/{name}",
                f"{share:.6f}",
                f"{float(heatmap.max()):.6f}",
                "" if unlike_tested is None else int(unlike_tested),
            ]
        )

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:  # whoever is killed now leaves no table beside heatmaps that it is not of
            (self.folder / INDEX).unlink(missing_ok=True)
        self._stack.__exit__(kind, error, trace)
