"""The frame loop of the service: a step in, a moment out, told to everybody who listens."""

from __future__ import annotations

import json
import secrets
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from threading import RLock
from typing import TYPE_CHECKING, Any, NamedTuple

from crowdfence._core import CrowdMap, Terrain
from crowdfence.config import RunConfig
from crowdfence.exports.map_description import MapDescription
from crowdfence.georeference import Georeference
from crowdfence.pipeline import FrameLoop, Step
from crowdfence.pipeline.close_look import CloseLook
from crowdfence.pipeline.crowds_apart import CrowdsApart
from crowdfence.pipeline.denied_crowd import DeniedCrowd
from crowdfence.pipeline.still_video import StillVideo
from crowdfence.pipeline.unheeded_crowd import UnheededCrowd
from crowdfence.service.belief import belief_bytes
from crowdfence.service.ground import Ground
from crowdfence.service.left_out import DroneAction, LeftOut
from crowdfence.service.operator_zones import OperatorAction, OperatorZones
from crowdfence.service.packing import packed, unpacked
from crowdfence.service.recent_looks import RecentLooks
from crowdfence.service.seen_columns import SeenColumns
from crowdfence.service.timeline import Moment, Timeline
from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.history import history_line, zone_set_of_line, zones_digest
from crowdfence.zones.zone import closed_of

if TYPE_CHECKING:
    from crowdfence.pipeline.detect import HeatmapSource

OnMoment = Callable[[Moment, Moment | None], None]
"""Told what is published now, and what was before."""

_BELIEF_COSTS_AT_MOST = 0.05
"""Share of the time that goes into maps for the history."""
_BELIEF_FRESH_NS = 1_000_000_000


class Belief(NamedTuple):
    """The crowd map from above (`belief_bytes`), of a moment, as of a stamp."""

    number: int
    stamp_ns: int
    body: bytes


