"""Pictures -> a video file that browsers and players show (PyAV, extra `video`).

VP9 in MP4: libvpx is BSD-licensed, the format is free of royalties, and every current browser plays it.
x264 and x265, which PyAV's wheels carry as well, are GPL; MPEG-4 part 2 is LGPL, but no browser plays it.
"""

from __future__ import annotations

from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from crowdfence.atomic_file import atomic_path

if TYPE_CHECKING:
    from av.video.stream import VideoStream

LONGEST_SIDE = 1920
_CODEC = "libvpx-vp9"
_OPTIONS = {"deadline": "realtime", "cpu-used": "7", "row-mt": "1", "crf": "32", "b": "0"}
_TICKS_PER_S = 1000
_KEY_FRAME_EVERY = 64


def video_size(width: int, height: int) -> tuple[int, int]:
    """(width, height) of the video for pictures of that size: at most `LONGEST_SIDE`, both even."""
    shrink = min(1.0, LONGEST_SIDE / max(width, height))
    return max(16, 2 * round(width * shrink / 2)), max(16, 2 * round(height * shrink / 2))


class VideoWriter:
    """Writes a video file that appears under its name when the block succeeds; a context manager.

    The first picture sets the size. Others are scaled to fit into it, on black.
    """

    def __init__(self, path: Path, *, rate: Fraction = Fraction(25)) -> None:
        """`rate` in pictures a second is a hint for players and the encoder; the stamps decide."""
        self.path = path
        self._rate = rate
        self._stack = ExitStack()
        self._size: tuple[int, int] | None = None
        self._last_tick = -1

    def __enter__(self) -> VideoWriter:
        import av

        with self._stack as stack:
            temporary = stack.enter_context(atomic_path(self.path))
            self._container = stack.enter_context(av.open(str(temporary), "w", format="mp4"))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None and self._size is not None:
                self._container.mux(self._stream.encode(None))
        finally:
            self._stack.__exit__(kind, error, trace)

    def write(self, picture: NDArray[np.uint8], time_s: float) -> None:
        """Add a picture [H, W, 3] RGB shown from `time_s` on; a time that does not increase is moved up."""
        import av

        if self._size is None:
            self._begin(picture)
        frame = av.VideoFrame.from_ndarray(_fitted(picture, self._size or (0, 0)), format="rgb24")
        self._last_tick = max(round(time_s * _TICKS_PER_S), self._last_tick + 1)
        frame.pts, frame.time_base = self._last_tick, Fraction(1, _TICKS_PER_S)
        self._container.mux(self._stream.encode(frame))

    def _begin(self, picture: NDArray[np.uint8]) -> None:
        self._size = video_size(picture.shape[1], picture.shape[0])
        stream: Any = self._container.add_stream(_CODEC, rate=self._rate, options=_OPTIONS)
        stream.width, stream.height = self._size
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = Fraction(1, _TICKS_PER_S)
        stream.codec_context.gop_size = _KEY_FRAME_EVERY
        self._stream: VideoStream = stream


def _fitted(picture: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    height, width = picture.shape[:2]
    if (width, height) == size:
        return np.ascontiguousarray(picture)
    scale = min(size[0] / width, size[1] / height)
    inner = max(1, min(size[0], round(width * scale))), max(1, min(size[1], round(height * scale)))
    canvas = Image.new("RGB", size)
    left, top = (size[0] - inner[0]) // 2, (size[1] - inner[1]) // 2
    canvas.paste(Image.fromarray(picture).resize(inner, Image.Resampling.BILINEAR), (left, top))
    return np.asarray(canvas)
