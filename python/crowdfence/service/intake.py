"""What is given to a live service: checked, journaled, acknowledged. By any thread."""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import asdict
from functools import partial
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from crowdfence._core import Observation
from crowdfence.legible import legible
from crowdfence.service.alerts import Alerts
from crowdfence.service.applying import Applying
from crowdfence.service.clock import Clock, steady_s
from crowdfence.service.gate import Gate, Refused
from crowdfence.service.heard import UNKNOWN, Heard
from crowdfence.service.journal import Journal, Record, RecordKind
from crowdfence.service.left_out import DroneAction
from crowdfence.service.mission import Mission
from crowdfence.service.operator_zones import OperatorAction
from crowdfence.service.poses import Poses
from crowdfence.service.store import Write
from crowdfence.service.view_lag import ViewLag
from crowdfence.service.view_message import ViewMessage, first_problem
from crowdfence.sources.camera_mask import CameraMask

_DECIDED_WITHIN_S = 10.0


class Accepted(NamedTuple):
    """A view that is on disk."""

    seq: int
    duplicate: bool


class Intake:
    """Into the journal, and from there to `applying`."""

    def __init__(
        self,
        mission: Mission,
        journal: Journal,
        clock: Clock,
        gate: Gate,
        poses: Poses,
        masks: Mapping[str, CameraMask],
        heard: Heard,
        alerts: Alerts,
        applying: Applying,
    ) -> None:
        self._mission, self._journal, self._clock, self._gate = mission, journal, clock, gate
        self._poses, self._masks, self._heard = poses, masks, heard
        self._alerts, self._applying = alerts, applying

    def give_view(self, raw: bytes, drones: Sequence[str] = ()) -> Accepted:
        """A view as JSON, from somebody who may give those of `drones` (empty: any). Refused."""
        message = self._checked(raw)
        if message.image is not None and self._mission.heatmaps.kind == "recorded":
            reason = "this service runs no detector (--detector): send heatmaps"
            raise self._lost(422, reason, message.drone, message.stamp_ns)
        if message.world_from_camera is not None and not self._poses.aligns(message.drone):
            return self._give("view", message.drone, message.stamp_ns, lambda: raw, drones)
        return self._give("view", message.drone, message.stamp_ns, lambda: self._posed(message), drones)

    def _checked(self, raw: bytes) -> ViewMessage:
        """Refused for what can be no view."""
        try:
            message = ViewMessage.model_validate_json(raw)
        except ValidationError as error:
            raise self._lost(422, first_problem(error)) from error
        try:
            message.check(self._masks.get(message.drone))
        except ValueError as error:
            raise self._lost(422, str(error), message.drone, message.stamp_ns) from error
        return message

    def _lost(self, status: int, reason: str, drone: str = "", stamp_ns: int = 0) -> Refused:
        """Of a view that nobody can use, given again or not; without a drone where nobody could read whose it
        is. An operator hears of it: who gives it may look at no answer."""
        name = drone if drone in self._heard.accepted or drone in self._mission.drones else UNKNOWN
        self._heard.refused[name] += 1
        what = f"a view of {drone}" if drone else "what was given as a view"
        text = legible(f"{what} cannot be used, and is lost: {reason}")
        now_ns = self._clock.now_ns() or stamp_ns
        self._alerts.raise_("refused_views", "warning", text, now_ns, drone=name)
        return Refused(status, reason)

    def _posed(self, message: ViewMessage) -> bytes:
        """As it is journaled: with its right pose, so that a restart needs no telemetry and no alignment."""
        if message.world_from_camera is None:
            pose = self._poses.pose_at(message.drone, message.stamp_ns, self._clock.now_ns())
        else:
            pose = self._poses.righted(message.drone, np.array(message.world_from_camera))
        return message.posed(pose).model_dump_json().encode()

    def give_observation(self, raw: bytes, drones: Sequence[str] = ()) -> Accepted:
        """The bytes of an observation (`Observation.to_bytes`). Refused."""
        try:
            observation = Observation.from_bytes(raw)
        except ValueError as error:
            raise self._lost(422, str(error)) from error
        drone, stamp_ns, ours = observation.drone, observation.stamp_ns, self._mission.terrain.fingerprint
        if observation.terrain_fingerprint != ours:
            other = f"{observation.terrain_fingerprint:016x}"
            reason = f"the observation is of terrain {other}, not {ours:016x}"
            raise self._lost(422, reason, drone, stamp_ns)
        if self._poses.aligns(drone):
            reason = f"{drone} projects itself: it must be aligned there, not by --alignment here"
            raise self._lost(422, reason, drone, stamp_ns)
        if drone in self._masks:
            reason = f"{drone} projects itself: its pictures must be masked there, not by --camera-mask here"
            raise self._lost(422, reason, drone, stamp_ns)
        return self._give("observation", drone, stamp_ns, lambda: raw, drones)

    def _give(
        self, kind: RecordKind, drone: str, stamp_ns: int, body: Callable[[], bytes], drones: Sequence[str]
    ) -> Accepted:
        if drones and drone not in drones:
            mine = ", ".join(drones)
            reason = f"this token gives views of {mine}, not of {drone!r}"
            raise self._lost(403, reason, drone, stamp_ns)
        came_ns = self._clock.now_ns()  # it may wait for its pose then
        try:
            self._check_other_kind(kind, drone, stamp_ns)
            self._gate.enter(drone, stamp_ns)
            raw = self._body(drone, body)
        except Refused:
            self._heard.refused[drone if drone in self._heard.accepted else UNKNOWN] += 1
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
        self._heard.acknowledging.took(time.monotonic() - started_s)
        self._heard.view(drone, stamp_ns)
        self._heard.came_ns[drone] = self._clock.now_ns()
        if self._clock.kind == "system":
            self._heard.lag.setdefault(drone, ViewLag()).came(stamp_ns, came_ns)
        return Accepted(seq, duplicate=False)

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
        if here.drone in self._poses.feeds:
            there, here = (one.model_copy(update={"world_from_camera": None}) for one in (there, here))
        return there == here

    def _body(self, drone: str, body: Callable[[], bytes]) -> bytes:
        try:
            return body()
        except Refused:
            self._gate.leave(drone)
            raise

    def _journaled(self, record: Record, done: Future[int]) -> None:
        """In the thread that writes, so that records come in the order of their places."""
        if done.exception() is not None:
            self._gate.leave(record.drone)
            return
        self._heard.accepted[record.drone] += 1  # before the gate forgets the name
        self._heard.accepted_s = steady_s()
        self._applying.put(record.at(done.result()), acknowledged_s=time.monotonic())

    def decide(self, action: OperatorAction | DroneAction, beside: Write) -> str:
        """Do what an operator asks and write what belongs to it; the id of the zone or the name of the drone.
        RefusedAction; Refused where it cannot be kept."""
        with self._mission.lock:
            self._mission.check(action)
        body = json.dumps(asdict(action)).encode()
        record = Record(0, "operator", "", action.stamp_ns, self._clock.now_ns(), body)
        decided: Future[str] = Future()

        def journaled(done: Future[int]) -> None:
            if done.exception() is None:
                self._applying.put(record.at(done.result()), decided=decided)

        future = self._journal.append(record, journaled, beside)
        try:
            future.result()
        except sqlite3.Error as error:
            raise Refused(507, f"the action cannot be kept: {error}", 5.0) from error
        try:
            return decided.result(timeout=_DECIDED_WITHIN_S)
        except FutureTimeout as error:
            raise Refused(
                503, "it is on disk and will be done, after the pictures that wait for the detector"
            ) from error
