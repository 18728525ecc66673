"""One object of a JSON document, read key by key; errors name the key, its value and what is allowed.

null is the same as a key left out.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from crowdfence.errors import DetectorError, quoted

_REQUIRED: Any = object()


class JsonSection:
    """Typed access to one JSON object. `done()` refuses the keys that nobody asked for."""

    def __init__(self, value: object, path: str = "") -> None:
        if not isinstance(value, Mapping):
            raise DetectorError(f"{path or 'the contract'} must be a JSON object, got {quoted(value)}")
        self._value = value
        self._path = path
        self._known: set[str] = set()

    def key(self, name: str) -> str:
        return f"{self._path}.{name}" if self._path else name

    def refuse(self, name: str, allowed: str) -> DetectorError:
        return DetectorError(f"{self.key(name)} is {quoted(self._value.get(name))}; allowed: {allowed}")

    def section(self, name: str) -> JsonSection | None:
        """The object under `name`; None when it is null or absent."""
        value = self._get(name, None)
        return None if value is None else JsonSection(value, self.key(name))

    def text(self, name: str, default: str | None = _REQUIRED) -> Any:
        value = self._get(name, default)
        if value is default:
            return default
        if not isinstance(value, str) or not value:
            raise self.refuse(name, "text that is not empty")
        return value

    def choice(self, name: str, allowed: Sequence[str], default: Any = _REQUIRED) -> Any:
        value = self._get(name, default)
        if value is default:
            return default
        if value not in allowed:
            raise self.refuse(name, ", ".join(allowed))
        return value

    def integer(self, name: str, low: int, high: int, default: Any = _REQUIRED) -> Any:
        value = self._get(name, default)
        if value is default:
            return default
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.refuse(name, f"a whole number from {low} to {high}")
        return value

    def number(
        self, name: str, low: float = -math.inf, default: Any = _REQUIRED, *, above: bool = False
    ) -> Any:
        """A finite number >= low, or > low with `above`."""
        value = self._get(name, default)
        if value is default:
            return default
        if not is_number(value) or value < low or (above and value == low):
            bound = "" if low == -math.inf else f" {'above' if above else 'of at least'} {low:g}"
            raise self.refuse(name, f"a finite number{bound}")
        return float(value)

    def numbers(self, name: str, count: int, default: tuple[float, ...]) -> tuple[float, ...]:
        value = self._get(name, list(default))
        if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != count:
            raise self.refuse(name, f"a list of {count} numbers")
        if not all(is_number(item) for item in value):
            raise self.refuse(name, f"a list of {count} finite numbers")
        return tuple(float(item) for item in value)

    def span(self, name: str) -> tuple[float, float] | None:
        """[low, high] with 0 <= low <= high, or None."""
        if self._get(name, None) is None:
            return None
        low, high = self.numbers(name, 2, ())
        if not 0.0 <= low <= high:
            raise self.refuse(name, "[low, high] with 0 <= low <= high")
        return low, high

    def free(self, name: str) -> dict[str, Any] | None:
        """Any JSON object, or None. NaN and infinity are no JSON, though Python reads and writes them."""
        value = self._get(name, None)
        if value is not None and not isinstance(value, Mapping):
            raise self.refuse(name, "a JSON object or null")
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError, RecursionError) as error:
            raise DetectorError(
                f"{self.key(name)} is no JSON ({error}); allowed: what JSON has, text and finite numbers, "
                "not NaN and infinity"
            ) from None
        return None if value is None else dict(value)

    def raw(self, name: str) -> Any:
        return self._get(name, None)

    def done(self) -> None:
        unknown = [name for name in self._value if name not in self._known]
        if unknown:
            raise DetectorError(
                f"{self.key(quoted(unknown[0]))} is not a key of the contract; "
                f"allowed{f' in {self._path}' if self._path else ''}: {', '.join(sorted(self._known))}"
            )

    def _get(self, name: str, default: Any) -> Any:
        self._known.add(name)
        value = self._value.get(name)
        if value is not None:
            return value
        if default is _REQUIRED:
            raise DetectorError(f"{self.key(name)} is missing")
        return default


def is_number(value: object) -> bool:
    """Whether it is one, and finite as a float: whole numbers of JSON have no end."""
    return (
        isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
    )
