"""Tables of numbers as text: read by column name, one bad row costs that row only."""

from collections.abc import Iterator, Sequence
from pathlib import Path

MAX_LINE_CHARACTERS = 1 << 20
"""A longer line is cut here, and then does not fit its header."""


def read_rows(
    path: Path, required: Sequence[str], delimiter: str = ","
) -> Iterator[tuple[int, dict[str, str] | str]]:
    """(line number, row by column name) of every line after the header; a line that does not fit the header
    comes as a text that says so. Cells may be in double quotes but not hold the delimiter.

    ValueError when the file is empty, a required column is missing or there twice, or the header is separated
    by something else.
    """
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        header = _cells(file.readline(MAX_LINE_CHARACTERS), delimiter)
        if header == [""]:
            raise ValueError(f"{path} is empty: expected a header with {', '.join(required)}")
        missing = [name for name in required if name not in header]
        if missing:
            raise ValueError(
                f"{path} has no column {missing[0]!r}; its header holds {', '.join(header)[:400]}"
                f"{_other_form(header, delimiter)}"
            )
        if twice := [name for name in required if header.count(name) > 1]:
            raise ValueError(f"{path} has {header.count(twice[0])} columns {twice[0]!r}; name one of them so")
        lines = iter(lambda: file.readline(MAX_LINE_CHARACTERS), "")
        for number, line in enumerate(lines, start=2):
            cells = _cells(line, delimiter)
            if len(cells) == len(header):
                yield number, dict(zip(header, cells, strict=True))
            elif cells != [""]:
                yield number, f"line {number} has {len(cells)} columns, the header has {len(header)}"


def _other_form(header: list[str], delimiter: str) -> str:
    """What to do about a header that looks written in another form of table; "" where it does not."""
    text = delimiter.join(header)
    if "\x00" in text or "\ufffd" in text:
        return ". Save it as UTF-8"
    names = {"\t": "tabs", ";": "semicolons", ",": "commas"}
    for other, name in names.items():
        if other != delimiter and other in text:
            wanted = names.get(delimiter, repr(delimiter))
            return f". Save it with {wanted} instead of {name}, and numbers with decimal points"
    return ""


def integer(row: dict[str, str], column: str) -> int:
    """A whole number of at most 20 digits. ValueError names the column."""
    text = row[column]
    if not (text.isascii() and text.isdecimal() and len(text) <= 20):
        raise ValueError(f"{column} is {text[:40]!r}, expected a whole number")
    return int(text)


def numbers(row: dict[str, str], columns: Sequence[str]) -> list[float]:
    """The values of several columns. ValueError names the first that is no number."""
    values = []
    for column in columns:
        try:
            values.append(float(row[column]))
        except ValueError:
            raise ValueError(f"{column} is {row[column][:40]!r}, expected a number") from None
    return values


def _cells(line: str, delimiter: str) -> list[str]:
    return [cell.strip().strip('"') for cell in line.rstrip("\r\n").split(delimiter)]
