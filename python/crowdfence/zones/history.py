"""The zones of a whole mission: what was closed at every instant, and what became of every zone.

In a file, one JSON value a line: a header, which says how many instants there are, then one line per instant.
An outline is written when it changed, and so are zones of others, which may be thousands. A file of fewer
instants was cut, and is refused: what it ends with is not what is closed last.
Coordinates are local metres, every digit kept.
"""

from __future__ import annotations

import json
import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from hashlib import sha256
from itertools import pairwise
from operator import index
from os import PathLike
from typing import TYPE_CHECKING, Any

from crowdfence._core import StampError
from crowdfence.atomic_file import atomic_path
from crowdfence.georeference import Georeference
from crowdfence.iso_time import iso_utc
from crowdfence.zones.altitude_band import AltitudeBand
from crowdfence.zones.area import require_area
from crowdfence.zones.evidence import DroneEvidence
from crowdfence.zones.tracker import ZoneEvent
from crowdfence.zones.zone import Zone, ZoneSet, are_same, closed_of

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

VERSION = 2
"""Since 2 an instant whose zones of others are those of the instant before does not name them."""
_READ = (1, 2)
_FORMAT = "crowdfence zone history"
_OF_FILE = ("format", "version", "anchor_wgs84", "ground", "instants")
"""What its first line says beside the description."""
_FARTHEST_M = 1e8
"""From the anchor, as for views: there is no such place on Earth."""
_OUTLINES = ("polygon", "crowd_outline")
_GROUPS = ("zones", "unseen", "static")
_OF_ZONES = tuple(field.name for field in fields(Zone))
_OF_LOOKS = tuple(field.name for field in fields(DroneEvidence))
_NOT_AS_WRITTEN = (LookupError, TypeError, AttributeError, ValueError, OverflowError, RecursionError)


class ZoneHistoryError(ValueError):
    """A file that is no zone history; the message names the file and what is wrong with it."""


