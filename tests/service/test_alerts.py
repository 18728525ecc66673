"""Alerts that several threads raise, clear and acknowledge at once."""

from pathlib import Path
from threading import Lock, Thread
from time import sleep
from types import TracebackType

from crowdfence.service.alerts import Alerts
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
