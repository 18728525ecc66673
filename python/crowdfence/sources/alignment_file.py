"""Pose offsets as a file: what `crowdfence align` found, for every command that opens the recording."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

from crowdfence.atomic_file import write_bytes
from crowdfence.sources.pose_offset import PoseOffset

KIND = "crowdfence alignment"
_NUMBERS = ("pitch_deg", "yaw_deg", "roll_deg", "time_s")
_MOST = {"pitch_deg": 180.0, "yaw_deg": 180.0, "roll_deg": 180.0, "time_s": 86_400.0, "position_m": 1000.0}
"""Beyond that nothing is an offset of poses that are roughly right, but another unit or a slip."""


def write_alignment(
    path: str | PathLike[str], offsets: Mapping[str, PoseOffset], found: Mapping[str, Any] | None = None
) -> None:
    """JSON with the offsets of each drone, and beside them what is to be told of how they were found.

    OSError when it cannot be written."""
    drones = {drone: asdict(offset) for drone, offset in offsets.items()}
    content = {"kind": KIND, "drones": drones, "found": dict(found or {})}
    write_bytes(path, (json.dumps(content, indent=2) + "\n").encode())


def read_alignment(path: str | PathLike[str]) -> dict[str, PoseOffset]:
    """The offsets of each drone. OSError when it cannot be read, ValueError that names what is wrong."""
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is no alignment: {error}") from error
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise ValueError(f"{path} is no alignment; `crowdfence align` writes one")
    drones = content.get("drones")
    if not isinstance(drones, dict):
        raise ValueError(f"{path}: drones must be names with their offsets")
    return {str(drone): _offset(path, drone, values) for drone, values in drones.items()}


def _offset(path: str | PathLike[str], drone: str, values: Any) -> PoseOffset:
    known = {*_NUMBERS, "position_m"}
    if not isinstance(values, dict) or not set(values) <= known:
        raise ValueError(
            f"{path}: {drone} must have {', '.join(sorted(known))} and nothing else, got {values}"
        )
    position = values.get("position_m", [0.0, 0.0, 0.0])
    numbers = [values.get(name, 0.0) for name in _NUMBERS]
    if not isinstance(position, list) or len(position) != 3:
        raise ValueError(
            f"{path}: position_m of {drone} must be east, north and up in metres, got {position}"
        )
    for name, number in zip((*_NUMBERS, *["position_m"] * 3), (*numbers, *position), strict=True):
        if isinstance(number, bool) or not isinstance(number, (int, float)):
            raise ValueError(f"{path}: {drone} has {number!r} where a number is needed")
        if abs(number) > _MOST[name]:
            raise ValueError(f"{path}: {name} of {drone} is {str(number)[:20]}, beyond {_MOST[name]:g}")
    pitch, yaw, roll, time_s = map(float, numbers)
    east, north, up = map(float, position)
    return PoseOffset(pitch, yaw, roll, time_s, (east, north, up))
