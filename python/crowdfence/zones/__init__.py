"""Crowd map -> no-fly zones on the ground plane.

- `belief`           what a crowd map tells about columns of ground: the one door to the fusion methods
- `regions`          which columns of crowd belong together
- `tracker`          which zone is which from one instant to the next: ids, creation, merge, split, expiry
- `outline`          columns -> polygon
- `grow` `simplify`  polygon -> a larger one: holes, buffer, fewer corners
- `safety_distance`  how large a buffer is: formulas with their sources
- `evidence`         who saw a zone
- `unseen`           ground that is not known to be empty
- `map_holes`        what a map lacks inside of itself
- `known_ground`     how far the ground of a map reaches
- `rules` `altitude_band` `zone` `zone_id`   what a zone is told, and what it is
- `ground_heights`   how low and how high the ground of a zone lies
- `given_ground`     the same for zones of others
- `area`             what others draw must have an inside
- `capacity`         all zones in a fence of few items
- `history`          the zones of a whole mission, and its file
- `engine`           all of these, instant by instant
- `find`             a crowd map at one stamp -> its regions, outlined exactly
"""

from crowdfence.zones.altitude_band import AltitudeBand
from crowdfence.zones.engine import ZoneEngine
from crowdfence.zones.evidence import DroneEvidence
from crowdfence.zones.find import find_zones
from crowdfence.zones.rules import ZoneRules
from crowdfence.zones.safety_distance import safety_distance_m
from crowdfence.zones.tracker import ZoneEvent
from crowdfence.zones.zone import Zone, ZoneSet
from crowdfence.zones.zone_id import MAX_ID_LENGTH

__all__ = [
    "MAX_ID_LENGTH",
    "AltitudeBand",
    "DroneEvidence",
    "Zone",
    "ZoneEngine",
    "ZoneEvent",
    "ZoneRules",
    "ZoneSet",
    "find_zones",
    "safety_distance_m",
]
