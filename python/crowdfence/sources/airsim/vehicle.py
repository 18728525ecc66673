"""One vehicle of an AirSim recording: its camera's track, and its pictures with their stamps."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.sources.airsim.pose import CameraRows, compose, read_telemetry
from crowdfence.sources.airsim.settings import SCENE, AirSimSettings
from crowdfence.sources.airsim.table import TABLE_NAME, ImageName, TableRow
from crowdfence.sources.airsim.truth_pictures import (
    DEPTH_VIS,
    SEGMENTATION,
    TRUTH_TYPES,
    depth_source,
    pair_truth,
)
from crowdfence.sources.layers import LayerPixels, layer_names
from crowdfence.sources.pictures.decoding import Size, read_only_heatmap, read_regions, read_silhouettes
from crowdfence.sources.pictures.left_out import labels_without_frame
from crowdfence.sources.place_camera import UnplacedFrame
from crowdfence.sources.pose_track import PoseTrack, track_from_rows
from crowdfence.sources.recorded_truth import FrameTruth
from crowdfence.sources.recording import PixelSources

SAME_CLOCK_MS = 100
"""File names and table run on one clock when they differ by less than this in the median."""

Colour = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class AirSimOptions:
    """What a recording does not say about itself."""

    settings: Path | None = None
    """settings.json; None looks in the recording's folder and in the one above."""
    camera: str | None = None
    """Camera of every vehicle; None takes the one with the most colour pictures."""
    crowd_colors: Sequence[Colour] = ()
    """Segmentation colours (R, G, B) that mean crowd; without them segmentation is not read."""
    pose_delay_ms: float = 0.0
    """How much later a pose was logged than the picture it belongs to was taken (AirSim issue 1309)."""

    def __post_init__(self) -> None:
        for colour in self.crowd_colors:
            if len(colour) != 3 or not all(0 <= channel <= 255 for channel in colour):
                raise ValueError(f"crowd_colors holds {colour}, expected (R, G, B) from 0 to 255")
        if not abs(self.pose_delay_ms) < 1e6:
            raise ValueError(f"pose_delay_ms is {self.pose_delay_ms}, expected less than 1e6")


@dataclass(frozen=True, slots=True)
class Vehicle:
    """What a recording holds of one vehicle."""

    unplaced: list[UnplacedFrame]
    track: PoseTrack
    camera: str
    """Name of the camera that was read."""
    clock: str
    """What the stamps come from: "file names" or "table"."""


@dataclass(frozen=True, slots=True)
class _Moment:
    """One picture of the chosen camera with the truth pictures that belong to it."""

    row: TableRow
    stamp_ns: int
    anchor: ImageName
    truth: dict[int, ImageName]
    fault: str | None = None


