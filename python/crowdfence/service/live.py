"""Live views: checked, journaled, acknowledged, grouped into instants, taken into the map.

intake (any thread) -> journal -> applying (one thread, in the order of the journal) -> instants -> steps
                ticker (by the clock) ---^
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from crowdfence.service.alerts import Alerts
from crowdfence.service.applying import Applying
from crowdfence.service.clock import Clock, steady_s
from crowdfence.service.fleet import Fleet
from crowdfence.service.gate import Gate
from crowdfence.service.heard import UNKNOWN, Heard
from crowdfence.service.intake import Intake
from crowdfence.service.journal import Journal
from crowdfence.service.media import Media
from crowdfence.service.mission import Mission
from crowdfence.service.poses import Poses
from crowdfence.service.settings import ServiceSettings
from crowdfence.service.ticker import Ticker
from crowdfence.sources.camera_mask import CameraMask

_MOST_DRONES = 1000


class Live:
    """Begins where the journal ends. `start` it once; `stop` leaves a snapshot."""

    def __init__(
        self,
        mission: Mission,
        journal: Journal,
        fleet: Fleet,
        media: Media,
        alerts: Alerts,
        clock: Clock,
        settings: ServiceSettings,
        *,
        poses: Poses | None = None,
        masks: Mapping[str, CameraMask] | None = None,
        detector_threads: int = 1,
    ) -> None:
        self._mission, self._clock, self._settings = mission, clock, settings
        self._alerts = alerts
        self.heard = Heard()
        self.poses = poses or Poses({}, wait_s=0.0, stale_s=0.0, started_ns=0)
        """Of drones whose views come without."""
        self.masks = masks or {}
        """Where the pictures of a drone show no ground."""
        most = int(mission.loop.crowd_map.method.parameters.get("fleet_size", _MOST_DRONES))
        gate = Gate(
            clock,
            alerts,
            settings,
            fleet=self._known_drones,
            last_view_ns=self.heard.last_view_ns,
            most_drones=most,
        )
        self.applying = Applying(
            mission,
            journal,
            fleet,
            media,
            alerts,
            clock,
            settings,
            gate,
            self.heard,
            detector_threads,
            self.masks,
        )
        gate.behind_s = lambda: self.applying.behind_s
        self.intake = Intake(
            mission, journal, clock, gate, self.poses, self.masks, self.heard, alerts, self.applying
        )
        self._ticker = Ticker(mission, journal, clock, settings, self.heard, self.applying)

    def _known_drones(self) -> Iterable[str]:
        return (*self._mission.drones, *self.heard.accepted, *self.applying.gathering.drones)

    @property
    def silent_s(self) -> float | None:
        """How long no view has been accepted, whatever its stamp; before the first one since the start by the
        age of the newest that was there, None where there is none."""
        if self.heard.accepted_s is not None:
            return steady_s() - self.heard.accepted_s
        look_ns = self.applying.newest_look_ns
        return max(0.0, (self._clock.now_ns() - look_ns) / 1e9) if look_ns else None

    @property
    def newest_ns(self) -> int:
        """The newest stamp of the state; 0 for none. Safe before `start` alone."""
        newest = self._mission.newest
        newest_ns = 0 if newest is None else newest.stamp_ns
        return max(self.applying.newest_look_ns, self.applying.last_ns or 0, newest_ns)

    def flooded(self, reason: str) -> None:
        """A view was refused before anybody read it, so that its drone is not known."""
        self.heard.refused[UNKNOWN] += 1
        self._alerts.raise_("refused_views", "warning", reason, self._clock.now_ns(), drone=UNKNOWN)

    def start(self) -> None:
        """After `applying.recover`."""
        self.applying.start()
        # A replay says itself when it is over, and may be as slow as it likes.
        if self._clock.kind == "system" or self._settings.clock == "views":
            self._ticker.start()

    def finish(self) -> None:
        """No view follows: what waits becomes instants now. The journal says so."""
        self.applying.settled(30.0)
        self._ticker.tick(self.applying.gathering.end_ns)
        self.applying.settled(30.0)

    def stop(self) -> None:
        self._ticker.stop()
        self.applying.stop()