class Mission:
    """One crowd map that is kept up to date. One thread steps; all others read."""

    def __init__(
        self,
        name: str,
        terrain: Terrain,
        georeference: Georeference | None,
        config: RunConfig,
        drones: Sequence[str],
        timeline: Timeline,
        *,
        heatmaps: HeatmapSource,
        fleet_size: int | None = None,
        static_zones: Sequence[Zone] = (),
        dismissed_for_s: float = 60.0,
        now_ns: Callable[[], int],
    ) -> None:
        """`config` is complete (`RunConfig.with_detector`); `now_ns` is the service's clock."""
        self._now_ns = now_ns
        self.name, self.terrain, self.georeference, self.config = name, terrain, georeference, config
        self.heatmaps = heatmaps
        self.ground = Ground(terrain)
        self.timeline = timeline
        self._static = closed_of(static_zones)
        # Views pass the gate, recordings their reader: both judge clocks, and drones may be away for a day.
        crowd_map = config.crowd_map(terrain, fleet_size or max(1, len(drones)), max_gap_s=float("inf"))
        self.loop = FrameLoop(crowd_map, config.zones, static_zones)
        self.recent_looks = RecentLooks()
        self.unheeded_crowd = UnheededCrowd(terrain, crowd_map.method.b_threshold)
        self.denied_crowd = DeniedCrowd()
        self.crowds_apart = CrowdsApart()
        self._seen = SeenColumns(self.terrain)
        self.still_video = StillVideo()
        self._dismissed_for_s = dismissed_for_s
        self.operator_zones = self._no_operator_zones()
        self.left_out = LeftOut()
        self.newest: Moment | None = None
        """What is published; replaced as a whole."""
        self.found: ZoneSet = self.loop.look_again(0)
        """The zones of the last step, or of a map that nobody saw; without what operators did."""
        self._unseen = self.found
        self._static_digest = zones_digest(self.found.static)
        self._had_other_static = False
        self._static_before: tuple[Zone, ...] | None = None
        """The zones of others that what comes into the map anew is published with."""
        self.listeners: list[OnMoment] = []
        self.lock = RLock()
        """Held by whoever steps or reads the crowd map."""
        self._known_drones = tuple(drones)
        self._belief: Belief | None = None
        self.run = secrets.token_hex(4)
        """Of this mission in this process: numbers of moments begin anew with another one, and those that no
        snapshot holds are given again after a restart."""
        self._next_belief_s = 0.0

    @property
    def threshold(self) -> float:
        return self.loop.threshold

    @property
    def drones(self) -> tuple[str, ...]:
        """Those of the recording, and whoever gave a view."""
        return tuple(dict.fromkeys((*self._known_drones, *self.loop.crowd_map.drones)))

    def _no_operator_zones(self) -> OperatorZones:
        return OperatorZones(self.config.zones, self.terrain, self._dismissed_for_s)

    def check(self, action: OperatorAction | DroneAction) -> None:
        """RefusedAction for what `do` would not do now."""
        if isinstance(action, DroneAction):
            self.left_out.check(action)
        else:
            self.operator_zones.check(action, self._published)

    def do(self, action: OperatorAction | DroneAction) -> str:
        """Do what an operator asks and publish what follows from it; the id of the zone or the name of the
        drone. RefusedAction."""
        if isinstance(action, DroneAction):
            self.left_out.do(action)
            name = action.drone
        else:
            name = self.operator_zones.do(action, self._published)
        self.publish(max(action.stamp_ns, 0 if self.newest is None else self.newest.stamp_ns))
        return name

    @property
    def _published(self) -> ZoneSet:
        return self.found if self.newest is None else self.newest.zones

    def stepped(self, step: Step) -> Moment:
        """Publish what a step of the loop brought."""
        self.found = step.zones
        self.recent_looks.add(step.update.observations)
        self.unheeded_crowd.add(step.update.observations, step.crowd_ids)
        looks = [CloseLook(observation) for observation in step.update.observations]
        self.denied_crowd.look(looks, step.shown_ids, step.crowd_ids)
        self.crowds_apart.look(looks, step.shown_ids)
        self._seen.add(step.update.voxel_ids)
        return self.publish(step.stamp_ns)

    def look_again(self, stamp_ns: int) -> Moment:
        """Publish the zones as of a stamp after the last step, when no view came."""
        self.found = self.loop.look_again(stamp_ns)
        return self.publish(stamp_ns)

    def opening(self, stamp_ns: int) -> Moment:
        """What holds before anybody saw anything: the zones that somebody else drew, and, with
        `close_unseen`, all ground. Of no history."""
        figures = {**self._figures(self._unseen, self._unseen), "seen_m2": 0.0}
        return Moment(0, stamp_ns, self._unseen, {}, figures)

    @contextmanager
    def with_static_of_before(self) -> Iterator[None]:
        """What comes into the map anew after a crash, with its stamps of before, is published with the zones
        of others of then: those of another file hold from this start on (`apply_static`)."""
        self._static_before = before = self.timeline.newest_of_others()
        try:
            yield
        finally:
            self._static_before = None
            self._had_other_static |= before is not None and zones_digest(before) != self._static_digest

    def apply_static(self, stamp_ns: int) -> bool:
        """Publish the static zones that this service was given, where the one before had others; whether."""
        with self.lock:
            if self.newest is None or not self._had_other_static:
                return False
            self._had_other_static = False
            self.publish(max(stamp_ns, self.newest.stamp_ns))
            return True

    def end_dismissals_of_the_future(self) -> None:
        """Before the first view after a restart: those of a clock that was ahead would last too long."""
        with self.lock:
            now_ns, newest = self._now_ns(), self.newest
            if self.operator_zones.end_those_after(now_ns) and newest is not None:
                self.publish(max(now_ns, newest.stamp_ns))

    def publish(self, stamp_ns: int) -> Moment:
        """Publish the zones of the last step with what operators made of them, as of a stamp."""
        found = self.found
        if self._static_before is not None:
            found = replace(found, static=self._static_before)
        # Stamps may be ahead of the clock, as far as views may: a dismissal is no shorter for it.
        zones, marks = self.operator_zones.applied_to(found, min(stamp_ns, self._now_ns()))
        number = 1 if self.newest is None else self.newest.number + 1
        before = self.newest
        moment = Moment(number, stamp_ns, zones, marks, self._figures(found, zones))
        self.newest = moment
        # What became of zones is told with the step that brought it, and not again with what operators do.
        self.found = replace(self.found, events=())
        self.timeline.add(moment)
        for listener in self.listeners:
            listener(moment, before)
        return moment

    def _figures(self, found: ZoneSet, zones: ZoneSet) -> dict[str, Any]:
        """`zones` are those found with what operators made of them."""
        return {
            "seen_m2": self._seen.count * self.terrain.voxel_size_m**2,
            "crowd_m2": found.area_m2 + found.dropped_area_m2,
            "closed_m2": zones.closed_m2,
            "zones": len(zones.closed),
        }

    def to_bytes(self) -> bytes:
        """All that the next step depends on, for a snapshot."""
        newest = self.newest
        told = {
            "number": 0 if newest is None else newest.number,
            "stamp_ns": 0 if newest is None else newest.stamp_ns,
            "found": history_line(0, replace(self.found, static=())),
            "static_digest": self._static_digest,
            "operator_zones": self.operator_zones.to_json(),
            "left_out": self.left_out.to_json(),
            "still_video": self.still_video.to_json(),
            "unheeded_crowd": self.unheeded_crowd.to_json(),
        }
        return packed(json.dumps(told).encode(), self.loop.crowd_map.to_bytes(), self.loop.to_bytes())

    def restore(self, data: bytes) -> None:
        """What `to_bytes` gave, on the same terrain with the same settings. It fails for anything else, and
        nothing has changed then."""
        told, crowd_map, of_loop = unpacked(data)
        loop = FrameLoop(CrowdMap.from_bytes(crowd_map, self.terrain), self.config.zones, self._static)
        loop.restore(of_loop)
        state = json.loads(told)
        kept = zone_set_of_line(state["found"])
        found = replace(kept, static=self._unseen.static)  # on the ground, as those of a step
        operator_zones = self._no_operator_zones()
        operator_zones.restore(state["operator_zones"])
        still_video = StillVideo()
        still_video.restore(state.get("still_video", {}))  # builds of before did not keep it, nor
        left_out = LeftOut()
        left_out.restore(state.get("left_out", []))  # ... who is left out: they left out nobody
        unheeded = UnheededCrowd(self.terrain, loop.crowd_map.method.b_threshold)
        if "unheeded_crowd" in state:  # ... nor crowd for which nothing was closed
            unheeded.restore(state["unheeded_crowd"])
        zones, marks = operator_zones.applied_to(found, state["stamp_ns"])
        self.loop, self.found, self.operator_zones, self.newest = loop, found, operator_zones, None
        self.still_video, self.left_out, self.unheeded_crowd = still_video, left_out, unheeded
        self._seen.begin_anew()
        self._seen.add(loop.crowd_map.seen_ids())
        # Builds of before kept the zones themselves.
        had = state["static_digest"] if "static_digest" in state else zones_digest(kept.static)
        self._had_other_static = had != self._static_digest
        self._belief = None
        if state["number"]:
            figures = self._figures(found, zones)
            self.newest = Moment(state["number"], state["stamp_ns"], zones, marks, figures)

    def keep_belief(self) -> None:
        """Into the history, as often as it costs little."""
        if time.monotonic() < self._next_belief_s or self.newest is None:
            return
        started_s = time.monotonic()
        belief = self.belief()
        self.timeline.add_belief(belief.number, self.newest.stamp_ns, belief.body)
        ended_s = time.monotonic()
        self._next_belief_s = ended_s + max(0.2, (ended_s - started_s) / _BELIEF_COSTS_AT_MOST)

    def read_at_ns(self, now_ns: int | None = None) -> int:
        """As of when the crowd map is read: now (None: by the service's clock), or the newest look or moment
        where that is later. What nobody looks at is not known to be empty for ever."""
        moment, span = self.newest, self.loop.crowd_map.span_ns
        return max(
            self._now_ns() if now_ns is None else now_ns,
            0 if moment is None else moment.stamp_ns,
            0 if span is None else span[1],
        )

    def belief(self, now_ns: int = 0) -> Belief:
        """The newest map from above, as of now where that is behind its moment: ground that nobody looks at
        turns stale also while nothing happens. Made anew for every moment, and once it is a second old."""
        with self.lock:
            moment, known = self.newest, self._belief
            number = 0 if moment is None else moment.number
            crowd_map = self.loop.crowd_map
            stamp_ns = self.read_at_ns(now_ns)
            if (
                known is not None
                and known.number == number
                and 0 <= stamp_ns - known.stamp_ns < _BELIEF_FRESH_NS
            ):
                return known
            made = belief_bytes(
                crowd_map,
                self.ground,
                stamp_ns,
                threshold=self.threshold,
                stale_after_s=self.config.zones.stale_after_s,
            )
            self._belief = Belief(number, stamp_ns, made)
            return self._belief

    def description(self, stamp_ns: int, first_stamp_ns: int | None) -> MapDescription:
        """Where the numbers of a moment come from, for the files made from it."""
        return MapDescription(
            stamp_ns=stamp_ns,
            threshold=self.threshold,
            method=self.loop.crowd_map.method.name,
            parameters=self.config.parameters(self.loop.crowd_map),
            first_stamp_ns=first_stamp_ns,
            drones=self.drones,
            mission=self.name,
        )

    def parameters(self) -> dict[str, Any]:
        return dict(self.config.parameters(self.loop.crowd_map))
