"""Writes the native mission file frame by frame. `mission_layout` describes it."""

import contextlib
import json
import os
from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from mcap.records import Schema
from mcap_ros2.writer import Writer
from numpy.typing import ArrayLike, NDArray

from crowdfence._core import Camera
from crowdfence.georeference import Georeference
from crowdfence.sources import ros2_messages
from crowdfence.sources.camera_info import camera_info_fields
from crowdfence.sources.mission_layout import (
    FORMAT_VERSION,
    MAP_FRAME,
    METADATA,
    METADATA_DRONE,
    METADATA_REFUSED,
    TOPICS,
    Part,
    topic,
    topic_prefix,
)
from crowdfence.sources.pictures import picture_format
from crowdfence.sources.recording import RefusedFrame
from crowdfence.sources.stamps import LAST_STAMP_NS


class MissionWriter:
    """Writes a mission file; a context manager.

    The file grows as `<path>.part` and takes its name when the writer is closed, so that no half-written file
    ever carries it. After an error inside the `with` block the partial file is removed; after a power cut it
    stays, and `open_recording` reads what is in it.

    Poses and frames may come in any order between drones, but the stamps of one drone's poses, and of its
    frames, must increase: ValueError otherwise, and for stamps outside [0, LAST_STAMP_NS].
    """

    def __init__(
        self,
        path: str | PathLike[str],
        *,
        georeference: Georeference | None = None,
        terrain: str | PathLike[str] | None = None,
        source: str = "",
    ) -> None:
        """`terrain` is a map file to suggest to readers, kept as a path relative to the mission file."""
        self.path = Path(path)
        description = _description(self.path, georeference, terrain, source)
        self._part_path = self.path.with_name(self.path.name + ".part")
        self._file = self._part_path.open("wb")
        self._mcap = Writer(self._file)
        self._schemas: dict[str, Schema] = {}
        self._prefixes: dict[str, str] = {}
        self._cameras: dict[str, Camera] = {}
        self._last_stamp_ns: dict[tuple[str, str], int] = {}
        self._mcap.add_metadata(METADATA, description)

    def add_camera(self, drone: str, camera: Camera) -> None:
        """Intrinsics of the drone's frames from now on."""
        self._cameras[drone] = camera

    def add_pose(self, drone: str, stamp_ns: int, position: ArrayLike, quaternion: ArrayLike) -> None:
        """Pose of the drone's camera: `position` [3] in local ENU metres, `quaternion` [4] w x y z turning
        camera axes (OpenCV) into ENU. Written bit for bit; also goes out on /tf."""
        self._advance(drone, "pose", stamp_ns)
        x, y, z = (float(value) for value in np.asarray(position, dtype=np.float64))
        qw, qx, qy, qz = (float(value) for value in np.asarray(quaternion, dtype=np.float64))
        header = ros2_messages.header(stamp_ns, MAP_FRAME)
        point, rotation = {"x": x, "y": y, "z": z}, {"w": qw, "x": qx, "y": qy, "z": qz}
        pose = {"header": header, "pose": {"position": point, "orientation": rotation}}
        self._write(topic(self._prefix(drone), "pose"), ros2_messages.POSE_STAMPED, stamp_ns, pose)
        transform = {
            "header": header,
            "child_frame_id": self._camera_frame(drone),
            "transform": {"translation": point, "rotation": rotation},
        }
        self._write("/tf", ros2_messages.TF_MESSAGE, stamp_ns, {"transforms": [transform]})

    def add_frame(
        self,
        drone: str,
        stamp_ns: int,
        *,
        image: bytes | None = None,
        heatmap: NDArray[Any] | None = None,
        regions: NDArray[Any] | None = None,
        silhouettes: NDArray[np.bool_] | None = None,
        depth_m: NDArray[np.float32] | None = None,
    ) -> None:
        """One image of a drone whose camera was added, with whatever is known about it.

        image        JPEG or PNG bytes, stored untouched
        heatmap      [h, w] uint8 (value / 255) or float in [0, 1], stored as uint8 or float32
        regions      [H, W] crowd number per image pixel, 0 = none, at most 65535
        silhouettes  [H, W] bool; depth_m [H, W] metres along the camera's z axis, NaN = unknown
        """
        if drone not in self._cameras:
            raise ValueError(f"no camera of {drone!r} was added before its frame at {stamp_ns}")
        encoded = {
            "image": None if image is None else _compressed(image),
            "heatmap": None if heatmap is None else _raster(_heatmap_pixels(heatmap)),
            "regions": None if regions is None else _raster(_region_pixels(regions)),
            "silhouettes": None if silhouettes is None else _raster(_silhouette_pixels(silhouettes)),
            "depth": None if depth_m is None else _raster(np.asarray(depth_m, dtype=np.float32)),
        }
        self._advance(drone, "frame", stamp_ns)
        self._write_part(drone, "camera_info", stamp_ns, camera_info_fields(self._cameras[drone]))
        for part in ("image", "heatmap", "regions", "silhouettes", "depth"):
            message = encoded[part]
            if message is not None:
                self._write_part(drone, part, stamp_ns, message)

    def add_refused(self, refused: Iterable[RefusedFrame]) -> None:
        """Frames that the source of this mission had but could not pass on; readers report them again."""
        rows = [
            {"drone": frame.drone, "stamp_ns": frame.stamp_ns, "reason": frame.reason} for frame in refused
        ]
        if rows:
            self._mcap.add_metadata(METADATA_REFUSED, {"frames": json.dumps(rows)})

    def add_drone(self, drone: str) -> None:
        """Announce a drone of the fleet. Its first pose or frame does the same."""
        self._prefix(drone)

    def close(self) -> None:
        """Finish the file and give it its name. Closing twice is harmless."""
        if self._file.closed:
            return
        self._mcap.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        os.replace(self._part_path, self.path)

    def discard(self) -> None:
        """Stop writing and remove the partial file."""
        # Closing flushes, which fails again on a full disk; the file goes away all the same.
        with contextlib.suppress(OSError):
            self._file.close()
        self._part_path.unlink(missing_ok=True)

    def __enter__(self) -> "MissionWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self.discard()
            return
        try:
            self.close()
        except BaseException:
            self.discard()
            raise

    def _advance(self, drone: str, what: str, stamp_ns: int) -> None:
        if not 0 <= stamp_ns <= LAST_STAMP_NS:
            raise ValueError(f"{what} of {drone!r}: stamp {stamp_ns} is outside [0, {LAST_STAMP_NS}] ns")
        last_ns = self._last_stamp_ns.get((drone, what), -1)
        if stamp_ns <= last_ns:
            raise ValueError(
                f"{what} of {drone!r}: stamp {stamp_ns} does not come after the last one, {last_ns}"
            )
        self._last_stamp_ns[drone, what] = stamp_ns

    def _prefix(self, drone: str) -> str:
        if drone not in self._prefixes:
            prefix = topic_prefix(drone, set(self._prefixes.values()))
            self._prefixes[drone] = prefix
            self._mcap.add_metadata(METADATA_DRONE, {"drone": drone, "topic_prefix": prefix})
        return self._prefixes[drone]

    def _camera_frame(self, drone: str) -> str:
        return f"{self._prefix(drone)[1:]}/camera_optical"

    def _write_part(self, drone: str, part: Part, stamp_ns: int, fields: dict[str, Any]) -> None:
        message = {"header": ros2_messages.header(stamp_ns, self._camera_frame(drone)), **fields}
        self._write(topic(self._prefix(drone), part), TOPICS[part][1], stamp_ns, message)

    def _write(self, name: str, message_type: str, stamp_ns: int, message: dict[str, Any]) -> None:
        if message_type not in self._schemas:
            definition = ros2_messages.DEFINITIONS[message_type]
            self._schemas[message_type] = self._mcap.register_msgdef(message_type, definition)
        self._mcap.write_message(name, self._schemas[message_type], message, log_time=stamp_ns)


