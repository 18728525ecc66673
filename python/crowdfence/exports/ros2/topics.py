"""All messages of a run in the order of their stamps, and the file of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any

from crowdfence.exports.ros2.earth_frame import earth_from_map
from crowdfence.exports.ros2.grids import belief_cells, closed_cells, occupancy_grid
from crowdfence.exports.ros2.ground import ground_cloud, height_at, terrain_mesh
from crowdfence.exports.ros2.zone_markers import zone_markers
from crowdfence.sources.mission import ros2_messages
from crowdfence.sources.mission.topic_writer import TopicMessage, TopicWriter
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.history import ZoneHistory

ZONES, CLOSED = "/crowdfence/zones", "/crowdfence/closed"
OTHERS = "/crowdfence/zones_of_others"
"""Apart from the zones of every instant: those of a national file are thousands, and stay as they are."""
BELIEF, GROUND, TERRAIN = "/crowdfence/belief", "/crowdfence/ground", "/crowdfence/terrain"
TF_STATIC = "/tf_static"


def result_messages(history: ZoneHistory, grid: SurfaceGrid | None) -> Iterator[TopicMessage]:
    """Zones of every instant of a run; `grid` is its map at the last one, None: zones alone."""
    first_ns, last_ns = history.stamps_ns[0], history.stamps_ns[-1]
    if history.georeference is not None:
        transform = earth_from_map(history.georeference, first_ns)
        yield _message(first_ns, TF_STATIC, ros2_messages.TF_MESSAGE, {"transforms": [transform]}, True)
    if grid is not None:
        yield _message(first_ns, TERRAIN, ros2_messages.MARKER_ARRAY, terrain_mesh(grid, first_ns), True)
    ground = None if grid is None else height_at(grid)
    before: ZoneSet | None = None
    for stamp_ns, zones in zip(history.stamps_ns, history.sets, strict=True):
        markers = zone_markers(replace(zones, static=()), stamp_ns, ground)
        yield _message(stamp_ns, ZONES, ros2_messages.MARKER_ARRAY, markers)
        if not _are_same(zones.static, () if before is None else before.static):
            markers = zone_markers(replace(zones, zones=(), unseen=()), stamp_ns, ground)
            yield _message(stamp_ns, OTHERS, ros2_messages.MARKER_ARRAY, markers, True)
        if grid is not None and (stamp_ns == last_ns or not _closes_the_same(zones, before)):
            cells = closed_cells(zones.closed, grid, with_state=stamp_ns == last_ns)
            message = occupancy_grid(cells, grid, stamp_ns)
            yield _message(stamp_ns, CLOSED, ros2_messages.OCCUPANCY_GRID, message, True)
        before = zones
    if grid is not None:
        threshold = history.sets[-1].threshold
        message = occupancy_grid(belief_cells(grid), grid, last_ns)
        yield _message(last_ns, BELIEF, ros2_messages.OCCUPANCY_GRID, message, True)
        cloud = ground_cloud(grid, threshold, last_ns)
        yield _message(last_ns, GROUND, ros2_messages.POINT_CLOUD2, cloud, True)


def write_results_mcap(
    path: str | PathLike[str], history: ZoneHistory, grid: SurfaceGrid | None
) -> dict[str, int]:
    """Write a file of them; messages by topic. OSError when it cannot be written; nothing is left then."""
    counts: dict[str, int] = {}
    with TopicWriter(path) as writer:
        for message in result_messages(history, grid):
            writer.add_message(message)
            counts[message.topic] = counts.get(message.topic, 0) + 1
    return counts


def _closes_the_same(zones: ZoneSet, before: ZoneSet | None) -> bool:
    return before is not None and _are_same(zones.closed, before.closed)


def _are_same(zones: Sequence[Zone], others: Sequence[Zone]) -> bool:
    """Outlines that did not change are the same object from instant to instant."""
    if len(zones) != len(others):
        return False
    return all(one.polygon is other.polygon for one, other in zip(zones, others, strict=True))


def _message(
    stamp_ns: int, topic: str, message_type: str, fields: dict[str, Any], latched: bool = False
) -> TopicMessage:
    return TopicMessage(stamp_ns, topic, message_type, ros2_messages.encode(message_type, fields), latched)
