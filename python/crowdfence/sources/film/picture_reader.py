"""Single frames of a film, by their number.

Films are read in order nearly always, so the decoder goes on where it was; elsewhere it begins at the key
frame before.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from crowdfence.sources.pictures.video import Video

_AHEAD = 150
"""Decoding this many frames is about as much work as a new beginning at a key frame."""


class FilmPictures:
    """The frames of a film. One frame at a time is in memory; any thread may ask."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with Video(path) as video:
            self.size = video.size
            self.created = video.metadata.get("creation_time")
            self._pts, self.times_s = video.shown_times()
        self._video: Video | None = None
        self._frames: Iterator[tuple[int | None, np.ndarray | str]] = iter(())
        self._next = 0
        self._lock = threading.Lock()

    def ppm(self, number: int) -> bytes:
        """The frame as PPM. ValueError when it is damaged or builds on a damaged one."""
        with self._lock:
            wanted = self._pts[number]
            if self._video is None or not self._next <= number < self._next + _AHEAD:
                self._begin_before(wanted)
            for pts, picture in self._frames:
                if pts is None or pts < wanted:
                    continue
                self._next = number + 1
                if pts > wanted:
                    break
                if isinstance(picture, str):
                    raise ValueError(picture)
                return b"P6 %d %d 255\n" % (picture.shape[1], picture.shape[0]) + picture.tobytes()
            self._video = None
            raise ValueError("cannot be decoded")

    def _begin_before(self, pts: int) -> None:
        if self._video is not None:
            self._video.close()
        self._video = Video(self.path)
        self._frames = self._video.pictures_from(pts)
