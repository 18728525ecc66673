"""Records of the journal, in their order, into the state: grouped into instants, taken into the map.

The state follows from the journal alone. After a crash it is made again from the last snapshot and the
records behind it, and is the one that an uninterrupted service would have."""

from __future__ import annotations

import json
import logging
import queue
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from threading import Event, Thread

import numpy as np

from crowdfence._core import CrowdfenceError, Observation, View
from crowdfence.service.alerts import CALM_S, Alerts
from crowdfence.service.arrivals import Arrival, Content, stepped
from crowdfence.service.clock import Clock
from crowdfence.service.detecting import Detecting
from crowdfence.service.fleet import Fleet
from crowdfence.service.gate import Gate
from crowdfence.service.gathering import Gathering
from crowdfence.service.heard import Heard
from crowdfence.service.heatmap_doubts import HeatmapDoubts
from crowdfence.service.journal import Journal, PutAside, Record
from crowdfence.service.left_out import DroneAction
from crowdfence.service.media import Media, heatmap_png
from crowdfence.service.mission import Mission
from crowdfence.service.operator_zones import OperatorAction
from crowdfence.service.packing import packed, unpacked
from crowdfence.service.settings import ServiceSettings
from crowdfence.service.track import Sighting
from crowdfence.service.view_message import CameraMessage, ViewMessage
from crowdfence.sources.camera_mask import CameraMask
from crowdfence.sources.recording import RefusedFrame

_LOG = logging.getLogger(__name__)
_SECOND_NS = 1_000_000_000
_CLOSING = ("add", "lock", "leave_out")
"""What operators do that opens nothing."""
_APART_NS = 200_000
"""From one instant to one of the same stamp or an older one that comes behind it. Closer ones are taken for
stamps in a larger unit on the clock of a simulation (`crates/crowdfence/src/stamp.rs`)."""


