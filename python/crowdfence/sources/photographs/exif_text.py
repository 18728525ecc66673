"""Texts of EXIF, which some cameras fill up with zeros or blanks."""

from __future__ import annotations

from typing import Any


def exif_text(value: Any) -> str:
    """Empty where it is no text, or missing."""
    return value.replace("\0", "").strip() if isinstance(value, str) else ""