@dataclass(frozen=True, slots=True, eq=False)
class ZoneHistory:
    """Zone sets by stamp, in order. ValueError for stamps that are no whole numbers, or that do not increase:
    of two instants of one stamp, as where a view came late, the zones are those of the later step."""

    stamps_ns: Sequence[int]
    sets: Sequence[ZoneSet]
    georeference: Georeference | None
    """Where on Earth the local frame lies."""
    description: Mapping[str, Any]
    """What they were made from: mission, drones, method, threshold, parameters."""
    ground: Polygon | MultiPolygon | None = None
    """What the rim of the map encloses, in local metres (`known_ground`); None where nobody says."""

    def __post_init__(self) -> None:
        if len(self.stamps_ns) == 0 or len(self.stamps_ns) != len(self.sets):
            raise ValueError(
                f"{len(self.stamps_ns)} stamps for {len(self.sets)} zone sets; there must be any"
            )
        try:
            stamps_ns = [index(stamp_ns) for stamp_ns in self.stamps_ns]
        except TypeError as error:
            raise ValueError("stamps of zone sets are whole nanoseconds since 1970") from error
        for before_ns, stamp_ns in pairwise(stamps_ns):
            if stamp_ns <= before_ns:  # an earlier set would be told for a later stamp
                raise ValueError(f"stamp {stamp_ns} follows {before_ns}; stamps of zone sets must increase")

    def __len__(self) -> int:
        return len(self.sets)

    def at(self, stamp_ns: int) -> ZoneSet:
        """What was known at a stamp: the zones of the last instant up to it. StampError before the first."""
        return self.sets[self.index_at(stamp_ns)]

    def index_at(self, stamp_ns: int) -> int:
        """Which instant that is."""
        number = bisect_right(self.stamps_ns, stamp_ns) - 1
        if number < 0:
            first = self.stamps_ns[0]
            raise StampError(f"{iso_utc(stamp_ns)} is before the first instant, {iso_utc(first)}")
        return number

    @property
    def events(self) -> Iterator[ZoneEvent]:
        return (event for zones in self.sets for event in zones.events)

    def write(self, path: str | PathLike[str]) -> None:
        """Write the file. OSError when it cannot be written, ValueError for a description that says what the
        file itself does."""
        if said := [name for name in _OF_FILE if name in self.description]:
            raise ValueError(f"description has {said[0]!r}, which is the file's own; call it otherwise")
        anchor = self.georeference
        header = {
            "format": _FORMAT,
            "version": VERSION,
            "anchor_wgs84": None
            if anchor is None
            else [anchor.latitude_deg, anchor.longitude_deg, anchor.height_m],
            "ground": None if self.ground is None else rings_of(self.ground),
            **self.description,
            "instants": len(self),
        }
        before: ZoneSet | None = None
        # Line by line: all of them at once take gigabytes after an hour over hundreds of zones.
        with atomic_path(path) as temporary, open(temporary, "wb") as file:
            file.write(_json_line(header))
            for stamp_ns, zones in zip(self.stamps_ns, self.sets, strict=True):
                file.write(_json_line(history_line(int(stamp_ns), zones, before)))
                before = zones

    @staticmethod
    def read(path: str | PathLike[str]) -> ZoneHistory:
        """Read a file that `write` wrote. ZoneHistoryError for another one, OSError when there is none."""
        number = 1
        with open(path, encoding="utf-8") as file:
            try:
                header = json.loads(file.readline())
                if not isinstance(header, dict) or header.get("format") != _FORMAT:
                    raise ValueError(f"it does not begin with the header of a {_FORMAT}")
                if header["version"] not in _READ:
                    raise ZoneHistoryError(
                        f"{path} is a zone history of version {header['version']}; up to {VERSION} is read "
                        "here"
                    )
                anchor = header["anchor_wgs84"]
                stamps_ns: list[int] = []
                sets: list[ZoneSet] = []
                for number, text in enumerate(file, 2):  # noqa: B007 - told where it fails
                    if not text.endswith("\n"):
                        raise _cut(path, stamps_ns, header.get("instants"))
                    line = json.loads(text)
                    if header["version"] == 1 and "static" not in line:
                        raise KeyError("static")
                    zones = zone_set_of_line(line, sets[-1] if sets else None)
                    stamps_ns.append(int(line["stamp_ns"]))
                    if stamps_ns[-2:] != sorted(set(stamps_ns[-2:])):
                        raise ValueError("its instant is not after the one before")
                    sets.append(zones)
                # Files of earlier builds do not say how many there are.
                promised = header.get("instants", len(stamps_ns))
                if len(stamps_ns) < promised:
                    raise _cut(path, stamps_ns, promised)
                if len(stamps_ns) > promised:
                    raise ValueError(f"{len(stamps_ns)} instants where its first line says {promised}")
                if not sets:
                    raise ValueError("it holds no instant")
                ground = header.get("ground")
                return ZoneHistory(
                    stamps_ns,
                    sets,
                    None if anchor is None else Georeference(*anchor),
                    {name: value for name, value in header.items() if name not in _OF_FILE},
                    None if ground is None else _outline_of(ground, "ground"),
                )
            except ZoneHistoryError:
                raise
            except _NOT_AS_WRITTEN as error:
                said = _said(error)
                if number > 1:
                    raise ZoneHistoryError(f"{path} is damaged in line {number}: {said}") from error
                raise ZoneHistoryError(
                    f"{path} is no zone history: {said}; give the folder that a run wrote, or its "
                    "zone_history.jsonl"
                ) from error


