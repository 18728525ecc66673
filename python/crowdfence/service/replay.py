"""A recording through the frame loop, at any speed: the same instants as `crowdfence run`."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread

from crowdfence._core import View
from crowdfence.errors import FrameError, one_line
from crowdfence.service.alerts import Alerts
from crowdfence.service.clock import Clock
from crowdfence.service.fleet import Fleet
from crowdfence.service.heatmap_doubts import HeatmapDoubts
from crowdfence.service.media import Media, heatmap_png
from crowdfence.service.mission import Mission
from crowdfence.service.track import Sighting
from crowdfence.sources.recording import Instant, Recording, RefusedFrame

_LOG = logging.getLogger(__name__)
_SECOND_NS = 1_000_000_000
_SLOWEST = 0.001
"""A recorded second in a quarter of an hour; no thread waits for ever."""


class Replay:
    """Plays in a thread of its own until the end, or until `stop`."""

    def __init__(
        self,
        recording: Recording,
        mission: Mission,
        fleet: Fleet,
        media: Media,
        clock: Clock,
        alerts: Alerts,
        *,
        speed: float,
        on_end: Callable[[], None],
    ) -> None:
        """`speed`: recorded seconds a second, at least 0.001; inf for as fast as it goes."""
        if not speed >= _SLOWEST:
            raise ValueError(f"replay speed is {speed:g}; it must be at least {_SLOWEST:g}")
        self._recording, self._mission, self._fleet, self._media = recording, mission, fleet, media
        self._clock, self._speed, self._on_end = clock, speed, on_end
        self._alerts, self._doubts = alerts, HeatmapDoubts(alerts)
        self._stopped = Event()
        self._thread = Thread(target=self._play, name="replay", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stopped.set()
        self._thread.join()

    def _play(self) -> None:
        try:
            self._play_all()
        except Exception as error:  # the last moment stays published; the page and the log say why it ended
            _LOG.exception("the replay ended early")
            text = f"the replay ended early, nobody looked at the rest of the recording: {one_line(error)}"
            now_ns = self._clock.now_ns()
            self._alerts.raise_("refused_views", "alarm", text, now_ns, is_new=True)
        finally:
            self._on_end()

    def _play_all(self) -> None:
        recording, mission = self._recording, self._mission
        self._tell_refused()
        first_ns, started_s = None, time.monotonic()
        instants = recording.instants(mission.config.grouping.tolerance_ms)
        drones = len(recording.drones)
        for instant, found in mission.heatmaps.detected(instants, drones, mission.still_video):
            first_ns = instant.stamp_ns if first_ns is None else first_ns
            due_s = started_s + (instant.stamp_ns - first_ns) / _SECOND_NS / self._speed
            if self._stopped.wait(max(0.0, due_s - time.monotonic())):
                return
            with mission.lock:
                counted = [view for view in found.views if view.drone not in mission.left_out]
                all_are_left_out = bool(found.views) and not counted
                if not all_are_left_out:
                    step = mission.loop.step(counted, instant.stamp_ns, found.refused)
                self._clock.saw(instant.stamp_ns)
                for refused in found.refused:
                    text = f"a view of {refused.drone} could not be used: {refused.reason}"
                    self._refuse(refused.drone, text, instant.stamp_ns)
                self._show(instant, found.views)
                if all_are_left_out:
                    mission.look_again(instant.stamp_ns)
                else:
                    mission.stepped(step)
            mission.keep_belief()
            if self._stopped.is_set():
                return

    def _tell_refused(self) -> None:
        """Frames that the reader could not use are in no instant."""
        of_drones: dict[str, list[RefusedFrame]] = {}
        for refused in self._recording.refused:
            of_drones.setdefault(refused.drone, []).append(refused)
        for drone, some in of_drones.items():
            text = f"a frame of {drone} cannot be used: {some[0]}"
            if len(some) > 1:
                text = f"{len(some)} frames of {drone} cannot be used, the first: {some[0]}"
            self._refuse(drone, text, self._recording.frames[0].stamp_ns)

    def _refuse(self, drone: str, text: str, now_ns: int) -> None:
        self._alerts.raise_("refused_views", "warning", text, now_ns, drone=drone, is_new=True)

    def _show(self, instant: Instant, views: list[View]) -> None:
        frames = {frame.drone: frame for frame in instant.frames}
        for frame in instant.frames:  # the refused ones too
            self._fleet.was_at(frame.drone, frame.stamp_ns, frame.world_from_camera[:3, 3])
        for view in views:
            self._doubts.look(view, instant.stamp_ns)
            frame = frames[view.drone]
            has_picture = frame.pixels.image is not None
            self._fleet.saw(
                view.drone,
                Sighting(view.stamp_ns, view.camera, view.world_from_camera, has_picture, True),
            )
            # Of a part of the picture: on the page the rest would flicker.
            if not frame.is_whole(view) or not self._media.wants(view.drone, view.stamp_ns):
                continue
            self._media.keep("heatmap", view.drone, view.stamp_ns, heatmap_png(view.heatmap))
            if has_picture:
                with suppress(FrameError):
                    self._media.keep("picture", view.drone, view.stamp_ns, frame.encoded_image())
