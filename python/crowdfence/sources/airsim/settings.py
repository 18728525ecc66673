"""What AirSim's settings.json says about vehicles and cameras, with AirSim's own defaults where it is silent.

Reference: "Settings" and "Image APIs" in the documentation of AirSim and Cosys-AirSim.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.georeference import Georeference
from crowdfence.sources.rotation import from_yaw_pitch_roll_deg

SCENE = 0
"""ImageType of the colour picture."""

DEFAULT_WIDTH, DEFAULT_HEIGHT, DEFAULT_FOV_DEG = 256, 144, 90.0

_OLD_CAMERA_IDS = {
    "0": "front_center",
    "1": "front_right",
    "2": "front_left",
    "3": "bottom_center",
    "4": "back_center",
}
_LOOKS_AHEAD = "front_center"


@dataclass(frozen=True, slots=True)
class Mount:
    """Camera on its vehicle: forward, right, down of the body, metres and unit quaternion (w, x, y, z)."""

    position: NDArray[np.float64]
    quaternion: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AirSimSettings:
    """settings.json, or an empty object where there is none."""

    content: dict[str, Any]
    path: Path | None

    @staticmethod
    def read(path: Path | None) -> "AirSimSettings":
        """ValueError when the file is not a JSON object."""
        if path is None:
            return AirSimSettings({}, None)
        try:
            content = json.loads(path.read_text(encoding="utf-8-sig"))
        except (ValueError, RecursionError) as error:
            raise ValueError(f"{path} is not JSON: {error}") from error
        if not isinstance(content, dict):
            raise ValueError(
                f"{path} is not AirSim settings: expected an object, found {type(content).__name__}"
            )
        return AirSimSettings(content, path)

    @property
    def vehicles(self) -> dict[str, Any]:
        return self._object(self.content, "Vehicles")

    def georeference(self) -> Georeference | None:
        """OriginGeopoint; its Altitude is taken as metres above the ellipsoid."""
        origin = self._object(self.content, "OriginGeopoint")
        if not origin:
            return None
        values = [self._number(origin, key, None) for key in ("Latitude", "Longitude", "Altitude")]
        return Georeference(*values)

    def start_ned(self, vehicle: str, fleet: int) -> NDArray[np.float64]:
        """Where the vehicle's own coordinates begin, NED metres from the world origin.

        AirSim turns no axes there: the start's Yaw is the vehicle's first heading and nothing else. A single
        vehicle may do without where the settings name none; of several, each must be in the settings, or all
        would start at one place.
        """
        if vehicle not in self.vehicles and fleet == 1 and self.vehicles:
            raise ValueError(
                f"{self._name} does not hold the vehicle {vehicle!r} of the recording, but "
                f"{', '.join(map(repr, self.vehicles))}: where it started and its camera looks is not told. "
                "Take the settings.json that it was recorded with, or add it under Vehicles"
            )
        if vehicle not in self.vehicles and fleet > 1:
            raise ValueError(
                f"{self._name} has no start position for vehicle {vehicle!r} under Vehicles: the positions "
                f"of {fleet} vehicles cannot be put into one frame. Add Vehicles.{vehicle}.X, Y, Z"
            )
        entry = self._object(self.vehicles, vehicle)
        return np.array([self._number(entry, axis, 0.0) for axis in "XYZ"])

    def mount(self, vehicle: str, camera: str) -> tuple[Mount, list[str]]:
        """The camera on the vehicle, and what had to be assumed.

        ValueError for a camera other than front_center whose direction is not in the settings: AirSim's other
        cameras look sideways, back or down.
        """
        entry = self._mounted(vehicle, camera)
        angles_known = any(key in entry for key in ("Pitch", "Roll", "Yaw"))
        if not angles_known and _OLD_CAMERA_IDS.get(camera, camera) != _LOOKS_AHEAD:
            raise ValueError(
                f"{self._name} does not say where camera {camera!r} of {vehicle!r} looks: add "
                f"Vehicles.{vehicle}.Cameras.{camera} with X, Y, Z, Pitch, Roll, Yaw"
            )
        assumed = []
        if not any(axis in entry for axis in "XYZ"):
            assumed.append(
                f"position of camera {camera!r} on {vehicle!r} is not in the settings: taken as the body's"
            )
        position = np.array([self._number(entry, axis, 0.0) for axis in "XYZ"])
        yaw, pitch, roll = (self._number(entry, key, 0.0) for key in ("Yaw", "Pitch", "Roll"))
        return Mount(position, from_yaw_pitch_roll_deg(yaw, pitch, roll)), assumed

    def intrinsics(self, vehicle: str, camera: str, image_type: int = SCENE) -> Camera:
        """Pinhole from image size and horizontal field of view: fx = fy = (width / 2) / tan(FOV / 2)."""
        width, height, fov_deg = self.capture(vehicle, camera, image_type)
        focal = width / 2 / math.tan(math.radians(fov_deg) / 2)
        return Camera.pinhole(width, height, focal, focal, width / 2, height / 2)

    def capture(self, vehicle: str, camera: str, image_type: int) -> tuple[int, int, float]:
        """(width, height, horizontal field of view in degrees) of one kind of image of a camera."""
        defaults = self._object(self.content, "CameraDefaults")
        settings = {
            **self._capture_settings(defaults, image_type),
            **self._capture_settings(self._camera(vehicle, camera), image_type),
        }
        width = self._number(settings, "Width", DEFAULT_WIDTH)
        height = self._number(settings, "Height", DEFAULT_HEIGHT)
        fov_deg = self._number(settings, "FOV_Degrees", DEFAULT_FOV_DEG)
        if not (1 <= width <= 2**15 and 1 <= height <= 2**15 and 0 < fov_deg < 180):
            raise ValueError(
                f"{self._name}: camera {camera!r} of {vehicle!r} has {width:g}x{height:g} pixels and "
                f"{fov_deg:g} degrees (sizes 1 to 32768, field of view between 0 and 180)"
            )
        return int(width), int(height), fov_deg

    def cameras(self, vehicle: str) -> list[str]:
        """Names of the vehicle's cameras in the settings."""
        return list(self._object(self._object(self.vehicles, vehicle), "Cameras"))

    def has_gimbal(self, vehicle: str, camera: str) -> bool:
        """Whether AirSim stabilises the camera."""
        return bool(self._camera(vehicle, camera).get("Gimbal"))

    def _camera(self, vehicle: str, camera: str) -> dict[str, Any]:
        cameras = self._object(self._object(self.vehicles, vehicle), "Cameras")
        same = {camera, _OLD_CAMERA_IDS.get(camera, camera)}
        same |= {old for old, new in _OLD_CAMERA_IDS.items() if new == camera}
        name = next((name for name in cameras if name in same), camera)
        return self._object(cameras, name)

    def _mounted(self, vehicle: str, camera: str) -> dict[str, Any]:
        """Where a camera is and looks, as far as it is said. AirSim moves the cameras that a vehicle names;
        what these leave open, also by a NaN, CameraDefaults may say."""
        named = self._camera(vehicle, camera)
        defaults = self._object(self.content, "CameraDefaults") if named else {}
        return {**_said(defaults), **_said(named)}

    def _capture_settings(self, owner: dict[str, Any], image_type: int) -> dict[str, Any]:
        entries = owner.get("CaptureSettings", [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise ValueError(f"{self._name}: CaptureSettings is not a list of objects")
        return next((entry for entry in entries if entry.get("ImageType", SCENE) == image_type), {})

    def _object(self, owner: dict[str, Any], key: str) -> dict[str, Any]:
        value = owner.get(key, {})
        if not isinstance(value, dict):
            raise ValueError(f"{self._name}: {key} is not an object but {type(value).__name__}")
        return value

    def _number(self, owner: dict[str, Any], key: str, default: float | None) -> float:
        value = owner.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e300:
            raise ValueError(f"{self._name}: {key} is {str(value)[:40]!r}, expected a number")
        return float(value)

    @property
    def _name(self) -> str:
        return str(self.path) if self.path else "(no settings.json)"


def _said(entry: dict[str, Any]) -> dict[str, Any]:
    """Without NaN, which stands for what is not set."""
    return {
        key: value for key, value in entry.items() if not (isinstance(value, float) and math.isnan(value))
    }
