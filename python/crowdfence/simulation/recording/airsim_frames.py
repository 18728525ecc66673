"""Frames as the files of an AirSim recording, and body poses in AirSim's conventions.

AirSim: north-east-down from each vehicle's own start; body and camera axes forward, right, down.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from crowdfence.simulation.flight.gimbal import CAMERA_IN_BODY_M
from crowdfence.simulation.recording.frame_summary import FrameSummary
from crowdfence.simulation.scenarios.scenario import Scenario
from crowdfence.simulation.scene_class import SceneClass
from crowdfence.simulation.schedule import Capture
from crowdfence.sources.mission.messages import FrameContent, decode_people, encode_people

CAMERA = "front_center"
SCENE, DEPTH_PLANAR, SEGMENTATION = 0, 1, 5
"""AirSim's ImageType numbers."""

PALETTE = {
    SceneClass.SKY: (55, 181, 57),
    SceneClass.GROUND: (153, 108, 6),
    SceneClass.ROAD: (112, 105, 191),
    SceneClass.CROWD: (89, 121, 72),
    SceneClass.CYCLIST: (190, 225, 64),
}
"""AirSim's colours (R, G, B) of the segmentation ids 0 to 4."""

_NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_FRONT_RIGHT_DOWN = np.diag([1.0, -1.0, -1.0])
"""Forward, left, up <-> forward, right, down."""
_OPTICAL_FROM_CAMERA = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Camera axes forward, right, down -> right, down, forward."""


@dataclass(frozen=True, slots=True)
class AirSimEncoder:
    """Frame -> files by their path inside the recording."""

    scenario: Scenario

    def __call__(self, content: FrameContent, capture: Capture) -> Mapping[str, bytes]:
        paths = frame_paths(self.scenario, capture, rgb=content.image is not None)
        assert content.depth_m is not None and content.segmentation is not None
        assert content.instances is not None and content.regions is not None and content.people is not None
        palette = np.array([PALETTE[kind] for kind in SceneClass], np.uint8)
        files = {
            paths.depth: _pfm(content.depth_m),
            paths.segmentation: _png(palette[content.segmentation]),
            paths.instances: _png(content.instances),
            paths.regions: _png(_eight_bits(content.regions)),
            paths.people: encode_people(content.people, capture.stamp_ns),
        }
        if content.heatmap is not None:
            files[paths.heatmap] = _png(content.heatmap)
        if content.image is not None:
            files[paths.scene] = content.image
        return files


@dataclass(frozen=True, slots=True)
class FramePaths:
    """Where the files of one frame lie inside the recording."""

    scene: str
    depth: str
    segmentation: str
    instances: str
    regions: str
    heatmap: str
    people: str
    images: tuple[str, ...]
    """Names of those that the table lists."""

    def all(self, *, rgb: bool, heatmaps: bool) -> tuple[str, ...]:
        """Those that a recording holds."""
        always = (self.depth, self.segmentation, self.instances, self.regions, self.people)
        return always + (self.scene,) * rgb + (self.heatmap,) * heatmaps


def frame_paths(scenario: Scenario, capture: Capture, *, rgb: bool) -> FramePaths:
    """Names as recent versions of Cosys-AirSim give them, with the capture's stamp."""
    vehicle, stamp_ns = scenario.drone_names[capture.drone], capture.stamp_ns
    kinds = {SCENE: "png", DEPTH_PLANAR: "pfm", SEGMENTATION: "png"}
    names = {kind: f"img_{vehicle}_{CAMERA}_{kind}_{stamp_ns}.{suffix}" for kind, suffix in kinds.items()}
    listed = tuple(name for kind, name in names.items() if rgb or kind != SCENE)
    return FramePaths(
        scene=f"images/{names[SCENE]}",
        depth=f"images/{names[DEPTH_PLANAR]}",
        segmentation=f"images/{names[SEGMENTATION]}",
        instances=f"truth/instances/instance_{vehicle}_{stamp_ns}.png",
        regions=f"truth/regions/region_{vehicle}_{stamp_ns}.png",
        heatmap=f"heatmaps/heatmap_{vehicle}_{stamp_ns}.png",
        people=f"truth/people/people_{vehicle}_{stamp_ns}.cdr",
        images=listed,
    )


