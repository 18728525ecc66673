"""What the service tells a fleet of ROS: zones at every instant, maps as often as they cost little.

    /crowdfence/zones            visualization_msgs/MarkerArray  every instant, again every second
    /crowdfence/zones_of_others  visualization_msgs/MarkerArray  every five seconds
    /crowdfence/closed           nav_msgs/OccupancyGrid          100 closed or crowd, 0 empty, -1 not known
    /crowdfence/belief           nav_msgs/OccupancyGrid          crowd in hundredths, -1 not known
    /tf_static                   tf2_msgs/TFMessage              earth -> map, every five seconds

The names and meanings are those of the file that a run writes (`exports.ros2`). A reader that hears nothing
for seconds knows nothing: all of it is repeated, zones with the stamp that they are of, grids as of now. Who
plans on a grid seldom looks at its stamp, and ground is not known to be empty for ever because no view comes.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from threading import Event, Thread
from typing import Any

from crowdfence.exports.ros2.earth_frame import earth_from_map
from crowdfence.exports.ros2.grids import belief_cells, closed_cells, occupancy_grid
from crowdfence.exports.ros2.ground import height_at
from crowdfence.exports.ros2.topics import BELIEF, CLOSED, OTHERS, TF_STATIC, ZONES
from crowdfence.exports.ros2.zone_markers import HeightAt, zone_markers
from crowdfence.service.mission import Mission
from crowdfence.service.timeline import Moment
from crowdfence.sources.mission import ros2_messages
from crowdfence.surface_grid import SurfaceGrid, read_crowd_map
from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.zone import are_same

Put = Callable[[str, str, bytes], None]
"""Topic, type, CDR."""

_LOG = logging.getLogger(__name__)
_AGAIN_S = 1.0
_SAME_AGAIN_S = 5.0
"""What does not change from instant to instant."""
_GRIDS_COST_AT_MOST = 0.1
"""Share of the time that goes into grids."""


class RosPublisher:
    """In a thread of its own, so that it holds nobody up; the newest moment counts."""

    def __init__(self, mission: Mission, put: Put) -> None:
        self._mission, self._put = mission, put
        self._news, self._stopping = Event(), Event()
        self._framed_s = self._others_s = self._grids_due_s = 0.0
        self._others: tuple[Zone, ...] = ()
        self._grid: SurfaceGrid | None = None
        self._thread = Thread(target=self._publish_all, name="ros publisher", daemon=True)

    def start(self) -> None:
        self._mission.listeners.append(self._happened)
        self._thread.start()

    def stop(self) -> None:
        self._mission.listeners.remove(self._happened)
        self._stopping.set()
        self._news.set()
        self._thread.join()

    def _happened(self, moment: Moment, before: Moment | None) -> None:
        self._news.set()

    def _publish_all(self) -> None:
        while not self._stopping.is_set():
            self._news.wait(_AGAIN_S)
            self._news.clear()
            try:
                self._publish()
            except Exception:  # the fleet must not lose its zones over one message
                _LOG.exception("zones could not be published")

    def _publish(self) -> None:
        moment, now_s = self._moment(), time.monotonic()
        if now_s - self._framed_s > _SAME_AGAIN_S and self._mission.georeference is not None:
            self._framed_s = now_s
            frame = earth_from_map(self._mission.georeference, moment.stamp_ns)
            self._send(TF_STATIC, ros2_messages.TF_MESSAGE, {"transforms": [frame]})
        if now_s >= self._grids_due_s:
            self._publish_grids()
            self._grids_due_s = time.monotonic() + max(
                _AGAIN_S, (time.monotonic() - now_s) / _GRIDS_COST_AT_MOST
            )
            moment = self._moment()  # the map went on meanwhile
        ground = None if self._grid is None else height_at(self._grid)
        self._send_zones(ZONES, moment.own, moment.stamp_ns, ground)
        others = moment.of_others
        is_due = bool(others) and now_s - self._others_s > _SAME_AGAIN_S
        if is_due or not are_same(others, self._others):
            self._others, self._others_s = others, now_s
            of_others = replace(moment.zones, zones=(), unseen=(), static=others)
            self._send_zones(OTHERS, of_others, moment.stamp_ns, ground)

    def _send_zones(self, topic: str, zones: ZoneSet, stamp_ns: int, ground: HeightAt | None) -> None:
        self._send(topic, ros2_messages.MARKER_ARRAY, zone_markers(zones, stamp_ns, ground))

    def _moment(self) -> Moment:
        """The newest; before the first view what holds without any."""
        return self._mission.newest or self._mission.opening(self._mission.read_at_ns())

    def _publish_grids(self) -> None:
        mission = self._mission
        with mission.lock:
            moment = self._moment()
            stamp_ns = mission.read_at_ns()
            read = read_crowd_map(
                mission.loop.crowd_map,
                stamp_ns,
                threshold=mission.threshold,
                stale_after_s=mission.config.zones.stale_after_s,
            )
        grid = self._grid = read()  # half a second for four million voxels: views go on meanwhile
        closed = closed_cells(moment.zones.closed, grid, with_state=True)
        for topic, cells in ((CLOSED, closed), (BELIEF, belief_cells(grid))):
            message = occupancy_grid(cells, grid, stamp_ns)
            self._send(topic, ros2_messages.OCCUPANCY_GRID, message)

    def _send(self, topic: str, kind: str, fields: dict[str, Any]) -> None:
        self._put(topic, kind, ros2_messages.encode(kind, fields))
