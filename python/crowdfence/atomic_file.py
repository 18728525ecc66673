"""Write a file completely or not at all."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path


@contextmanager
def atomic_path(path: str | PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it replaces `path` when the block succeeds, else it is removed.

    A reader therefore sees the old file or the new one, never half of one. The output folder itself is
    created when its parent exists; deeper folders are not, so that a mistyped path is noticed.

    Raises OSError that names the path when the folder is missing or cannot be written.
    """
    target = Path(path)
    if target.is_dir():
        raise IsADirectoryError(f"{target} is a folder; name the file to write inside it")
    _make_output_folder(target)
    temporary = _reserve_beside(target)
    try:
        yield temporary
        _flush_to_disk(temporary)
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_bytes(path: str | PathLike[str], data: bytes) -> None:
    """Write `data` to `path` atomically; see `atomic_path` for the errors."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


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
