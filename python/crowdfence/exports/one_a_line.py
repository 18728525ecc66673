"""JSON with one zone a line: readable in an editor, and small in a difference between two files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any


def one_a_line(head: dict[str, Any], name: str, items: Sequence[Any]) -> str:
    """`head` with `items` under a name behind it. Without an indent Python encodes in C: with one, a national
    file of zones took most of a minute, and every coordinate a line."""
    lines = ",\n".join(_json(item) for item in items)
    before = f"{_json(head)[:-1]}, " if head else "{"
    return f'{before}"{name}": [\n{lines}\n]}}\n'


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
