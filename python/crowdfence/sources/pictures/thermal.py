"""Pictures of warmth, which drones with several cameras save beside those of colours, of one shot.

A detector that was trained on colours sees nobody in them, and calls the ground empty.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

THERMAL = "a thermal camera's, and detectors that were trained on colours see nobody in it"

_NAMED = re.compile(r"DJI_(?:\d{14}_)?\d{3,5}_T(?:_|$)", re.IGNORECASE)
"""DJI tells the lenses of a shot apart by a letter: W wide, Z zoom, V visible, T thermal."""
_FLIR = re.compile(rb"\xff\xe1..FLIR\x00", re.DOTALL)
"""The segment of a JPEG in which FLIR's cameras keep temperatures."""


def is_named_thermal(stem: str) -> bool:
    """By the name of a file of DJI's."""
    return _NAMED.match(stem) is not None


def is_thermal(stem: str, xmp: Mapping[str, str], head: bytes) -> bool:
    """By what a photograph says of itself, or its name; `head`: its first bytes."""
    source = xmp.get("drone-dji:ImageSource", "").lower()  # WideCamera, ZoomCamera, InfraredCamera
    if source:
        return "infrared" in source or "thermal" in source
    return (
        "LWIR" in xmp.get("Camera:BandName", "").upper() or bool(_FLIR.search(head)) or is_named_thermal(stem)
    )
