"""What notices that something is wrong: silence, drones in zones, a clock that jumps, a disk that fills up.

Data that stops opens nothing: zones stay as they are, and somebody is told.
"""

from __future__ import annotations

import logging
import sqlite3
import time
from collections.abc import Iterable
from threading import Event, Thread

import numpy as np
from numpy.typing import NDArray

from crowdfence.iso_time import iso_utc
from crowdfence.pipeline import lost_crowd_warning
from crowdfence.service import alerts as alert_log
from crowdfence.service.alerts import CALM_S, AlertKind, Level
from crowdfence.service.heard import UNKNOWN
from crowdfence.service.heatmap_doubts import LEAST_LOOKED_AT
from crowdfence.service.operator_zones import passable
from crowdfence.service.recent_looks import WINDOW_S
from crowdfence.service.service import Service
from crowdfence.service.timeline import Moment, forget_before, trim_moments
from crowdfence.service.write_trouble import LEAST_FREE_BYTES, free_bytes
from crowdfence.sources.lens.doubtful import lens_doubt
from crowdfence.sources.reversed_attitude import leans_reversed, reversal_doubt
from crowdfence.zones import Zone
from crowdfence.zones.square_metres import square_metres

_LOG = logging.getLogger(__name__)
_EVERY_S = 1.0
_TIDY_EVERY_S = 60.0
_SECOND_NS = 1_000_000_000
_DETECTOR_STALE_S = 10.0
_FLEET_IS_THERE_S = 60.0
"""Without a new drone."""
_SMALL_SHARE = 0.05
"""Of lost crowd: what is less counts as so much where it is told that the share has doubled."""
_NO_ROOM = 1e9
"""Of the disk, times less than it should have: nothing can be written any more."""

_OF_ANOTHER_TIME = (
    "; where it is the clock, its views are given the poses of another time: crowd lies elsewhere"
)


