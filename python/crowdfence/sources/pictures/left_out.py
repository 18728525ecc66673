"""What else a folder of pictures holds: whatever looks like a picture or a label and is not read is told."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from PIL import Image

_PICTURES = (
    *(".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".webp", ".bmp", ".ppm", ".pgm", ".tif", ".tiff", ".gif"),
    *(".heic", ".heif", ".avif", ".jp2", ".jxl"),
)
_RAW = (".dng", ".raw", ".arw", ".cr2", ".cr3", ".nef", ".orf", ".raf", ".rw2")
_FILMS = (".mp4", ".mov", ".mkv", ".m4v", ".avi", ".webm", ".mpg", ".ts", ".mts", ".m2ts")
_GEO_KEYS = 34735
"""TIFF tag of a map."""


def left_out(folder: Path, suffixes: Sequence[str], *, except_for: Collection[str] = ()) -> list[str]:
    """One sentence for files that look like pictures or films and have none of `suffixes` (lower case), one
    for subfolders that hold files that have, at any depth. Nothing is told of maps, of raw files beside the
    picture that was made of them and of names in `except_for`. OSError when it cannot be read.
    """
    entries = sorted(path for path in folder.iterdir() if _counts(path.name, except_for))
    files = [path for path in entries if not path.is_dir()]
    taken = {path.stem.lower() for path in files if path.suffix.lower() in suffixes}
    missed = [path.name for path in files if _looks_like_one(path, suffixes, taken)]
    folders = [path.name for path in entries if path.is_dir() and _holds_pictures(path, suffixes, except_for)]
    return [*_told(folder, missed, folders, suffixes)]


def labels_without_frame(folder: str, names: Collection[str], unused: Sequence[str]) -> list[str]:
    """One sentence where label files of a folder are nobody's, `unused` of all its `names`."""
    if not unused:
        return []
    return [
        f"{len(unused)} of {_counted(len(names), 'label file')} in {folder}/ belong to no frame, first: "
        f"{min(unused)}; their stamps must be those of the pictures or heatmaps"
    ]


def _told(folder: Path, files: list[str], folders: list[str], suffixes: Sequence[str]) -> Iterator[str]:
    name = folder.resolve().name
    if files:
        yield (
            f"{_counted(len(files), 'file')} of {name}/ left out, first: {files[0]}; of a folder only "
            f"{' '.join(suffixes)} are read"
        )
    if folders:
        yield (
            f"{_counted(len(folders), 'subfolder')} of {name}/ with pictures left out, first: {folders[0]}; "
            "move its pictures up, or name it by itself"
        )


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _counts(name: str, except_for: Collection[str]) -> bool:
    return not name.startswith(".") and name not in except_for


def _looks_like_one(path: Path, suffixes: Sequence[str], taken: Collection[str]) -> bool:
    suffix = path.suffix.lower()
    if suffix in suffixes:
        return False
    if suffix in _RAW:
        return path.stem.lower() not in taken
    return suffix in _FILMS or (suffix in _PICTURES and not _is_map(path))


def _is_map(path: Path) -> bool:
    if path.suffix.lower() not in (".tif", ".tiff"):
        return False
    try:
        with Image.open(path) as picture:
            return _GEO_KEYS in getattr(picture, "tag_v2", ())
    except Exception:  # maps of kinds that Pillow does not know, and damaged ones
        return True


def _holds_pictures(folder: Path, suffixes: Sequence[str], except_for: Collection[str]) -> bool:
    for _, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if _counts(name, except_for)]
        if any(Path(name).suffix.lower() in suffixes for name in files if _counts(name, except_for)):
            return True
    return False
