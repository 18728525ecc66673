"""Alerts that several threads raise, clear and acknowledge at once."""

from pathlib import Path
from random import Random
from threading import Lock, Thread
from time import sleep
from types import TracebackType

from crowdfence.service.alerts import AlertKind, Alerts, Level
from crowdfence.service.store import Store


class LockThatLetsOthersIn:
    """Whoever leaves it pauses: what other threads can do in between, they do."""

    def __init__(self) -> None:
        self._lock = Lock()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()
        sleep(0.1)


def at_once(*actions: object) -> None:
    threads = [Thread(target=action) for action in actions]  # type: ignore[arg-type]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def test_two_threads_that_meet_the_same_raise_one_alert(tmp_path: Path) -> None:
    store = Store(tmp_path, durable=False)
    try:
        alerts = Alerts(store)
        alerts._lock = LockThatLetsOthersIn()  # type: ignore[assignment]

        def raised() -> None:
            alerts.raise_("clock", "alarm", "uav1 is ahead", 1, drone="uav1")

        at_once(raised, raised)
        assert [alert.id for alert in alerts.all()] == ["A1"]
        alerts.clear("clock", 2, drone="uav1")
        assert alerts.active("clock", "uav1") is None
    finally:
        store.close()


def test_an_alert_that_is_over_while_somebody_acknowledges_it_is_over(tmp_path: Path) -> None:
    store = Store(tmp_path, durable=False)
    try:
        alerts = Alerts(store)
        name = alerts.raise_("clock", "alarm", "uav1 is ahead", 1, drone="uav1").id
        alerts._lock = LockThatLetsOthersIn()  # type: ignore[assignment]
        at_once(lambda: alerts.acknowledge(name, "ann", 2), lambda: alerts.clear("clock", 3, drone="uav1"))
        (alert,) = alerts.all()
        assert (alert.acknowledged_by, alert.cleared_ns) == ("ann", 3)
    finally:
        store.close()


def test_what_has_doubled_is_told_anew_and_what_grows_slowly_is_not(tmp_path: Path) -> None:
    store = Store(tmp_path, durable=False)
    try:
        alerts = Alerts(store)

        def told(measure: float) -> tuple[str, str]:
            alert = alerts.raise_("lost_crowd", "alarm", f"lost {measure}", 1, drone="uav1", measure=measure)
            return alert.id, alert.text

        assert told(10.0) == ("A1", "lost 10.0")
        assert told(19.0) == ("A1", "lost 10.0")
        assert told(20.0) == ("A1", "lost 20.0"), "nobody acknowledged it yet: one alert, with what holds now"
        alerts.acknowledge("A1", "ann", 2)
        assert told(39.0) == ("A1", "lost 20.0")
        assert told(40.0) == ("A2", "lost 40.0")
        old, new = sorted(alerts.all(), key=lambda alert: alert.id)
        assert (old.cleared_ns, new.cleared_ns, new.acknowledged_by) == (1, None, None)
    finally:
        store.close()


def test_what_is_active_is_what_a_look_at_all_alerts_finds(tmp_path: Path) -> None:
    """Through raising, clearing and acknowledging, beyond what is remembered, and after a restart."""
    store = Store(tmp_path, durable=False)
    chance = Random(7)
    drones, zones = ("uav1", "uav2", None), [None, *(f"Z{number}" for number in range(700))]
    kinds: tuple[AlertKind, ...] = ("drone_in_zone", "new_zone")

    def differences(alerts: Alerts) -> int:
        everything = alerts.all()[::-1]
        wrong = 0
        for kind in kinds:
            for drone in drones:
                alike = [
                    one
                    for one in everything
                    if one.cleared_ns is None and (one.kind, one.drone) == (kind, drone)
                ]
                wrong += drone is not None and alerts.all_active(kind, drone) != alike[::-1]
                for zone in zones[:40]:
                    first = next((one for one in alike if one.zone == zone), None)
                    wrong += alerts.active(kind, drone, zone) != first
        return wrong

    try:
        alerts = Alerts(store)
        for number in range(6000):
            kind, drone, zone = chance.choice(kinds), chance.choice(drones), chance.choice(zones)
            if chance.random() < 0.6:
                level: Level = "alarm" if kind == "drone_in_zone" else "info"
                alerts.raise_(kind, level, "there", number, drone=drone, zone=zone)
            elif chance.random() < 0.8:
                alerts.clear(kind, number, drone=drone, zone=zone)
            else:
                alerts.acknowledge(chance.choice(alerts.all()).id, "ann", number)
            if number % 500 == 0:
                assert differences(alerts) == 0
        assert len(alerts.all()) == 1000 and int(alerts.all()[0].id[1:]) > 1500
        store.flush()
        assert differences(alerts) == differences(Alerts(store)) == 0
    finally:
        store.close()


def test_what_is_over_at_a_stamp_before_it_happened_is_over(tmp_path: Path) -> None:
    """A zone is closed again now, because its dismissal ends, and views of a second ago, which waited for the
    detector, show nobody there: its alert stood for good."""
    store = Store(tmp_path, durable=False)
    try:
        alerts = Alerts(store)
        alerts.raise_("new_zone", "warning", "zone Z1 is closed again", 5_000_000_000, zone="Z1")
        alerts.clear("new_zone", 4_000_000_000, zone="Z1")
        assert alerts.active("new_zone", zone="Z1") is None
    finally:
        store.close()