class Watch:
    """Looks once a second, in a thread of its own."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._stopping = Event()
        self._thread = Thread(target=self._look_all, name="watch", daemon=True)
        self._tidied_s = time.monotonic()
        self._met: tuple[set[str], int] = set(), 0
        """All drones that came or are expected, and when the last one was new."""
        self._pose_causes: dict[str, str] = {}
        """Of the trouble of each drone's poses at the last look."""

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()
        self._thread.join()

    def _look_all(self) -> None:
        while not self._stopping.wait(_EVERY_S):
            try:
                self.look()
                if time.monotonic() - self._tidied_s > _TIDY_EVERY_S:
                    self._tidied_s = time.monotonic()
                    self.tidy()
            except Exception as error:  # a mistake of ours must not end all looking
                _LOG.exception("looking after the mission failed")
                text = (
                    f"looking for trouble failed, other alerts may be missing: {type(error).__name__} {error}"
                )
                self._set(True, "watch_failed", "alarm", text)
            else:
                self._set(False, "watch_failed", "alarm", "")

    def look(self) -> None:
        """Raise and clear what follows from how things stand now."""
        service = self._service
        if service.mode != "finished":
            self._silence()
        self._stamps_off()
        self._flood()
        self._doubles()
        self._poses()
        self._cameras()
        self._unused_options()
        self._detector()
        self._map_behind()
        self._same_answer()
        self._unlike_pictures()
        self._untested_ground()
        self._shrunk_pictures()
        self._no_ground()
        self._lost_crowd()
        self._unheeded_crowd()
        self._denied_crowd()
        self._crowds_apart()
        self._left_out()
        self._drones_and_zones()
        self._clock()
        self._disk()
        self._dismissals()

    def happened(self, moment: Moment, before: Moment | None) -> None:
        """A listener of the mission: new zones, and those that are closed again. After a crash also of what
        comes into the map anew; what was told of it before is not told again."""
        self._ended_dismissals(moment, before)
        for event in moment.zones.events:
            if event.kind in ("created", "split"):
                zone = next((one for one in moment.zones if one.id == event.id), None)
                if zone is not None:
                    whence = "appeared" if event.other is None else f"came out of {event.other}"
                    text = f"zone {zone.id} {whence}: {square_metres(zone.area_m2)} of crowd"
                    self._tell_of(zone.id, "info", text, moment.stamp_ns)
            elif event.kind in ("expired", "merged"):
                self._service.alerts.clear("new_zone", moment.stamp_ns, zone=event.id)

    def _tell_of(
        self, zone: str, level: Level, text: str, stamp_ns: int, dismissed_ns: int | None = None
    ) -> None:
        """Unless it was told, at this stamp or, where the clock may have ended a dismissal, since that."""
        alerts = self._service.alerts
        told_ns = [
            one.raised_ns
            for one in alerts.all()
            if one.zone == zone and one.kind == "new_zone" and one.text == text
        ]
        if stamp_ns in told_ns or (dismissed_ns is not None and max(told_ns, default=0) > dismissed_ns):
            return
        if level != "info":
            alerts.clear("new_zone", stamp_ns, zone=zone)
        alerts.raise_("new_zone", level, text, stamp_ns, zone=zone)

    def _ended_dismissals(self, moment: Moment, previous: Moment | None) -> None:
        """A dismissal that ends before its time, also where its ground goes on under another name: whoever
        flies through it must hear of it."""
        before, now, marks = _dismissed(previous), _dismissed(moment), moment.marks
        for_ns = round(self._service.settings.dismissed_for_s * _SECOND_NS)
        texts = {
            name: (f"zone {name} is closed again: it is no longer dismissed", before[name])
            for name in before.keys() - now.keys()
        }
        for event in moment.zones.events:
            old, new = (event.other, event.id) if event.kind == "split" else (event.id, event.other)
            if event.kind in ("split", "merged") and old in before and new is not None and new not in now:
                text = f"zone {new} closes ground of {old}, which was dismissed"
                texts.setdefault(new, (text, before[old]))
        for zone in moment.zones:
            if zone.id in texts and not marks.get(zone.id, {}).get("locked"):
                text, until_ns = texts[zone.id]
                self._tell_of(zone.id, "warning", text, moment.stamp_ns, until_ns - for_ns)

    def _silence(self) -> None:
        service, now_ns, live = self._service, self._service.now_ns(), self._service.live
        most_s, ahead_s = service.settings.silent_after_s, service.settings.max_ahead_s
        heard, started_ns = (
            ({}, 0) if live is None else (dict(live.heard.last_view_ns), live.applying.started_ns)
        )
        came = {} if live is None else dict(live.heard.came_ns)
        for drone in service.drones:
            last = service.fleet.last(drone)
            last_ns = max(0 if last is None else last.stamp_ns, heard.get(drone, 0))
            since_ns = last_ns or started_ns
            silent = since_ns > 0 and now_ns - since_ns > most_s * _SECOND_NS
            silent |= service.clock.kind == "system" and last_ns - now_ns > ahead_s * _SECOND_NS
            text = (
                f"no view from {drone} for more than {most_s:g} s, the last of {iso_utc(last_ns)}: zones stay"
                if last_ns
                else f"no view from {drone} since the start of the service, for more than {most_s:g} s: what "
                "it should look at is seen by nobody"
            )
            late_s = (came.get(drone, 0) - last_ns) / _SECOND_NS
            # One that is late by less was there in time: that none followed is what is wrong.
            is_late = late_s > most_s / 2.0
            if last_ns and is_late and 0 <= now_ns - came[drone] <= most_s * _SECOND_NS:
                text += (
                    f"; one came in that time, {late_s:.1f} s after its stamp: the clock of the drone is "
                    "behind, and poses that --mavlink tells for its views are those of then, or its link "
                    "keeps views back"
                )
            self._set(silent, "drone_silent", "alarm", text, drone=drone)

    def _stamps_off(self) -> None:
        """Views that are neither so late that `drone_silent` says it nor so wrong that the gate refuses them.
        Of drones that gave too few since the start to tell, what was raised before stays."""
        live = self._service.live
        if live is None:
            return
        for drone, lag in sorted(dict(live.heard.lag).items()):
            least_s, is_off = lag.least_s, lag.is_off
            if least_s is None or is_off is None:
                continue
            is_off &= least_s <= self._service.settings.silent_after_s
            by_feed = drone in live.poses.feeds
            self._set(
                is_off,
                "stamps_off",
                "alarm" if by_feed else "warning",
                _late_text(drone, least_s, by_feed)
                if least_s > 0.0
                else _early_text(drone, -least_s, by_feed),
                drone=drone,
                measure=abs(least_s),
            )

    def _flood(self) -> None:
        """Of views that nobody read no step says that it is over."""
        self._service.alerts.clear("refused_views", self._service.now_ns(), drone=UNKNOWN, calm_s=CALM_S)

    def _doubles(self) -> None:
        """Two drones under one name: when one falls silent, the other still gives views."""
        for drone in self._service.fleet.drones:
            apart_m = self._service.fleet.leaps_m(drone)
            if apart_m is None:
                continue
            text = (
                f"views of {drone} come from two places {apart_m:.0f} m apart by turns: two drones have one "
                "name, and nobody hears when one of them falls silent; or its poses jump"
            )
            self._set(apart_m > 0.0, "drone_doubled", "alarm", text, drone=drone)

    def _poses(self) -> None:
        live, now_ns = self._service.live, self._service.now_ns()
        if live is None:
            return
        for drone in live.poses.feeds:
            trouble = live.poses.trouble(drone, now_ns)
            if trouble is None:
                self._pose_causes.pop(drone, None)
                self._set(False, "pose_gap", "alarm", "", drone=drone)
                continue
            # Who acknowledged that two senders may be one drone has not acknowledged that both fell silent,
            # and who reads that it is silent looks in the wrong place once it speaks.
            is_other = self._pose_causes.get(drone, trouble.cause) != trouble.cause
            self._pose_causes[drone] = trouble.cause
            self._set(True, "pose_gap", "alarm", trouble.text, drone=drone, is_other=is_other)
        self._pose_frames(live.poses.frames(), len(live.poses.feeds))

    def _pose_frames(self, frames: dict[str, str], feeds: int) -> None:
        """Local poses that count from different frames. Of drones that told none since the start nobody
        knows: what was raised before stays."""
        if len(frames) < 2 <= feeds:
            return
        told = ", ".join(f"{drone} in {frame or '(no frame)'}" for drone, frame in frames.items())
        text = (
            f"poses come in frames that nothing joins ({told}): all are taken to count from --origin, and "
            "what one drone sees may be put far from what another sees there; name origin= of each in "
            "--topics, publish them in one frame, give tf= in --topics, with tf from that frame to each "
            "camera, or take them by --mavlink; where all autopilots were given one origin, acknowledge this"
        )
        apart = len(set(frames.values()))
        self._set(apart > 1, "pose_frames", "warning", text, measure=float(apart))

    def _cameras(self) -> None:
        """What a recording warns of when it is opened."""
        fleet = self._service.fleet
        for drone in fleet.drones:
            last, turns = fleet.last(drone), fleet.turns(drone)
            if last is None:
                continue
            lens = lens_doubt(last.camera)
            self._set(lens is not None, "doubtful_lens", "warning", f"{drone}: {lens}", drone=drone)
            attitudes = reversal_doubt(turns)
            # A camera that hangs level both ways, as one that looks straight down, ends nothing.
            if attitudes is not None or leans_reversed(turns):
                text = f"{drone}: {attitudes}"
                self._set(attitudes is not None, "reversed_attitudes", "warning", text, drone=drone)

    def _unused_options(self) -> None:
        """Offsets and masks for a drone that does not come: misspelled, they leave another as it is."""
        live, now_ns = self._service.live, self._service.now_ns()
        if live is None or not (live.poses.aligned or live.masks):
            return
        drones = {*self._service.mission.drones, *live.heard.last_view_ns, *live.poses.feeds}
        if drones != self._met[0]:
            self._met = drones, now_ns
        fleet_is_there = bool(drones) and now_ns - self._met[1] >= _FLEET_IS_THERE_S * _SECOND_NS
        unused: tuple[tuple[AlertKind, str, Iterable[str], str], ...] = (
            ("alignment_unused", "--alignment", live.poses.aligned, "poses stay as wrong as they are"),
            ("mask_unused", "--camera-mask", live.masks, "ground behind a drone's own parts is called empty"),
        )
        for kind, option, named, consequence in unused:
            for drone in named:
                text = (
                    f"{option} names {drone}, of which no view was taken; there are "
                    f"{', '.join(sorted(drones))}: under a misspelled name {consequence}"
                )
                if drone in drones or fleet_is_there:
                    self._set(drone not in drones, kind, "warning", text, drone=drone)

    def _detector(self) -> None:
        live = self._service.live
        if live is None:
            return
        oldest_s = live.applying.detecting.oldest_s
        stale = oldest_s is not None and oldest_s > _DETECTOR_STALE_S
        text = f"the detector has not answered for {_DETECTOR_STALE_S:g} s: pictures wait, zones stay"
        self._set(stale, "detector_stale", "alarm", text)
        for drone, still in self._service.mission.still_video.standing().items():
            self._set(still is not None, "detector_stale", "alarm", still or "", drone=drone)

    def _map_behind(self) -> None:
        """Zones as old as views wait are no better than those of a drone that is silent as long."""
        live, most_s = self._service.live, self._service.settings.silent_after_s
        if live is None:
            return
        behind_s = live.applying.behind_s
        if behind_s <= most_s:
            self._service.alerts.clear("map_behind", self._service.now_ns(), calm_s=CALM_S)
            return
        text = (
            f"views wait for {behind_s:.0f} s before they are taken into the map, because more come than it "
            "can take: zones show what was seen then, and crowd that came since closes nothing; give fewer "
            "views a second, or take a coarser map or a faster machine"
        )
        self._set(True, "map_behind", "alarm", text, measure=behind_s)

    def _same_answer(self) -> None:
        """A detector that does not see its pictures clears all ground, or closes it. Until it has answered
        often enough since the start, what was raised before stays."""
        heatmaps = self._service.mission.heatmaps
        is_known, text = heatmaps.watch.same_answer(LEAST_LOOKED_AT)
        if is_known or heatmaps.kind != "model":
            self._set(text is not None, "same_answer", "alarm", text or "")

    def _unlike_pictures(self) -> None:
        """Of drones that gave too few pictures since the start to tell, what was raised before stays."""
        for drone, text in self._service.mission.heatmaps.watch.mostly_unlike(LEAST_LOOKED_AT).items():
            self._set(text is not None, "unlike_pictures", "warning", text or "", drone=drone)

    def _untested_ground(self) -> None:
        """The same."""
        ground = self._service.mission.heatmaps.watch.ground
        for drone, text in ground.mostly_untested(LEAST_LOOKED_AT).items():
            self._set(text is not None, "untested_ground", "warning", text or "", drone=drone)

    def _shrunk_pictures(self) -> None:
        """Of drones whose newest view was a picture; a run warns of these before its first frame."""
        heatmaps, fleet = self._service.mission.heatmaps, self._service.fleet
        for drone in fleet.drones:
            last = fleet.last(drone)
            if last is None or not last.picture:
                continue
            told = heatmaps.shrunk([(last.camera.width, last.camera.height)])
            self._set(bool(told), "shrunk_pictures", "warning", f"{drone}: {'; '.join(told)}", drone=drone)

    def _no_ground(self) -> None:
        """Of drones that gave too little since the start to tell, what was raised before stays."""
        range_m = self._service.mission.config.projection.max_range_m
        for drone, meets_ground in self._service.mission.recent_looks.meets_ground().items():
            text = (
                f"no view of {drone} of the last {WINDOW_S:g} s shows ground of the map within {range_m:g} "
                "m: what it should look at is seen by nobody. Does its camera look at the horizon, or past "
                "the map?"
            )
            self._set(not meets_ground, "no_ground", "warning", text, drone=drone)

    def _lost_crowd(self) -> None:
        """Of drones that gave nothing since the start nobody knows: what was raised before stays."""
        for drone, mass in self._service.mission.recent_looks.masses().items():
            text = lost_crowd_warning(drone, mass)
            share = max(mass.lost / mass.total if text else 0.0, _SMALL_SHARE)
            self._set(text is not None, "lost_crowd", "alarm", text or "", drone=drone, measure=share)

    def _unheeded_crowd(self) -> None:
        mission, moment = self._service.mission, self._service.mission.newest
        if moment is None or not mission.unheeded_crowd.has_begun:  # what was raised before a restart stays
            return
        least_m2 = mission.config.zones.least_area_m2(mission.config.projection.coverage)
        found = mission.unheeded_crowd.beside(moment.zones.closed, mission.threshold, least_m2)
        text, measure = ("", None) if found is None else (found.text, found.area_m2)
        self._set(found is not None, "unheeded_crowd", "alarm", text, measure=measure)

    def _denied_crowd(self) -> None:
        """Of drones that looked little or not at all at what others showed since the start nobody knows: what
        was raised before stays. What one that is left out sees opens nothing. Who acknowledged it did so for
        what was seen until then: another occasion is told again."""
        mission, alerts, now_ns = self._service.mission, self._service.alerts, self._service.now_ns()
        undecided = mission.denied_crowd.undecided
        for drone, denial in mission.denied_crowd.now(now_ns).items():
            if denial is None and drone in undecided and drone not in mission.left_out:
                continue
            known = alerts.active("denied_crowd", drone)
            if denial is None or drone in mission.left_out:
                self._set(False, "denied_crowd", "alarm", "", drone=drone)
                continue
            seen_ns = None if known is None else known.acknowledged_ns
            is_new = seen_ns is not None and denial.since_ns > seen_ns
            alerts.raise_("denied_crowd", "alarm", denial.text, now_ns, drone=drone, is_new=is_new)

    def _crowds_apart(self) -> None:
        """Of a fleet that looked little or not at all at the same crowds since the start nobody knows: what
        was raised before stays."""
        apart, left_out = self._service.mission.crowds_apart, self._service.mission.left_out
        text = apart.now({action.drone for action in left_out})
        if text is not None or not apart.is_undecided:
            self._set(text is not None, "crowds_apart", "alarm", text or "")

    def _left_out(self) -> None:
        """As long as it lasts, so that nobody forgets that the fleet has one drone less that looks."""
        for drone in self._service.drones:
            action = self._service.mission.left_out.by(drone)
            text = (
                ""
                if action is None
                else f"{drone} was left out by {action.user} at {iso_utc(action.stamp_ns)} "
                f"({action.reason}): its looks do not count, and what it alone has in view is seen by nobody"
            )
            self._set(action is not None, "left_out", "warning", text, drone=drone)

    def _drones_and_zones(self) -> None:
        service, moment = self._service, self._service.mission.newest
        if moment is None:
            return
        closed = passable(moment.zones, moment.marks).closed
        places = service.fleet.places()
        for drone in sorted({*service.fleet.drones, *places}):
            inside, near = self._around(places[drone], closed) if drone in places else ([], [])
            unseen = self._of_zones(drone, inside, "drone_in_zone", "alarm", "is in zone")
            verb = f"is within {service.settings.near_m:g} m of zone"
            self._of_zones(drone, [] if unseen else near, "drone_near_zone", "warning", verb)

    def _around(self, position: NDArray[np.float64], closed: tuple[Zone, ...]) -> tuple[list[str], list[str]]:
        """Zones that a drone is in, and those within reach of it, the nearest first."""
        import shapely

        east, north, up = position
        place = shapely.Point(east, north)
        ground_m = float(self._service.raster.height_at(np.array([[east, north]]))[0])
        # Above a band above ground nothing is closed; where the ground is not known the comparison is false.
        in_band = [
            zone
            for zone in closed
            if zone.kind != "unseen" and not (zone.band.datum == "AGL" and up - ground_m > zone.band.upper_m)
        ]
        distances = sorted((zone.polygon.distance(place), zone.id) for zone in in_band)
        inside = [name for distance_m, name in distances if distance_m == 0.0]
        near = [name for distance_m, name in distances if 0.0 < distance_m <= self._service.settings.near_m]
        return inside, near

    def _of_zones(self, drone: str, zones: list[str], kind: AlertKind, level: Level, verb: str) -> bool:
        """One alert of a kind and drone that nobody acknowledged, and whether there is one: it stays with its
        zone as long as that is one of `zones`. Those that somebody acknowledged hide no other zone."""
        alerts, now_ns = self._service.alerts, self._service.now_ns()
        told = {alert.zone: alert for alert in alerts.all_active(kind, drone)}
        for zone in told.keys() - set(zones):
            alerts.clear(kind, now_ns, drone=drone, zone=zone)
        if any(told[zone].acknowledged_by is None for zone in zones if zone in told):
            return True
        untold = next((zone for zone in zones if zone not in told), None)
        if untold is not None:
            alerts.raise_(kind, level, f"{drone} {verb} {untold}", now_ns, drone=drone, zone=untold)
        return untold is not None

    def _clock(self) -> None:
        jump_s = self._service.clock.jumped_ns() / _SECOND_NS
        text = (
            f"the machine's clock was set by {jump_s:+.1f} s while the service runs, which goes on with the "
            "one that it began with: restart it to take the new one"
        )
        if jump_s < -self._service.settings.max_ahead_s:
            text += ", which it does with this folder once that clock has passed its newest view"
        self._set(jump_s != 0.0, "clock", "alarm", text, measure=abs(jump_s))

    def _disk(self) -> None:
        service = self._service
        service.store.note(lambda connection: None)  # tells how it stands, also while nobody writes
        if service.store_trouble is not None:
            text = f"nothing can be written, views are refused: {service.store_trouble}"
            self._set(True, "disk", "alarm", text, measure=_NO_ROOM)
            return
        free = free_bytes(service.store.path.parent)
        if free is None:
            return
        text = f"only {free / 1e6:.0f} MB are free for the journal"
        short = min(LEAST_FREE_BYTES / max(free, 1), _NO_ROOM / 2)
        self._set(free < LEAST_FREE_BYTES, "disk", "alarm", text, measure=short)

    def _dismissals(self) -> None:
        """A dismissed zone comes back when its time is over, also when no view comes."""
        service, mission = self._service, self._service.mission
        moment = mission.newest
        if moment is None or service.mode != "live":
            return
        now_ns = service.now_ns()
        ends = [int(mark["dismissed"]["until_ns"]) for mark in moment.marks.values() if mark.get("dismissed")]
        if ends and min(ends) <= now_ns:
            with mission.lock:
                mission.publish(max(now_ns, moment.stamp_ns))

    def _set(
        self,
        wrong: bool,
        kind: AlertKind,
        level: Level,
        text: str,
        *,
        drone: str | None = None,
        is_new: bool = False,
        measure: float | None = None,
        is_other: bool = False,
    ) -> None:
        alerts, now_ns = self._service.alerts, self._service.now_ns()
        if wrong:
            alerts.raise_(
                kind, level, text, now_ns, drone=drone, is_new=is_new, measure=measure, is_other=is_other
            )
        else:
            alerts.clear(kind, now_ns, drone=drone)

    def tidy(self) -> None:
        """Retention: what is too old, and pictures, maps and zones of the past beyond their room."""
        service = self._service
        oldest_ns = service.now_ns() - round(service.settings.keep_s * _SECOND_NS)
        room = int(service.settings.keep_media_mb * 1e6)

        def write(connection: sqlite3.Connection) -> None:
            forget_before(connection, oldest_ns)
            alert_log.forget_before(connection, oldest_ns)
            for table in ("media", "beliefs"):
                trim(connection, table, room)
            trim_moments(connection, room)
            connection.execute("DELETE FROM damaged WHERE received_ns < ?", (oldest_ns,))
            connection.execute("PRAGMA incremental_vacuum(1000)")

        service.store.note(write)