def _description(
    path: Path, georeference: Georeference | None, terrain: str | PathLike[str] | None, source: str
) -> dict[str, str]:
    description = {"format": "crowdfence mission", "version": str(FORMAT_VERSION), "source": source}
    if georeference is not None:
        # repr keeps every bit of a float64; 1e-15 degrees are 0.1 nm, but equal runs should be equal.
        description["latitude_deg"] = repr(float(georeference.latitude_deg))
        description["longitude_deg"] = repr(float(georeference.longitude_deg))
        description["height_m"] = repr(float(georeference.height_m))
    if terrain is not None:
        relative = os.path.relpath(Path(terrain).resolve(), path.parent.resolve())
        description["terrain"] = relative.replace(os.sep, "/")
    return description


def _compressed(image: bytes) -> dict[str, Any]:
    picture = picture_format(image)
    if picture is None:
        raise ValueError(f"an image must be JPEG or PNG, got bytes that begin with {image[:8]!r}")
    return {"format": picture, "data": bytes(image)}


def _heatmap_pixels(heatmap: NDArray[Any]) -> NDArray[Any]:
    heatmap = np.asarray(heatmap)
    if heatmap.dtype == np.uint8:
        return heatmap
    if not np.issubdtype(heatmap.dtype, np.floating):
        raise ValueError(f"a heatmap is uint8 or float, got {heatmap.dtype}")
    return heatmap.astype(np.float32)


def _region_pixels(regions: NDArray[Any]) -> NDArray[Any]:
    regions = np.asarray(regions)
    if regions.dtype == np.uint8 or regions.size == 0:
        return regions.astype(np.uint8)
    low, high = int(regions.min()), int(regions.max())
    if not np.issubdtype(regions.dtype, np.integer) or low < 0 or high > 65535:
        raise ValueError(
            f"crowd numbers are integers in [0, 65535], got {regions.dtype} from {low} to {high}"
        )
    return regions.astype(np.uint8 if high < 256 else np.uint16)


def _silhouette_pixels(silhouettes: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return np.asarray(silhouettes, dtype=np.bool_).astype(np.uint8) * np.uint8(255)


_ENCODINGS = {"uint8": "mono8", "uint16": "mono16", "float32": "32FC1"}


def _raster(pixels: NDArray[Any]) -> dict[str, Any]:
    """Fields of a sensor_msgs/Image apart from its header."""
    shape: Sequence[int] = pixels.shape
    if len(shape) != 2 or 0 in shape:
        raise ValueError(f"expected pixels [h, w] with at least one value, got shape {tuple(shape)}")
    little_endian = np.ascontiguousarray(pixels.astype(pixels.dtype.newbyteorder("<")))
    return {
        "height": shape[0],
        "width": shape[1],
        "encoding": _ENCODINGS[pixels.dtype.name],
        "is_bigendian": 0,
        "step": shape[1] * pixels.dtype.itemsize,
        "data": little_endian.tobytes(),
    }
