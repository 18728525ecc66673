"""Zones of one moment as text, one module per format:

- `zone_export`  what is written: zones, stamp, place on Earth, and who says so
- `ed318` `ed269` `f3548`  for authorities and UTM
- `kml` `zones_csv`  for viewers, spreadsheets and databases
- `qgc_plan`  the fence of an autopilot
- `over_coverage`  what formats without holes close beside the zones
- `times` `geoid`  stamps as text, heights above sea level
"""

from collections.abc import Callable

from crowdfence.exports.zone_formats.ed269 import ed269
from crowdfence.exports.zone_formats.ed318 import ed318
from crowdfence.exports.zone_formats.f3548 import f3548
from crowdfence.exports.zone_formats.kml import kml
from crowdfence.exports.zone_formats.qgc_plan import qgc_plan
from crowdfence.exports.zone_formats.zone_export import ZoneExport
from crowdfence.exports.zone_formats.zones_csv import zones_csv

ZONE_FORMATS: dict[str, Callable[[ZoneExport], str]] = {
    "ed318": ed318,
    "ed269": ed269,
    "ed269-list": lambda export: ed269(export, as_list=True),
    "f3548": f3548,
    "kml": kml,
    "multidrone": lambda export: kml(export, multidrone=True),
    "qgc": qgc_plan,
    "csv": zones_csv,
}
"""Name -> what writes it. ValueError where the zones cannot be written in this format."""

__all__ = ["ZONE_FORMATS", "ZoneExport", "ed269", "ed318", "f3548", "kml", "qgc_plan", "zones_csv"]
