"""Picture files and bytes -> arrays, with every limit checked before pixels are decoded.

Everything here raises ValueError (or OSError from the file itself) for pictures that are damaged, of another
size than the camera says, or not of the expected kind. A JPEG that libjpeg would patch up counts as damaged
(`intact_jpeg`).
"""

import io
import math
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, UnidentifiedImageError

from crowdfence.errors import one_line
from crowdfence.sources.pictures.intact_jpeg import require_intact

Size = tuple[int, int]
"""(width, height)"""

LARGEST: Size = (2**14, 2**14)
"""No picture without a known camera may declare more columns or rows than this."""

_FORMATS = ("BMP", "GIF", "JPEG", "JPEG2000", "PNG", "PPM", "TIFF", "WEBP")
"""What is read as a picture, whatever it is called (MPO is of JPEG). Pillow knows others, and hands EPS,
which is a program, to Ghostscript: whoever may send a picture would run it here."""

UPRIGHT = 1
"""EXIF Orientation of a picture that is stored as it is shown."""

_TO_UPRIGHT = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
"""By EXIF Orientation."""

_OPAQUE = 255
_SUBFILE_TYPE, _COPY_OR_MASK = 254, 0b101
"""TIFF tag, and those of its bits."""


def decode_rgb(data: bytes, size: Size) -> NDArray[np.uint8]:
    """Encoded picture of a posed camera -> [H, W, 3] uint8 of exactly `size`.

    ValueError for one deeper than 8 bit; for one that is transparent anywhere, as at the rim of what was
    rectified: nobody sees what is there, and the colours below mean nothing; and for one that asks to be
    turned (EXIF Orientation): nobody can know whether its pose means it as stored or as shown.
    """
    with _opened(io.BytesIO(data), size, is_colour=True) as picture:
        _require_opaque(picture)
        return np.asarray(picture.convert("RGB"))


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """Picture file of any size -> [H, W, 3] uint8, upright as its EXIF Orientation says. Transparency is
    dropped; deeper than 8 bit is refused."""
    with _opened(path, None, is_colour=True, may_be_turned=True) as picture:
        turn = _TO_UPRIGHT.get(orientation(picture))  # Pillow has turned a TIFF, which says 1 by now
        return np.asarray((picture if turn is None else picture.transpose(turn)).convert("RGB"))


def further_pages(path: Path) -> int:
    """Pages behind the first one that `read_rgb` gives, or frames of an animation. Smaller copies of a page,
    masks and the previews in photographs are none. ValueError where what follows is damaged."""
    try:
        with Image.open(path, formats=_FORMATS) as picture:
            count = int(getattr(picture, "n_frames", 1))
            if picture.format == "MPO":
                return 0
            return _tiff_pages(picture, count) if picture.format == "TIFF" else count - 1
    except OSError as error:
        if error.errno is not None:
            raise
        raise ValueError(f"what follows its first page is damaged: {error}") from error
    except Exception as error:  # whatever the library meets in damaged tags
        raise ValueError(f"what follows its first page is damaged: {error}") from error


def _tiff_pages(picture: Any, count: int) -> int:
    pages = 0
    for number in range(1, count):
        picture.seek(number)
        kind = int(picture.tag_v2.get(_SUBFILE_TYPE, 0))
        pages += kind & _COPY_OR_MASK == 0
    return pages


def orientation(picture: Image.Image) -> int:
    """EXIF Orientation, 1 (upright) to 8; 1 where none is told, or damaged."""
    try:
        told = picture.getexif().get(ExifTags.Base.Orientation, UPRIGHT)
    except Exception:  # whatever the library meets in damaged tags
        return UPRIGHT
    return told if isinstance(told, int) and told in _TO_UPRIGHT else UPRIGHT


def turned_fault(told: int) -> str:
    """Why a picture with a pose, or with labels, is refused that asks to be turned, and what to do."""
    return (
        f"is stored turned (EXIF Orientation {told}), and its pose or labels may mean the stored picture or "
        "the one that is shown: turn its pixels as those mean them, and save it with Orientation 1"
    )


def read_heatmap(path: Path, image_size: Size) -> NDArray[Any]:
    """Heatmap file -> [h, w], no larger than its image: 8-bit grey PNG as uint8, 16-bit grey PNG as float32
    value / 65535, .npy as it is."""
    if path.suffix == ".npy":
        return _read_npy(path)
    with _opened(path, None, at_most=image_size) as picture:
        if picture.mode == "L":
            return np.asarray(picture)
        if picture.mode in ("I;16", "I;16L", "I;16B", "I"):
            return (np.asarray(picture).astype(np.float32) / np.float32(65535)).astype(np.float32)
        raise ValueError(
            f"{path.name} has mode {picture.mode}: a heatmap is a grey picture, value / maximum = probability"
        )


