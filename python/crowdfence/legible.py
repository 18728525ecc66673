"""Names of others, as everybody can read them.

A character that nobody sees keeps two names apart that look alike; one that turns the text around it, or that
a terminal obeys, makes a line say what was never meant.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

_KINDS = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode categories: control, format (zero width, directions), lone surrogates, separators of lines."""
_FILLERS = "\u034f\u115f\u1160\u17b4\u17b5\u3164\uffa0"
"""Letters and marks that are drawn as nothing."""
_FORMULA = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""The last four are the same, as wide as a Chinese character: some programs take them for these."""


def unreadable(name: str) -> str | None:
    """The first character that nobody sees, or tells from a space, as U+200B."""
    return next((_told(c) for c in name if _is_unreadable(c) or (c.isspace() and c != " ")), None)


def legible(text: str) -> str:
    """On one line and without such characters."""
    return " ".join("".join(" " if c.isspace() else "" if _is_unreadable(c) else c for c in text).split())


def shown(text: str) -> str:
    """With such characters told by their number; lines stay."""
    return "".join(f"<{_told(c)}>" if _is_unreadable(c) and c not in "\n\t" else c for c in text)


def first_of(names: Sequence[str], most: int) -> str:
    """Names for a sentence: of many the first, and how many more there are."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def table_cell(text: str) -> str:
    """In a CSV file. Programs that calculate take what begins like a formula for one, and it may send what
    else the table holds to anybody: an apostrophe in front makes it text."""
    return f"'{text}" if text.startswith(_FORMULA) else text


def _is_unreadable(character: str) -> bool:
    return unicodedata.category(character) in _KINDS or character in _FILLERS


def _told(character: str) -> str:
    return f"U+{ord(character):04X}"