def _json_line(value: Mapping[str, Any]) -> bytes:
    return (json.dumps(value, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _said(error: Exception) -> str:
    """What is wrong with a file, in words of files."""
    if isinstance(error, json.JSONDecodeError):
        return "it is cut off, or no JSON"
    if isinstance(error, UnicodeDecodeError):
        return "it is no text in UTF-8"
    if isinstance(error, KeyError):
        return f"it lacks {error}"
    if type(error) is ValueError:
        return str(error)
    return f"it does not hold what an instant has ({error})"


def _cut(path: str | PathLike[str], stamps_ns: Sequence[int], instants: int | None) -> ZoneHistoryError:
    of = "" if instants is None else f" of {instants}"
    end = f", {iso_utc(stamps_ns[-1])}," if stamps_ns else ""
    return ZoneHistoryError(
        f"{path} was cut: it holds {len(stamps_ns)}{of} instants, and what is closed after the last{end} is "
        "missing; copy it again, or run again"
    )


def history_line(stamp_ns: int, zones: ZoneSet, before: ZoneSet | None = None) -> dict[str, Any]:
    """An instant for JSON; outlines that zones of the same id had `before` are left out, and zones of others
    where all are those of before: "static" is not there then."""
    known = _by_id(before)
    groups = [group for group in _GROUPS if group != "static" or not _has_static_of(zones, before)]
    return {
        "stamp_ns": stamp_ns,
        "stamp_utc": iso_utc(stamp_ns),
        "threshold": zones.threshold,
        "min_area_m2": zones.min_area_m2,
        "dropped_count": zones.dropped_count,
        "dropped_area_m2": zones.dropped_area_m2,
        **{
            group: [zone_record(zone, known.get(zone.id)) for zone in getattr(zones, group)]
            for group in groups
        },
        "events": [
            {name: value for name, value in asdict(event).items() if name != "stamp_ns" and value is not None}
            for event in zones.events
        ],
    }


def _by_id(zones: ZoneSet | None) -> dict[str, Zone]:
    return {} if zones is None else {zone.id: zone for zone in zones.closed}


def _has_static_of(zones: ZoneSet, before: ZoneSet | None) -> bool:
    return before is not None and are_same(zones.static, before.static)


def zones_digest(zones: Iterable[Zone]) -> str:
    """The same for the same zones, in another process too."""
    digest = sha256()
    for zone in zones:
        digest.update(json.dumps(zone_record(zone)).encode())
    return digest.hexdigest()


def zone_record(zone: Zone, before: Zone | None = None) -> dict[str, Any]:
    """A zone for JSON, every digit kept; outlines that it shares with the one `before` are left out."""
    record: dict[str, Any] = {}
    for name in _OF_ZONES:
        value = getattr(zone, name)
        if name in _OUTLINES:
            if before is not None and getattr(before, name) is value:
                continue
            value = None if value is None else rings_of(value)
        elif name == "band":
            value = [value.lower_m, value.upper_m, value.datum]
        elif name == "evidence":
            value = [{figure: getattr(look, figure) for figure in _OF_LOOKS} for look in value]
        elif name == "name" and value is None:
            continue  # of all but a few
        elif value != value:  # the probability of ground that nobody has seen
            value = None
        record[name] = value
    return record


def zone_set_of_line(line: Mapping[str, Any], before: ZoneSet | None = None) -> ZoneSet:
    """The other way, with the same zones `before`."""
    stamp_ns = int(line["stamp_ns"])
    known = _by_id(before)
    groups = {
        group: before.static
        if group == "static" and group not in line and before is not None
        else tuple(zone_of_record(record, known) for record in line[group])
        for group in _GROUPS
    }
    return ZoneSet(
        threshold=line["threshold"],
        min_area_m2=line["min_area_m2"],
        dropped_count=line["dropped_count"],
        dropped_area_m2=line["dropped_area_m2"],
        events=tuple(ZoneEvent(stamp_ns, **event) for event in line["events"]),
        **groups,
    )


def zone_of_record(record: Mapping[str, Any], before: Mapping[str, Zone] | None = None) -> Zone:
    """The other way."""
    values = dict(record)
    for name in _OUTLINES:
        if name not in values:
            values[name] = getattr((before or {})[values["id"]], name)
        elif name == "polygon" or values[name] is not None:
            values[name] = _outline_of(values[name], f"zone {values['id']}")
    for name in ("probability_max", "probability_mean"):
        values[name] = math.nan if values[name] is None else values[name]
    values["seen_by"] = tuple(values["seen_by"])
    values["band"] = AltitudeBand(*values["band"])
    values["interval"] = None if values["interval"] is None else tuple(values["interval"])
    values["evidence"] = tuple(DroneEvidence(**look) for look in values["evidence"])
    return Zone(**values)


def rings_of(outline: Polygon | MultiPolygon) -> list[list[list[list[float]]]]:
    """Parts of rings of corners, as GeoJSON has them in a MultiPolygon."""
    import shapely

    return [
        [shapely.get_coordinates(ring).tolist() for ring in (part.exterior, *part.interiors)]
        for part in getattr(outline, "geoms", [outline])
    ]


def polygon_of(parts: Sequence[Sequence[Sequence[Sequence[float]]]]) -> Polygon | MultiPolygon:
    """The other way; one part is a Polygon."""
    import shapely

    polygons = [shapely.Polygon(rings[0], rings[1:]) for rings in parts]
    return polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)


def _outline_of(parts: Sequence[Sequence[Sequence[Sequence[float]]]], name: str) -> Polygon | MultiPolygon:
    """The same, of a file: ValueError for an outline that no run has written."""
    outline = polygon_of(parts)
    if not max(map(abs, outline.bounds)) < _FARTHEST_M:
        raise ValueError(f"{name} reaches to {outline.bounds}, which are no local metres")
    require_area(outline, name)
    return outline


def with_static(history: ZoneHistory, static: Sequence[Zone]) -> ZoneHistory:
    """The same with zones that somebody else drew, at every instant."""
    sets = [replace(zones, static=(*zones.static, *closed_of(static))) for zones in history.sets]
    return replace(history, sets=sets)
