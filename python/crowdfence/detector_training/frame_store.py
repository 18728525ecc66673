"""Decoded frames and labels of many missions on disk, so that every pass over them is a memory read."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from crowdfence._core import vibrant
from crowdfence.atomic_file import NO_ROOM, atomic_path
from crowdfence.detector_training.labels import (
    LABEL_STRIDE,
    STRIDE,
    Target,
    picture_training_labels,
    training_labels,
)
from crowdfence.labelled_pictures.coco import annotation_file
from crowdfence.labelled_pictures.picture_recording import is_labelled_pictures
from crowdfence.sources.recording import Frame

_FORMAT = 7
"""Another one wherever labels are read or made otherwise: what is stored is not what it would be now."""


@dataclass(frozen=True, slots=True, eq=False)
class StoredMission:
    """The frames of one mission, N of one size, mapped from disk."""

    name: str
    images: NDArray[np.uint8]
    """[N, H, W, 3] RGB."""
    crowd: NDArray[np.uint8]
    """[N, T, h, w] labels (`TrainingLabels`), one plane per target."""
    known: NDArray[np.bool_]
    """[N, T, h, w] False where the truth is unknown."""
    skipped: tuple[str, ...]
    """Frames that could not be used, and why."""
    photographs: bool = False
    """Labelled pictures instead of a recording."""
    doubts: tuple[str, ...] = ()
    """What is doubtful about the recording and its map, one sentence each."""
    sizes: NDArray[np.int64] | None = None
    """[N, 2] rows and columns of each picture, which lies in the upper left corner; None: all are whole."""

    def __len__(self) -> int:
        return len(self.images)

    def size_of(self, frame: int) -> tuple[int, int]:
        """Rows and columns of a frame, multiples of the stride."""
        rows, columns = self.images.shape[1:3] if self.sizes is None else self.sizes[frame].tolist()
        return rows, columns


def store_missions(
    paths: Sequence[Path],
    targets: Sequence[Target],
    folder: Path,
    *,
    workers: int = 1,
    terrain_options: Mapping[str, Any] | None = None,
    vibrance: float = 1.0,
    on_mission: Callable[[StoredMission], None] | None = None,
) -> list[StoredMission]:
    """Decode and label the frames of the recordings at `paths` into `folder`; what is there is reused, unless
    a recording, its map or a picture was changed since.

    Sides that are no multiple of the stride are cut down to one. Frames that cannot be read are skipped and
    named. `terrain_options` say how the maps are opened, see `pipeline.open_terrain`; `vibrance` is that with
    which the model is shown pictures (`ModelInput`), and so are those that are stored. ValueError for a
    recording without a usable frame, or with frames of several sizes; OSError for a folder without room, and
    for a process that is killed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    missions = []
    # Forking beside the threads of a library that decodes can leave a child waiting for ever.
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        options = dict(terrain_options or {})
        parts = [folder / _key(path, targets, options, vibrance) for path in paths]
        alike = (tuple(targets), options, vibrance)
        stored = pool.map(_stored, paths, *([one] * len(paths) for one in alike), parts)
        try:
            for path, part in zip(paths, stored, strict=True):
                missions.append(_mapped(part, is_labelled_pictures(path)))
                if on_mission is not None:
                    on_mission(missions[-1])
        except BrokenProcessPool as error:
            raise OSError(
                "a process that decodes missions was killed (out of memory?); the same command with fewer "
                "--workers goes on"
            ) from error
    return missions


def _key(path: Path, targets: Sequence[Target], options: dict[str, Any], vibrance: float) -> str:
    stat = (annotation_file(path) or path).stat()
    file = [str(path.resolve()), stat.st_size, stat.st_mtime_ns]
    shown = [] if vibrance == 1.0 else [vibrance]
    what = json.dumps([_FORMAT, *file, list(targets), options, *shown], default=str)
    return f"{path.stem}-{hashlib.sha256(what.encode()).hexdigest()[:12]}"


