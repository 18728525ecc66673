"""Recordings of AirSim and Cosys-AirSim, with heatmaps and telemetry beside them.

    airsim_rec.txt                                  the simulator's table: body pose and images per moment
    images/                                         its pictures
    settings.json                                   start positions, camera mounts, fields of view, origin
    heatmaps/heatmap_<vehicle>_<stamp_ns>.png|npy   what the detector said
    telemetry/<vehicle>.csv                         optional: camera or gimbal at telemetry rate
    truth/regions/region_<vehicle>_<stamp_ns>.png   optional: crowd numbers
    terrain/terrain.bt, terrain/dem.tif             optional: a map

The table holds neither the gimbal nor the camera's pose, and its stamps are milliseconds, perhaps of
another clock than the file names. Where telemetry is missing, the camera is the table's body pose with the
mount of the settings; a gimbal that moved is then unknown, and the recording's warnings say so.

The camera's pose is composed at every telemetry row and then interpolated, so that a mission file, which
holds exactly these poses, gives the same views bit for bit.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.sources.admission import Capture, Limits, admit
from crowdfence.sources.airsim_pose import CameraRows, compose, read_telemetry
from crowdfence.sources.airsim_settings import SCENE, AirSimSettings
from crowdfence.sources.airsim_table import TABLE_NAME, ImageName, TableRow, read_table
from crowdfence.sources.pictures import read_depth_cm, read_heatmap, read_pfm, read_regions, read_silhouettes
from crowdfence.sources.pose_track import PoseTrack, track_from_rows
from crowdfence.sources.recording import PixelSources, Recording, RefusedFrame
from crowdfence.sources.terrain_hint import find_terrain

DEPTH_PLANAR, DEPTH_PERSPECTIVE, DEPTH_VIS, SEGMENTATION = 1, 2, 3, 5
_TRUTH_TYPES = {
    DEPTH_PLANAR: "planar depth",
    DEPTH_PERSPECTIVE: "depth along the ray",
    SEGMENTATION: "segmentation",
}

SAME_CLOCK_MS = 100
"""File names and table run on one clock when they differ by less than this in the median."""

Color = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class AirSimOptions:
    """What a recording does not say about itself."""

    settings: Path | None = None
    """settings.json; None looks in the recording's folder and in the one above."""
    camera: str | None = None
    """Camera of every vehicle; None takes the one with the most colour pictures."""
    crowd_colors: Sequence[Color] = ()
    """Segmentation colours (R, G, B) that mean crowd; without them segmentation is not read."""
    pose_delay_ms: float = 0.0
    """How much later a pose was logged than the picture it belongs to was taken (AirSim issue 1309)."""


def read_airsim(folder: Path, limits: Limits, options: AirSimOptions) -> Recording:
    """Open the folder that holds airsim_rec.txt. ValueError when table or settings cannot be used."""
    settings = AirSimSettings.read(options.settings or _find_settings(folder))
    only_vehicle = next(iter(settings.vehicles)) if len(settings.vehicles) == 1 else "drone"
    camera_names = sorted({name for vehicle in settings.vehicles for name in settings.cameras(vehicle)})
    rows, faulty = read_table(folder / TABLE_NAME, only_vehicle, camera_names)
    by_vehicle: dict[str, list[TableRow]] = {}
    for row in rows:
        by_vehicle.setdefault(row.vehicle, []).append(row)
    if not by_vehicle:
        raise ValueError(
            f"{folder / TABLE_NAME} has no usable line: {faulty[0][1] if faulty else 'only a header'}"
        )
    importer = _Importer(folder, settings, options, fleet=len(by_vehicle))
    found = {vehicle: importer.read_vehicle(vehicle, rows) for vehicle, rows in sorted(by_vehicle.items())}
    frames, refused = admit(
        {vehicle: item.captures for vehicle, item in found.items()},
        {vehicle: item.track for vehicle, item in found.items()},
        limits,
    )
    terrain = find_terrain(folder)
    return Recording(
        name=folder.resolve().name,
        drones=tuple(found),
        frames=frames,
        georeference=settings.georeference(),
        terrain=terrain,
        refused=[RefusedFrame(vehicle, None, reason) for vehicle, reason in faulty] + refused,
        warnings=tuple(importer.warnings),
        manifest={
            "kind": "airsim",
            "path": str(folder),
            "settings": str(settings.path) if settings.path else None,
            "cameras": {vehicle: item.camera for vehicle, item in found.items()},
            "clock": {vehicle: item.clock for vehicle, item in found.items()},
        },
        pose_tracks={vehicle: item.track for vehicle, item in found.items()},
    )


@dataclass(frozen=True, slots=True)
class _Vehicle:
    captures: list[Capture]
    track: PoseTrack
    camera: str
    clock: str


