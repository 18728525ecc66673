"""Where an OctoMap of ours lies: a comment line in the file, which every OctoMap reader skips.

An OctoMap's grid always starts at zero, so the origin of the terrain's grid and the anchor of the local frame
stand in the comment `# crowdfence {"origin_m": [x, y, z], "anchor_wgs84": [lat, lon, height], ...}`.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple

from crowdfence._core import Terrain
from crowdfence.georeference import Georeference

_MARK = b"# crowdfence "
LONGEST_HEADER = 1 << 16
"""Bytes of a file that are searched for the comment; it stands on the second line."""


class OctomapFrame(NamedTuple):
    """From tree coordinates to the world."""

    origin_m: tuple[float, float, float]
    """Added to tree coordinates gives local ENU metres."""
    georeference: Georeference | None


def described(terrain: Terrain) -> dict[str, Any]:
    """The frame of a terrain, as the comment holds it."""
    frame: dict[str, Any] = {"frame": "tree + origin_m = local east-north-up metres"}
    frame["origin_m"] = list(terrain.origin)
    if terrain.georeference is not None:
        anchor = terrain.georeference
        frame["anchor_wgs84"] = [anchor.latitude_deg, anchor.longitude_deg, anchor.height_m]
    return frame


def annotated(data: bytes, content: dict[str, Any]) -> bytes:
    """The file with the comment after its first line."""
    rest = data.index(b"\n") + 1
    # ASCII JSON has no line breaks, whatever the mission is called. A view, because a map has many bytes.
    return b"".join([data[:rest], _MARK, json.dumps(content).encode("ascii"), b"\n", memoryview(data)[rest:]])


def read_frame(data: bytes) -> OctomapFrame | None:
    """The frame in the comment of a file; None where there is no comment. ValueError when it is broken."""
    for line in data[:LONGEST_HEADER].split(b"\n"):
        if line.startswith(_MARK):
            return _parsed(line.removeprefix(_MARK))
        if line.strip() == b"data":
            break
    return None


def _parsed(text: bytes) -> OctomapFrame:
    try:
        content = json.loads(text)
        x, y, z = (float(value) for value in content["origin_m"])
        anchor = content.get("anchor_wgs84")
        return OctomapFrame((x, y, z), None if anchor is None else Georeference(*map(float, anchor)))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"the crowdfence comment in the header cannot be read: {error}") from error
