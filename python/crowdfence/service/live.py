"""Live views: checked, journaled, acknowledged, grouped into instants, taken into the map.

    give (any thread) -> journal -> apply (one thread, in the order of the journal) -> instants -> steps

The state follows from the journal alone. After a crash it is made again from the last snapshot and the
records behind it, and is the one that an uninterrupted service would have."""

from __future__ import annotations

import json
import logging
import queue
import sqlite3
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from threading import Event, Thread
from typing import NamedTuple

import numpy as np

from crowdfence._core import CrowdfenceError, Observation, View
from crowdfence.service.alerts import Alerts
from crowdfence.service.arrivals import Arrival, Content, stepped
from crowdfence.service.clock import Clock
from crowdfence.service.detecting import Detecting
from crowdfence.service.fleet import Fleet
from crowdfence.service.gate import Gate, Refused
from crowdfence.service.gathering import Gathering
from crowdfence.service.heatmap_doubts import HeatmapDoubts
from crowdfence.service.journal import Journal, Record, RecordKind
from crowdfence.service.latency import Latency
from crowdfence.service.media import Media, heatmap_png
from crowdfence.service.mission import Mission
from crowdfence.service.operator_zones import OperatorAction
from crowdfence.service.packing import packed, unpacked
from crowdfence.service.poses import Poses
from crowdfence.service.settings import ServiceSettings
from crowdfence.service.store import Write
from crowdfence.service.track import Sighting
from crowdfence.service.view_message import CameraMessage, ViewMessage

_LOG = logging.getLogger(__name__)
_SECOND_NS = 1_000_000_000
_MOST_DRONES = 1000
_TICK_S = 0.1
_DECIDED_WITHIN_S = 10.0
_APART_NS = 200_000
"""From one instant to one of the same stamp or an older one that comes behind it. Closer ones are taken for
stamps in a larger unit on the clock of a simulation (`crates/crowdfence/src/stamp.rs`)."""


