"""A video file as a stream of pictures (PyAV, extra `video`).

What the decoder cannot decode, or only by patching it up from its neighbours, is not passed on: a frame is
skipped when it is damaged and when it builds on a damaged one, that is until the next key frame.

A camera that is held upright stores its frames lying, and a rotation flag with them; frames come out as they
are meant to be shown.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.pictures.broken_frames import BrokenFrame, BrokenFrames
from crowdfence.sources.pictures.decoding import LARGEST
from crowdfence.sources.pictures.stream import PictureStream, SkippedPicture, StreamPicture, check_every
from crowdfence.sources.pictures.transport_stream import losses

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.packet import Packet
    from av.video.frame import VideoFrame

FORMATS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,m4v,h264,hevc,obu,ivf,flv,ogg,asf,"
    "mjpeg,mxf"
)
"""Playlists and capture devices are left out: a file must not make the reader open other files."""

_MISSING_END_S = 0.35
"""Sound may go on a little longer than the pictures."""
_UNTIDY_S = 1.0
"""By so much the order of a file may be wrong without harm."""
_SQUARE = 0.01
"""Scaling to whole pixels leaves such a share between the sides of one."""
_HEAD = 50
"""Among so many frames, one is whole in any film of use."""


class Video:
    """A video file, opened; a context manager.

    ValueError when it is no video that can be decoded, OSError when it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        import av
        from av.stream import Disposition

        self.path = path
        with path.open("rb"):
            pass  # FFmpeg's own message would not say what is wrong with the path
        try:
            self._container: InputContainer = av.open(
                f"file:{path}", options={"format_whitelist": FORMATS, "protocol_whitelist": "file"}
            )
        except (av.FFmpegError, ValueError) as error:
            raise ValueError(
                f"{path} is no video that can be read (MP4, MOV, Matroska, WebM, AVI, MPEG-TS ...): "
                f"{_said(error)}"
            ) from error
        if not self._container.streams.video:
            self._container.close()
            raise ValueError(f"{path} holds no pictures, only {_kinds(self._container)}")
        streams = self._container.streams.video
        # The cover of a film is a stream of one picture.
        films = [one for one in streams if not one.disposition & Disposition.attached_pic]
        self._stream = (films or streams)[0]
        self.further_films = max(len(films) - 1, 0)
        """Streams of pictures beside this one, as of a second lens."""
        codec = self._stream.codec_context
        if codec is None:
            self._container.close()
            raise ValueError(f"{path} has a codec that is not known here")
        # Frames in parallel tell of an error after the packet that caused it, and slices in parallel not at
        # all: FFmpeg then hands out what it has patched up as if it were whole.
        codec.thread_count = 1
        codec.options = {"err_detect": "explode"}
        if codec.width > LARGEST[0] or codec.height > LARGEST[1]:
            self._container.close()
            raise ValueError(
                f"{path} declares {codec.width}x{codec.height} pixels, more than {LARGEST[0]}x{LARGEST[1]}"
            )

    @property
    def frame_count(self) -> int | None:
        """How many frames the file says it has, where it says so; for progress only."""
        if self._stream.frames > 0:
            return int(self._stream.frames)
        rate, duration = self._stream.average_rate, self._container.duration
        return None if not rate or not duration else round(float(rate) * duration / 1e6)

    def pictures(self, *, every: int = 1) -> PictureStream:
        """Every `every`-th frame in the order in which they are shown, one in memory at a time."""
        check_every(every)
        number, last_s = -1, None
        for number, item in enumerate(self._frames()):
            last_s = self._time_s(item.pts) or last_s
            if number % every:
                continue
            if isinstance(item, BrokenFrame):
                yield SkippedPicture(number, "", self._time_s(item.pts), item.reason)
                continue
            try:
                rgb = _upright(item)
            except ValueError as error:
                yield SkippedPicture(number, "", self._time_s(item.pts), _said(error))
                continue
            yield StreamPicture(number, "", self._time_s(item.pts), rgb)
        if missing := self.missing_end(last_s or 0.0):
            yield SkippedPicture(number + 1, "", last_s, missing)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) as shown."""
        width, height = int(self._stream.codec_context.width), int(self._stream.codec_context.height)
        return (height, width) if _quarters(self.rotation_deg) % 2 else (width, height)

    @property
    def rotation_deg(self) -> int:
        """By how many degrees, counterclockwise, the stored frames are turned to be shown: what the first
        frame says that can be decoded."""
        return self._turn[0]

    @property
    def is_mirrored(self) -> bool:
        """Whether the same frame says that they are shown mirrored."""
        return self._turn[1]

    @cached_property
    def _turn(self) -> tuple[int, bool]:
        with Video(self.path) as again:
            frames = (item for item in islice(again._frames(), _HEAD) if not isinstance(item, BrokenFrame))
            first = next(frames, None)
            return (0, False) if first is None else (int(first.rotation), _mirrors(first))

    @property
    def pixel_aspect(self) -> float:
        """How many times as wide as high a pixel is meant to be shown; 1 where the file does not say."""
        stored = float(self._stream.sample_aspect_ratio or 1.0)
        return 1.0 / stored if _quarters(self.rotation_deg) % 2 else stored

    @property
    def metadata(self) -> dict[str, str]:
        """What the file says about itself, such as creation_time."""
        return {**self._container.metadata, **self._stream.metadata}

    def missing_end(self, last_s: float) -> str:
        """What is told of a file that is not whole, where the last frame in it is shown at `last_s`; empty
        where it is, or does not say how long it is."""
        declared_s = self._declared_s()
        if declared_s is None or declared_s - last_s <= _MISSING_END_S:
            return ""
        return f"the file ends at {last_s:.3f} s, although it declares {declared_s:.3f} s"

    def shown_times(self) -> tuple[list[int], list[float], list[int]]:
        """When each frame is shown, in order, without decoding: on the clock of the stream, and in seconds
        since the film's beginning; then the key frames, on the clock of the stream. These may be hidden, as
        where a film was cut off between two of them: those that are shown build on one that is not.

        ValueError when the file holds no frame with a time, and where times begin anew within it.
        """
        import av

        shown, keys = set[int](), set[int]()
        latest: int | None = None
        try:
            for packet in self._container.demux(self._stream):
                if packet.pts is None or not packet.size:
                    continue
                if packet.is_keyframe:
                    keys.add(packet.pts)
                if not packet.is_discard:
                    shown.add(packet.pts)
                if packet.dts is not None:
                    self._require_onward(latest, packet.dts)
                    latest = packet.dts
        except av.FFmpegError as error:
            if not shown:
                raise ValueError(f"{self.path} cannot be read: {_said(error)}") from error
        if not shown:
            raise ValueError(f"{self.path} holds no frame with a time")
        pts = sorted(shown)
        return pts, [self._time_s(one) or 0.0 for one in pts], sorted(keys)

    def _require_onward(self, before: int | None, dts: int) -> None:
        """ValueError for a time at which a frame is decoded that lies well before that of the one before."""
        back_s = 0.0 if before is None else float((before - dts) * (self._stream.time_base or 0))
        if back_s > _UNTIDY_S:
            raise ValueError(
                f"{self.path}: its times go back by {back_s:.1f} s within it, as where films were put one "
                "behind the other byte for byte, and nobody knows which of two frames of one time is meant: "
                "join films with ffmpeg -f concat -i LIST.txt -c copy FILM"
            )

    def pictures_from(self, pts: int | None) -> Iterator[tuple[int | None, NDArray[np.uint8] | str]]:
        """Frames with their times from the key frame before `pts` on, or from the beginning for None, in the
        order in which they are shown: RGB [H, W, 3], or what is wrong with one."""
        import av

        try:
            if pts is not None:  # a transport stream is sought past its first key frame
                self._container.seek(pts, stream=self._stream, backward=True)
        except av.FFmpegError as error:
            raise ValueError(f"{self.path}: no way to frame {pts}: {_said(error)}") from error
        for item in self._frames():
            if isinstance(item, BrokenFrame):
                yield item.pts, item.reason
            else:
                yield item.pts, _upright(item)

    def close(self) -> None:
        self._container.close()

    def __enter__(self) -> Video:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _frames(self) -> Iterator[VideoFrame | BrokenFrame]:
        """Frames and gaps in the order in which they are shown."""
        gaps = BrokenFrames()
        for item in self._decoded():
            if isinstance(item, BrokenFrame):
                gaps.add(item)
                continue
            gaps.reach(item.pts)
            yield from gaps.before(item.pts)
            if gaps.repeats(item.pts):
                continue  # the decoder's patched-up version of what it has just refused
            if item.is_corrupt:
                yield gaps.seen(BrokenFrame(item.pts, "damaged"))
            elif gaps.touch(item):
                yield BrokenFrame(item.pts, "may build on a damaged frame; the next key frame ends that")
            else:
                yield item
        yield from gaps.before(None)

    def _decoded(self) -> Iterator[VideoFrame | BrokenFrame]:
        """What the decoder gives, in its order."""
        import av

        packets = self._packets()
        while True:
            try:
                packet, is_whole = next(packets, (None, True))
            except av.FFmpegError as error:
                yield BrokenFrame(None, f"the file cannot be read any further: {_said(error)}")
                return
            if packet is None:
                return
            if not is_whole:
                yield BrokenFrame(packet.pts, "bytes of it were lost on their way")
            try:
                yield from packet.decode()
            except av.FFmpegError as error:
                if is_whole:
                    yield BrokenFrame(packet.pts, f"cannot be decoded: {_said(error)}")

    def _packets(self) -> Iterator[tuple[Packet, bool]]:
        """Coded frames, and whether all bytes of each are there, as far as the container tells."""
        import av

        demuxed = self._container.demux(self._stream)
        if not len(self._losses):
            yield from ((packet, True) for packet in demuxed)
            return
        begin = 0
        held: list[Packet] = []
        try:
            for packet in demuxed:
                if packet.pos is not None:  # frames that the container holds together have one place
                    yield from self._judged(held, begin, packet.pos)
                    begin, held = packet.pos, []
                held.append(packet)
        except av.FFmpegError:
            yield from self._judged(held, begin, math.inf)
            raise
        yield from self._judged(held, begin, math.inf)

    def _judged(self, packets: list[Packet], begin: int, end: float) -> Iterator[tuple[Packet, bool]]:
        """Coded frames that lie between two places of the file, and whether nothing is missing there."""
        is_whole = not ((self._losses >= begin) & (self._losses < end)).any()
        yield from ((packet, is_whole or not packet.size) for packet in packets)

    @cached_property
    def _losses(self) -> NDArray[np.int64]:
        """Where bytes of the frames are missing, in the file."""
        is_counted = self._container.format.name == "mpegts"
        return losses(self.path, self._stream.id) if is_counted else np.empty(0, np.int64)

    def _declared_s(self) -> float | None:
        if self._stream.duration and self._stream.time_base:
            return float(self._stream.duration * self._stream.time_base)
        duration_us = self._container.duration
        if duration_us is None or duration_us <= 0:
            return None
        # Matroska, which tells it of the whole file alone, counts from 0 whenever its film begins.
        return duration_us / 1e6 - max(self._container.start_time or 0, 0) / 1e6

    def _time_s(self, pts: int | None) -> float | None:
        base = self._stream.time_base
        return None if pts is None or base is None else float((pts - (self._stream.start_time or 0)) * base)


def squeezed(pixel_aspect: float) -> str:
    """What pixels that are not square mean for a detector, which is shown them as if they were; empty where
    they are."""
    if abs(math.log(pixel_aspect)) <= _SQUARE:
        return ""
    return (
        f"has pixels {pixel_aspect:.3f} times as wide as high, in which people look squeezed to a detector: "
        "save it with square pixels (ffmpeg -vf scale=iw*sar:ih,setsar=1)"
    )


def left_aside(further_films: int) -> str:
    """What is told of films in the same file that nobody looks at; empty where there are none."""
    if not further_films:
        return ""
    return (
        f"holds {further_films + 1} films, as of several lenses, and only the first is looked at: take the "
        "others out (ffmpeg -i FILM -map 0:v:1 -c copy OTHER) and name them by themselves"
    )


def require_unturned(film: Video) -> None:
    """ValueError for a film whose frames are turned to be shown, whose poses may mean either."""
    if _quarters(film.rotation_deg):
        raise ValueError(
            f"{film.path} is stored turned (its rotation flag says {-film.rotation_deg % 360} degrees "
            "clockwise), and its poses may mean the stored frames or those that are shown: turn its frames "
            "as the poses mean them, and save it without the flag"
        )
    if film.is_mirrored:  # from top to bottom, as other ways turn it too
        raise ValueError(
            f"{film.path} is shown upside down from how it is stored, mirrored, and its poses may mean "
            "either: turn its frames as the poses mean them, and save it without the flag (display matrix)"
        )


def _upright(frame: VideoFrame) -> NDArray[np.uint8]:
    """RGB [H, W, 3] as shown. ValueError when it cannot be converted."""
    rgb = np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)
    quarters = _quarters(frame.rotation)
    return np.ascontiguousarray(np.rot90(rgb, quarters)) if quarters else rgb


def _mirrors(frame: VideoFrame) -> bool:
    """By its display matrix (ISO 14496-12, 3 x 3 whole numbers)."""
    matrix: Any = frame.side_data.get("DISPLAYMATRIX")
    if matrix is None:
        return False
    a, b, _, c, d, *_ = np.frombuffer(bytes(matrix), np.int32).astype(np.float64).tolist()
    return bool(a * d - b * c < 0.0)


def _quarters(rotation_deg: int) -> int:
    """Counterclockwise, 0 to 3."""
    return round(rotation_deg / 90) % 4


def _said(error: Any) -> str:
    return str(getattr(error, "strerror", None) or error)


def _kinds(container: InputContainer) -> str:
    return ", ".join(sorted({stream.type for stream in container.streams})) or "nothing"