def read_only_heatmap(files: Sequence[Path], image_size: Size) -> NDArray[Any]:
    """The same of a frame that should have one file, and may have one of each kind: nobody knows then which
    of them counts."""
    if len(files) > 1:
        names = ", ".join(file.name for file in files)
        raise ValueError(f"{len(files)} heatmaps for one frame: {names}; remove those that do not count")
    return read_heatmap(files[0], image_size)


def read_regions(path: Path, size: Size) -> NDArray[Any]:
    """Crowd region picture -> [H, W] uint8, value = crowd number."""
    with _opened(path, size) as picture:
        if picture.mode not in ("L", "P", "1"):
            raise ValueError(
                f"{path.name} has mode {picture.mode}: crowd regions are an 8-bit picture of crowd numbers"
            )
        numbers = np.asarray(picture).astype(np.uint8)
        # Programs that reduce a mask to its colours sort them as they like: black, which no eye takes for
        # crowd, then has a number.
        black = _black_of_palette(picture) if picture.mode == "P" else set()
        crowds = black.intersection(np.unique(numbers).tolist())
        if 0 not in black and crowds:
            raise ValueError(
                f"{path.name} has a palette in which black is {min(crowds)}, a crowd, and 0, no crowd, is a "
                "colour: save it in grey"
            )
        return numbers


def _black_of_palette(picture: Image.Image) -> set[int]:
    colours = np.array(picture.getpalette("RGB"), np.uint8).reshape(-1, 3)
    return set(np.flatnonzero((colours == 0).all(axis=1)).tolist())


def read_silhouettes(
    path: Path, size: Size, crowd_colors: Sequence[tuple[int, int, int]]
) -> NDArray[np.bool_]:
    """Segmentation picture -> [H, W] bool, True where the colour is one of `crowd_colors` (R, G, B)."""
    with _opened(path, size) as picture:
        rgb = np.asarray(picture.convert("RGB"))
    silhouettes = np.zeros(rgb.shape[:2], dtype=np.bool_)
    for colour in crowd_colors:
        silhouettes |= (rgb == np.array(colour, dtype=np.uint8)).all(axis=-1)
    return silhouettes


def read_depth_cm(path: Path, size: Size) -> NDArray[np.float32]:
    """16-bit PNG in centimetres -> [H, W] float32 metres, NaN where it holds 0."""
    return _depth_cm(path, size)


def decode_depth_cm(data: bytes) -> NDArray[np.float32]:
    """The same from the file's bytes, whatever the size."""
    return _depth_cm(io.BytesIO(data), None)


def _depth_cm(source: Path | io.BytesIO, size: Size | None) -> NDArray[np.float32]:
    with _opened(source, size) as picture:
        if not picture.mode.startswith("I"):
            name = source.name if isinstance(source, Path) else "picture"
            raise ValueError(f"{name} has mode {picture.mode}: 8-bit depth is clipped; record 16 bit or PFM")
        centimetres = np.asarray(picture).astype(np.float32)
    return np.where(centimetres > 0, centimetres / np.float32(100), np.float32(np.nan)).astype(np.float32)


def read_pfm(path: Path, size: Size) -> NDArray[np.float32]:
    """AirSim's PFM -> [H, W] float32, first row on top; values that are not finite become NaN.

    AirSim writes rows from the top although the format says from the bottom, and its own client reads them
    back that way (writePFMfile in Utils.hpp).
    """
    expected = size[0] * size[1] * 4
    with path.open("rb") as file:
        magic, shape, scale = (file.readline(64).strip() for _ in range(3))
        if magic != b"Pf":
            raise ValueError(f"{path.name} is not a one-channel PFM: it begins with {magic!r}")
        if shape.split() != [str(size[0]).encode(), str(size[1]).encode()]:
            raise ValueError(f"{path.name} has size {shape!r}, the camera has {size[0]}x{size[1]}")
        data = file.read(expected + 1)
    if len(data) != expected:
        raise ValueError(
            f"{path.name} holds {len(data)} bytes of pixels, its size asks for {expected}: truncated?"
        )
    try:
        order = "<" if float(scale) < 0 else ">"
    except ValueError:
        raise ValueError(f"{path.name} has scale {scale!r}, expected a number") from None
    values = np.frombuffer(data, dtype=f"{order}f4").reshape(size[1], size[0])
    return np.where(np.isfinite(values), values, np.float32(np.nan)).astype(np.float32)


def picture_format(data: bytes) -> str | None:
    """What the first bytes say, "jpeg" or "png"; None for anything else."""
    if data.startswith(b"\xff\xd8\xff"):
        return "jpeg"
    return "png" if data.startswith(b"\x89PNG\r\n\x1a\n") else None


