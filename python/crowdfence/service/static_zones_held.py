"""The zones of others at the end of a line over which they come once."""

from __future__ import annotations

from typing import Any

Told = dict[str, Any]
"""The zones of a moment, as `ZoneSetJson` makes them."""


class StaticZonesHeld:
    """Those of the last answer that had them."""

    def __init__(self) -> None:
        self._version: str | None = None
        self._zones: list[Told] = []

    def whole(self, told: Told) -> Told | None:
        """The same with the zones of others; None where they are left out and others than those held."""
        if not told.get("static_left_out"):  # builds of before leave out none
            self._version = told.get("static_version")
            self._zones = [zone for zone in told["zones"] if zone["kind"] == "static"]
            return told
        if told["static_version"] != self._version:
            return None
        return {**told, "static_left_out": False, "zones": [*told["zones"], *self._zones]}