@dataclass(slots=True)
class VehicleReader:
    """Reads the vehicles of one recording, one after the other; `warnings` grows on the way."""

    folder: Path
    settings: AirSimSettings
    options: AirSimOptions
    fleet: int
    truth_of: Callable[[str, int], FrameTruth]
    """What is known of the picture of a vehicle with a stamp."""
    warnings: list[str] = field(default_factory=list)
    _layer_names: list[str] = field(default_factory=list, init=False)
    _labels_of_frames: dict[str, set[str]] = field(default_factory=dict, init=False)
    """Names that labels of the frames may have, by kind."""

    def __post_init__(self) -> None:
        self._layer_names = layer_names(self.folder, self.warnings)
        if self.settings.path is None:
            self.warnings.append(
                "no settings.json: AirSim's default camera (256x144, 90 degrees) at the body's own position"
            )

    def labels_without_frame(self) -> list[str]:
        """What is told of label files that are of no frame, once all vehicles are read."""
        said = []
        for kind in ("regions", *(f"layers/{name}" for name in self._layer_names)):
            names = [path.name for path in (self.folder / "truth" / kind).glob("*.png")]
            unused = [name for name in names if name not in self._labels_of_frames.get(kind, ())]
            said.extend(labels_without_frame(f"truth/{kind}", names, unused))
        return said

    def read(self, vehicle: str, rows: list[TableRow]) -> Vehicle:
        """ValueError when the settings do not say where the vehicle started or its camera looks."""
        recorded = {image.camera for row in rows for image in row.images}
        camera = self.options.camera or _busiest_camera(rows)
        if camera is None:
            self._warn(vehicle, f"{TABLE_NAME} lists no picture of it: it has no frames")
            return Vehicle([], track_from_rows([], [], [])[0], "", "")
        self._check_camera(vehicle, camera, recorded)
        telemetry = self._telemetry(vehicle, camera)
        clock = self._clock(rows, camera, telemetry)
        moments = self._moments(vehicle, rows, camera, clock)
        poses = telemetry or self._poses_of_table(vehicle, rows, camera, moments)
        track, remarks = track_from_rows(poses.stamps_ns, poses.positions, poses.quaternions)
        self._warn(vehicle, *poses.remarks, *remarks)
        if self.options.pose_delay_ms:
            track = track.shifted(-round(self.options.pose_delay_ms * 1e6))
        intrinsics = self.settings.intrinsics(vehicle, camera)
        truth_types = self._matching_truth(vehicle, camera, moments)
        frames = [
            UnplacedFrame(
                m.stamp_ns,
                intrinsics,
                self._pixels(vehicle, m, intrinsics, truth_types),
                m.fault,
                self.truth_of(vehicle, m.anchor.stamp_ns),
            )
            for m in moments
        ]
        return Vehicle(frames, track, camera, clock)

    def _check_camera(self, vehicle: str, camera: str, recorded: set[str]) -> None:
        if camera not in recorded:
            raise ValueError(
                f"{self.folder / TABLE_NAME} lists no picture of camera {camera!r} of {vehicle!r}; "
                f"its cameras are {', '.join(sorted(recorded)) or 'none'}"
            )
        if recorded != {camera}:
            others = ", ".join(sorted(recorded - {camera}))
            self._warn(vehicle, f"only camera {camera!r} is read, not {others}")

    def _telemetry(self, vehicle: str, camera: str) -> CameraRows | None:
        path = self.folder / "telemetry" / f"{vehicle}.csv"
        if not path.is_file():
            return None
        mount, assumed = self.settings.mount(vehicle, camera)
        self._warn(vehicle, *assumed)
        return read_telemetry(path, self.settings.start_ned(vehicle, self.fleet), mount)

    def _poses_of_table(
        self, vehicle: str, rows: list[TableRow], camera: str, moments: list[_Moment]
    ) -> CameraRows:
        mount, assumed = self.settings.mount(vehicle, camera)
        gimbal = " although the settings stabilise it" if self.settings.has_gimbal(vehicle, camera) else ""
        fixed = f"no telemetry/{vehicle}.csv: the camera is taken as fixed to the body{gimbal}"
        self._warn(vehicle, *assumed, f"{fixed}; if a gimbal moved, all its poses are wrong")
        # The pose of a line belongs to its picture; with several or none, to the line's own millisecond.
        pictures = Counter(moment.row.line for moment in moments)
        stamp_of = {m.row.line: m.stamp_ns for m in moments if pictures[m.row.line] == 1}
        return compose(
            [stamp_of.get(row.line, row.stamp_ms * 1_000_000) for row in rows],
            [row.position for row in rows],
            [row.quaternion for row in rows],
            self.settings.start_ned(vehicle, self.fleet),
            mount,
        )

    def _clock(self, rows: list[TableRow], camera: str, telemetry: CameraRows | None) -> str:
        """Where stamps come from: the file names (nanoseconds) if they run with the table or with the
        telemetry, else the table."""
        pairs = [
            (row.stamp_ms, image.stamp_ns) for row in rows for image in row.images if image.camera == camera
        ]
        apart_ms = median(abs(stamp_ns // 1_000_000 - stamp_ms) for stamp_ms, stamp_ns in pairs)
        if apart_ms <= SAME_CLOCK_MS:
            return "file names"
        if telemetry is not None and telemetry.stamps_ns:
            first, last = min(telemetry.stamps_ns), max(telemetry.stamps_ns)
            by_name = sum(first <= stamp_ns <= last for _, stamp_ns in pairs)
            by_table = sum(first <= stamp_ms * 1_000_000 <= last for stamp_ms, _ in pairs)
            if by_name > by_table:
                return "file names"
        apart = f"file names and table run {apart_ms / 1000:.3f} s apart"
        self._warn(rows[0].vehicle, f"{apart}: stamps are the table's, in whole milliseconds")
        return "table"

    def _moments(self, vehicle: str, rows: list[TableRow], camera: str, clock: str) -> list[_Moment]:
        types = {image.image_type for row in rows for image in row.images if image.camera == camera}
        anchor_type = SCENE if SCENE in types else min(types)
        moments = []
        unpaired = 0
        for row in rows:
            of_camera = [image for image in row.images if image.camera == camera]
            anchors = [image for image in of_camera if image.image_type == anchor_type]
            for number, anchor in enumerate(anchors):
                truth, left = pair_truth(anchor, number, len(anchors), of_camera)
                unpaired += left
                fault = None
                if clock == "table" and number > 0:
                    fault = f"line {row.line} lists {len(anchors)} pictures for one stamp: only one is read"
                stamp_ns = anchor.stamp_ns if clock == "file names" else row.stamp_ms * 1_000_000
                moments.append(_Moment(row, stamp_ns, anchor, truth, fault))
        if unpaired:
            self._warn(vehicle, f"{unpaired} truth pictures belong to no colour picture of their line")
        if any(image.image_type == DEPTH_VIS for row in rows for image in row.images):
            self._warn(vehicle, "DepthVis pictures (type 3) are 8-bit and clipped: not read as depth")
        return moments

    def _matching_truth(self, vehicle: str, camera: str, moments: list[_Moment]) -> set[int]:
        """Truth types with the geometry of the colour picture; others would not lie on its pixels."""
        recorded = {image_type for moment in moments for image_type in moment.truth}
        geometry = self.settings.capture(vehicle, camera, SCENE)
        matching = set()
        for image_type in sorted(recorded):
            if self.settings.capture(vehicle, camera, image_type) == geometry:
                matching.add(image_type)
            else:
                kind = TRUTH_TYPES[image_type]
                self._warn(
                    vehicle, f"{kind}: not read, its size or field of view is not the colour picture's"
                )
        return matching

    def _pixels(self, vehicle: str, moment: _Moment, camera: Camera, truth_types: set[int]) -> PixelSources:
        size = (camera.width, camera.height)
        stamps = dict.fromkeys((moment.anchor.stamp_ns, moment.stamp_ns))
        heatmaps = _heatmap_files(self.folder / "heatmaps", vehicle, list(stamps))
        regions = self._label_file("regions", [f"region_{vehicle}_{stamp}.png" for stamp in stamps])
        truth = {
            key: self.folder / "images" / moment.truth[key].file for key in truth_types & set(moment.truth)
        }
        image = self.folder / "images" / moment.anchor.file
        colours = self.options.crowd_colors
        return PixelSources(
            image=image.read_bytes if moment.anchor.image_type == SCENE else None,
            heatmap=partial(read_only_heatmap, heatmaps, size) if heatmaps else None,
            regions=None if regions is None else lambda: read_regions(regions, size),
            silhouettes=_silhouettes(truth.get(SEGMENTATION), size, colours),
            depth_m=depth_source(truth, camera),
            layers=self._layers(vehicle, list(stamps), size),
        )

    def _layers(self, vehicle: str, stamps: list[int], size: Size) -> dict[str, LayerPixels]:
        """Heatmaps of other classes, by the name of the layer."""
        found = {}
        for name in self._layer_names:
            heatmaps = _heatmap_files(self.folder / "layers" / name, vehicle, stamps)
            labels = self._label_file(f"layers/{name}", [f"label_{vehicle}_{stamp}.png" for stamp in stamps])
            if heatmaps or labels:
                found[name] = LayerPixels(
                    partial(read_only_heatmap, heatmaps, size) if heatmaps else None,
                    None if labels is None else partial(read_regions, labels, size),
                )
        return found

    def _label_file(self, kind: str, names: Sequence[str]) -> Path | None:
        self._labels_of_frames.setdefault(kind, set()).update(names)
        return first_file(self.folder / "truth" / kind, names)

    def _warn(self, vehicle: str, *sentences: str) -> None:
        self.warnings.extend(f"{vehicle}: {sentence}" for sentence in sentences)


def _silhouettes(
    segmentation: Path | None, size: Size, colours: Sequence[Colour]
) -> Callable[[], NDArray[np.bool_]] | None:
    if segmentation is None or not colours:
        return None
    return lambda: read_silhouettes(segmentation, size, colours)


def _heatmap_files(folder: Path, vehicle: str, stamps: Sequence[int]) -> list[Path]:
    """Heatmaps of one picture, under the first of its stamps that has some: one, or one of each kind."""
    for stamp in stamps:
        files = [folder / f"heatmap_{vehicle}_{stamp}{suffix}" for suffix in (".png", ".npy")]
        if found := [file for file in files if file.is_file()]:
            return found
    return []


def first_file(folder: Path, names: Sequence[str]) -> Path | None:
    """The first of these files that exists."""
    return next((folder / name for name in names if (folder / name).is_file()), None)


def _busiest_camera(rows: list[TableRow]) -> str | None:
    images = [image for row in rows for image in row.images]
    scenes = [image for image in images if image.image_type == SCENE]
    counts = Counter(image.camera for image in scenes or images)
    return min(counts, key=lambda camera: (-counts[camera], camera)) if counts else None
