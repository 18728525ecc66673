"""What is constant of the way from stamp to arrival, and what a network explains."""

from collections.abc import Iterable
from itertools import cycle, islice
from pathlib import Path

import pytest

from crowdfence import View
from crowdfence.service.clock import Clock
from crowdfence.service.service import Service
from crowdfence.service.view_lag import ViewLag
from crowdfence.service.watch import Watch
from support.small_service import SECOND_NS, START_NS, asked, message, running, settle, view


class Now:
    def __init__(self) -> None:
        self.ns = START_NS

    def clock(self) -> Clock:
        return Clock("system", system=lambda: self.ns, steady=lambda: self.ns)


def lagging(lags_s: Iterable[float], every_s: float = 1.0) -> ViewLag:
    lag = ViewLag()
    for number, lag_s in enumerate(lags_s):
        now_ns = START_NS + round(number * every_s * SECOND_NS)
        lag.came(now_ns - round(lag_s * SECOND_NS), now_ns)
    return lag


@pytest.mark.parametrize("lag_s", [1.6, 2.0, 5.0, -0.6, -1.9])
def test_a_constant_lag_that_no_network_explains_is_off(lag_s: float) -> None:
    jitter = cycle((0.0, 0.1, 0.3, 0.05))
    lags_s = [lag_s + one for one in islice(jitter, 20)]
    assert lagging(lags_s).is_off is True
    assert lagging(lags_s).least_s == pytest.approx(lag_s, abs=1e-6)
    assert lagging(lags_s[:9]).is_off is None, "nine seconds prove nothing"
    assert lagging(lags_s, every_s=0.1).is_off is None, "nor do two seconds, however many views they have"
    assert lagging([*lags_s, *[0.1] * 20]).is_off is False, "the clock was set right"


@pytest.mark.parametrize(
    ("lags_s", "is_off"),
    [
        ([0.05] * 20, False),
        ([0.9, 4.0] * 10, False),  # a link that chokes, and comes free now and then
        ([30.0 - number for number in range(20)], None),  # a backlog after an outage
        ([2.0, 2.9, 3.5, 5.0] * 5, None),  # a link that chokes all the time
        ([1.2] * 20, None),
        ([-0.2] * 20, False),
    ],
)
def test_what_networks_do_is_no_clock(lags_s: list[float], is_off: bool | None) -> None:
    assert lagging(lags_s).is_off is is_off


def test_before_the_first_view_nothing_is_known() -> None:
    assert ViewLag().least_s is None and ViewLag().is_off is None


def test_a_clock_a_few_seconds_behind_is_told(tmp_path: Path) -> None:
    """Too little for `drone_silent`, and its views were taken in late without a word."""
    now = Now()
    behind_s = {"uav1": 0.1, "uav2": 3.0, "uav3": -1.0}

    def give(service: Service, seconds: int) -> None:
        assert service.live is not None
        for _ in range(seconds):
            now.ns += SECOND_NS
            for drone, lag_s in behind_s.items():
                one = view(drone, 3)
                stamp_ns = now.ns - round(lag_s * SECOND_NS)
                given = View(drone, stamp_ns, one.camera, one.world_from_camera, one.heatmap)
                service.live.intake.give_view(message(given))
            settle(service)
            watch.look()

    with running(tmp_path, clock=now.clock()) as service, asked(service) as http:
        watch = Watch(service)
        give(service, 9)
        assert not [one for one in service.alerts.all() if one.kind == "stamps_off"]
        give(service, 3)
        late, early = (service.alerts.active("stamps_off", drone) for drone in ("uav2", "uav3"))
        assert service.alerts.active("stamps_off", "uav1") is None
        assert late is not None and early is not None and (late.level, early.level) == ("warning", "warning")
        assert late.text.startswith("all views of uav2 come 3.0 s or more after their stamps: ")
        assert early.text.startswith("views of uav3 come up to 1.0 s before their stamps: ")
        told = {one["drone"]: one["lag_s"] for one in http.get("/api/v1/drones").json()["drones"]}
        assert told == pytest.approx(behind_s)
        metrics = http.get("/metrics").text
        assert 'crowdfence_view_lag_seconds{drone="uav2"} 3.0' in metrics
        behind_s["uav2"] = 0.1
        give(service, 20)
        assert service.alerts.active("stamps_off", "uav2") is None


def test_the_clock_of_the_views_is_no_clock_to_lag_behind(tmp_path: Path) -> None:
    with running(tmp_path) as service, asked(service) as http:
        assert service.live is not None
        service.live.intake.give_view(message(view("uav1", 3)))
        service.live.finish()
        (told,) = http.get("/api/v1/drones").json()["drones"]
        assert told["lag_s"] is None