class Applying:
    """`recover` first, then `start`: from there on one thread applies what is `put`; `stop` leaves a
    snapshot."""

    def __init__(
        self,
        mission: Mission,
        journal: Journal,
        fleet: Fleet,
        media: Media,
        alerts: Alerts,
        clock: Clock,
        settings: ServiceSettings,
        gate: Gate,
        heard: Heard,
        detector_threads: int,
        masks: Mapping[str, CameraMask],
    ) -> None:
        self._mission, self._journal, self._fleet, self._media = mission, journal, fleet, media
        self._alerts, self._clock, self._settings = alerts, clock, settings
        self._gate, self._heard, self._masks = gate, heard, masks
        self._doubts = HeatmapDoubts(alerts)
        self.detecting = Detecting(mission.heatmaps, detector_threads)
        self.gathering = self._no_gathering()
        self.last_ns: int | None = None
        """Stamp of the newest instant."""
        self.started_ns = 0
        """From when on drones are expected; with the clock of the views from the first one on."""
        self._applied = 0
        self._since_snapshot = 0
        self._recovering = False
        self._records: queue.Queue[Record | Event | None] = queue.Queue()
        self._acknowledged_s: dict[int, float] = {}
        self._decided: dict[int, Future[str]] = {}
        self._thread = Thread(target=self._apply_all, name="live", daemon=True)

    def _no_gathering(self) -> Gathering:
        return Gathering(
            tolerance_ns=int(self._mission.config.grouping.tolerance_ms * 1e6),
            max_delay_ns=int(self._settings.max_delay_ms * 1e6),
        )

    # -- from other threads ------------------------------------------------------------------------------

    def put(
        self, record: Record, *, acknowledged_s: float | None = None, decided: Future[str] | None = None
    ) -> None:
        """A record that is on disk; in the order of their places. `acknowledged_s`: when its giver was told,
        by a steady clock. `decided` gets the zone of an operator's action, or why it was not done."""
        if acknowledged_s is not None:
            self._acknowledged_s[record.seq] = acknowledged_s
        if decided is not None:
            self._decided[record.seq] = decided
        self._records.put(record)

    @property
    def waiting(self) -> int:
        """Records on disk that are not in the map yet."""
        return self._records.qsize()

    @property
    def behind_s(self) -> float:
        """How long the oldest view on disk has waited for its turn, behind others; 0 where none waits."""
        turns = [then_s for seq, then_s in list(self._acknowledged_s.items()) if seq > self._applied]
        return time.monotonic() - min(turns) if turns else 0.0

    def settled(self, timeout_s: float) -> None:
        """Wait until all that was put is applied. TimeoutError."""
        applied = Event()
        self._records.put(applied)
        if not applied.wait(timeout_s):
            raise TimeoutError(f"{self._records.qsize()} records wait after {timeout_s:g} s")

    @property
    def works(self) -> bool:
        """Whether views still go into the map."""
        return self._thread.is_alive()

    @property
    def newest_look_ns(self) -> int:
        """The newest stamp of what drones saw, in the map or on its way there; 0 for nothing."""
        with self._mission.lock:
            seen = self._mission.loop.crowd_map.span_ns
        sightings = [self._fleet.last(drone) for drone in self._fleet.drones]
        return max(
            0 if seen is None else seen[1],
            self.gathering.waits_until_ns,
            *(0 if last is None else last.stamp_ns for last in sightings),
        )

    # -- from beginning to end ---------------------------------------------------------------------------

    def recover(self) -> str | None:
        """Make the state again; what was left out of it because it is damaged, None for nothing. StoreError
        where what was accepted is not all there."""
        self._recovering = True
        with self._mission.with_static_of_before():
            self._journal.restore_newest(self._restore)
            records, aside = self._journal.after(self._applied)
            for record in records:
                self._apply(record)
            recovered = self._applied
            again = sum(self._close_again(record) for record in aside.operators)
        self._recovering = False
        if recovered or aside.records:
            told = {"records": len(records), "damaged": aside.records, "seq": recovered}
            _LOG.info("recovered: it is as after record %d of the journal", recovered, extra=told)
        return _left_out(aside, again) if aside.records else None

    def _close_again(self, record: Record) -> bool:
        """What an operator closed behind a damaged record is closed again: a view that cannot be read must
        not open it. What operators opened behind it stays closed. Whether there was something to do."""
        action = _action(record)
        with self._mission.lock:
            try:
                self._mission.check(action)
            except ValueError:  # of a zone that is not there any more
                return False
        if action.action not in _CLOSING:
            return False
        self._apply(self._journal.append_again(record))
        return True

    def apply_static(self) -> None:
        """Close the static zones of now, where those of before were others. Between `recover` and `start`."""
        if self._mission.apply_static(self._clock.now_ns()):
            self._since_snapshot += 1  # kept, so that the history goes on behind it
            self._snapshot()

    def start(self) -> None:
        self.started_ns = 0 if self._clock.kind == "views" else self._clock.now_ns()
        self._thread.start()

    def stop(self) -> None:
        """Once all that was put is applied."""
        self._records.put(None)
        self._thread.join()
        self.detecting.stop()

    # -- one record after the other ----------------------------------------------------------------------

    def _apply_all(self) -> None:
        while (record := self._records.get()) is not None:
            if isinstance(record, Event):
                record.set()
                continue
            self._apply(record)
            if record.kind in ("view", "observation"):
                self._gate.leave(record.drone)
            self._keep()
        self._snapshot()

    def _keep(self) -> None:
        """Never fails: the journal has all that a snapshot has, and views must go on into the map."""
        try:
            if self._since_snapshot >= self._settings.snapshot_every:
                self._snapshot()
            self._mission.keep_belief()
        except Exception:  # a moment without memory, of which a snapshot takes most
            _LOG.exception("the state after record %s could not be kept", self._applied)
            self._since_snapshot = 1  # not again with every record

    def _apply(self, record: Record) -> None:
        """Never fails: a record that cannot be used is refused, and the next one follows."""
        self._applied = record.seq
        self._since_snapshot += 1
        try:
            if record.kind == "operator":
                self._act(record)
            elif record.kind == "tick":
                self._take(self.gathering.advance(record.stamp_ns))
            elif record.kind == "look":
                self._take(self.gathering.advance(record.stamp_ns))
                self._look_again(record.stamp_ns - self.gathering.patience_ns)
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

    def _act(self, record: Record) -> None:
        mission = self._mission
        action = _action(record)
        decided = self._decided.pop(record.seq, None)
        with mission.lock:
            try:
                name = mission.do(action)
            except ValueError as error:  # somebody else was faster
                if decided is not None:
                    decided.set_exception(error)
                return
        if decided is not None:
            decided.set_result(name)

    def _look_again(self, stamp_ns: int) -> None:
        """No view came for long: zones as of a stamp that lies before every instant to come."""
        if self.last_ns is None or stamp_ns > self.last_ns:
            with self._mission.lock:
                self._mission.look_again(stamp_ns)
            self.last_ns = stamp_ns

    def _arrive(self, record: Record) -> None:
        arrival = self._arrival(record)
        self._clock.saw(record.stamp_ns)
        self._heard.view(record.drone, record.stamp_ns)
        self.started_ns = self.started_ns or record.stamp_ns
        self._take_with(*self.gathering.push(arrival))

    def _arrival(self, record: Record, near: bool | None = None) -> Arrival:
        """`near`: whether its look is at near ground alone, where that was decided before a restart."""
        if record.kind == "observation":
            return Arrival(record.seq, record.drone, record.stamp_ns, Observation.from_bytes(record.body))
        message = ViewMessage.model_validate_json(record.body)
        mask = self._masks.get(record.drone)
        try:
            if message.heatmap is not None:
                view = message.view(mask)
                place = view.world_from_camera[:3, 3]
                return Arrival(record.seq, record.drone, record.stamp_ns, view, position=place)
            frame = message.frame(mask)
        except ValueError as error:  # the mask is of now, the view of another camera before a restart
            refused = RefusedFrame(record.drone, record.stamp_ns, str(error))
            return Arrival(record.seq, record.drone, record.stamp_ns, refused)
        near = self.detecting.leaves_far_out(frame) if near is None else near
        return Arrival(
            record.seq,
            record.drone,
            record.stamp_ns,
            self.detecting.submit(frame, record.seq, near=near),
            image=frame.encoded_image(),
            position=frame.world_from_camera[:3, 3],
            near=near,
        )

    # -- one instant after the other ---------------------------------------------------------------------

    def _take(self, instants: Sequence[Sequence[Arrival]]) -> None:
        for group in instants:
            self._step(group, group[-1].stamp_ns)

    def _take_with(self, instants: Sequence[Sequence[Arrival]], too_late: Sequence[Arrival]) -> None:
        """And what came too late for its instant, each by itself."""
        self._take(instants)
        for late in too_late:
            self._heard.late[late.drone] += 1
            self._step([late], late.stamp_ns)

    def _step(self, group: Sequence[Arrival], stamp_ns: int) -> None:
        """Never fails: what cannot be taken in is refused, and the next instant follows. Zones, and some
        methods, need every instant after the one before; what was seen keeps its age."""
        if self.last_ns is not None and stamp_ns <= self.last_ns:
            stamp_ns = self.last_ns + _APART_NS
        acknowledged_s = [self._acknowledged_s.pop(arrival.seq, None) for arrival in group]
        try:
            # Waited for without the lock: a detector that does not answer holds up the map, not its readers.
            contents = [self._unless_still(arrival) for arrival in group]
            with self._mission.lock:
                self._step_counted(group, contents, stamp_ns)
        except Exception as error:  # a mistake of ours
            _LOG.exception("the instant %s could not be taken in", stamp_ns)
            self._refuse(group, f"the service failed: {type(error).__name__} {error}")
        finally:
            self.gathering.took(group)
        for then_s in acknowledged_s:
            if then_s is not None:
                self._heard.publishing.took(time.monotonic() - then_s)

    def _step_counted(self, group: Sequence[Arrival], contents: Sequence[Content], stamp_ns: int) -> None:
        """Without the looks of drones that are left out, which are shown all the same."""
        pairs = list(zip(group, contents, strict=True))
        counted = [pair for pair in pairs if pair[0].drone not in self._mission.left_out]
        for arrival, content in pairs:
            if arrival.drone in self._mission.left_out:
                self._heard.left_out[arrival.drone] += 1
                if isinstance(content, RefusedFrame):
                    self._refuse([arrival], content.reason)
                self._show(arrival, content)
        if not counted:
            self._look_again(stamp_ns)
            return
        newest_ns = counted[-1][0].stamp_ns
        if self.last_ns is None or newest_ns > self.last_ns:
            stamp_ns = newest_ns
        self._step_with([arrival for arrival, _ in counted], [content for _, content in counted], stamp_ns)

    def _unless_still(self, arrival: Arrival) -> Content:
        content = arrival.arrived()
        if not isinstance(content, View):
            return content
        by_picture = arrival.image is not None
        still = self._mission.still_video.refusal_of(content, lambda: arrival.image, of_picture=by_picture)
        return still or content

    def _step_with(self, group: Sequence[Arrival], contents: Sequence[Content], stamp_ns: int) -> None:
        try:
            step = stepped(self._mission.loop, contents, stamp_ns)
        except CrowdfenceError as error:
            self._step_without(group, contents, stamp_ns, error)
            return
        for refused in step.refused:
            self._refuse([one for one in group if one.drone == refused.drone], refused.reason)
        self.last_ns = stamp_ns
        for arrival, content in zip(group, contents, strict=True):
            if arrival.drone in step.drones and not self._recovering:
                now_ns = self._clock.now_ns()
                self._alerts.clear("refused_views", now_ns, drone=arrival.drone, calm_s=CALM_S)
                if isinstance(content, View):
                    self._doubts.look(content, now_ns)
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

    def _refuse(self, group: Sequence[Arrival], reason: str) -> None:
        for arrival in group:
            _LOG.warning(
                "view refused: %s", reason, extra={"drone": arrival.drone, "stamp_ns": arrival.stamp_ns}
            )
            self._heard.refused[arrival.drone] += 1
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

    def _show(self, arrival: Arrival, content: Content) -> None:
        if not isinstance(content, View):
            return
        self._fleet.saw(
            arrival.drone,
            Sighting(
                arrival.stamp_ns, content.camera, content.world_from_camera, arrival.image is not None, True
            ),
        )
        # Of a part of the picture: on the page the rest would flicker.
        if self._recovering or arrival.near or not self._media.wants(arrival.drone, arrival.stamp_ns):
            return
        self._media.keep("heatmap", arrival.drone, arrival.stamp_ns, heatmap_png(content.heatmap))
        if arrival.image is not None:
            self._media.keep("picture", arrival.drone, arrival.stamp_ns, arrival.image)

    # -- snapshots ---------------------------------------------------------------------------------------

    def _snapshot(self) -> None:
        if self._since_snapshot == 0:
            return
        with self._mission.lock:
            body = self.to_bytes()
        forget_ns = self._clock.now_ns() - round(self._settings.max_age_s * 2 * _SECOND_NS)
        self._journal.keep_snapshot(
            self._applied,
            body,
            needed_from=self.gathering.first_waiting(self._applied + 1),
            forget_before_ns=forget_ns,
        )
        self._since_snapshot = 0

    def to_bytes(self) -> bytes:
        """The state after the last record that was applied."""
        told = {
            **self.gathering.to_json(),
            "seq": self._applied,
            "far_looks": self.detecting.far_looks.to_json(),
            "last_ns": self.last_ns,
            "last_view_ns": dict(sorted(dict(self._heard.last_view_ns).items())),
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
        if told.get("seq", seq) != seq:  # builds of before did not say
            raise ValueError(f"snapshot {seq} is the one of record {told['seq']}")
        waiting = [record for place in told["waiting"] if (record := self._journal.record(place)) is not None]
        if len(waiting) < len(told["waiting"]):
            raise ValueError(f"snapshot {seq} needs records that are gone")
        last_ns, gathering = told["last_ns"], self._no_gathering()
        near, far_looks = set(told.get("near", ())), told.get("far_looks", {})  # builds of before had none
        arrivals = [self._arrival(record, record.seq in near) for record in waiting]
        instants, too_late = gathering.restore(told, arrivals)
        cameras = {
            drone: Sighting(stamp_ns, CameraMessage(**camera).camera(), np.array(pose), picture, True)
            for drone, (stamp_ns, camera, pose, picture) in told["cameras"].items()
        }
        heard: dict[str, int] = told.get("last_view_ns", {})  # builds of before kept it of cameras alone
        self._mission.restore(mission)
        self._applied, self.last_ns, self.gathering = seq, last_ns, gathering
        self.detecting.far_looks.restore(far_looks)
        for drone, stamp_ns in heard.items():
            self._heard.view(drone, stamp_ns)
            self._clock.saw(stamp_ns)
        for drone, sighting in cameras.items():
            self._fleet.saw(drone, sighting)
            self._clock.saw(sighting.stamp_ns)
        for record in waiting:
            self._heard.view(record.drone, record.stamp_ns)
            self._clock.saw(record.stamp_ns)
        self._take_with(instants, too_late)


def _action(record: Record) -> OperatorAction | DroneAction:
    told = json.loads(record.body)
    return DroneAction(**told) if "drone" in told else OperatorAction(**told)


def _left_out(aside: PutAside, again: int) -> str:
    """In words."""
    lines = [f"{aside.records} records at the end of the journal are damaged and put aside: zones may be old"]
    operators = len(aside.operators) + aside.unread_operators
    if operators:
        lines.append(
            f"{operators} of them tell what operators did, of which {again} that close are done again; the "
            "list of their actions has all"
        )
    return "; ".join(lines)