def _stored(
    path: Path, targets: tuple[Target, ...], options: dict[str, Any], vibrance: float, part: Path
) -> Path:
    """Write one mission as arrays; the description comes last and says that the rest is whole."""
    if _is_current(part):
        return part
    part.with_suffix(".json").unlink(missing_ok=True)
    from crowdfence.errors import FrameError
    from crowdfence.pipeline import read_map
    from crowdfence.sources import open_recording

    if is_labelled_pictures(path):
        return _stored_pictures(path, len(targets), vibrance, part)
    recording = open_recording(path)
    if not recording.frames:
        raise ValueError(f"{path} holds no usable frame")
    ground = read_map(recording, **options) if "ground" in targets else None
    terrain = None if ground is None else ground.terrain
    sizes = {(frame.camera.height, frame.camera.width) for frame in recording.frames}
    if len(sizes) > 1:
        raise ValueError(_of_several_sizes(path, recording.frames))
    height, width = (side // STRIDE * STRIDE for side in sizes.pop())
    arrays = _Arrays.create(part, len(recording.frames), len(targets), height, width)
    kept, skipped = 0, [str(refused) for refused in recording.refused]
    for frame in recording.frames:
        try:
            labels = [training_labels(target, frame, recording, terrain) for target in targets]
            arrays.images[kept] = _shown(frame, vibrance)[:height, :width]
        except FrameError as error:
            skipped.append(str(error))
            continue
        arrays.crowd[kept] = np.stack([label.crowd for label in labels])
        arrays.known[kept] = np.stack([label.known for label in labels])
        kept += 1
    doubts = [*recording.warnings, *(() if ground is None else ground.doubts)]
    read = _files_of(path, part.parent) + ([] if recording.terrain is None else [recording.terrain])
    return _described(path, part, kept, skipped, doubts, read, None)


def _of_several_sizes(path: Path, frames: Sequence[Frame]) -> str:
    drones: dict[str, set[str]] = {}
    for frame in frames:
        drones.setdefault(f"{frame.camera.width} x {frame.camera.height}", set()).add(frame.drone)
    of_each = "; ".join(f"{size} of {', '.join(sorted(some))}" for size, some in sorted(drones.items()))
    return (
        f"{path} holds frames of several sizes ({of_each}), and a mission to train on has those of one: make "
        "one mission for each size, `crowdfence convert ... --without DRONE` leaves the drones of others out"
    )


def _stored_pictures(path: Path, targets: int, vibrance: float, part: Path) -> Path:
    """Pictures of any sizes: each in the upper left corner, around which nothing is known. What somebody
    outlined stands for every target."""
    from crowdfence.errors import FrameError
    from crowdfence.labelled_pictures.picture_recording import open_labelled_pictures

    pictures = open_labelled_pictures(path)
    frames = pictures.recording.frames
    height = max(frame.camera.height for frame in frames) // STRIDE * STRIDE
    width = max(frame.camera.width for frame in frames) // STRIDE * STRIDE
    arrays = _Arrays.create(part, len(frames), targets, height, width)
    sizes: list[tuple[int, int]] = []
    kept, skipped = 0, []
    for frame in frames:
        try:
            image = _shown(frame, vibrance)[:height, :width]
            labels = picture_training_labels(pictures, frame)
            if min(image.shape[:2]) < STRIDE:
                raise FrameError(
                    frame.drone, frame.stamp_ns, f"picture is less than {STRIDE} pixels high or wide"
                )
        except FrameError as error:
            skipped.append(str(error))
            continue
        rows, columns = (
            min(side, whole) for side, whole in zip(labels.known.shape, arrays.known.shape[2:], strict=True)
        )
        arrays.images[kept, : image.shape[0], : image.shape[1]] = image
        arrays.crowd[kept, :, :rows, :columns] = labels.crowd[:rows, :columns]
        arrays.known[kept, :, :rows, :columns] = labels.known[:rows, :columns]
        sizes.append((rows * LABEL_STRIDE, columns * LABEL_STRIDE))
        kept += 1
    read = [path / frame.drone for frame in frames]
    return _described(path, part, kept, skipped, pictures.recording.warnings, read, sizes)


def _shown(frame: Frame, vibrance: float) -> NDArray[np.uint8]:
    """The picture of a frame as a model is shown it."""
    image = frame.image()
    return image if vibrance == 1.0 else vibrant(image, vibrance)


def _described(
    path: Path,
    part: Path,
    kept: int,
    skipped: list[str],
    doubts: Sequence[str],
    read: Sequence[Path],
    sizes: list[tuple[int, int]] | None,
) -> Path:
    if not kept:
        raise ValueError(f"no frame of {path} can be used; the first reason: {skipped[0]}")
    facts = {"name": path.stem, "frames": kept, "skipped": skipped, "doubts": list(doubts), "sizes": sizes}
    facts["read"] = {str(file.resolve()): _state(file) for file in read}
    with atomic_path(part.with_suffix(".json")) as whole:
        whole.write_text(json.dumps(facts))
    return part


def _is_current(part: Path) -> bool:
    """Whether a mission is here whole, and of its files as they are now."""
    try:
        read = json.loads(part.with_suffix(".json").read_text())["read"]
    except (OSError, ValueError):
        return False
    whole = all(_file(part, name).exists() for name in ("images", "crowd", "known"))
    return whole and all(_state(Path(file)) == state for file, state in read.items())


def _state(file: Path) -> list[int] | None:
    """Size and time of change; None for a file that is not there."""
    try:
        found = file.stat()
    except OSError:
        return None
    return [found.st_size, found.st_mtime_ns]


def _files_of(path: Path, store: Path) -> list[Path]:
    """The files of a recording, which may be a folder, without those that are stored into it."""
    if not path.is_dir():
        return [path]
    return sorted(file for file in path.rglob("*") if file.is_file() and store not in file.parents)


@dataclass(frozen=True, slots=True, eq=False)
class _Arrays:
    images: Any
    crowd: Any
    known: Any

    @classmethod
    def create(cls, part: Path, frames: int, targets: int, height: int, width: int) -> _Arrays:
        labels = (frames, targets, height // LABEL_STRIDE, width // LABEL_STRIDE)
        try:
            return cls(
                _created(_file(part, "images"), np.uint8, (frames, height, width, 3)),
                _created(_file(part, "crowd"), np.uint8, labels),
                _created(_file(part, "known"), np.bool_, labels),
            )
        except OSError:
            for name in ("images", "crowd", "known"):
                _file(part, name).unlink(missing_ok=True)
            raise


def _created(path: Path, dtype: DTypeLike, shape: tuple[int, ...]) -> Any:
    """A mapped array of zeros. OSError where the disk has no room for it: whoever finds that out by writing
    into it is killed."""
    array = np.lib.format.open_memmap(path, "w+", dtype, shape)
    with path.open("r+b") as file:
        size = os.fstat(file.fileno()).st_size
        try:
            os.posix_fallocate(file.fileno(), 0, size)
        except OSError as error:
            if error.errno in NO_ROOM:
                needs = f"{error.strerror} for {size / 1e6:.0f} MB; make room, or take another --store"
                raise OSError(error.errno, needs, str(path)) from error
    return array


def _mapped(part: Path, photographs: bool) -> StoredMission:
    facts = json.loads(part.with_suffix(".json").read_text())
    images, crowd, known = (
        np.load(_file(part, name), mmap_mode="r")[: facts["frames"]] for name in ("images", "crowd", "known")
    )
    skipped, doubts = tuple(facts["skipped"]), tuple(facts["doubts"])
    sizes = None if facts["sizes"] is None else np.array(facts["sizes"], np.int64)
    return StoredMission(facts["name"], images, crowd, known, skipped, photographs, doubts, sizes)


def _file(part: Path, name: str) -> Path:
    return part.with_name(f"{part.name}.{name}.npy")