def as_png(data: bytes) -> bytes:
    """Any picture that Pillow reads, as PNG without loss (AirSim's uncompressed PPM, for instance)."""
    with _opened(io.BytesIO(data), None) as picture:
        encoded = io.BytesIO()
        picture.save(encoded, format="PNG")
        return encoded.getvalue()


@contextmanager
def _opened(
    source: Path | io.BytesIO,
    size: Size | None,
    at_most: Size = LARGEST,
    *,
    is_colour: bool = False,
    may_be_turned: bool = False,
) -> Iterator[Image.Image]:
    """The picture, fully decoded; its declared size is checked first, so that a lie costs no memory.
    `is_colour`: its channels must have 8 bits, as a camera shows it."""
    name = source.name if isinstance(source, Path) else "picture"
    try:
        with Image.open(source, formats=_FORMATS) as picture:
            # Pillow turns a TIFF while it decodes it, and the tag is gone; of others it may lie behind the
            # pixels.
            if picture.format == "TIFF" and not may_be_turned:
                _require_upright(picture, name)
            width, height = picture.size
            if size is not None and picture.size != size:
                raise ValueError(f"{name} is {width}x{height}, the camera is {size[0]}x{size[1]}")
            if width > at_most[0] or height > at_most[1]:
                raise ValueError(
                    f"{name} declares {width}x{height} pixels, more than {at_most[0]}x{at_most[1]}"
                )
            if is_colour:
                _require_eight_bits(picture, name)
            picture.load()
            if not may_be_turned:
                _require_upright(picture, name)
            if picture.format in ("JPEG", "MPO"):
                _require_intact(source, name)
            yield picture
    except (SyntaxError, EOFError, struct.error, zlib.error) as error:
        raise ValueError(f"{name} is damaged: {error}") from error
    except Image.DecompressionBombError as error:  # as a whole one may be, put together of many
        most = 2 * (Image.MAX_IMAGE_PIXELS or 0)
        raise ValueError(f"{name} has more than {most:,} pixels: cut it into several") from error
    except UnidentifiedImageError as error:  # its own words name the object that held the bytes
        raise ValueError(f"{name} is damaged: it is no picture that can be read") from error
    except OSError as error:
        if error.errno is not None:
            raise
        raise ValueError(f"{name} is damaged: {error}") from error


def _require_eight_bits(picture: Image.Image, name: str) -> None:
    """Before it is decoded. Pillow clips deeper grey to black and white, and of deeper colours it keeps the
    upper 8 bits, which are black where a camera of 12 bits fills the lower ones."""
    if picture.mode[0] in "IF":
        raise ValueError(f"{name} has mode {picture.mode}: save it with 8 bits a channel")
    if any(";16" in str(tile.args) for tile in getattr(picture, "tile", ())):
        raise ValueError(f"{name} has 16 bits a channel: save it with 8 bits a channel")


def _require_opaque(picture: Image.Image) -> None:
    if picture.has_transparency_data and np.asarray(picture.convert("RGBA"))[..., 3].min() < _OPAQUE:
        raise ValueError(
            "picture is transparent in places, where nobody sees anything: give it as the camera took it"
        )


def _require_upright(picture: Image.Image, name: str) -> None:
    if (told := orientation(picture)) != UPRIGHT:
        raise ValueError(f"{name} {turned_fault(told)}")


def _require_intact(source: Path | io.BytesIO, name: str) -> None:
    try:
        require_intact(source.read_bytes() if isinstance(source, Path) else source.getvalue())
    except ValueError as error:
        raise ValueError(f"{name} is damaged: {error}") from None


def _read_npy(path: Path) -> NDArray[Any]:
    # np.load allocates what the header claims, so the claim is compared with the file first.
    with path.open("rb") as file:
        try:
            read_header = _NPY_HEADERS[np.lib.format.read_magic(file)]
            shape, fortran_order, dtype = read_header(file)
        except Exception as error:  # whatever numpy meets: it reads the header as Python
            raise ValueError(f"{path.name} is not a usable .npy file: {one_line(error)}") from error
        if dtype != np.uint8 and not np.issubdtype(dtype, np.floating):
            raise ValueError(f"{path.name} holds {dtype}: a heatmap is uint8 or float")
        expected = math.prod(shape) * dtype.itemsize
        left = path.stat().st_size - file.tell()
        if left != expected:
            raise ValueError(
                f"{path.name} holds {left} bytes of values, its shape {shape} asks for {expected}"
            )
        values = np.frombuffer(file.read(expected), dtype=dtype)
    return values.reshape(shape, order="F" if fortran_order else "C")


_NPY_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
