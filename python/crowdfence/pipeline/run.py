"""A whole recording: frames -> heatmaps -> views of each instant -> crowd map and zones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdfence._core import CrowdMap, CrowdMass, Terrain, View
from crowdfence.config import RunConfig
from crowdfence.config.layer import low_threshold_doubt
from crowdfence.errors import quoted
from crowdfence.exports.frames_csv import FrameRow
from crowdfence.exports.map_description import MapDescription
from crowdfence.georeference import Georeference
from crowdfence.maps import MapHoles
from crowdfence.maps.voxel_size import coarse_voxels_warning
from crowdfence.pipeline.clocks import check_clocks
from crowdfence.pipeline.detect import HeatmapFunction, HeatmapSource, heatmap_source
from crowdfence.pipeline.detector_review import DetectorReview, review_detector
from crowdfence.pipeline.flight_doubts import FlightDoubts
from crowdfence.pipeline.frame_loop import FrameLoop, Step
from crowdfence.pipeline.lost_crowd import LOST, lost_crowd_warnings, shares
from crowdfence.pipeline.terrain import check_overlap, require_recording
from crowdfence.pipeline.under_ground import under_ground_line
from crowdfence.pipeline.unheeded_crowd import UnheededInFlight, near_zones
from crowdfence.sources.ground_contact import on_ground
from crowdfence.sources.layers import CROWD
from crowdfence.sources.no_frame import no_frame_line
from crowdfence.sources.recording import Instant, Recording, RefusedFrame
from crowdfence.zones import Zone, ZoneSet
from crowdfence.zones.history import ZoneHistory
from crowdfence.zones.known_ground import known_ground
from crowdfence.zones.tracker import column_keys

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector

OnStep = Callable[[Instant, Step], None]


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A recording fused to the end."""

    recording: Recording
    terrain: Terrain
    config: RunConfig
    """Complete: what was left to the detector is filled in."""
    heatmaps: HeatmapSource
    review: DetectorReview | None
    """None where no model made the heatmaps."""
    crowd_map: CrowdMap
    threshold: float
    rows: list[FrameRow]
    zones: ZoneSet
    """As of the last instant."""
    history: ZoneHistory
    """The zones at every instant."""
    refused: tuple[RefusedFrame, ...]
    """Every frame that took no part: those of the recording, then those met on the way."""
    last_views: dict[str, View]
    """Newest view of each drone."""
    holes: MapHoles | None
    """Holes of the map, where its reader counted them."""
    crowd_mass: dict[str, CrowdMass]
    """Where the crowd in the pictures of each drone went."""
    voxel_size_why: str = ""
    """Who chose the size of the voxels, where the map's reader said."""
    doubts: tuple[str, ...] = ()
    """What is doubtful about the map and what was taken from it, about the units of heatmaps, about drones
    that saw nothing of the map, or nobody where others did, and about videos that stood still, one sentence
    each."""
    unheeded: tuple[str, ...] = ()
    """Crowd that was shown and that nothing was closed for, in one sentence at most."""
    static_left_out: tuple[str, ...] = ()
    """What files of zones of others hold and closes nothing, one sentence each."""

    def __repr__(self) -> str:
        closed = f"{len(self.zones)} zones from {self.threshold:.3g} on"
        return (
            f"Run({self.recording.name!r}, {self.crowd_map.method.name}, {len(self.rows)} instants, {closed})"
        )

    @property
    def stamp_ns(self) -> int:
        """The last instant."""
        return self.rows[-1].stamp_ns

    @property
    def warnings(self) -> list[str]:
        """What is doubtful about the recording, the detector on this flight, the map under it, and the zones
        of others."""
        of_detector = [] if self.review is None else self.review.warnings
        lost = lost_crowd_warnings(self.crowd_mass) if self.recording.layer == CROWD else []
        of_pictures = [*of_detector, *self.heatmaps.warnings, *lost, *self.unheeded]
        return [*self.recording.warnings, *self.doubts, *of_pictures, *self.static_left_out]

    @property
    def georeference(self) -> Georeference | None:
        """Where on Earth the local frame lies, where the recording or the map knows."""
        return self.recording.georeference or self.terrain.georeference

    @property
    def description(self) -> MapDescription:
        """Where its numbers come from, for the files made from it."""
        return MapDescription(
            stamp_ns=self.stamp_ns,
            threshold=self.threshold,
            method=self.crowd_map.method.name,
            parameters=self.config.parameters(self.crowd_map),
            first_stamp_ns=self.rows[0].stamp_ns,
            drones=self.recording.drones,
            mission=self.recording.name,
            layer=self.recording.layer,
        )


