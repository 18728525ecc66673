"""What the clock completes where no view does; the journal says so."""

from __future__ import annotations

import logging
import sqlite3
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from threading import Event, Thread

from crowdfence.service.applying import Applying
from crowdfence.service.clock import Clock, steady_s
from crowdfence.service.heard import Heard
from crowdfence.service.journal import Journal, Record, RecordKind
from crowdfence.service.mission import Mission
from crowdfence.service.settings import ServiceSettings

_LOG = logging.getLogger(__name__)
_SECOND_NS = 1_000_000_000
_TICK_S = 0.1


class Ticker:
    """An instant that no view completes is completed by the clock, and ground that nobody looks at any more
    is closed by it. From `start` on, in a thread of its own."""

    def __init__(
        self,
        mission: Mission,
        journal: Journal,
        clock: Clock,
        settings: ServiceSettings,
        heard: Heard,
        applying: Applying,
    ) -> None:
        self._mission, self._journal, self._clock, self._settings = mission, journal, clock, settings
        self._heard, self._applying = heard, applying
        self._quiet_since_s = 0.0
        self._ticked_ns = self._looked_ns = 0
        self._stopping = Event()
        self._thread = Thread(target=self._run, name="ticker", daemon=True)

    def start(self) -> None:
        self._quiet_since_s = steady_s()
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()

    def tick(self, stamp_ns: int, kind: RecordKind = "tick") -> None:
        """It is so late; by a look, zones are made once more."""
        record = Record(0, kind, "", stamp_ns, self._clock.now_ns(), b"")
        future = self._journal.append(record, partial(self._ticked, record))
        with suppress(sqlite3.Error):  # the disk is full: told elsewhere, and tried again
            future.result()

    def _ticked(self, record: Record, done: Future[int]) -> None:
        if done.exception() is None:
            self._applying.put(record.at(done.result()))

    def _run(self) -> None:
        while not self._stopping.wait(_TICK_S):
            try:
                self._tick_if_due()
            except Exception:  # a mistake of ours, or a moment without memory, must not end all ticks
                _LOG.exception("the clock could complete nothing; it tries again")

    def _tick_if_due(self) -> None:
        now_ns = self._clock.now_ns()
        if self._applying.waiting:
            return
        if self._clock.kind == "views":
            self._tick_when_quiet()
            return
        again = now_ns - self._ticked_ns > self._settings.max_delay_ms * 1e6
        if again and self._applying.gathering.is_due(now_ns):
            self._ticked_ns = now_ns
            self.tick(now_ns)
        if now_ns - self._looked_ns > self._look_every_ns and self._has_nothing_new(now_ns):
            self._looked_ns = now_ns
            self.tick(now_ns, "look")

    def _tick_when_quiet(self) -> None:
        """The clock of the views stands still when none comes, as at the end of a simulation: the last ones
        would wait for good."""
        since_s = max(self._quiet_since_s, self._heard.accepted_s or 0.0)
        gathering = self._applying.gathering
        if gathering.drones and steady_s() - since_s > self._settings.quiet_s:
            self._quiet_since_s = steady_s()
            self.tick(gathering.end_ns)

    @property
    def _look_every_ns(self) -> float:
        return self._mission.config.zones.stale_after_s / 2 * _SECOND_NS

    def _has_nothing_new(self, now_ns: int) -> bool:
        """Whether ground that is open could have become unknown since the last zones were made."""
        last_ns = self._applying.last_ns
        if last_ns is None or not self._mission.config.zones.close_unseen:
            return False
        return now_ns - self._applying.gathering.patience_ns - last_ns > self._look_every_ns
