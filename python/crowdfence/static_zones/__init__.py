"""No-fly zones that somebody else drew, from their files: ED-318, ED-269, GeoJSON, KML. They stay closed."""

from __future__ import annotations

import json
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Iterable, Iterator
from os import PathLike
from pathlib import Path
from typing import Any

from crowdfence.errors import one_line
from crowdfence.georeference import Georeference
from crowdfence.legible import first_of, legible
from crowdfence.static_zones.given_zone import GivenZone, StaticZones, local_zones
from crowdfence.static_zones.kml_polygons import kml_zones
from crowdfence.static_zones.plain_geojson import geojson_zones
from crowdfence.static_zones.uas_zones import ed269_zones, ed318_zones, is_ed269, is_ed318
from crowdfence.zones import Zone

__all__ = ["StaticZoneError", "StaticZones", "open_static_zones", "read_static_zones"]

_ZIP = b"PK\x03\x04"
MOST_NAMED = 5
"""Of zones that are left out for one reason."""


class StaticZoneError(ValueError):
    """A file of zones that cannot be used; the message names the file and what is wrong with it."""


def open_static_zones(
    path: str | PathLike[str], georeference: Georeference | None, taken: set[str] | None = None
) -> StaticZones:
    """The zones of a file in the local frame that `georeference` anchors. Ids are those of the file where
    they are short and not `taken`. StaticZoneError for what cannot be used, OSError for a missing file."""
    path = Path(path)
    data = path.read_bytes()
    if georeference is None:
        raise StaticZoneError(f"{path}: the recording has no place on Earth, so zones cannot be placed in it")
    left_out: list[str] = []
    try:
        if data.removeprefix(BOM_UTF8).lstrip().startswith(b"<"):
            given = list(kml_zones(data, left_out))
        else:
            document = _with_head(_document(data))
            given = list(_reader(document)(document, left_out))
        zones = local_zones(given, georeference, set() if taken is None else taken, left_out)
    except RecursionError as error:
        raise StaticZoneError(f"{path}: it is nested too deeply") from error
    # A LookupError is also what KML in an unknown encoding ends in.
    except (LookupError, TypeError, AttributeError, ValueError, OverflowError) as error:
        what = f"{one_line(error)} is missing" if isinstance(error, KeyError) else one_line(error)
        raise StaticZoneError(f"{path}: {what}") from error
    if not zones and not left_out:
        left_out.append("it holds no zone")
    return StaticZones(tuple(zones), tuple(left_out))


def _document(data: bytes) -> Any:
    try:
        return json.loads(data)
    except ValueError as error:
        why: object = error
        if data.startswith(_ZIP):
            why = "it is a zip archive, as a .kmz is; unpack it (unzip FILE.kmz) and give the .kml in it"
        elif data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
            why = "it is text in UTF-16; save it in UTF-8"
        raise ValueError(f"it is neither KML nor JSON (ED-318, ED-269, GeoJSON): {why}") from error


def _with_head(document: Any) -> Any:
    """The feeds of Austria and Lithuania are the list of ED-269 alone, without what is around it in files."""
    if isinstance(document, list) and document and isinstance(document[0], dict):
        as_file = {"features": document}
        return as_file if is_ed269(as_file) else document
    return document


def _reader(document: Any) -> Callable[[Any, list[str]], Iterator[GivenZone]]:
    if not isinstance(document, dict):
        raise ValueError("it is neither KML nor a JSON object with zones")
    if is_ed318(document):
        return ed318_zones
    return ed269_zones if is_ed269(document) else geojson_zones


def read_static_zones(
    paths: list[Path], georeference: Georeference | None, taken: Iterable[str] = ()
) -> tuple[tuple[Zone, ...], list[str]]:
    """The zones of several files, and a sentence for everything that is left out, or for all that is left out
    for one reason. No zone gets an id that is `taken`, nor one of another."""
    taken = set(taken)
    zones: list[Zone] = []
    left_out = []
    for path in paths:
        read = open_static_zones(path, georeference, taken)
        zones += read.zones
        left_out += [legible(f"{path.name}: {sentence}") for sentence in _together(read.left_out)]
    return tuple(zones), left_out


def _together(sentences: Iterable[str]) -> Iterator[str]:
    """Those of a few zones as they are; a national file has thousands that are left out for one reason."""
    named: dict[str, list[str]] = {}
    for sentence in sentences:
        name, _, reason = sentence.rpartition(": ")
        named.setdefault(reason, []).append(name)
    for reason, names in named.items():
        if len(names) <= MOST_NAMED:
            yield from (f"{name}: {reason}" if name else reason for name in names)
        else:
            yield f"{first_of(names, MOST_NAMED)}: {reason}"