def _late_text(drone: str, late_s: float, by_feed: bool) -> str:
    text = (
        f"all views of {drone} come {late_s:.1f} s or more after their stamps: its clock is behind, or its "
        "link, its encoder or a detector on board holds each back as long; what it sees is taken in late"
    )
    return text + _OF_ANOTHER_TIME if by_feed else text


def _early_text(drone: str, early_s: float, by_feed: bool) -> str:
    text = (
        f"views of {drone} come up to {early_s:.1f} s before their stamps: its clock is ahead of that of "
        "this machine; what it sees stands against newer looks of others"
    )
    return text + _OF_ANOTHER_TIME if by_feed else text


def _dismissed(moment: Moment | None) -> dict[str, int]:
    """Zones that drones may pass, and until when."""
    marks = {} if moment is None else moment.marks
    return {name: int(mark["dismissed"]["until_ns"]) for name, mark in marks.items() if mark.get("dismissed")}


def trim(connection: sqlite3.Connection, table: str, room: int) -> None:
    """The oldest rows of a table go until bodies fit into `room` bytes."""
    (size,) = connection.execute(f"SELECT COALESCE(SUM(LENGTH(body)), 0) FROM {table}").fetchone()
    while size > room:
        connection.execute(
            f"DELETE FROM {table} WHERE stamp_ns <= (SELECT stamp_ns FROM {table} ORDER BY stamp_ns LIMIT 1 "
            f"OFFSET (SELECT COUNT(*) / 10 FROM {table}))"
        )
        (size,) = connection.execute(f"SELECT COALESCE(SUM(LENGTH(body)), 0) FROM {table}").fetchone()
