"""Zones as CSV: one row each, with the outline as WKT in longitude and latitude."""

from __future__ import annotations

import csv
import io

from crowdfence.exports.zone_formats.times import rfc3339
from crowdfence.exports.zone_formats.zone_export import ZoneExport
from crowdfence.legible import table_cell
from crowdfence.zones import Zone

COLUMNS = (
    "id",
    "kind",
    "restriction",
    "valid_from",
    "valid_until",
    "created",
    "lower_m",
    "upper_m",
    "datum",
    "closed_m2",
    "crowd_m2",
    "probability_max",
    "probability_mean",
    "probability_low",
    "probability_high",
    "forgotten_at",
    "last_seen",
    "seen_by",
    "reason",
    "name",
    "wkt",
)


def zones_csv(export: ZoneExport) -> str:
    """RFC 4180 text with a header line. What is not known is an empty field."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(COLUMNS)
    for zone in export.zones:
        row = _row(zone, export)
        writer.writerow([row[column] for column in COLUMNS])
    return text.getvalue()


def _row(zone: Zone, export: ZoneExport) -> dict[str, object]:
    band, is_crowd = export.band(zone), zone.kind == "crowd"
    low, high = zone.interval or ("", "")
    return {
        "id": table_cell(zone.id),
        "kind": zone.kind,
        "restriction": zone.restriction,
        "valid_from": rfc3339(export.start_ns(zone)),
        "valid_until": "" if zone.valid_until_ns is None else rfc3339(zone.valid_until_ns, up=True),
        "created": "" if zone.created_ns is None else rfc3339(zone.created_ns),
        "lower_m": band.lower_m,
        "upper_m": band.upper_m,
        "datum": band.datum,
        "closed_m2": zone.polygon.area,
        "crowd_m2": zone.area_m2 if is_crowd else "",
        "probability_max": zone.probability_max if is_crowd else "",
        "probability_mean": zone.probability_mean if is_crowd else "",
        "probability_low": low,
        "probability_high": high,
        "forgotten_at": "" if zone.forgotten_ns is None else rfc3339(zone.forgotten_ns),
        "last_seen": rfc3339(zone.last_seen_ns) if is_crowd else "",
        "seen_by": table_cell(" ".join(zone.seen_by)),
        "reason": zone.reason or "",
        "name": table_cell(zone.name or ""),
        "wkt": export.outline(zone).wkt,
    }
