"""Heatmaps of pictures as a folder: one grey PNG each, and a table of them."""

from __future__ import annotations

import csv
import os
import shutil
import tempfile
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from crowdfence.atomic_file import atomic_path, require_replaceable
from crowdfence.legible import table_cell

HEATMAPS, INDEX = "heatmaps", "index.csv"
COLUMNS = ("frame", "source", "time_s", "file", "crowd_share", "largest", "unlike_tested")
CROWD_FROM = 0.5


class HeatmapFolder:
    """Writes `heatmaps/frame_<number>.png` (8-bit grey, value / 255) and `index.csv`; a context manager.

    The columns of the table: number in the stream, file name of the picture, seconds since the beginning of a
    video, file of the heatmap, share of its cells above 0.5, largest value, and 1 where the picture is unlike
    everything that the detector was tested on (0: alike; empty: unknown). Everything appears when the block
    succeeds; after an error the folder is as it was.
    """

    def __init__(self, folder: Path, *, replace: bool = False) -> None:
        """FileExistsError when the folder holds heatmaps or a table, unless they are to be replaced."""
        self.folder = folder
        for name in (HEATMAPS, INDEX):
            require_replaceable(folder / name, force=replace)
        self._stack = ExitStack()

    def __enter__(self) -> HeatmapFolder:
        with ExitStack() as stack:
            table = stack.enter_context(atomic_path(self.folder / INDEX))
            file = stack.enter_context(open(table, "w", newline="", encoding="utf-8"))
            self._part = Path(tempfile.mkdtemp(prefix=f".{HEATMAPS}-", dir=self.folder))
            stack.callback(shutil.rmtree, self._part, ignore_errors=True)
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
        name = f"frame_{number:06d}.png"
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
        if kind is None:
            final = self.folder / HEATMAPS
            if final.exists():
                shutil.rmtree(final)
            mask = os.umask(0)
            os.umask(mask)
            self._part.chmod(0o777 & ~mask)
            self._part.rename(final)
        self._stack.__exit__(kind, error, trace)
