"""A service from its parts: a replay of a recording, or a live mission on a terrain."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from crowdfence._core import Terrain
from crowdfence.config import RunConfig
from crowdfence.detector.detector import Detector
from crowdfence.georeference import Georeference
from crowdfence.iso_time import iso_utc
from crowdfence.pipeline.clocks import check_clocks
from crowdfence.pipeline.detect import HeatmapSource, heatmap_source
from crowdfence.pipeline.terrain import check_overlap
from crowdfence.service.access import Access
from crowdfence.service.alerts import Alerts
from crowdfence.service.belief import check_side
from crowdfence.service.clock import Clock
from crowdfence.service.fleet import Fleet
from crowdfence.service.inputs import Inputs
from crowdfence.service.journal import Journal
from crowdfence.service.live import Live
from crowdfence.service.media import Media
from crowdfence.service.mission import Mission
from crowdfence.service.poses import Poses
from crowdfence.service.replay import Replay
from crowdfence.service.service import Service
from crowdfence.service.settings import ServiceSettings
from crowdfence.service.store import FILE, Store, StoreError
from crowdfence.service.timeline import Timeline
from crowdfence.service.watch import Watch
from crowdfence.sources.ground_contact import on_ground
from crowdfence.sources.no_frame import no_frame_line
from crowdfence.sources.recording import Recording
from crowdfence.zones import Zone


@contextmanager
def replayed(
    recording: Recording,
    terrain: Terrain,
    config: RunConfig,
    *,
    detector: Detector | None = None,
    speed: float = 1.0,
    settings: ServiceSettings | None = None,
    access: Access | None = None,
    static_zones: Sequence[Zone] = (),
) -> Iterator[Service]:
    """A recording plays as soon as the block begins. What it leaves behind goes with the block. ValueError as
    for `pipeline.run`, and for a map that is too long."""
    check_side(terrain)
    settings = settings or ServiceSettings()
    recording = on_ground(recording, terrain)
    if not recording.frames:
        raise ValueError(no_frame_line(recording, recording.refused))
    check_clocks(recording)
    check_overlap(recording, terrain, config.projection.max_range_m)
    max_range_m, whole = config.projection.max_range_m, config.whole_looks
    heatmaps = heatmap_source(detector, terrain, max_range_m, whole=whole, recording=recording)
    with TemporaryDirectory(prefix="crowdfence-") as folder:
        store = Store(Path(folder), durable=False)
        try:
            clock = Clock("views")
            service = _service(
                store,
                recording.name,
                terrain,
                recording.georeference or terrain.georeference,
                config.with_detector(heatmaps.contract),
                recording.drones,
                heatmaps,
                clock,
                settings,
                access,
                static_zones,
                bounds=_within_reach(recording, config.projection.max_range_m),
            )
            service.mode = "replay"
            replay = Replay(
                recording,
                service.mission,
                service.fleet,
                service.media,
                clock,
                service.alerts,
                speed=speed,
                on_end=lambda: service.set_mode("finished"),
            )
            watch = Watch(service)
            service.mission.listeners.append(watch.happened)
            watch.start()
            replay.start()
            try:
                yield service
            finally:
                replay.stop()
                watch.stop()
        finally:
            store.close()


@contextmanager
def live(
    folder: Path,
    terrain: Terrain,
    config: RunConfig,
    *,
    name: str,
    georeference: Georeference | None = None,
    drones: Sequence[str] = (),
    detector: Detector | None = None,
    detector_threads: int = 1,
    settings: ServiceSettings | None = None,
    access: Access | None = None,
    static_zones: Sequence[Zone] = (),
    clock: Clock | None = None,
    inputs: Inputs | None = None,
) -> Iterator[Service]:
    """A mission whose state is in `folder`; it goes on where it ended there, however it ended. `drones` are
    those that are expected, `inputs` what is listened to besides HTTP. StoreError for a folder that cannot be
    used, belongs to another mission, or ends ahead of the clock; ValueError for a mission or drone without a
    name, and for a map that is too long; ValueError and OSError as for `Inputs`."""
    if not all(word.strip() for word in (name, *drones)):
        raise ValueError(f"the mission {name!r} and its drones {list(drones)} need names that are not empty")
    check_side(terrain)
    settings = settings or ServiceSettings()
    clock = clock or Clock(settings.clock)
    heatmaps = heatmap_source(detector, terrain, config.projection.max_range_m, whole=config.whole_looks)
    store = Store(folder)
    try:
        config = config.with_detector(heatmaps.contract)
        anchor = georeference or terrain.georeference
        # Of another origin the terrain, which is laid around it, is another one too.
        store.belongs_to(
            origin=_origin(anchor),
            configuration=json.dumps(config.to_json(), sort_keys=True),
            terrain=f"{terrain.fingerprint:016x}",
        )
        service = _service(
            store,
            name,
            terrain,
            anchor,
            config,
            drones,
            heatmaps,
            clock,
            settings,
            access,
            static_zones,
        )
        inputs = inputs or Inputs()
        feeds = inputs.feeds(terrain, anchor)
        going = Live(
            service.mission,
            Journal(store),
            service.fleet,
            service.media,
            service.alerts,
            clock,
            settings,
            poses=Poses(
                feeds,
                wait_s=settings.pose_wait_s,
                stale_s=settings.pose_stale_s,
                started_ns=clock.now_ns(),
                max_ahead_s=settings.max_ahead_s if clock.kind == "system" else math.inf,
                offsets=inputs.offsets,
            ),
            masks=inputs.camera_masks,
            detector_threads=detector_threads,
        )
        watch = Watch(service)
        service.mission.listeners.append(watch.happened)
        damaged = going.applying.recover()
        clock.saw(going.newest_ns)
        service.fleet.restarted_ns = going.newest_ns
        _check_clock(store, clock, going.newest_ns, settings.max_ahead_s)
        told = [damaged, _commits_lost(store.lost_commits), _alerts_lost(service.alerts.unread)]
        lost = "; ".join(one for one in told if one)
        if lost:
            service.alerts.raise_("records_damaged", "alarm", lost, clock.now_ns())
            # It happened, and does not hold: the next time is told anew, and this one until somebody looked.
            service.alerts.clear("records_damaged", clock.now_ns())
        service.live = going
        if service.mission.newest is not None or clock.now_ns():  # else it has no place on a time line
            service.publish(service.moment(None))
        going.applying.apply_static()
        service.mission.end_dismissals_of_the_future()
        going.start()
        watch.start()
        try:
            with inputs.connected(service, feeds):
                yield service
        finally:
            watch.stop()
            going.stop()
    finally:
        store.close()


def _commits_lost(count: int) -> str | None:
    if not count:
        return None
    return (
        f"{count} commits at the end of {FILE}-wal cannot be read and are left out: views that were "
        "acknowledged and what operators decided may be gone, and zones may be old"
    )


def _alerts_lost(count: int) -> str | None:
    return f"{count} alerts of before are damaged, and what they told is not known" if count else None


def _check_clock(store: Store, clock: Clock, newest_ns: int, max_ahead_s: float) -> None:
    """StoreError for a state from the future. Looks of now would be older than what it knows already: a crowd
    that a drone sees would close nothing until time has caught up, and no alarm makes such zones right."""
    ahead_s = (newest_ns - clock.now_ns()) / 1e9
    if ahead_s > max_ahead_s:
        raise StoreError(
            f"what is in {store.path} ends at {iso_utc(newest_ns)}, {ahead_s:.1f} s ahead of this machine's "
            f"clock ({iso_utc(clock.now_ns())}): set the clock if it is wrong; if it is right, start again "
            "once it has passed that stamp, or begin with nothing seen in another folder (--data)"
        )


def _service(
    store: Store,
    name: str,
    terrain: Terrain,
    georeference: Georeference | None,
    config: RunConfig,
    drones: Sequence[str],
    heatmaps: HeatmapSource,
    clock: Clock,
    settings: ServiceSettings,
    access: Access | None,
    static_zones: Sequence[Zone],
    bounds: tuple[float, float, float, float] | None = None,
) -> Service:
    mission = Mission(
        name,
        terrain,
        georeference,
        config,
        drones,
        Timeline(store),
        heatmaps=heatmaps,
        static_zones=static_zones,
        dismissed_for_s=settings.dismissed_for_s,
        now_ns=clock.now_ns,
    )
    raster = mission.ground.raster(bounds)
    fleet = Fleet(
        drones,
        terrain,
        raster,
        max_range_m=config.projection.max_range_m,
        stale_after_s=settings.silent_after_s,
        max_ahead_s=settings.max_ahead_s,
    )
    return Service(
        mission=mission,
        raster=raster,
        fleet=fleet,
        media=Media(store),
        alerts=Alerts(store),
        access=access or Access(),
        store=store,
        clock=clock,
        settings=settings,
    )


def _origin(anchor: Georeference | None) -> str:
    """To a millimetre: one that is computed from a map again may differ in its last digits."""
    if anchor is None:
        return "none"
    degrees = (anchor.latitude_deg, anchor.longitude_deg)
    return json.dumps([*(round(one, 8) + 0.0 for one in degrees), round(anchor.height_m, 3) + 0.0])


def _within_reach(recording: Recording, max_range_m: float) -> tuple[float, float, float, float] | None:
    """West, south, east, north of what any camera can see."""
    if not recording.frames:
        return None
    places = np.array([frame.world_from_camera[:2, 3] for frame in recording.frames])
    (west, south), (east, north) = places.min(axis=0) - max_range_m, places.max(axis=0) + max_range_m
    return float(west), float(south), float(east), float(north)
