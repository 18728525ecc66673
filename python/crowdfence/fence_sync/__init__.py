"""Zones -> the fence of an autopilot, over MAVLink, and kept there.

- `fence_item`          what a fence is made of
- `messages`            what is said; `mavlink_codec` makes packets of it, `transport` carries them
- `conversation`        how something is said until it is answered, without sockets or clocks
- `transfer` `questions` `reposition`   conversations: fences, what else is asked, a command
- `ground_station`      our end of a link to one vehicle
- `autopilot_capacity` `placement`      zones -> shapes on Earth that cover them and fit
- `enforcement` `inside`                what the autopilot will not do with them
- `vehicle_memory`      which shapes are ours
- `synchronise`         all of these: a vehicle's fence made equal to the zones
- `placed_zones` `zone_file` `service_zones` `zone_source`      where the zones come from
- `debounce` `watch`    zones that change
- `fence_geojson`       a fence as a file
"""

from crowdfence.fence_sync.autopilot_capacity import ItemCapacity, StorageCapacity
from crowdfence.fence_sync.conversation import Patience
from crowdfence.fence_sync.fence_error import FenceError
from crowdfence.fence_sync.fence_event import FenceEvent
from crowdfence.fence_sync.fence_geojson import fence_geojson
from crowdfence.fence_sync.ground_station import GroundStation
from crowdfence.fence_sync.placed_zones import PlacedZones
from crowdfence.fence_sync.service_zones import ServiceZones, is_address
from crowdfence.fence_sync.synchronise import FenceKeeper, FenceReport
from crowdfence.fence_sync.transport import open_transport
from crowdfence.fence_sync.watch import FenceWatch, WatchPlan
from crowdfence.fence_sync.zone_file import ZoneFile
from crowdfence.fence_sync.zone_source import ZonePlace, ZoneSource

__all__ = [
    "FenceError",
    "FenceEvent",
    "FenceKeeper",
    "FenceReport",
    "FenceWatch",
    "GroundStation",
    "ItemCapacity",
    "Patience",
    "PlacedZones",
    "ServiceZones",
    "StorageCapacity",
    "WatchPlan",
    "ZoneFile",
    "ZonePlace",
    "ZoneSource",
    "fence_geojson",
    "is_address",
    "open_transport",
]