@dataclass(frozen=True, slots=True)
class _Moment:
    """One picture of the chosen camera with the truth pictures that belong to it."""

    row: TableRow
    stamp_ns: int
    anchor: ImageName
    truth: dict[int, ImageName]
    fault: str | None = None


@dataclass(slots=True)
class _Importer:
    folder: Path
    settings: AirSimSettings
    options: AirSimOptions
    fleet: int
    warnings: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.settings.path is None:
            self.warnings.append(
                "no settings.json: AirSim's default camera (256x144, 90 degrees) at the body's own position"
            )

    def read_vehicle(self, vehicle: str, rows: list[TableRow]) -> _Vehicle:
        camera = self.options.camera or _busiest_camera(rows)
        if camera is None:
            raise ValueError(f"{self.folder / TABLE_NAME} lists no image of vehicle {vehicle!r}")
        others = {image.camera for row in rows for image in row.images} - {camera}
        if others:
            self.warnings.append(
                f"{vehicle}: only camera {camera!r} is read, not {', '.join(sorted(others))}"
            )
        telemetry = self._telemetry(vehicle, camera)
        clock = self._clock(rows, camera, telemetry)
        moments = self._moments(vehicle, rows, camera, clock)
        poses = telemetry or self._poses_of_table(vehicle, rows, camera, moments)
        track, remarks = track_from_rows(poses.stamps_ns, poses.positions, poses.quaternions)
        self._warn(vehicle, [*poses.remarks, *remarks])
        if self.options.pose_delay_ms:
            track = track.shifted(-round(self.options.pose_delay_ms * 1e6))
        intrinsics = self.settings.intrinsics(vehicle, camera)
        truth_types = self._matching_truth(vehicle, camera, moments)
        captures = [
            Capture(m.stamp_ns, intrinsics, self._pixels(vehicle, m, intrinsics, truth_types), m.fault)
            for m in moments
        ]
        return _Vehicle(captures, track, camera, clock)

    def _telemetry(self, vehicle: str, camera: str) -> CameraRows | None:
        path = self.folder / "telemetry" / f"{vehicle}.csv"
        if not path.is_file():
            return None
        mount, assumed = self.settings.mount(vehicle, camera)
        self._warn(vehicle, assumed)
        return read_telemetry(path, self.settings.start_ned(vehicle, self.fleet), mount)

    def _poses_of_table(
        self, vehicle: str, rows: list[TableRow], camera: str, moments: list[_Moment]
    ) -> CameraRows:
        mount, assumed = self.settings.mount(vehicle, camera)
        gimbal = " although the settings stabilise it" if self.settings.has_gimbal(vehicle, camera) else ""
        fixed = f"no telemetry/{vehicle}.csv: the camera is taken as fixed to the body{gimbal}"
        self._warn(vehicle, [*assumed, f"{fixed}; if a gimbal moved, all its poses are wrong"])
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
        """ "file names" (nanoseconds) where they run with the table or with the telemetry, else "table"."""
        pairs = [
            (row.stamp_ms, image.stamp_ns) for row in rows for image in row.images if image.camera == camera
        ]
        apart_ms = (
            median(abs(stamp_ns // 1_000_000 - stamp_ms) for stamp_ms, stamp_ns in pairs) if pairs else 0
        )
        if apart_ms <= SAME_CLOCK_MS:
            return "file names"
        if telemetry is not None and telemetry.stamps_ns:
            first, last = min(telemetry.stamps_ns), max(telemetry.stamps_ns)
            by_name = sum(first <= stamp_ns <= last for _, stamp_ns in pairs)
            by_table = sum(first <= stamp_ms * 1_000_000 <= last for stamp_ms, _ in pairs)
            if by_name > by_table:
                return "file names"
        self._warn(
            rows[0].vehicle,
            [
                f"file names and table run {apart_ms / 1000:.3f} s apart: stamps are the table's, in whole "
                "milliseconds"
            ],
        )
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
                truth, left = _paired(anchor, number, len(anchors), of_camera)
                unpaired += left
                fault = None
                if clock == "table" and number > 0:
                    fault = f"line {row.line} lists {len(anchors)} pictures for one stamp: only one is read"
                stamp_ns = anchor.stamp_ns if clock == "file names" else row.stamp_ms * 1_000_000
                moments.append(_Moment(row, stamp_ns, anchor, truth, fault))
        if unpaired:
            self._warn(
                vehicle, [f"{unpaired} truth pictures cannot be assigned to a colour picture of their line"]
            )
        if any(image.image_type == DEPTH_VIS for row in rows for image in row.images):
            self._warn(vehicle, ["DepthVis pictures (type 3) are 8-bit and clipped: not read as depth"])
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
                kind = _TRUTH_TYPES[image_type]
                self._warn(
                    vehicle, [f"{kind}: another size or field of view than the colour picture's, not read"]
                )
        return matching

    def _pixels(self, vehicle: str, moment: _Moment, camera: Camera, truth_types: set[int]) -> PixelSources:
        size = (camera.width, camera.height)
        stamps = dict.fromkeys((moment.anchor.stamp_ns, moment.stamp_ns))
        heatmap = _first_file(
            self.folder / "heatmaps",
            [f"heatmap_{vehicle}_{stamp}{suffix}" for stamp in stamps for suffix in (".png", ".npy")],
        )
        regions = _first_file(
            self.folder / "truth" / "regions", [f"region_{vehicle}_{stamp}.png" for stamp in stamps]
        )
        truth = {
            key: self.folder / "images" / moment.truth[key].file for key in truth_types & set(moment.truth)
        }
        image = self.folder / "images" / moment.anchor.file
        colors = self.options.crowd_colors
        segmentation = truth.get(SEGMENTATION) if colors else None
        return PixelSources(
            image=image.read_bytes if moment.anchor.image_type == SCENE else None,
            heatmap=None if heatmap is None else lambda: read_heatmap(heatmap, size),
            regions=None if regions is None else lambda: read_regions(regions, size),
            silhouettes=None
            if segmentation is None
            else lambda: read_silhouettes(segmentation, size, colors),
            depth_m=_depth_source(truth, camera),
        )

    def _warn(self, vehicle: str, sentences: Sequence[str]) -> None:
        self.warnings.extend(f"{vehicle}: {sentence}" for sentence in sentences)


def find_airsim_folder(path: Path) -> Path | None:
    """The folder with airsim_rec.txt: `path` itself or its only subfolder with one, None if there is none.

    ValueError when several subfolders are recordings.
    """
    if (path / TABLE_NAME).is_file():
        return path
    inside = sorted(table.parent for table in path.glob(f"*/{TABLE_NAME}"))
    if len(inside) > 1:
        names = ", ".join(folder.name for folder in inside)
        raise ValueError(f"{path} holds {len(inside)} AirSim recordings ({names}): open one of them")
    return inside[0] if inside else None


def _find_settings(folder: Path) -> Path | None:
    return _first_file(folder, ["settings.json"]) or _first_file(folder.parent, ["settings.json"])


def _first_file(folder: Path, names: Sequence[str]) -> Path | None:
    return next((folder / name for name in names if (folder / name).is_file()), None)


def _busiest_camera(rows: list[TableRow]) -> str | None:
    images = [image for row in rows for image in row.images]
    scenes = [image for image in images if image.image_type == SCENE]
    counts = Counter(image.camera for image in scenes or images)
    return min(counts, key=lambda camera: (-counts[camera], camera)) if counts else None


def _paired(
    anchor: ImageName, number: int, anchors: int, of_camera: list[ImageName]
) -> tuple[dict[int, ImageName], int]:
    """The truth pictures of one line that belong to its `number`-th colour picture, and how many to none.

    Equal nanoseconds decide. AirSim itself takes the clock anew for every file; its pictures then pair by
    order, provided that the line lists as many of them (issues 2110 and 3177: it does not always).
    """
    truth: dict[int, ImageName] = {}
    unpaired = 0
    for image_type in _TRUTH_TYPES:
        images = [image for image in of_camera if image.image_type == image_type]
        same = [image for image in images if image.stamp_ns == anchor.stamp_ns]
        if same:
            truth[image_type] = same[0]
        elif len(images) == anchors:
            truth[image_type] = images[number]
        elif number == 0:
            unpaired += len(images)
    return truth, unpaired


def _depth_source(truth: dict[int, Path], camera: Camera) -> Callable[[], NDArray[np.float32]] | None:
    size = (camera.width, camera.height)
    if DEPTH_PLANAR in truth:
        planar = truth[DEPTH_PLANAR]
        return lambda: _read_depth(planar, size)
    if DEPTH_PERSPECTIVE in truth:
        along_ray = truth[DEPTH_PERSPECTIVE]
        return lambda: _read_depth(along_ray, size) * _cosines(camera)
    return None


def _read_depth(path: Path, size: tuple[int, int]) -> NDArray[np.float32]:
    return read_pfm(path, size) if path.suffix == ".pfm" else read_depth_cm(path, size)


def _cosines(camera: Camera) -> NDArray[np.float32]:
    """Cosine between every pixel's ray and the z axis [H, W]."""
    x = (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx
    y = (np.arange(camera.height) + 0.5 - camera.cy) / camera.fy
    cosines: NDArray[Any] = 1.0 / np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2)
    return cosines.astype(np.float32)
