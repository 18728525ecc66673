"""A recording with truth, replayed under several configurations and scored against that truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMass, Observation, Terrain
from crowdfence.config import OrConfig, RunConfig
from crowdfence.errors import FrameError
from crowdfence.evaluation.cells.rates import Confusion, labelled_cells
from crowdfence.evaluation.iou import MeanIou
from crowdfence.evaluation.layer_measures import LayerMeasures
from crowdfence.evaluation.measures import Measures, SeenVoxels
from crowdfence.evaluation.probability_quality import ProbabilityQuality
from crowdfence.evaluation.safety import EVERY_S, CrowdsInView, CrowdWatch, Safety, near_columns
from crowdfence.evaluation.threshold_sweep import SweepResult, ThresholdSweep
from crowdfence.evaluation.untold_truth import UntoldTruth
from crowdfence.pipeline.clocks import check_clocks
from crowdfence.pipeline.detect import RECORDED, HeatmapSource, recorded_heatmaps
from crowdfence.pipeline.flight_doubts import FlightDoubts
from crowdfence.pipeline.frame_loop import FrameLoop
from crowdfence.pipeline.terrain import check_overlap
from crowdfence.pipeline.under_ground import under_ground_line
from crowdfence.pipeline.unheeded_crowd import UnheededInFlight
from crowdfence.sources.ground_contact import on_ground
from crowdfence.sources.layers import CROWD
from crowdfence.sources.no_frame import no_frame_line
from crowdfence.sources.recording import Instant, InstantViews, Recording, RefusedFrame
from crowdfence.truth.at_exposure import (
    MAX_PEOPLE_GAP_S,
    are_people_recorded,
    instants_with_people,
    people_at,
    timed_frame,
)
from crowdfence.truth.crowd_masks import crowd_mask, has_crowd_mask, require_crowd_masks
from crowdfence.truth.over_time import (
    CrowdsOfTheWorld,
    LayerOfTheWorld,
    ProjectedLabels,
    TruthAhead,
    TruthOverTime,
)
from crowdfence.zones.sorted_keys import united
from crowdfence.zones.zone_ground import ZoneGround

TruthKind = Literal["projected", "world"]
OnInstant = Callable[[Instant, InstantViews], None]

THRESHOLDS = np.concatenate([np.geomspace(1e-4, 0.009, 20), np.arange(0.01, 1.0, 0.01)])
"""Of the probability. A crowd is rare, so thresholds of a calibrated probability are small."""
MEANS = np.concatenate([np.arange(0.01, 0.99, 0.01), [0.985, 0.99, 0.995, 0.999]])
"""Of the mean heatmap value."""


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """How well one configuration found the crowd."""

    config: RunConfig
    threshold: float
    iou: MeanIou
    """Equation 4 at `threshold`."""
    sweep: SweepResult
    """Of `or`: over its `b_threshold`, its only knob."""
    safety: Safety | None
    """Who stands in a zone, once a second; None where the recording does not say where people are."""
    measures: Measures | None = None
    """What else a report shows, where it was asked for."""
    layer: LayerMeasures | None = None
    """What else is counted of a layer other than crowds, once a second."""
    unheeded: tuple[str, ...] = ()
    """Crowd that was shown and that nothing was closed for, in one sentence at most."""

    @property
    def quality(self) -> ProbabilityQuality | None:
        """Whether the probability means what it says, where it was counted."""
        counted = self.measures or self.layer
        return None if counted is None else counted.quality

    @property
    def knob(self) -> float:
        """What `iou` stands at: `threshold`, or the `b_threshold` of `or`, which has no other."""
        return self.config.method.b_threshold if isinstance(self.config.method, OrConfig) else self.threshold


class Scores(NamedTuple):
    """What a replay found: `rows, refused, crowd_mass, swept, doubts, stamps_ns = score(...)`."""

    rows: list[Score]
    """One per configuration, in their order."""
    refused: tuple[RefusedFrame, ...]
    """Frames that took no part."""
    crowd_mass: dict[str, CrowdMass]
    """Where the crowd in the pictures of each drone went, under the first configuration."""
    swept: list[Score]
    """One per configuration of `swept`; of these the IoU alone was counted."""
    doubts: tuple[str, ...]
    """What is doubtful about the views (`FlightDoubts`), one sentence each."""
    stamps_ns: tuple[int, ...]
    """The instants that were compared with the truth, in the order of every `MeanIou.per_frame`."""


class CellCounter:
    """Heatmap cells of labelled frames; those above `b_threshold` are called crowd, as equation 1 has it."""

    def __init__(self, b_threshold: float = 0.5, untold: UntoldTruth | None = None) -> None:
        """`untold` is told of labels that cannot be read."""
        self.b_threshold = b_threshold
        self._untold = UntoldTruth() if untold is None else untold
        self.counts = Confusion(0, 0, 0, 0)

    def add(self, instant: Instant, found: InstantViews) -> None:
        """The views of an instant; those of frames without a label do not count, nor do those of a part of
        their picture."""
        labelled = {frame.drone: frame for frame in instant.frames if has_crowd_mask(frame)}
        for view in found.views:
            frame = labelled.get(view.drone)
            if frame is None or not frame.is_whole(view):
                continue
            try:
                mask = crowd_mask(frame)
            except FrameError as error:
                self._untold.label(error)
                continue
            seen = ... if view.looked_at is None else view.looked_at
            for values, crowd in labelled_cells([view.heatmap], [mask]):
                self.counts += Confusion.of(values[seen] > self.b_threshold, crowd[seen])

    def nothing_shown_warning(self, layer: str) -> str | None:
        """One sentence where labels were counted, and none of them shows the class of the layer."""
        if self.counts.positives or not self.counts.negatives:
            return None
        return (
            f"no label shows {layer} on more than half of a heatmap cell: the IoU is 0 wherever a method "
            f"calls ground {layer}, however good it is; is that what the labels mean by their numbers or "
            "colours?"
        )

    def counted(self) -> Confusion:
        """The counts; ValueError when there was no labelled frame with a usable heatmap."""
        if self.counts.positives + self.counts.negatives == 0:
            raise ValueError("no frame has both a crowd label and a usable heatmap")
        return self.counts


def measured_rates(
    recording: Recording,
    heatmaps: HeatmapSource = RECORDED,
    *,
    b_threshold: float = 0.5,
    on_instant: OnInstant | None = None,
    untold: UntoldTruth | None = None,
) -> Confusion:
    """Heatmap cells of all labelled frames, called crowd above `b_threshold`: rates hold for a method of the
    same. `untold` is told of labels that cannot be read. ValueError when there are none."""
    require_crowd_masks(recording)
    cells = CellCounter(b_threshold, untold)
    for instant, found in heatmaps.detected(recording.instants(), len(recording.drones)):
        cells.add(instant, found)
        if on_instant is not None:
            on_instant(instant, found)
    return cells.counted()


def score(
    recording: Recording,
    terrain: Terrain,
    configs: Sequence[RunConfig],
    heatmaps: HeatmapSource = RECORDED,
    *,
    truth: TruthKind = "projected",
    on_instant: OnInstant | None = None,
    with_measures: bool = False,
    swept: Sequence[RunConfig] = (),
    untold: UntoldTruth | None = None,
) -> Scores:
    """Replay the recording once, feeding every configuration the same views, and score each.

    `truth` is "projected", the paper's (`ProjectedLabels`), or "world" (`CrowdsOfTheWorld`). The
    configurations must agree on how views are projected and grouped; what they leave open is filled in from
    the detector's contract; of their zones, thresholds, looks, the least area and how long ground stays empty
    count. ValueError when they do not, when there is none, when the recording does not hold that truth, or
    when no frame of it can be used.
    `with_measures`: all that a report shows, which takes about as long again. Of `swept`, further
    configurations, the IoU alone is counted. `untold` is told of frames whose truth cannot be told, which are
    left out; ValueError where that is so of all.
    """
    if not configs:
        raise ValueError("configs is empty: give a RunConfig for each method that is to be scored")
    if heatmaps is RECORDED and recording.layer == CROWD:
        heatmaps = recorded_heatmaps(recording)
    contract, layer = heatmaps.contract, recording.layer
    configs = [config.with_layer(layer, contract).with_detector(contract) for config in configs]
    swept = [config.with_layer(layer, contract).with_detector(contract) for config in swept]
    first, alike = configs[0], [*configs, *swept]
    if any((config.projection, config.grouping) != (first.projection, first.grouping) for config in alike):
        raise ValueError("configurations that are scored together must project and group views alike")
    recording = on_ground(recording, terrain)
    untold = UntoldTruth() if untold is None else untold
    crowds = _truth(truth, recording, terrain, first, untold)
    check_clocks(recording)
    check_overlap(recording, terrain, first.projection.max_range_m)
    drones = len(recording.drones)

    def loop(config: RunConfig) -> FrameLoop:
        crowd_map = config.crowd_map(terrain, drones, max_gap_s=float("inf"))
        return FrameLoop(crowd_map, config.zones, closes=False)  # what would be closed is counted by columns

    of_crowds = layer == CROWD
    measured = with_measures and of_crowds
    judged = [_Judged(config, loop(config), Measures() if measured else None) for config in configs]
    beside = [_Judged(config, loop(config), None) for config in swept]
    tested = None if contract is None else contract.validity
    needed = truth == "world" or measured
    knows_people = _knows_people(recording, first.grouping.tolerance_ms, untold, needed=needed)
    watch = CrowdWatch(recording, terrain, tested) if of_crowds and knows_people else None
    highest = np.zeros(terrain.voxel_count, np.float32)
    watched_ns = -np.inf
    looked = 0
    of_flight = FlightDoubts(heatmaps, layer)
    compared_ns: list[int] = []
    refused = list(recording.refused)
    instants = recording.instants(first.grouping.tolerance_ms)
    with ThreadPoolExecutor(1, thread_name_prefix="truth") as executor:
        ahead = TruthAhead(crowds, executor)
        for instant, found in heatmaps.detected(ahead.begun(instants), drones):
            # Views are projected once; the other maps take the observations.
            update = judged[0].loop.integrate(found.views, instant.stamp_ns)
            looked += len(update.observations)
            for one in [*judged[1:], *beside]:
                one.loop.integrate_observed(update.observations, instant.stamp_ns)
            for seen in update.observations:
                highest[seen.voxel_ids] = np.maximum(highest[seen.voxel_ids], seen.mean)
            shown_ids = np.empty(0, np.int64)
            for one in judged if of_crowds else ():
                shown_ids = united(shown_ids, one.hold(instant.stamp_ns, update.observations))
            of_flight.look(found.views, update.observations, shown_ids)
            crowd = untold.tried(ahead.next)
            if watch is not None:
                watch.saw(update.observations)
            if crowd is not None:
                compared_ns.append(instant.stamp_ns)
                for one in [*judged, *beside]:
                    one.compare(crowd, highest, instant.stamp_ns)
                if instant.stamp_ns - watched_ns >= EVERY_S * 1e9:
                    frame = timed_frame(instant) if knows_people else None
                    known = frame is not None and are_people_recorded(frame, recording)
                    if watch is not None and known:
                        in_view = untold.tried(partial(watch.at, instant))
                        if in_view is not None:
                            watched_ns = instant.stamp_ns
                            for one in judged:
                                one.watch(in_view, crowd, highest, instant.stamp_ns)
                    elif not of_crowds:
                        watched_ns = instant.stamp_ns
                        people = (
                            untold.tried(partial(people_at, frame, recording))
                            if frame is not None and known
                            else None
                        )
                        feet = None if people is None else people.position
                        for one in judged:
                            one.look_at_layer(crowd, feet, instant.stamp_ns)
            refused += found.refused
            if on_instant is not None:
                on_instant(instant, found)
    first_map = judged[0].loop.crowd_map
    if not looked:
        raise ValueError(no_frame_line(recording, refused))
    if first_map.seen_count == 0:
        why = under_ground_line(terrain, recording.frames) or of_flight.blind.upward_line()
        raise ValueError(
            f"no view saw the terrain within max_range_m = {first.projection.max_range_m:g} m: "
            f"{why or 'do map and poses share one frame?'}"
        )
    labelled = sum(has_crowd_mask(frame) for frame in recording.frames)
    told_of_none = (
        untold.labels == labelled if truth == "projected" else not compared_ns and bool(untold.first)
    )
    if told_of_none:
        raise ValueError(_told_of_none(recording, untold))
    rows = [one.score(safety=watch is not None) for one in judged]
    others = [one.score(safety=False) for one in beside]
    doubts = of_flight.warnings(recording.drones, first.projection.max_range_m)
    return Scores(rows, tuple(refused), judged[0].loop.crowd_mass, others, tuple(doubts), tuple(compared_ns))


def _knows_people(recording: Recording, tolerance_ms: float, untold: UntoldTruth, *, needed: bool) -> bool:
    """Whether it is recorded at any instant where people are; ValueError where that is `needed` and they are
    recorded, but at other times, or no frame says when it was exposed. `untold` is told of those."""
    if not len(recording.people.stamps_ns):
        return False
    timed = 0
    for frame in recording.frames:
        try:
            frame.exposure_ns()
            timed += 1
        except FrameError as error:
            untold.world(error)
    known = any(instants_with_people(recording, tolerance_ms))
    if needed and not timed and recording.frames:
        raise ValueError(_told_of_none(recording, untold))
    if needed and not known and recording.frames:
        raise ValueError(
            f"{recording.name} records where people are at no time within {MAX_PEOPLE_GAP_S} s of an "
            "exposure: are the clocks of the pictures and of the world the same?"
        )
    return known


def _told_of_none(recording: Recording, untold: UntoldTruth) -> str:
    return f"the truth of {recording.name} can be told of no frame: {untold.first}"


def unrecorded_warning(recording: Recording, tolerance_ms: float, truth: TruthKind) -> str | None:
    """One sentence where people are recorded, but not at every instant."""
    if not len(recording.people.stamps_ns):
        return None
    known = [one for one in instants_with_people(recording, tolerance_ms) if one is not None]
    if all(known):
        return None
    left_out = "the IoU and of who stands in a zone" if truth == "world" else "who stands in a zone"
    return (
        f"nobody's position is recorded within {MAX_PEOPLE_GAP_S} s of {known.count(False)} of "
        f"{len(known)} instants: they are left out of {left_out}"
    )


def _truth(
    kind: TruthKind, recording: Recording, terrain: Terrain, config: RunConfig, untold: UntoldTruth
) -> TruthOverTime:
    if kind == "world":
        of_world = CrowdsOfTheWorld if recording.layer == CROWD else LayerOfTheWorld
        return of_world(recording, terrain)
    projection = config.projection.with_detector(None)
    assert projection.target_height_m is not None
    return ProjectedLabels(
        recording,
        terrain,
        max_range_m=projection.max_range_m,
        target_height_m=projection.target_height_m,
        coverage=projection.coverage,
        surface=projection.surface,
        on_damaged=untold.label,
    )


class _Judged:
    """One configuration at work, and what is counted of it."""

    def __init__(self, config: RunConfig, loop: FrameLoop, measures: Measures | None) -> None:
        self.config, self.loop, self.measures = config, loop, measures
        self.safety = Safety()
        self._layer: LayerMeasures | None = None
        rules = config.zones.rules(loop.threshold, loop.crowd_map.coverage)
        self._ground = ZoneGround(loop.crowd_map, rules)
        self._unheeded = UnheededInFlight(
            loop.crowd_map.terrain,
            loop.crowd_map.method.b_threshold,
            loop.threshold,
            least_m2=rules.min_area_m2,
        )
        self._sweeps_mean = isinstance(config.method, OrConfig)
        self._knob = config.method.b_threshold if self._sweeps_mean else loop.threshold
        knobs = MEANS if self._sweeps_mean else THRESHOLDS
        self._sweep = ThresholdSweep([*knobs, self._knob], above=self._sweeps_mean)

    def compare(self, crowd: NDArray[np.bool_], highest: NDArray[np.float32], stamp_ns: int) -> None:
        """Against the crowd voxels [V]; highest [V] mean value so far decides what `or` says at every
        knob."""
        ids, probability = self.loop.crowd_map.seen_probability(stamp_ns)
        self._sweep.update(highest[ids] if self._sweeps_mean else probability, crowd[ids])

    def hold(self, stamp_ns: int, observations: Sequence[Observation]) -> NDArray[np.int64]:
        """Close and open ground, after every instant that may be watched, by what was taken in; the voxels
        that some look clearly shows as crowd by itself, sorted."""
        self._ground.step(stamp_ns)
        crowd_map = self.loop.crowd_map
        crowd_ids = crowd_map.crowd_ids(stamp_ns, threshold=self.loop.threshold)
        is_near = near_columns(self._ground, crowd_map.terrain.voxel_size_m)
        shown_ids = self._ground.closed.shown_ids
        self._unheeded.look(stamp_ns, observations, crowd_ids, shown_ids, is_near)
        return shown_ids

    def watch(
        self,
        crowds: CrowdsInView,
        crowd: NDArray[np.bool_],
        highest: NDArray[np.float32],
        stamp_ns: int,
    ) -> None:
        """Who stands where, against the ground that is held closed; arguments as for `compare`."""
        crowd_map, closed = self.loop.crowd_map, self._ground.columns
        stale_after_s = self.config.zones.stale_after_s
        self.safety.add(crowds, crowd_map, stamp_ns, self.loop.threshold, closed, stale_after_s)
        if self.measures is not None:
            ids, probability = crowd_map.seen_probability(stamp_ns)
            score = highest[ids].astype(np.float64) if self._sweeps_mean else probability
            seen = SeenVoxels(ids, probability, score, crowd[ids])
            self.measures.add(crowds, closed, crowd_map.terrain, seen, stamp_ns)

    def look_at_layer(
        self, truth: NDArray[np.bool_], people_enu: NDArray[np.floating[Any]] | None, stamp_ns: int
    ) -> None:
        """What the map of a layer says, against its truth [V] and where everybody stands [P, 3]."""
        self._layer = self._layer or LayerMeasures()
        self._layer.add(self.loop.crowd_map, stamp_ns, self.loop.threshold, truth, people_enu)

    def score(self, *, safety: bool) -> Score:
        result = self._sweep.result()
        counted = self.safety if safety else None
        at_knob = result.at(self._knob)
        unheeded = () if self._layer is not None else self._unheeded.warnings(self.loop.crowd_mass)
        return Score(
            self.config, self.loop.threshold, at_knob, result, counted, self.measures, self._layer, unheeded
        )