def summary_of_files(
    folder: Path, paths: FramePaths, scenario: Scenario, world_from_camera: NDArray[np.float64] | None
) -> FrameSummary:
    """Statistics of a frame from its files. OSError or ValueError when one is damaged."""
    from crowdfence.sources.pictures.decoding import read_pfm

    camera = scenario.intrinsics()
    with Image.open(folder / paths.segmentation) as picture:
        reds = np.asarray(picture.convert("RGB"))[..., 0]
    class_of_red = np.zeros(256, np.uint8)
    for kind, colour in PALETTE.items():
        class_of_red[colour[0]] = kind
    return FrameSummary.of(
        class_of_red[reds],
        read_pfm(folder / paths.depth, (camera.width, camera.height)),
        decode_people((folder / paths.people).read_bytes()),
        camera,
        world_from_camera,
    )


def ned(points: NDArray[np.float64], start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Local ENU metres [..., 3] -> north, east, down from `start` [3] (NED from the world's origin)."""
    return np.asarray(points @ _NED_FROM_ENU.T - start)


def body_quaternions_ned(world_from_body: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternions [N, 4] of forward, left, up in ENU -> forward, right, down in NED."""
    matrices = Rotation.from_quat(world_from_body, scalar_first=True).as_matrix()
    return _quaternions(_NED_FROM_ENU @ matrices @ _FRONT_RIGHT_DOWN)


def gimbal_quaternions(body_from_camera: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternions [N, 4] of optical axes in forward, left, up -> camera axes in forward, right, down."""
    matrices = Rotation.from_quat(body_from_camera, scalar_first=True).as_matrix()
    return _quaternions(_FRONT_RIGHT_DOWN @ matrices @ _OPTICAL_FROM_CAMERA)


def airsim_settings(scenario: Scenario, starts: NDArray[np.float64]) -> dict[str, Any]:
    """settings.json for vehicles that start at `starts` [drones, 3], NED."""
    mount = dict(zip("XYZ", (CAMERA_IN_BODY_M * (1.0, -1.0, -1.0)).tolist(), strict=True))
    capture = {
        "Width": scenario.camera.width,
        "Height": scenario.camera.height,
        "FOV_Degrees": scenario.camera.hfov_deg,
    }
    kinds = [{"ImageType": kind, **capture} for kind in (SCENE, DEPTH_PLANAR, SEGMENTATION)]
    anchor = scenario.georeference
    return {
        "SettingsVersion": 2.0,
        "SimMode": "Multirotor",
        "OriginGeopoint": {
            "Latitude": anchor.latitude_deg,
            "Longitude": anchor.longitude_deg,
            "Altitude": anchor.height_m,
        },
        "Vehicles": {
            name: {
                "VehicleType": "SimpleFlight",
                **dict(zip("XYZ", start.tolist(), strict=True)),
                "Cameras": {CAMERA: {**mount, "Pitch": 0, "Roll": 0, "Yaw": 0, "CaptureSettings": kinds}},
            }
            for name, start in zip(scenario.drone_names, starts, strict=True)
        },
    }


def _quaternions(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(Rotation.from_matrix(matrices).as_quat(scalar_first=True))


def _pfm(depth_m: NDArray[np.float32]) -> bytes:
    """AirSim's PFM: little-endian, first row on top; what has no depth is infinitely far."""
    values = np.where(np.isnan(depth_m), np.inf, depth_m).astype("<f4")
    return f"Pf\n{values.shape[1]} {values.shape[0]}\n-1\n".encode() + values.tobytes()


def _png(pixels: NDArray[Any]) -> bytes:
    encoded = io.BytesIO()
    Image.fromarray(pixels).save(encoded, format="PNG", compress_level=1)
    return encoded.getvalue()


def _eight_bits(regions: NDArray[Any]) -> NDArray[np.uint8]:
    if int(regions.max(initial=0)) > 255:
        raise ValueError(f"crowd {int(regions.max())}: the region pictures of AirSim recordings end at 255")
    return regions.astype(np.uint8)
