"""A picture, or a folder of them, as a stream."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from crowdfence.legible import shown
from crowdfence.sources.pictures.stream import PictureStream, SkippedPicture, StreamPicture, check_every

SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".ppm", ".tif", ".tiff")


def is_picture_file(path: Path) -> bool:
    """By its name: a damaged picture is a picture still."""
    return path.suffix.lower() in SUFFIXES


def is_file_or_lost(path: Path) -> bool:
    """A file, or a link to one that is gone: whoever reads it says so."""
    return path.is_file() or (path.is_symlink() and not path.exists())


def picture_files(path: Path) -> list[Path]:
    """The picture itself, or the pictures of a folder by name (subfolders are not entered, see `left_out`).

    OSError when the path cannot be read, ValueError for a folder without pictures.
    """
    if not path.is_dir():
        return [path]
    files = sorted(file for file in path.iterdir() if is_picture_file(file) and is_file_or_lost(file))
    if not files:
        raise ValueError(f"{path} holds no pictures ({' '.join(SUFFIXES)}) and no recording")
    return files


def read_pictures(files: Sequence[Path], *, every: int = 1) -> PictureStream:
    """Every `every`-th file, one in memory at a time. A file that cannot be read is skipped and reported, and
    so is whatever follows the first page of one."""
    from crowdfence.sources.pictures.decoding import further_pages, read_rgb

    check_every(every)
    for number in range(0, len(files), every):
        file = files[number]
        name = shown(file.name)  # one that is no UTF-8 can be written nowhere
        try:
            yield StreamPicture(number, name, None, read_rgb(file))
            if pages := further_pages(file):
                reason = f"only its first page is used, not the {pages} behind it: save each as a picture"
                yield SkippedPicture(number, name, None, reason)
        except (OSError, ValueError) as error:
            yield SkippedPicture(number, name, None, shown(str(error)))
