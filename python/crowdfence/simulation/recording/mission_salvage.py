"""What an earlier, unfinished run left of a mission file."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.records import Metadata

from crowdfence._core import Camera
from crowdfence.simulation.recording.frame_summary import FrameSummary
from crowdfence.simulation.recording.manifest import first_difference
from crowdfence.sources.mission.layout import (
    MAGIC,
    METADATA_SIMULATION,
    FramePart,
    split_topic,
)
from crowdfence.sources.mission.mcap_records import McapFile, MessageLocation, StoredMessage
from crowdfence.sources.mission.messages import decode_people, decode_picture, decode_pose, decode_raster
from crowdfence.sources.mission.ros2_messages import header_stamp_ns
from crowdfence.sources.mission.topic_writer import part_path
from crowdfence.sources.pictures.decoding import decode_depth_cm


@dataclass(slots=True)
class SalvagedFile:
    """The frames of one mission file, whole or cut off."""

    mcap: McapFile
    manifest: dict[str, Any] | None = None
    frames: dict[tuple[str, int], dict[FramePart, MessageLocation]] = field(default_factory=dict)
    """Messages by topic prefix and stamp."""

    @staticmethod
    def read(path: Path) -> SalvagedFile:
        """ValueError when it is no MCAP file."""
        found = SalvagedFile(McapFile(path))
        for record in found.mcap.scan():
            if isinstance(record, StoredMessage):
                found._take(record)
            elif isinstance(record, Metadata) and record.name == METADATA_SIMULATION:
                found.manifest = json.loads(record.metadata.get("manifest", "null"))
        return found

    def _take(self, message: StoredMessage) -> None:
        place = split_topic(message.topic)
        if place is None or place[1] == "pose":
            return
        key = place[0], header_stamp_ns(bytes(message.data[:12]))
        self.frames.setdefault(key, {})[place[1]] = message.location


@dataclass(frozen=True, slots=True)
class Salvage:
    """Frames of earlier runs of the same mission, by topic prefix and stamp."""

    files: Sequence[SalvagedFile]
    parts: frozenset[FramePart]
    """A frame is whole when it has these."""

    def frame(self, prefix: str, stamp_ns: int) -> Mapping[FramePart, bytes] | None:
        """The messages of a frame as they were, None when it is not there as a whole."""
        for file in self.files:
            found = file.frames.get((prefix, stamp_ns), {})
            if found.keys() == self.parts:
                return {part: file.mcap.payload(location) for part, location in found.items()}
        return None


def salvage(path: Path, manifest: Mapping[str, Any], parts: frozenset[FramePart]) -> Salvage:
    """What `path` (ended by an interrupt) and its part (left by a kill) hold of the mission `manifest`.

    The partial file is kept under another name until `finished` is called, so that a second kill loses
    nothing. ValueError when a file is of another mission, and names the difference.
    """
    part, kept_path = part_path(path), _kept_path(path)
    if part.exists() and part.stat().st_size < len(MAGIC):
        part.unlink()  # killed before anything was written
    for file in (path, part, kept_path):
        if file.exists():
            _require_same_mission(SalvagedFile.read(file), manifest)
    if part.exists():
        if kept_path.exists() and _frame_count(kept_path) > _frame_count(part):
            part.unlink()
        else:
            os.replace(part, kept_path)
    return Salvage([SalvagedFile.read(file) for file in (kept_path, path) if file.exists()], parts)


def finished(path: Path) -> None:
    """The mission is complete: what was kept of earlier runs can go."""
    _kept_path(path).unlink(missing_ok=True)


def summary_of_parts(parts: Mapping[FramePart, bytes], camera: Camera, *, footprint: bool) -> FrameSummary:
    """Statistics of a frame from its messages."""
    return FrameSummary.of(
        decode_raster(parts["segmentation"]),
        decode_depth_cm(decode_picture(parts["depth_cm"])),
        decode_people(parts["people"]),
        camera,
        decode_pose(parts["true_pose"]).world_from_camera() if footprint else None,
    )


def _kept_path(path: Path) -> Path:
    return part_path(path).with_suffix(".earlier")


def _frame_count(path: Path) -> int:
    return len(SalvagedFile.read(path).frames)


def _require_same_mission(file: SalvagedFile, manifest: Mapping[str, Any]) -> None:
    if file.manifest is None and not file.frames:
        return  # killed before the manifest was written
    difference = first_difference(dict(manifest), file.manifest or {})
    if difference is not None:
        raise ValueError(
            f"{file.mcap.path} is of another mission and cannot be resumed: {difference}. "
            "Give the same options as before, or replace it with --force"
        )
