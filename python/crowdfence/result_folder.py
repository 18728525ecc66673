"""The folder that a run wrote, read again for what is made from it afterwards."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime, timezone
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowdfence._core import CrowdMap
from crowdfence.errors import quoted
from crowdfence.exports.map_description import MapDescription
from crowdfence.exports.state_raster import StateRaster, read_states
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.zones.history import ZoneHistory

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

HISTORY = "zone_history.jsonl"
SUMMARY = "summary.json"
CROWD_MAP = "crowd_map.tif"
READ_AGAIN = (HISTORY, CROWD_MAP, "terrain.bt", "crowd_map.crowdmap")
"""What is made from a run afterwards is made from these."""
MARGIN_M = 60.0
STALE_AFTER_S = 30.0
"""Of a run that does not say it."""
_LATEST_NS = 2**63 - 1


def files_read_of(run: str | PathLike[str]) -> list[Path]:
    """Of the run in a folder, or its history file alone."""
    path = Path(run)
    return [path / name for name in READ_AGAIN] if path.is_dir() else [path]


@contextmanager
def read_as_one(run: str | PathLike[str]) -> Iterator[None]:
    """OSError where a run has replaced the folder during the block: what that read is of two runs, and the
    zones of one may lie on the ground of the other."""
    before = _standing(run)
    try:
        yield
    finally:
        if _standing(run) != before:
            raise OSError(f"{run} was replaced by another run while it was read; give the command again")


def _standing(run: str | PathLike[str]) -> tuple[int, int] | None:
    """Which folder stands there; None for a history file alone."""
    if not Path(run).is_dir():
        return None
    found = Path(run).stat()
    return found.st_dev, found.st_ino


def open_history(run: str | PathLike[str]) -> ZoneHistory:
    """The zones of the run in a folder, or of a history file. FileNotFoundError, ZoneHistoryError."""
    path = Path(run)
    if path.is_dir():
        path = path / HISTORY
        if not path.exists():
            raise FileNotFoundError(f"{run} holds no {HISTORY}; {_why_no_history(path.parent)}")
    return ZoneHistory.read(path)


def _why_no_history(run: Path) -> str:
    try:
        layer = json.loads((run / SUMMARY).read_bytes())["layer"]
    except (OSError, ValueError, RecursionError, KeyError, TypeError):
        return "is it a folder that crowdfence run wrote?"
    return (
        f"it is of a run with --layer {quoted(layer)}, of which no zones are made: what that found is in the "
        "files beside, and zones are those of a run without --layer"
    )


def known_ground_of(run: str | PathLike[str], history: ZoneHistory) -> Polygon | MultiPolygon | None:
    """What the rim of the run's map encloses: from its history, or from its terrain where it was written
    before histories said it; None where neither says."""
    from crowdfence.maps import open_terrain
    from crowdfence.zones.known_ground import known_ground

    terrain = Path(run) / "terrain.bt"
    if history.ground is None and terrain.exists():
        return known_ground(open_terrain(terrain))
    return history.ground


def ground_height_of(run: str | PathLike[str]) -> float:
    """Local height half way up the ground of the run's map; 0, that of the anchor, where it wrote none."""
    from crowdfence.maps import open_terrain

    terrain = Path(run) / "terrain.bt"
    return float(open_terrain(terrain).bounds[:, 2].mean()) if terrain.exists() else 0.0


def open_grid(
    run: str | PathLike[str], history: ZoneHistory, stamp_ns: int | None = None
) -> SurfaceGrid | None:
    """The map of the run in a folder at its last instant, or at a later stamp, seen from above; None where
    the run did not write its map and terrain. MapFileError for files that do not belong together."""
    crowd_map = _open_map(run)
    return None if crowd_map is None else _grid(crowd_map, history, stamp_ns)


def _open_map(run: str | PathLike[str]) -> CrowdMap | None:
    from crowdfence.maps import open_terrain

    terrain, state = Path(run) / "terrain.bt", Path(run) / "crowd_map.crowdmap"
    if not (terrain.exists() and state.exists()):
        return None
    return CrowdMap.load(state, open_terrain(terrain))


def _grid(crowd_map: CrowdMap, history: ZoneHistory, stamp_ns: int | None) -> SurfaceGrid:
    return SurfaceGrid.from_crowd_map(
        crowd_map,
        history.stamps_ns[-1] if stamp_ns is None else stamp_ns,
        threshold=history.sets[-1].threshold,
        stale_after_s=float(history.description.get("stale_after_s", STALE_AFTER_S)),
        margin_m=MARGIN_M,
    )


class StatesOfGround:
    """What the map of the run in a folder says of the ground at its last instant, and later, by when looks
    have grown old. The map is read when it is first needed, and then kept."""

    def __init__(self, run: str | PathLike[str], history: ZoneHistory) -> None:
        self._run, self._history = run, history

    @cached_property
    def _map(self) -> CrowdMap | None:
        return _open_map(self._run)

    def at(self, stamp_ns: int) -> StateRaster | None:
        """None before the last instant, where the run did not write its map, and before such files said where
        they lie. MapFileError as of `open_grid`."""
        last_ns = self._history.stamps_ns[-1]
        if stamp_ns == last_ns:
            path = Path(self._run) / CROWD_MAP
            return read_states(path) if path.exists() else None
        if stamp_ns < last_ns or self._map is None:
            return None
        return StateRaster.of(_grid(self._map, self._history, stamp_ns))


def description_at(history: ZoneHistory, stamp_ns: int) -> MapDescription:
    """Where the numbers of a moment come from."""
    told: Mapping[str, Any] = history.description
    return MapDescription(
        stamp_ns=stamp_ns,
        threshold=history.at(stamp_ns).threshold,
        method=told.get("method", "unknown"),
        parameters=told.get("parameters", {}),
        first_stamp_ns=history.stamps_ns[0],
        drones=tuple(told.get("drones", ())),
        mission=told.get("mission", ""),
    )


def stamp_of(text: str, history: ZoneHistory) -> int:
    """Nanoseconds of "last", "first", a number of seconds after the first instant ("+2.5"), nanoseconds, or
    ISO 8601 (UTC unless it says otherwise). ValueError for anything else, and beyond the year 2262."""
    if text in ("first", "last"):
        return history.stamps_ns[0 if text == "first" else -1]
    try:
        stamp_ns = _told_ns(text, history.stamps_ns[0])
    except (ValueError, OverflowError):
        raise ValueError(
            f"{text!r} is no stamp; give last, first, +SECONDS, nanoseconds, or 2026-01-01T12:00:00.5Z"
        ) from None
    if abs(stamp_ns) > _LATEST_NS:
        raise ValueError(f"{text!r} is beyond the year 2262, where stamps in nanoseconds end")
    return stamp_ns


def _told_ns(text: str, first_ns: int) -> int:
    if text.startswith("+"):
        return first_ns + round(float(text) * 1e9)
    if text.lstrip("-").isdigit():
        return int(text)
    # Whole seconds apart: datetime knows no nanoseconds.
    # ISO 8601 has either sign before the fraction.
    parts = re.fullmatch(r"(.*?)(?:[.,](\d+))?(Z|[+-]\d\d:?\d\d)?", text, re.DOTALL)
    assert parts is not None
    whole, digits, offset = parts.groups(default="")
    moment = datetime.fromisoformat(whole + offset.removesuffix("Z"))
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=timezone.utc)
    fraction_ns = int(digits.ljust(9, "0")[:9]) if digits else 0
    return round(moment.timestamp()) * 1_000_000_000 + fraction_ns