def run(
    recording: Recording,
    terrain: Terrain,
    config: RunConfig | None = None,
    *,
    detector: Detector | HeatmapFunction | None = None,
    holes: MapHoles | None = None,
    voxel_size_why: str = "",
    map_doubts: Sequence[str] = (),
    static_zones: Sequence[Zone] = (),
    static_left_out: Sequence[str] = (),
    on_step: OnStep | None = None,
) -> Run:
    """Fuse a whole recording (`open_recording`) onto a terrain (`open_terrain`, which relates the two: the
    metres of `Terrain.open` may count from elsewhere). `on_step` is called after every instant, for progress
    or scores.

    `detector` makes the heatmaps: a `Detector` from the pictures, or any function frame -> heatmap [h, w];
    None takes the recorded ones. What `config` leaves open is filled in from a model's contract. `holes` are
    those of the map (`read_map`), for the summary, and so are `voxel_size_why` and `map_doubts`.
    `static_zones` are zones that somebody else drew, `static_left_out` what their files hold besides
    (`read_static_zones`), for the summary. A recording of another layer than crowds
    (`Recording.of_layer`) closes nothing else.

    ValueError when the configuration is out of bounds, recording and terrain have two local frames, the
    cameras are nowhere near the terrain, no frame can be used, or no view saw any of it; StampError where
    drones may have two clocks; TypeError for what is no recording, terrain, configuration or detector. Frames
    that cannot be used are in `Run.refused`.
    """
    require_recording(recording)
    if not isinstance(terrain, Terrain):
        raise TypeError(f"{quoted(terrain)} is no Terrain; `open_terrain` makes one of a map for a recording")
    config = RunConfig() if config is None else config
    if not isinstance(config, RunConfig):
        raise TypeError(
            f"{quoted(config)} is no RunConfig; a method goes into one: RunConfig(EvidenceConfig())"
        )
    max_range_m = config.projection.max_range_m
    recording = on_ground(recording, terrain)
    check_clocks(recording)
    check_overlap(recording, terrain, max_range_m)
    heatmaps = heatmap_source(
        detector,
        terrain,
        max_range_m,
        whole=config.whole_looks,
        layer=recording.layer,
        recording=recording,
    )
    review = review_detector(heatmaps, recording, terrain, config)
    config = config.with_layer(recording.layer, heatmaps.contract)
    config, doubts = config.with_detector(heatmaps.contract).with_terrain(terrain)
    coarse = coarse_voxels_warning(terrain.voxel_size_m)
    under = under_ground_line(terrain, recording.frames)
    low = low_threshold_doubt(config.method, config.zones.threshold, recording.layer)
    crowd_map = config.crowd_map(terrain, len(recording.drones), max_gap_s=float("inf"))
    loop = FrameLoop(crowd_map, config.zones, static_zones, closes=recording.layer == CROWD)
    rows: list[FrameRow] = []
    zone_sets: list[ZoneSet] = []
    refused = list(recording.refused)
    last_views: dict[str, View] = {}
    last: Step | None = None
    looked = 0
    instants = recording.instants(config.grouping.tolerance_ms)
    of_flight = FlightDoubts(heatmaps, recording.layer)
    unheeded = UnheededInFlight(
        terrain,
        crowd_map.method.b_threshold,
        loop.threshold,
        least_m2=config.zones.least_area_m2(crowd_map.coverage),
    )
    for instant, found in heatmaps.detected(instants, len(recording.drones)):
        last = loop.step(found.views, instant.stamp_ns, found.refused)
        seen = last.update.observations
        of_flight.look(found.views, seen, last.shown_ids)
        if recording.layer == CROWD:
            is_near = near_zones(last.zones.closed, terrain)
            unheeded.look(last.stamp_ns, seen, last.crowd_ids, last.shown_ids, is_near)
        looked += len(last.drones)
        rows.append(frame_row(last, terrain))
        zone_sets.append(last.zones)
        refused += last.refused
        last_views.update({view.drone: view for view in found.views})
        if on_step is not None:
            on_step(instant, last)
    if last is None or looked == 0:
        raise ValueError(no_frame_line(recording, refused))
    if last.seen_count == 0:
        why = under or of_flight.blind.upward_line() or "do map and poses share one frame?"
        raise ValueError(f"no view saw the terrain within max_range_m = {max_range_m:g} m: {why}")
    stamps_ns = [row.stamp_ns for row in rows]
    georeference = recording.georeference or terrain.georeference
    return Run(
        recording=recording,
        terrain=terrain,
        config=config,
        heatmaps=heatmaps,
        review=review,
        crowd_map=loop.crowd_map,
        threshold=loop.threshold,
        rows=rows,
        zones=last.zones,
        history=ZoneHistory(
            stamps_ns, zone_sets, georeference, _described(recording, config, loop), known_ground(terrain)
        ),
        refused=tuple(refused),
        last_views=last_views,
        holes=holes,
        crowd_mass={drone: loop.crowd_mass.get(drone, CrowdMass()) for drone in recording.drones},
        doubts=(
            *map_doubts,
            *doubts,
            *filter(None, (coarse, under, low)),
            *of_flight.warnings(recording.drones, max_range_m),
        ),
        unheeded=unheeded.warnings(loop.crowd_mass) if recording.layer == CROWD else (),
        voxel_size_why=voxel_size_why,
        static_left_out=tuple(static_left_out),
    )


def _described(recording: Recording, config: RunConfig, loop: FrameLoop) -> dict[str, Any]:
    """What the zones were made from, for files that explain themselves."""
    return {
        "mission": recording.name,
        "drones": list(recording.drones),
        "method": loop.crowd_map.method.name,
        "threshold": loop.threshold,
        "stale_after_s": config.zones.stale_after_s,
        "parameters": config.parameters(loop.crowd_map),
        "zone_rules": config.zone_parameters(loop.crowd_map.default_threshold()),
    }


def frame_row(step: Step, terrain: Terrain) -> FrameRow:
    """The figures of a step."""
    column = np.sort(column_keys(terrain.voxel_indices(step.crowd_ids)[:, :2]))
    columns = int(np.count_nonzero(np.diff(column))) + min(len(column), 1)
    lost = {f"crowd_{fate}": share for fate, share in shares(step.crowd_mass).items() if fate in LOST}
    return FrameRow(
        stamp_ns=step.stamp_ns,
        drones=step.drones,
        frames_refused=len(step.refused),
        voxels_seen=len(step.update.voxel_ids),
        voxels_seen_so_far=step.seen_count,
        crowd_voxels=len(step.crowd_ids),
        crowd_area_m2=columns * terrain.voxel_size_m**2,
        zones=len(step.zones),
        zones_area_m2=step.zones.area_m2,
        **lost,
    )
