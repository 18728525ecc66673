"""What a live service listens to besides HTTP."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

from crowdfence._core import Terrain
from crowdfence.georeference import Georeference
from crowdfence.service.mavlink_link import TelemetryAddress, check_ports, links
from crowdfence.service.poses import PoseFeed
from crowdfence.service.ros.link import RosLink
from crowdfence.service.service import Service
from crowdfence.service.telemetry import Telemetry, TelemetryOptions
from crowdfence.sources.camera_mask import CameraMask
from crowdfence.sources.pose_offset import PoseOffset


@dataclass(frozen=True, slots=True)
class Inputs:
    """Nothing by default."""

    mavlink: Sequence[TelemetryAddress] = ()
    mavlink_key: str | None = None
    """Pass phrase of signatures (MAVLink 2)."""
    telemetry: TelemetryOptions = field(default_factory=TelemetryOptions)
    ros: RosLink | None = None
    offsets: Mapping[str, PoseOffset] = field(default_factory=dict)
    """What the poses of a drone are constantly off, also of views that bring theirs."""
    camera_masks: Mapping[str, CameraMask] = field(default_factory=dict)
    """Where the pictures of a drone show no ground."""

    def __post_init__(self) -> None:
        """ValueError for an empty pass phrase, as of a file that was not filled in: anybody can sign with
        it."""
        if self.mavlink_key is not None and not self.mavlink_key.strip():
            raise ValueError("--mavlink-key holds no pass phrase: anybody could sign telemetry with it")

    def feeds(self, terrain: Terrain, anchor: Georeference | None) -> dict[str, PoseFeed]:
        """Where the poses of each drone come from. ValueError as for `Telemetry`, for a drone with two
        sources, and for drones that share a port without system ids."""
        check_ports(self.mavlink)
        feeds: dict[str, PoseFeed] = {} if self.ros is None else self.ros.feeds(anchor)
        for one in self.mavlink:
            if one.drone in feeds:
                raise ValueError(f"the pose of {one.drone} comes from two sources")
            feeds[one.drone] = Telemetry(one.drone, terrain, anchor, self.telemetry)
        return feeds

    @contextmanager
    def connected(self, service: Service, feeds: Mapping[str, PoseFeed]) -> Iterator[None]:
        """While the block runs. OSError, ValueError."""
        telemetry = {drone: feed for drone, feed in feeds.items() if isinstance(feed, Telemetry)}
        with ExitStack() as open_links:
            for link in links(self.mavlink, telemetry, service.clock, key=self.mavlink_key):
                link.start()
                open_links.callback(link.stop)
            if self.ros is not None:
                open_links.enter_context(self.ros.connected(service, feeds))
            yield
