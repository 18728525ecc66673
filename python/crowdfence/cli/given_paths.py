"""What can be said of the words of a command before anything is done."""

from __future__ import annotations

import os
import stat
from collections.abc import Sequence


def check_words(words: Sequence[str]) -> None:
    """ValueError for a word that is no UTF-8, which the files that a command writes could not name, for a
    pipe, which cannot be read twice and may never end, and for "-", which would be a file of that name."""
    for word in words:
        if word == "-":
            raise ValueError("- stands for no file here: name one; --json prints what a command found")
        try:
            word.encode()
        except UnicodeEncodeError:
            raise ValueError(f"{os.fsencode(word)!r} is no UTF-8; rename the file or folder") from None
        path = word.partition("=")[2] if word.startswith("--") else word
        if path and _is_pipe(path):
            raise ValueError(f"{path} is a pipe; save what it gives in a file, and name that")


def _is_pipe(path: str) -> bool:
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)
