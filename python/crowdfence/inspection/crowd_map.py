"""What a saved crowd map holds."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crowdfence._core import CrowdMap, Paper, Terrain
from crowdfence.inspection.terrain import read_map_file
from crowdfence.iso_time import iso_utc
from crowdfence.voxel_state import VoxelState

if TYPE_CHECKING:
    from crowdfence.inspection.options import InspectionOptions

MAGIC = b"CROWDMAP"
# Magic, version u32, payload length u64, then of the payload: terrain fingerprint u64, voxel count u64.
_HEAD = struct.Struct("<8sIQQQ")


@dataclass(frozen=True, slots=True)
class CrowdMapContent:
    """State at the last instant, with the method's own threshold."""

    method: str
    fleet_size: int | None
    """None for a method that takes any number of drones."""
    drones: tuple[str, ...]
    """Every drone that ever gave a view."""
    instants: int
    first_instant: str | None
    """ISO 8601 UTC; None before the first instant."""
    last_instant: str | None
    duration_s: float
    threshold: float
    states: dict[str, int]
    """State -> voxels."""
    highest_probability: float | None
    """Over the voxels that were seen, None when none was."""


@dataclass(frozen=True, slots=True)
class CrowdMapReport:
    """The head of the file and, with the terrain that it was made on, what it holds."""

    path: str
    bytes: int
    version: int
    terrain_fingerprint: str
    """Of the terrain that it was made on, 16 hexadecimal digits."""
    terrain_voxels: int
    content: CrowdMapContent | None
    """None when no terrain was given: the voxels mean nothing without it."""


def inspect_crowd_map(
    path: Path, terrain_path: Path | None, options: InspectionOptions, tell: Callable[[str], None]
) -> CrowdMapReport:
    """ValueError for a damaged file and for another terrain than its own."""
    with path.open("rb") as file:
        head = file.read(_HEAD.size)
    if len(head) < _HEAD.size or not head.startswith(MAGIC):
        raise ValueError(f"{path} is not a crowd map: it does not begin with {MAGIC.decode()} and its header")
    _, version, _, fingerprint, voxels = _HEAD.unpack(head)
    content = None
    if terrain_path is not None:
        tell(f"reading {terrain_path.name}")
        terrain = read_map_file(terrain_path, options).terrain
        tell(f"reading {path.name}")
        content = _content(_load(path, terrain, terrain_path))
    return CrowdMapReport(
        path=str(path),
        bytes=path.stat().st_size,
        version=version,
        terrain_fingerprint=f"{fingerprint:016x}",
        terrain_voxels=voxels,
        content=content,
    )


def _load(path: Path, terrain: Terrain, terrain_path: Path) -> CrowdMap:
    try:
        return CrowdMap.load(path, terrain)
    except ValueError as error:
        raise ValueError(f"{path} with {terrain_path}: {error}") from error


def _content(crowd_map: CrowdMap) -> CrowdMapContent:
    method = crowd_map.method
    span_ns = crowd_map.span_ns
    first_ns, last_ns = (0, 0) if span_ns is None else span_ns
    states = np.bincount(crowd_map.state(last_ns), minlength=len(VoxelState))
    seen_ids = crowd_map.seen_ids()
    return CrowdMapContent(
        method=repr(method),
        fleet_size=method.fleet_size if isinstance(method, Paper) else None,
        drones=tuple(crowd_map.drones),
        instants=crowd_map.instant_count,
        first_instant=None if span_ns is None else iso_utc(first_ns),
        last_instant=None if span_ns is None else iso_utc(last_ns),
        duration_s=(last_ns - first_ns) / 1e9,
        threshold=crowd_map.default_threshold(),
        states={state.name.lower(): int(states[state]) for state in VoxelState},
        highest_probability=float(crowd_map.probability(last_ns, seen_ids).max()) if seen_ids.size else None,
    )
