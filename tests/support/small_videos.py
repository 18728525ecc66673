"""Small videos whose frames tell their number, and damage done to single frames of them."""

import struct
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT, RATE = 64, 48, 10


def picture(number: int) -> NDArray[np.uint8]:
    """White to the left of column 4 * number (up to 32), else black above and dark green below, as a picture
    of one tone would be refused: [48, 64, 3]."""
    rgb = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    rgb[HEIGHT // 2 :, :, 1] = 60
    rgb[:, : 4 * min(number, 8)] = 255
    return rgb


def write_video(path: Path, frames: int, *, key_every: int = 5, pixel_aspect: str = "1:1") -> Path:
    """MPEG-4 part 2 at 10 frames a second, a key frame every `key_every`, frame n showing `picture(n)`."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=RATE, options={"aspect": pixel_aspect})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.gop_size, stream.bit_rate = key_every, 4_000_000
        for number in range(frames):
            frame = av.VideoFrame.from_ndarray(picture(number), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def packet_ends(path: Path) -> list[int]:
    """Byte after the coded bytes of each frame."""
    with av.open(str(path)) as container:
        return [packet.pos + packet.size for packet in container.demux(video=0) if packet.size]


def damage(path: Path, numbers: list[int]) -> Path:
    """Overwrite the coded bytes of these frames with zeros."""
    with av.open(str(path)) as container:
        places = [(packet.pos, packet.size) for packet in container.demux(video=0) if packet.size]
    data = bytearray(path.read_bytes())
    for number in numbers:
        position, size = places[number]
        data[position : position + size] = bytes(size)
    path.write_bytes(data)
    return path


def turn(path: Path, clockwise_deg: int, *, mirrored: bool = False) -> Path:
    """Set the rotation flag of an MP4: players show its frames turned so far (ISO 14496-12, tkhd matrix), or
    first with the upper side down."""
    data = bytearray(path.read_bytes())
    box = data.index(b"tkhd") + 4
    matrix = box + 4 + (20 if data[box] == 0 else 32) + 16
    a, b = {0: (1, 0), 90: (0, 1), 180: (-1, 0), 270: (0, -1)}[clockwise_deg]
    down = -1 if mirrored else 1
    values = (a, b, 0, -b * down, a * down, 0, 0, 0)
    data[matrix : matrix + 36] = struct.pack(">9i", *(65536 * value for value in values), 1 << 30)
    path.write_bytes(data)
    return path


def with_creation_time(plain: Path, told: Path, created: str) -> Path:
    """The film `plain` as `told`, an MP4 that says when it was created."""
    with av.open(str(plain)) as source, av.open(str(told), "w", format="mp4") as target:
        target.metadata["creation_time"] = created
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(source.streams.video[0]):
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
    return told


def delayed(plain: Path, late: Path, by_s: float) -> Path:
    """The film `plain` as `late`, with every time `by_s` later, as one that was cut out of a longer one. MP4
    hides what comes before 0, and has it still, as of a film that was cut between key frames."""
    options = {"avoid_negative_ts": "disabled"}
    with av.open(str(plain)) as source, av.open(str(late), "w", options=options) as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None and packet.pts is not None:
                packet.pts += round(by_s / packet.time_base)
                packet.dts += round(by_s / packet.time_base)
                packet.stream = stream
                target.mux(packet)
    return late


def side_by_side(films: list[Path], path: Path) -> Path:
    """The pictures of several films as streams of one."""
    with av.open(str(path), "w") as target:
        sources = [av.open(str(film)) for film in films]
        streams = [target.add_stream_from_template(source.streams.video[0]) for source in sources]
        for source, stream in zip(sources, streams, strict=True):
            for packet in source.demux(video=0):
                if packet.dts is not None:
                    packet.stream = stream
                    target.mux(packet)
            source.close()
    return path


def write_cover(path: Path, film: Path) -> Path:
    """A film with a picture that players show for it."""
    with av.open(str(film)) as source, av.open(str(path), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        cover = target.add_stream("mjpeg", rate=1)
        cover.width, cover.height, cover.pix_fmt = WIDTH, HEIGHT, "yuvj420p"
        cover.disposition = av.stream.Disposition.attached_pic.value  # PyAV 14 takes a number
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
        target.mux(cover.encode(av.VideoFrame.from_ndarray(picture(4), format="rgb24")))
        target.mux(cover.encode(None))
    return path


def write_grey_film(path: Path, codec: str, rate: int, frames: int) -> Path:
    """Coded out of order, with a key frame every 12; frame n is grey of 6 * n."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = WIDTH, HEIGHT, "yuv420p", 4_000_000
        stream.gop_size, stream.codec_context.max_b_frames = 12, 2
        for number in range(frames):
            grey = np.full((HEIGHT, WIDTH, 3), 6 * number, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="rgb24")))
        container.mux(stream.encode(None))
    return path
