"""What a recording holds, and whether its times, poses and views fit together."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdfence._core import Terrain, View
from crowdfence.errors import FrameError, StampError
from crowdfence.georeference import Georeference
from crowdfence.inspection.camera import CameraReport, distinct_cameras
from crowdfence.inspection.depth_agreement import DepthAgreement, depth_agreement
from crowdfence.inspection.flight import FlightReport
from crowdfence.inspection.terrain import TerrainReport
from crowdfence.inspection.timing import InstantSummary, Timing
from crowdfence.inspection.view_overlap import ViewOverlap, evenly_spread, measure_overlap
from crowdfence.iso_time import iso_utc
from crowdfence.maps import MapHoles
from crowdfence.maps.voxel_size import coarse_voxels_warning
from crowdfence.sources.ground_contact import on_ground
from crowdfence.sources.recording import Frame, Recording, RefusedFrame

if TYPE_CHECKING:
    from crowdfence.inspection.options import InspectionOptions

Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class HeatmapReport:
    """Size of the first heatmap that can be read."""

    width: int
    height: int
    dtype: str
    stride: float
    """Image columns per heatmap column."""


@dataclass(frozen=True, slots=True)
class PixelCounts:
    """Usable frames that hold each kind of pixels."""

    images: int
    heatmaps: int
    regions: int
    silhouettes: int
    depth: int


@dataclass(frozen=True, slots=True)
class DroneReport:
    """One drone of a recording."""

    drone: str
    frames: Timing
    """Usable frames; where frames were refused, there is a gap."""
    refused: int
    telemetry: Timing
    cameras: tuple[CameraReport, ...]
    """Usually one; several when the intrinsics change in flight."""
    heatmap: HeatmapReport | None
    pixels: PixelCounts
    flight: FlightReport
    depth: DepthAgreement | None


@dataclass(frozen=True, slots=True)
class Trouble:
    """Frames with the same trouble, numbers aside."""

    count: int
    drones: tuple[str, ...]
    first: str
    """The first of them in full."""


@dataclass(frozen=True, slots=True)
class TerrainBelow:
    """The map that belongs to a recording."""

    path: str
    given: bool
    """Whether the caller named it; otherwise the recording did."""
    report: TerrainReport | None
    problem: str | None
    """Why it cannot be used."""
    holes: MapHoles | None = None
    """None for a map that is no height model."""
    read_with: Mapping[str, Any] = field(default_factory=dict)
    """Options that the recording says its map is to be read with."""


@dataclass(frozen=True, slots=True)
class RecordingReport:
    """A recording, measured. What needs a terrain is None without one."""

    path: str
    kind: str
    """mission, airsim, folder, ROS 1 bag ..."""
    name: str
    frames: int
    first_frame: str | None
    """ISO 8601 UTC; None without usable frames."""
    last_frame: str | None
    duration_s: float
    drones: tuple[DroneReport, ...]
    instants: InstantSummary
    georeference: Georeference | None
    """Where (0, 0, 0) lies: of the recording, else as its map is told (`georeference`, `assume_local`)."""
    terrain: TerrainBelow | None
    """None: the recording names no map and none was given."""
    overlap: ViewOverlap | None
    refused: tuple[Trouble, ...]
    """Frames that do not take part, by reason, the most frequent first."""
    damaged: tuple[Trouble, ...] | None
    """Usable frames with pixels that cannot be read; None: not looked for (`check_pixels`)."""
    warnings: tuple[str, ...]
    layers: tuple[str, ...] = ()
    """Other classes than crowd that it holds heatmaps of."""


def inspect_recording(
    path: Path, terrain_path: Path | None, options: InspectionOptions, tell: Tell
) -> RecordingReport:
    """ValueError or OSError for a path that holds no usable recording, MapError for a `terrain_path` that
    cannot be read or be read as `terrain_options` say. A map that the recording itself names may be
    unreadable; the report says so then.
    """
    from crowdfence.pipeline.heatmap_units import HeatmapUnits
    from crowdfence.sources import open_recording

    tell(f"reading {path.name}")
    recording = open_recording(path, **options.source_options)
    terrain, below, doubts = _open_terrain(recording, terrain_path, options, tell)
    if terrain is not None:
        recording = on_ground(recording, terrain)
    instants = list(recording.instants(options.tolerance_ms))
    damaged, of_pixels = None, list[str]()
    if options.check_pixels:
        units = HeatmapUnits()
        damaged = group_trouble(check_pixels(recording.frames, tell, units.look))
        of_pixels = units.warnings
    overlap = None
    if terrain is not None and not options.quick:
        overlap = measure_overlap(
            instants,
            recording.drones,
            terrain,
            max_range_m=options.max_range_m,
            samples=options.sampled_instants,
            tell=tell,
        )
    doubts = (*doubts, *_what_a_run_doubts(recording, terrain), *of_pixels)
    told = options.terrain_options.get("georeference")
    tell("measuring flights")
    span = recording.span_ns
    return RecordingReport(
        path=str(path),
        kind=str(recording.manifest.get("kind", "recording")),
        name=recording.name,
        frames=len(recording.frames),
        first_frame=None if span is None else iso_utc(span[0]),
        last_frame=None if span is None else iso_utc(span[1]),
        duration_s=0.0 if span is None else (span[1] - span[0]) / 1e9,
        drones=tuple(_drone(recording, drone, terrain, options) for drone in recording.drones),
        instants=InstantSummary.of(instants, recording.drones, options.tolerance_ms),
        georeference=recording.georeference or (told if terrain is None else terrain.georeference),
        terrain=below,
        overlap=overlap,
        refused=tuple(group_trouble(recording.refused)),
        damaged=None if damaged is None else tuple(damaged),
        warnings=(*recording.warnings, *doubts),
        layers=recording.layers,
    )


def check_pixels(
    frames: Sequence[Frame],
    tell: Tell = lambda stage: None,
    look: Callable[[View], object] = lambda view: None,
) -> list[RefusedFrame]:
    """Read everything that the frames hold; one entry for each thing that cannot be used, also for a picture
    that shows nothing. `look` is given the views of recorded heatmaps."""
    damaged = []
    for number, frame in enumerate(frames, start=1):
        if number % 10 == 1:
            tell(f"reading pixels of frame {number}/{len(frames)}")
        pixels = frame.pixels
        readers: list[tuple[object, Callable[[], object]]] = [
            (pixels.heatmap, partial(_looked_at, frame, look)),
            (pixels.image, partial(_shown, frame)),
            (pixels.regions, frame.regions),
            (pixels.silhouettes, frame.silhouettes),
            (pixels.depth_m, frame.depth_m),
        ]
        for name, layer in pixels.layers.items():
            of_layer = replace(frame, pixels=pixels.of_layer(name))
            readers += [(layer.heatmap, of_layer.view), (layer.labels, of_layer.regions)]
        for recorded, read in readers:
            if recorded is None:
                continue
            try:
                read()
            except FrameError as error:
                damaged.append(RefusedFrame(frame.drone, frame.stamp_ns, error.reason))
    return damaged


def _looked_at(frame: Frame, look: Callable[[View], object]) -> None:
    look(frame.view())


def _shown(frame: Frame) -> None:
    """FrameError for a picture that detectors are not shown."""
    from crowdfence.detector.blank_picture import blank_reason

    if (reason := blank_reason(frame.image())) is not None:
        raise FrameError(frame.drone, frame.stamp_ns, reason)


def group_trouble(refused: Iterable[RefusedFrame]) -> list[Trouble]:
    """Frames by reason, the most frequent first. Reasons that differ in numbers only are one."""
    groups: dict[str, list[RefusedFrame]] = {}
    for frame in refused:
        groups.setdefault(re.sub(r"\d[\d.]*", "#", frame.reason), []).append(frame)
    return [
        Trouble(len(group), tuple(sorted({frame.drone for frame in group})), str(group[0]))
        for group in sorted(groups.values(), key=len, reverse=True)
    ]


def _open_terrain(
    recording: Recording, chosen: Path | None, options: InspectionOptions, tell: Tell
) -> tuple[Terrain | None, TerrainBelow | None, tuple[str, ...]]:
    """The map, what it is, and what is doubtful about it."""
    from crowdfence.pipeline import check_overlap, read_map
    from crowdfence.pipeline.terrain import came_along

    path = chosen or recording.terrain
    if path is None:
        return None, None, ()
    tell(f"reading {path.name}")
    given = chosen is not None
    try:
        reading = read_map(recording, path, **options.terrain_options)
    except ValueError as error:
        if given or options.terrain_options:
            raise
        return None, TerrainBelow(str(path), given, None, str(error)), ()
    terrain, problem = reading.terrain, None
    try:
        check_overlap(on_ground(recording, terrain), terrain, options.max_range_m)
    except ValueError as error:
        # Not fatal here: the figures show what is wrong (heights, frames beside the terrain).
        problem = str(error)
    said = recording.terrain_options if came_along(path, recording) else {}
    below = TerrainBelow(str(path), given, TerrainReport.of(terrain), problem, reading.holes, said)
    return terrain, below, reading.doubts


def _what_a_run_doubts(recording: Recording, terrain: Terrain | None) -> Iterator[str]:
    """What `run` refuses or warns of before its first frame."""
    from crowdfence.pipeline import check_clocks
    from crowdfence.pipeline.under_ground import under_ground_line

    try:
        check_clocks(recording)
    except StampError as error:
        yield str(error)
    if terrain is None:
        return
    of_map = coarse_voxels_warning(terrain.voxel_size_m), under_ground_line(terrain, recording.frames)
    yield from (doubt for doubt in of_map if doubt is not None)


def _drone(
    recording: Recording,
    drone: str,
    terrain: Terrain | None,
    options: InspectionOptions,
) -> DroneReport:
    frames = recording.frames_of(drone)
    track = recording.tracks().get(drone)
    with_depth = [frame for frame in frames if frame.pixels.depth_m is not None]
    return DroneReport(
        drone=drone,
        frames=Timing.of([frame.stamp_ns for frame in frames]),
        refused=sum(frame.drone == drone for frame in recording.refused),
        telemetry=Timing.of(np.empty(0, np.int64) if track is None else track.stamps_ns),
        cameras=tuple(
            CameraReport.of(camera) for camera in distinct_cameras(frame.camera for frame in frames)
        ),
        heatmap=_heatmap(frames),
        pixels=_pixel_counts(frames),
        flight=FlightReport.of(frames, terrain),
        depth=None
        if terrain is None
        else depth_agreement(
            evenly_spread(with_depth, options.sampled_instants), terrain, options.max_range_m
        ),
    )


def _heatmap(frames: Sequence[Frame]) -> HeatmapReport | None:
    for frame in frames:
        if frame.pixels.heatmap is None:
            continue
        try:
            heatmap = frame.heatmap()
        except FrameError:
            continue
        if heatmap.ndim == 2 and heatmap.size:
            height, width = heatmap.shape
            return HeatmapReport(width, height, str(heatmap.dtype), frame.camera.width / width)
    return None


def _pixel_counts(frames: Sequence[Frame]) -> PixelCounts:
    pixels = [frame.pixels for frame in frames]
    return PixelCounts(
        images=sum(source.image is not None for source in pixels),
        heatmaps=sum(source.heatmap is not None for source in pixels),
        regions=sum(source.regions is not None for source in pixels),
        silhouettes=sum(source.silhouettes is not None for source in pixels),
        depth=sum(source.depth_m is not None for source in pixels),
    )
