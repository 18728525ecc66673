"""Pictures one after the other, from files or a video: what `files` and `video` yield."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class StreamPicture:
    """A picture that could be read."""

    number: int
    """Place in the stream, from 0; pictures that cannot be read count."""
    name: str
    """File name of a picture, empty for the frames of a video."""
    time_s: float | None
    """Since the beginning of a video, None for picture files."""
    rgb: NDArray[np.uint8]
    """[H, W, 3]"""


@dataclass(frozen=True, slots=True)
class SkippedPicture:
    """A picture that could not be read, and why."""

    number: int
    name: str
    time_s: float | None
    reason: str

    def __str__(self) -> str:
        at = "" if self.time_s is None else f" at {self.time_s:.3f} s"
        return f"frame {self.number}{at}{f' ({self.name})' if self.name else ''}: {self.reason}"


PictureStream = Iterator[StreamPicture | SkippedPicture]


def check_every(every: int) -> None:
    """ValueError for a stride below 1."""
    if every < 1:
        raise ValueError(f"every is {every}; it must be at least 1")
