"""Write a folder completely or not at all: it is made beside its place and moved there when it is whole.

Whatever ends the writing early (an error, a full disk, a kill) leaves what stood there before, and a reader
sees the old folder or the new one, never a mixture.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import shutil
import tempfile
from collections.abc import Container, Iterator
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path

from crowdfence.atomic_file import NO_ROOM, lock_for_writing, require_replaceable, writable_folder

_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
"""Of Linux's renameat2(2): two names change places in one step."""


@contextmanager
def replaceable_folder(
    folder: str | PathLike[str], *, contents: Container[str], force: bool
) -> Iterator[None]:
    """Prove before the block, which ends in `whole_folder`, that the folder can be written there.

    contents  names of the files that such a folder holds
    force     whether a folder that holds such files may be replaced; one that holds anything else never is

    A block of data is written beside the place and removed. Folders made here that are still empty after the
    block are removed again. FileExistsError for a folder that may not be replaced, OSError that names the
    place otherwise.
    """
    target = _resolved(folder)
    _require_replaceable(target, contents, force)
    with writable_folder(target.parent, parents=True):
        yield


@contextmanager
def whole_folder(
    folder: str | PathLike[str], *, contents: Container[str], force: bool = False
) -> Iterator[Path]:
    """Yield an empty folder to write into; it takes the place of `folder` when the block succeeds, else it is
    removed. Folders that killed processes left beside it are removed too. Errors as for
    `replaceable_folder`."""
    target = _resolved(folder)
    with replaceable_folder(target, contents=contents, force=force):
        _remove_abandoned(target)
        beside = Path(tempfile.mkdtemp(prefix=_prefix(target), dir=target.parent))
        mask = os.umask(0)
        os.umask(mask)
        beside.chmod(0o777 & ~mask)  # mkdtemp folders are private
        try:
            with _held(beside):
                yield beside
                _flush_to_disk(beside)
                _require_replaceable(target, contents, force)  # another run may have finished meanwhile
                _take_place(beside, target)
        except OSError as error:
            raise _of_target(error, beside, target) from error
        finally:
            # Here lies what was written in vain, or what the new folder replaced.
            shutil.rmtree(beside, ignore_errors=True)


@contextmanager
def written_alone(folder: Path) -> Iterator[None]:
    """For a folder that is filled where it stands: FileExistsError while another process or thread does so;
    the lock ends with the process."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        lock_for_writing(handle, folder)
        yield
    finally:
        os.close(handle)


def _resolved(folder: str | PathLike[str]) -> Path:
    return Path(folder).resolve()  # a link stays a link: what it points to is replaced


def _require_replaceable(target: Path, contents: Container[str], force: bool) -> None:
    if not target.exists():
        return
    if not target.is_dir():
        raise NotADirectoryError(f"cannot write into {target}: it is a file, not a folder")
    if _is_where_we_are(target):
        raise OSError(
            f"cannot replace {target}: you are in it, and would be left in a folder that is gone; name a "
            "folder inside it, or go elsewhere first"
        )
    if os.path.ismount(target):
        raise OSError(f"cannot replace {target}: a disk is mounted there; name a folder inside it")
    found = sorted(os.listdir(target))
    foreign = [name for name in found if name not in contents]
    if foreign:
        raise FileExistsError(
            f"{target} holds {foreign[0]}, which is no result and would be lost; choose another folder"
        )
    if found:
        require_replaceable(target, force=force)


def _is_where_we_are(target: Path) -> bool:
    """Another folder takes the place of the target: a shell that stands in it would show an empty one."""
    try:
        return target.samefile(os.curdir)
    except OSError:  # what we are in is gone already
        return False


def _prefix(target: Path) -> str:
    return f".{target.name}.crowdfence-"


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Locked, so that nobody takes it for abandoned; the lock ends with the process."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _remove_abandoned(target: Path) -> None:
    for folder in target.parent.glob(f"{_prefix(target)}*"):
        with suppress(OSError):  # somebody writes into it, or it is not ours
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)
            finally:
                os.close(handle)


def _flush_to_disk(folder: Path) -> None:
    """Without this a power cut after the move could leave empty files under the final name."""
    for path in (*folder.iterdir(), folder):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _take_place(beside: Path, target: Path) -> None:
    """After this `beside` is gone or holds what `target` held."""
    try:
        os.rename(beside, target)  # where there is nothing, or an empty folder
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
        _exchange(beside, target)


def _exchange(beside: Path, target: Path) -> None:
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    paths = (os.fsencode(beside), os.fsencode(target))
    if rename is not None and rename(_AT_FDCWD, paths[0], _AT_FDCWD, paths[1], _RENAME_EXCHANGE) == 0:
        return
    # A file system without it (NFS): two steps. A kill between them leaves the old folder beside its place.
    old = beside.with_name(f"{beside.name}-replaced")
    os.rename(target, old)
    os.rename(beside, target)
    os.rename(old, beside)


def _of_target(error: OSError, beside: Path, target: Path) -> OSError:
    """The same error, telling the user's folder and not the one beside it."""
    if error.errno is None:
        return type(error)(str(error).replace(str(beside), str(target)))
    # Of a file that found no room, the message names its place beside the folder.
    why = os.strerror(error.errno) if error.errno in NO_ROOM else error.strerror
    return OSError(error.errno, f"cannot write {target}: {why}; nothing there was changed")
