"""Crowd map -> no-fly zones on the ground plane.

- `zone`     what a zone is
- `regions`  which columns of crowd belong together
- `outline`  columns -> polygon
- `find`     a crowd map at one stamp -> its zones

The first simple form: columns at or above a threshold, grouped into connected regions, outlined exactly.
Nothing is simplified, smoothed or buffered here, so a zone covers its crowd cells and nothing else.
"""

from crowdfence.zones.find import find_zones, zones_of
from crowdfence.zones.zone import MAX_ID_LENGTH, Zone, ZoneSet

__all__ = ["MAX_ID_LENGTH", "Zone", "ZoneSet", "find_zones", "zones_of"]
