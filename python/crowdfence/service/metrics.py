"""Figures of the running service, for Prometheus."""

from __future__ import annotations

from collections.abc import Iterator

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import generate_latest
from prometheus_client.registry import Collector, CollectorRegistry

from crowdfence.service.service import Service


def metrics_text(service: Service) -> bytes:
    """As of now."""
    registry = CollectorRegistry()
    registry.register(_Figures(service))
    return generate_latest(registry)


class _Figures(Collector):
    def __init__(self, service: Service) -> None:
        self._service = service

    def describe(self) -> Iterator[Metric]:
        return iter(())

    def collect(self) -> Iterator[Metric]:
        service, mission = self._service, self._service.mission
        moment, crowd_map = mission.newest, mission.loop.crowd_map
        yield _gauge("crowdfence_voxels", "voxels of the map", mission.terrain.voxel_count)
        yield _gauge("crowdfence_voxels_seen", "voxels that some drone has seen", crowd_map.seen_count)
        yield _gauge("crowdfence_instants", "instants in the map", crowd_map.instant_count)
        yield _gauge("crowdfence_listeners", "WebSocket listeners", service.hub.listeners)
        yield _gauge(
            "crowdfence_listeners_cut_off", "WebSocket listeners that did not read", service.hub.cut_off
        )
        yield _gauge("crowdfence_store_waiting", "writes that are not on disk yet", service.store.waiting)
        yield _gauge("crowdfence_store_bytes", "size of the file", service.store.bytes)
        yield _gauge(
            "crowdfence_store_failing", "1: nothing can be written", float(service.store_trouble is not None)
        )
        alerts = GaugeMetricFamily(
            "crowdfence_alerts_active", "alerts that are not over", labels=["kind", "level"]
        )
        active = [(alert.kind, alert.level) for alert in service.alerts.all() if alert.cleared_ns is None]
        for kind, level in sorted(set(active)):
            alerts.add_metric([kind, level], active.count((kind, level)))
        yield alerts
        if moment is not None:
            yield _gauge("crowdfence_zones", "zones that are closed", len(moment.zones.closed))
            for name in ("seen_m2", "crowd_m2", "closed_m2"):
                yield _gauge(
                    f"crowdfence_{name}", f"{name.removesuffix('_m2')} ground", moment.figures.get(name, 0.0)
                )
            lag_s = max(0.0, (service.now_ns() - moment.stamp_ns) / 1e9)
            yield _gauge("crowdfence_lag_seconds", "age of the newest instant", lag_s)
        crowd = CounterMetricFamily(
            "crowdfence_crowd_mass",
            "heatmap value of crowd that was shown, by what became of it: only what met ground is on the map",
            labels=["drone", "fate"],
        )
        for drone, mass in sorted(dict(mission.loop.crowd_mass).items()):
            for fate, part in mass.by_fate().items():
                crowd.add_metric([drone, fate], part)
        yield crowd
        yield from self._of_drones()

    def _of_drones(self) -> Iterator[Metric]:
        live = self._service.live
        if live is None:
            return
        yield _gauge("crowdfence_queue", "views on disk that are not in the map yet", live.applying.waiting)
        yield _gauge(
            "crowdfence_detecting", "pictures that the detector works on", len(live.applying.detecting)
        )
        for name, text, counts in (
            ("accepted", "views that were acknowledged", live.heard.accepted),
            ("refused", "views that were not taken", live.heard.refused),
            ("late", "views that came too late for their instant", live.heard.late),
            ("left_out", "views of drones that an operator left out", live.heard.left_out),
        ):
            family = CounterMetricFamily(f"crowdfence_views_{name}", text, labels=["drone"])
            for drone, count in sorted(counts.items()):
                family.add_metric([drone], count)
            yield family
        lag = GaugeMetricFamily(
            "crowdfence_view_lag_seconds",
            "from its stamp to its arrival, of the quickest view of late; below 0 a clock is ahead",
            labels=["drone"],
        )
        for drone in sorted(dict(live.heard.lag)):
            lag_s = live.heard.lag_s(drone)
            if lag_s is not None:
                lag.add_metric([drone], lag_s)
        yield lag
        for name, histogram in (
            ("acknowledge", live.heard.acknowledging),
            ("publish", live.heard.publishing),
        ):
            yield histogram.metric(f"crowdfence_{name}_seconds")


def _gauge(name: str, text: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, text, value=float(value))