class Accepted(NamedTuple):
    """A view that is on disk."""

    seq: int
    duplicate: bool


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
        detector_threads: int = 1,
    ) -> None:
        self._mission, self._journal, self._fleet, self._media = mission, journal, fleet, media
        self._alerts, self._clock, self._settings = alerts, clock, settings
        self._doubts = HeatmapDoubts(alerts)
        self._gathering = self._no_gathering()
        most = int(mission.loop.crowd_map.method.parameters.get("fleet_size", _MOST_DRONES))
        self._gate = Gate(clock, alerts, settings, fleet=self._known_drones, most_drones=most)
        self.poses = poses or Poses({}, wait_s=0.0, stale_s=0.0, started_ns=0)
        """Of drones whose views come without."""
        self._applied = 0
        self._since_snapshot = 0
        self._last_ns: int | None = None
        self._records: queue.Queue[Record | Event | None] = queue.Queue()
        self._done: dict[int, Future[str]] = {}
        self._recovering = False
        self.detecting = Detecting(mission.heatmaps, detector_threads)
        self._stopping = Event()
        self._applier = Thread(target=self._apply_all, name="live", daemon=True)
        self._ticker = Thread(target=self._tick_all, name="ticker", daemon=True)
        self.accepted: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.late: Counter[str] = Counter()
        self.last_view_ns: dict[str, int] = {}
        """Newest stamp of each drone that was accepted, also before a restart."""
        self.started_ns = 0
        """From when on drones are expected; with the clock of the views from the first one on."""
        self.acknowledging = Latency()
        """From the last byte of a view to its acknowledgement."""
        self.publishing = Latency()
        """From the acknowledgement to the zones that follow from it."""
        self._acknowledged_s: dict[int, float] = {}
        self._given_s = time.monotonic()
        """When the last view came."""
        self._accepted_s: float | None = None
        """When the last view was accepted since the start, by a steady clock."""

    def _no_gathering(self) -> Gathering:
        return Gathering(
            tolerance_ns=int(self._mission.config.grouping.tolerance_ms * 1e6),
            max_delay_ns=int(self._settings.max_delay_ms * 1e6),
        )

    # -- giving ------------------------------------------------------------------------------------------

    def give_view(self, raw: bytes, drones: Sequence[str] = ()) -> Accepted:
        """A view as JSON, from somebody who may give those of `drones` (empty: any). Refused; ValueError for
        what is no view."""
        message = ViewMessage.model_validate_json(raw)
        message.check()
        if message.image is not None and self._mission.heatmaps.kind == "recorded":
            raise Refused(422, "this service runs no detector (--detector): send heatmaps")
        if message.world_from_camera is not None and not self.poses.aligns(message.drone):
            return self._give("view", message.drone, message.stamp_ns, lambda: raw, drones)
        return self._give("view", message.drone, message.stamp_ns, lambda: self._posed(message), drones)

    def _posed(self, message: ViewMessage) -> bytes:
        """As it is journaled: with its right pose, so that a restart needs no telemetry and no alignment."""
        if message.world_from_camera is None:
            pose = self.poses.pose_at(message.drone, message.stamp_ns, self._clock.now_ns())
        else:
            pose = self.poses.righted(message.drone, np.array(message.world_from_camera))
        return message.posed(pose).model_dump_json().encode()

    def give_observation(self, raw: bytes, drones: Sequence[str] = ()) -> Accepted:
        """The bytes of an observation (`Observation.to_bytes`). Refused; ValueError for what is none."""
        observation = Observation.from_bytes(raw)
        ours = self._mission.terrain.fingerprint
        if observation.terrain_fingerprint != ours:
            raise Refused(
                422, f"the observation is of terrain {observation.terrain_fingerprint:016x}, not {ours:016x}"
            )
        if self.poses.aligns(observation.drone):
            raise Refused(
                422,
                f"{observation.drone} projects itself: it must be aligned there, not by --alignment here",
            )
        return self._give("observation", observation.drone, observation.stamp_ns, lambda: raw, drones)

    def _give(
        self, kind: RecordKind, drone: str, stamp_ns: int, body: Callable[[], bytes], drones: Sequence[str]
    ) -> Accepted:
        if drones and drone not in drones:
            raise Refused(403, f"this token gives views of {', '.join(drones)}, not of {drone!r}")
        try:
            self._check_other_kind(kind, drone, stamp_ns)
            self._gate.enter(drone, stamp_ns)
            raw = self._body(drone, body)
        except Refused:
            self.refused[drone if drone in self.accepted else "(unknown)"] += 1
            raise
        started_s = time.monotonic()
        record = Record(0, kind, drone, stamp_ns, self._clock.now_ns() or stamp_ns, raw)
        future = self._journal.append(record, partial(self._journaled, record))
        try:
            seq = future.result()
        except sqlite3.IntegrityError:
            place = self._journal.place_of(kind, drone, stamp_ns)
            if place is None:
                raise Refused(409, f"{drone} gave a view of {stamp_ns} before") from None
            if not self._is_same(place, kind, raw):
                raise Refused(
                    409, f"{drone} gave another view of {stamp_ns} before; that one counts"
                ) from None
            return Accepted(place, duplicate=True)
        except sqlite3.Error as error:
            raise Refused(507, f"the view cannot be kept: {error}", 5.0) from error
        self.acknowledging.took(time.monotonic() - started_s)
        self._heard(drone, stamp_ns)
        return Accepted(seq, duplicate=False)

    def _heard(self, drone: str, stamp_ns: int) -> None:
        self.last_view_ns[drone] = max(stamp_ns, self.last_view_ns.get(drone, 0))

    def _check_other_kind(self, kind: RecordKind, drone: str, stamp_ns: int) -> None:
        """Refused: a drone looks once at a stamp, whether it projects itself or not; the journal knows
        doubles of one kind alone."""
        other: RecordKind = "observation" if kind == "view" else "view"
        if self._journal.place_of(other, drone, stamp_ns) is not None:
            raise Refused(409, f"{drone} gave its {other} of {stamp_ns} before; that one counts")

    def _is_same(self, place: int, kind: RecordKind, raw: bytes) -> bool:
        """Whether the journal holds this very view. Poses from telemetry are left out: more of it may have
        come in between."""
        kept = self._journal.record(place)
        if kept is None or kept.body == raw:
            return kept is not None
        if kind != "view":
            return False
        there, here = (ViewMessage.model_validate_json(body) for body in (kept.body, raw))
        if here.drone in self.poses.feeds:
            there, here = (one.model_copy(update={"world_from_camera": None}) for one in (there, here))
        return there == here

    def _body(self, drone: str, body: Callable[[], bytes]) -> bytes:
        try:
            return body()
        except Refused:
            self._gate.leave(drone)
            raise

    def _known_drones(self) -> Iterable[str]:
        return (*self._mission.drones, *self.accepted, *self._gathering.drones)

    @property
    def waiting(self) -> int:
        """Records on disk that are not in the map yet."""
        return self._records.qsize()

    @property
    def silent_s(self) -> float | None:
        """How long no view has been accepted, whatever its stamp; before the first one since the start by the
        age of the newest that was there, None where there is none."""
        if self._accepted_s is not None:
            return time.monotonic() - self._accepted_s
        look_ns = self.newest_look_ns
        return max(0.0, (self._clock.now_ns() - look_ns) / _SECOND_NS) if look_ns else None

    def _journaled(self, record: Record, done: Future[int]) -> None:
        """In the thread that writes, so that records come in the order of their places."""
        if done.exception() is not None:
            self._gate.leave(record.drone)
            return
        seq = done.result()
        self.accepted[record.drone] += 1  # before the gate forgets the name
        self._acknowledged_s[seq] = self._given_s = self._accepted_s = time.monotonic()
        self._records.put(_placed(record, seq))

    # -- deciding ----------------------------------------------------------------------------------------

    def decide(self, action: OperatorAction, beside: Write) -> str:
        """Do what an operator asks and write what belongs to it; the id of the zone. RefusedAction; Refused
        where it cannot be kept."""
        with self._mission.lock:
            newest = self._mission.newest
            zones = self._mission.found if newest is None else newest.zones
            self._mission.operator_zones.check(action, zones)
        body = json.dumps(asdict(action)).encode()
        record = Record(0, "operator", "", action.stamp_ns, self._clock.now_ns(), body)
        done: Future[str] = Future()

        def journaled(future: Future[int]) -> None:
            if future.exception() is None:
                self._done[future.result()] = done
                self._records.put(_placed(record, future.result()))

        future = self._journal.append(record, journaled, beside)
        try:
            future.result()
        except sqlite3.Error as error:
            raise Refused(507, f"the action cannot be kept: {error}", 5.0) from error
        try:
            return done.result(timeout=_DECIDED_WITHIN_S)
        except FutureTimeout as error:
            raise Refused(
                503, "it is on disk and will be done, after the pictures that wait for the detector"
            ) from error

    # -- applying ----------------------------------------------------------------------------------------

    def recover(self) -> int:
        """Make the state again; how many damaged records were left out. Before `start`. StoreError where what
        was accepted is not all there."""
        self._recovering = True
        self._journal.restore_newest(self._restore)
        records, damaged = self._journal.after(self._applied)
        for record in records:
            self._apply(record)
        self._recovering = False
        _LOG.info("recovered", extra={"records": len(records), "damaged": damaged, "seq": self._applied})
        return damaged

    @property
    def newest_ns(self) -> int:
        """The newest stamp of the state; 0 for none. Safe before `start` alone."""
        newest = self._mission.newest
        return max(self.newest_look_ns, self._last_ns or 0, 0 if newest is None else newest.stamp_ns)

    @property
    def newest_look_ns(self) -> int:
        """The newest stamp of what drones saw, in the map or on its way there; 0 for nothing."""
        with self._mission.lock:
            seen = self._mission.loop.crowd_map.span_ns
        sightings = [self._fleet.last(drone) for drone in self._fleet.drones]
        return max(
            0 if seen is None else seen[1],
            self._gathering.waits_until_ns,
            *(0 if last is None else last.stamp_ns for last in sightings),
        )

    def apply_static(self) -> None:
        """Close the static zones of now, where those of before were others. Between `recover` and `start`."""
        if self._mission.apply_static(self._clock.now_ns()):
            self._since_snapshot += 1  # kept, so that the history goes on behind it
            self._snapshot()

    @property
    def works(self) -> bool:
        """Whether views still go into the map."""
        return self._applier.is_alive()

    def start(self) -> None:
        self.started_ns = 0 if self._clock.kind == "views" else self._clock.now_ns()
        self._applier.start()
        # A replay says itself when it is over, and may be as slow as it likes.
        if self._clock.kind == "system" or self._settings.clock == "views":
            self._given_s = time.monotonic()
            self._ticker.start()

    def settled(self, timeout_s: float) -> None:
        """Wait until all that is on disk is applied. TimeoutError."""
        applied = Event()
        self._records.put(applied)
        if not applied.wait(timeout_s):
            raise TimeoutError(f"{self._records.qsize()} records wait after {timeout_s:g} s")

    def finish(self) -> None:
        """No view follows: what waits becomes instants now. The journal says so."""
        self.settled(30.0)
        self._tick(self._gathering.end_ns)
        self.settled(30.0)

    def stop(self) -> None:
        self._stopping.set()
        self._records.put(None)
        self._applier.join()
        self.detecting.stop()

    def _apply_all(self) -> None:
        while (record := self._records.get()) is not None:
            if isinstance(record, Event):
                record.set()
                continue
            self._apply(record)
            if record.kind in ("view", "observation"):
                self._gate.leave(record.drone)
            if self._since_snapshot >= self._settings.snapshot_every:
                self._snapshot()
            self._mission.keep_belief()
        self._snapshot()

    def _apply(self, record: Record) -> None:
        """Never fails: a record that cannot be used is refused, and the next one follows."""
        self._applied = record.seq
        self._since_snapshot += 1
        try:
            if record.kind == "operator":
                self._act(record)
            elif record.kind == "tick":
                self._take(self._gathering.advance(record.stamp_ns))
            elif record.kind == "look":
                self._take(self._gathering.advance(record.stamp_ns))
                self._look_again(record.stamp_ns - self._gathering.patience_ns)
            else:
                self._arrive(record)
        except Exception as error:  # a mistake of ours: one record must not stop all that follow
            _LOG.exception("record %s could not be applied", record.seq)
            self._alerts.raise_(
                "refused_views",
                "alarm",
                f"record {record.seq} ({record.kind}) could not be applied: {error}",
                self._clock.now_ns(),
                is_new=True,
            )

    def _arrive(self, record: Record) -> None:
        arrival = self._arrival(record)
        self._clock.saw(record.stamp_ns)
        self._heard(record.drone, record.stamp_ns)
        self.started_ns = self.started_ns or record.stamp_ns
        instants, too_late = self._gathering.push(arrival)
        self._take(instants)
        for late in too_late:
            self.late[late.drone] += 1
            self._step([late], late.stamp_ns)

    def _take(self, instants: Sequence[Sequence[Arrival]]) -> None:
        for group in instants:
            self._step(group, group[-1].stamp_ns)

    def _step(self, group: Sequence[Arrival], stamp_ns: int) -> None:
        """Never fails: what cannot be taken in is refused, and the next instant follows. Zones, and some
        methods, need every instant after the one before; what was seen keeps its age."""
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            stamp_ns = self._last_ns + _APART_NS
        acknowledged_s = [self._acknowledged_s.pop(arrival.seq, None) for arrival in group]
        try:
            # Waited for without the lock: a detector that does not answer holds up the map, not its readers.
            contents = [self._unless_still(arrival.arrived()) for arrival in group]
            with self._mission.lock:
                self._step_with(group, contents, stamp_ns)
        except Exception as error:  # a mistake of ours
            _LOG.exception("the instant %s could not be taken in", stamp_ns)
            self._refuse(group, f"the service failed: {type(error).__name__} {error}")
        finally:
            self._gathering.took(group)
        for then_s in acknowledged_s:
            if then_s is not None:
                self.publishing.took(time.monotonic() - then_s)

    def _unless_still(self, content: Content) -> Content:
        if not isinstance(content, View):
            return content
        return self._mission.still_video.refusal_of(content) or content

    def _step_with(self, group: Sequence[Arrival], contents: Sequence[Content], stamp_ns: int) -> None:
        try:
            step = stepped(self._mission.loop, contents, stamp_ns)
        except CrowdfenceError as error:
            self._step_without(group, contents, stamp_ns, error)
            return
        for refused in step.refused:
            self._refuse([one for one in group if one.drone == refused.drone], refused.reason)
        self._last_ns = stamp_ns
        for arrival, content in zip(group, contents, strict=True):
            if arrival.drone in step.drones and not self._recovering:
                self._alerts.clear("refused_views", self._clock.now_ns(), drone=arrival.drone)
                if isinstance(content, View):
                    self._doubts.look(content, self._clock.now_ns())
            self._show(arrival, content)
        self._mission.stepped(step)

    def _step_without(
        self, group: Sequence[Arrival], contents: Sequence[Content], stamp_ns: int, error: CrowdfenceError
    ) -> None:
        """One view that cannot be used does not take the others of its instant with it. The core names the
        drone where a view is at fault, and nobody where the instant is."""
        at_fault = next((one for one in group if f"drone '{one.drone}'" in str(error)), None)
        if at_fault is None or len(group) == 1:
            self._refuse(group, str(error))
            return
        self._refuse([at_fault], str(error))
        left = [pair for pair in zip(group, contents, strict=True) if pair[0] is not at_fault]
        self._step_with([arrival for arrival, _ in left], [content for _, content in left], stamp_ns)

    def _look_again(self, stamp_ns: int) -> None:
        """No view came for long: zones as of a stamp that lies before every instant to come."""
        if self._last_ns is None or stamp_ns > self._last_ns:
            with self._mission.lock:
                self._mission.look_again(stamp_ns)
            self._last_ns = stamp_ns

    def _refuse(self, group: Sequence[Arrival], reason: str) -> None:
        for arrival in group:
            _LOG.warning(
                "view refused: %s", reason, extra={"drone": arrival.drone, "stamp_ns": arrival.stamp_ns}
            )
            self.refused[arrival.drone] += 1
            if arrival.position is not None:
                self._fleet.was_at(arrival.drone, arrival.stamp_ns, arrival.position)
            if not self._recovering:
                self._alerts.raise_(
                    "refused_views",
                    "warning",
                    f"a view of {arrival.drone} could not be used: {reason}",
                    self._clock.now_ns(),
                    drone=arrival.drone,
                    is_new=True,
                )

    def _act(self, record: Record) -> None:
        mission = self._mission
        action = OperatorAction(**json.loads(record.body))
        done = self._done.pop(record.seq, None)
        with mission.lock:
            zones = mission.found if mission.newest is None else mission.newest.zones
            try:
                zone = mission.operator_zones.do(action, zones)
            except ValueError as error:  # somebody else was faster
                if done is not None:
                    done.set_exception(error)
                return
            newest_ns = 0 if mission.newest is None else mission.newest.stamp_ns
            mission.publish(max(action.stamp_ns, newest_ns))
        if done is not None:
            done.set_result(zone)

    def _arrival(self, record: Record) -> Arrival:
        if record.kind == "observation":
            return Arrival(record.seq, record.drone, record.stamp_ns, Observation.from_bytes(record.body))
        message = ViewMessage.model_validate_json(record.body)
        if message.heatmap is not None:
            view = message.view()
            place = view.world_from_camera[:3, 3]
            return Arrival(record.seq, record.drone, record.stamp_ns, view, position=place)
        frame = message.frame()
        detected, place = self.detecting.submit(frame, record.seq), frame.world_from_camera[:3, 3]
        image = frame.encoded_image()
        return Arrival(record.seq, record.drone, record.stamp_ns, detected, image=image, position=place)

    def _show(self, arrival: Arrival, content: Content) -> None:
        if not isinstance(content, View):
            return
        self._fleet.saw(
            arrival.drone,
            Sighting(
                arrival.stamp_ns, content.camera, content.world_from_camera, arrival.image is not None, True
            ),
        )
        if self._recovering or not self._media.wants(arrival.drone, arrival.stamp_ns):
            return
        self._media.keep("heatmap", arrival.drone, arrival.stamp_ns, heatmap_png(content.heatmap))
        if arrival.image is not None:
            self._media.keep("picture", arrival.drone, arrival.stamp_ns, arrival.image)

    # -- time and snapshots ------------------------------------------------------------------------------

    def _tick_all(self) -> None:
        """An instant that no view completes is completed by the clock, and ground that nobody looks at any
        more is closed by it; the journal says so."""
        ticked_ns = looked_ns = 0
        while not self._stopping.wait(_TICK_S):
            now_ns = self._clock.now_ns()
            if self._records.qsize():
                continue
            if self._clock.kind == "views":
                self._tick_when_quiet()
                continue
            again = now_ns - ticked_ns > self._settings.max_delay_ms * 1e6
            if again and self._gathering.is_due(now_ns):
                ticked_ns = now_ns
                self._tick(now_ns)
            if now_ns - looked_ns > self._look_every_ns and self._has_nothing_new(now_ns):
                looked_ns = now_ns
                self._tick(now_ns, "look")

    def _tick_when_quiet(self) -> None:
        """The clock of the views stands still when none comes, as at the end of a simulation: the last ones
        would wait for good."""
        if self._gathering.drones and time.monotonic() - self._given_s > self._settings.quiet_s:
            self._given_s = time.monotonic()
            self._tick(self._gathering.end_ns)

    @property
    def _look_every_ns(self) -> float:
        return self._mission.config.zones.stale_after_s / 2 * _SECOND_NS

    def _has_nothing_new(self, now_ns: int) -> bool:
        """Whether ground that is open could have become unknown since the last zones were made."""
        if self._last_ns is None or not self._mission.config.zones.close_unseen:
            return False
        return now_ns - self._gathering.patience_ns - self._last_ns > self._look_every_ns

    def _tick(self, stamp_ns: int, kind: RecordKind = "tick") -> None:
        record = Record(0, kind, "", stamp_ns, self._clock.now_ns(), b"")
        future = self._journal.append(record, partial(self._ticked, record))
        with suppress(sqlite3.Error):  # the disk is full: told elsewhere, and tried again
            future.result()

    def _ticked(self, record: Record, done: Future[int]) -> None:
        if done.exception() is None:
            self._records.put(_placed(record, done.result()))

    def _snapshot(self) -> None:
        if self._since_snapshot == 0:
            return
        with self._mission.lock:
            body = self.to_bytes()
        forget_ns = self._clock.now_ns() - round(self._settings.max_age_s * 2 * _SECOND_NS)
        self._journal.keep_snapshot(
            self._applied,
            body,
            needed_from=self._gathering.first_waiting(self._applied + 1),
            forget_before_ns=forget_ns,
        )
        self._since_snapshot = 0

    def to_bytes(self) -> bytes:
        """The state after the last record that was applied."""
        told = {
            **self._gathering.to_json(),
            "last_ns": self._last_ns,
            "last_view_ns": dict(sorted(dict(self.last_view_ns).items())),
            "cameras": {
                drone: [
                    last.stamp_ns,
                    CameraMessage.of(last.camera).model_dump(),
                    last.world_from_camera.tolist(),
                    last.picture,
                ]
                for drone in self._fleet.drones
                if (last := self._fleet.last(drone)) is not None
            },
        }
        return packed(json.dumps(told).encode(), self._mission.to_bytes())

    def _restore(self, seq: int, body: bytes) -> None:
        """All of a snapshot or, where it fails, nothing: the one before it may do."""
        told_bytes, mission = unpacked(body)
        told = json.loads(told_bytes)
        waiting = [record for place in told["waiting"] if (record := self._journal.record(place)) is not None]
        if len(waiting) < len(told["waiting"]):
            raise ValueError(f"snapshot {seq} needs records that are gone")
        last_ns, gathering = told["last_ns"], self._no_gathering()
        gathering.restore(told, [self._arrival(record) for record in waiting])
        cameras = {
            drone: Sighting(stamp_ns, CameraMessage(**camera).camera(), np.array(pose), picture, True)
            for drone, (stamp_ns, camera, pose, picture) in told["cameras"].items()
        }
        heard: dict[str, int] = told.get("last_view_ns", {})  # builds of before kept it of cameras alone
        self._mission.restore(mission)
        self._applied, self._last_ns, self._gathering = seq, last_ns, gathering
        for drone, stamp_ns in heard.items():
            self._heard(drone, stamp_ns)
            self._clock.saw(stamp_ns)
        for drone, sighting in cameras.items():
            self._fleet.saw(drone, sighting)
            self._clock.saw(sighting.stamp_ns)
        for record in waiting:
            self._heard(record.drone, record.stamp_ns)
            self._clock.saw(record.stamp_ns)


def _placed(record: Record, seq: int) -> Record:
    return Record(seq, record.kind, record.drone, record.stamp_ns, record.received_ns, record.body)
