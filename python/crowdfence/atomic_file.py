"""Write a file completely or not at all, and know before long work that it can be written."""

import errno
import fcntl
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path

_PROOF_BYTES = 4096
"""One block of common file systems, so that a full disk is noticed."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Of these only writing can fail."""


@contextmanager
def atomic_path(path: str | PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it replaces `path` when the block succeeds, else it is removed.

    A reader therefore sees the old file or the new one, never half of one. A link stays a link: what it leads
    to is replaced. The output folder itself is created when its parent exists; deeper folders are not, so
    that a mistyped path is noticed.

    Raises OSError that names the path when the folder is missing or cannot be written, and for what is there
    and is no file.
    """
    target = file_at(path)
    _make_output_folder(target)
    temporary = _reserve_beside(target)
    try:
        yield temporary
        _flush_to_disk(temporary)
        os.replace(temporary, target)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno in NO_ROOM:  # a write does not say which file it was
            what = f"cannot write {target}: {os.strerror(error.errno)}; nothing there was changed"
            raise OSError(error.errno, what) from error
        raise


def write_bytes(path: str | PathLike[str], data: bytes) -> None:
    """Write `data` to `path` atomically; see `atomic_path` for the errors."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


@contextmanager
def writable_folder(folder: str | PathLike[str], *, parents: bool = False) -> Iterator[None]:
    """Prove before the block, which makes files for `folder`, that they can be written there.

    The folder is made when it is missing; its parents only with `parents`, so that a mistyped path is
    noticed. A block of data is written into it and removed. Folders made here that are still empty after the
    block are removed again: a command that fails leaves none behind.

    Raises OSError that names the folder.
    """
    place = Path(folder)
    made: list[Path] = []
    try:
        _make_folders(place, made, parents=parents)
        _write_proof(place)
        yield
    finally:
        _remove_empty(made)


@contextmanager
def replaceable_file(
    path: str | PathLike[str], *, force: bool, reads: Iterable[str | PathLike[str] | None] = ()
) -> Iterator[None]:
    """The same for one file, which is none of those that the block `reads`, and is there already only with
    `force`."""
    target = file_at(path)
    for read in reads:
        if read is not None and target.exists() and Path(read).exists() and target.samefile(read):
            raise FileExistsError(f"{path} is read for this, and would be lost; name another file to write")
    require_replaceable(target, force=force)
    with writable_folder(target.parent):
        yield


def require_replaceable(path: Path, *, force: bool) -> None:
    """FileExistsError for what is there, unless somebody said that it may be replaced."""
    if os.path.lexists(path) and not force:
        raise FileExistsError(f"{path} exists; --force replaces it")


def lock_for_writing(handle: int, path: Path) -> None:
    """For one writer alone, until `handle`, of a file or folder, is closed or its process ends.

    FileExistsError that names `path` while another process or thread has it."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        kind = "folder" if path.is_dir() else "file"
        raise FileExistsError(
            f"{path} is being written by another command; wait until that has ended, or name another {kind}"
        ) from None
    except OSError:
        pass  # a disk of another machine that cannot lock


def file_at(path: str | PathLike[str]) -> Path:
    """Where a link leads, as for whoever opens it. OSError for what is there and gives way to no file: a
    folder, a device, a pipe."""
    try:
        target = Path(path).resolve() if Path(path).is_symlink() else Path(path)
    except RuntimeError:  # of a ring of links, before Python 3.13
        target = Path(path)
    if target.is_symlink():
        raise OSError(errno.ELOOP, f"{path} is a link that leads to itself; name a file")
    if target.is_dir():
        raise IsADirectoryError(f"{path} is a folder; name the file to write inside it")
    if target.exists() and not target.is_file():
        raise OSError(
            errno.EINVAL, f"{path} is a device or a pipe, which no file may take the place of; name a file"
        )
    return target


def _make_folders(folder: Path, made: list[Path], *, parents: bool) -> None:
    """Make a folder; `made` receives what was missing, the outermost first."""
    try:
        missing = [place for place in (folder, *folder.parents) if not place.exists()]
        if len(missing) > 1 and not parents:
            raise FileNotFoundError(
                f"cannot write into {folder}: {folder.parent} does not exist; create it or choose another "
                "folder"
            )
        for place in reversed(missing):
            place.mkdir()
            made.append(place)
    except OSError as error:
        if error.strerror is None:
            raise
        raise OSError(error.errno, f"cannot make the output folder {folder}: {error.strerror}") from error
    if not folder.is_dir():
        raise NotADirectoryError(f"cannot write into {folder}: it is a file, not a folder")


def _write_proof(folder: Path) -> None:
    try:
        with tempfile.NamedTemporaryFile(prefix=".crowdfence-", dir=folder, buffering=0) as file:
            file.write(bytes(_PROOF_BYTES))
            os.fsync(file.fileno())
    except OSError as error:
        raise OSError(
            error.errno,
            f"cannot write into {folder}: {error.strerror}; check the permissions and the free space",
        ) from error


def _remove_empty(made: list[Path]) -> None:
    with suppress(OSError):  # the first that holds something keeps those around it
        for place in reversed(made):
            place.rmdir()


def _make_output_folder(target: Path) -> None:
    folder = target.parent
    try:
        folder.mkdir(exist_ok=True)
    except FileNotFoundError:
        raise FileNotFoundError(
            f"cannot write {target}: {folder.parent} does not exist; create it or choose another folder"
        ) from None
    except FileExistsError:
        raise NotADirectoryError(f"cannot write {target}: {folder} is a file, not a folder") from None
    except OSError as error:
        raise OSError(error.errno, f"cannot create the output folder {folder}: {error.strerror}") from error


def _reserve_beside(target: Path) -> Path:
    # The suffix stays last because some libraries choose the format by it.
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent)
    except OSError as error:
        raise OSError(
            error.errno, f"cannot write {target}: {error.strerror}; check the permissions and the free space"
        ) from error
    os.close(handle)
    temporary = Path(name)
    # mkstemp files are private (0600); a result file gets the permissions that open() would have given it.
    mask = os.umask(0)
    os.umask(mask)
    temporary.chmod(0o666 & ~mask)
    return temporary


def _flush_to_disk(temporary: Path) -> None:
    """Without this a power cut after the rename could leave an empty file under the final name."""
    with open(temporary, "rb") as file:
        os.fsync(file.fileno())
