"""Single frames of a film, by their number.

Films are read in order nearly always, so the decoder goes on where it was; elsewhere it begins at the key
frame before.
"""

from __future__ import annotations

import threading
from bisect import bisect_right
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.pictures.video import Video, require_unturned

_AHEAD = 150
"""Decoding this many frames is about as much work as a new beginning at a key frame."""


class FilmPictures:
    """The frames of a film. One frame at a time is in memory; any thread may ask."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with Video(path) as video:
            require_unturned(video)
            self.size = video.size
            self.pixel_aspect = video.pixel_aspect
            self.further_films = video.further_films
            self.created = video.metadata.get("creation_time")
            self._pts, self.times_s, self._keys = video.shown_times()
            self.missing_end = video.missing_end(self.times_s[-1])
        self._video: Video | None = None
        self._frames: Iterator[tuple[int | None, NDArray[np.uint8] | str]] = iter(())
        self._next = 0
        self._lock = threading.Lock()

    def ppm(self, number: int) -> bytes:
        """The frame as PPM. ValueError when it is damaged or builds on a damaged one."""
        with self._lock:
            wanted = self._pts[number]
            if self._video is not None and self._next <= number < self._next + _AHEAD:
                begins = [None, *self._keys_before(wanted)]
            else:
                begins = [*self._keys_before(wanted)]
            for begin in begins:
                if begin is not None:
                    self._begin_at(begin)
                picture = self._decoded_until(wanted)
                if picture is not None:
                    self._next = number + 1
                    break
            else:
                raise ValueError("cannot be decoded")
        if isinstance(picture, str):
            raise ValueError(picture)
        return b"P6 %d %d 255\n" % (picture.shape[1], picture.shape[0]) + picture.tobytes()

    def _keys_before(self, pts: int) -> list[int]:
        """Where to begin: the key frame before, the one before that where a container seeks past it (pictures
        that are coded out of order), the beginning."""
        before = bisect_right(self._keys, pts)
        return [*self._keys[max(before - 2, 0) : before][::-1], self._pts[0]]

    def _decoded_until(self, wanted: int) -> NDArray[np.uint8] | str | None:
        """The frame, or what is wrong with it; None when the decoder has gone past it."""
        for pts, picture in self._frames:
            if pts is not None and pts >= wanted:
                if pts == wanted:
                    return picture
                break
        self._next = len(self._pts)  # where it is now is not known
        return None

    def _begin_at(self, pts: int) -> None:
        if self._video is not None:
            self._video.close()
        self._video = Video(self.path)
        self._frames = self._video.pictures_from(None if pts == self._pts[0] else pts)
