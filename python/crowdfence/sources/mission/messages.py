"""Content of a frame -> the messages of a mission file, and the rasters and people back.

Encoding needs no file, so that the processes of a simulation can do it side by side.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence._core import Camera
from crowdfence.sources.layers import LayerGround
from crowdfence.sources.mission import ros2_messages
from crowdfence.sources.mission.camera_info import camera_info_fields
from crowdfence.sources.mission.layout import MAP_FRAME, FramePart, LayerPart, Part, message_type
from crowdfence.sources.pictures.decoding import picture_format
from crowdfence.sources.recorded_truth import CameraPose, RecordedPeople

CLOCK_OF_THE_WORLD = "world"
LARGEST_DEPTH_CM = 65535
_LEAST_TURN = 1e-6
"""Of a quaternion: what rounding leaves."""


@dataclass(frozen=True, slots=True, eq=False)
class LayerContent:
    """What one image says about a further layer; None = not recorded.

    heatmap  as that of `FrameContent`
    labels   [H, W] bool, True = the pixel shows the class
    """

    heatmap: NDArray[Any] | None = None
    labels: NDArray[np.bool_] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FrameContent:
    """One image of a drone and whatever is known about it; None = not recorded.

    image         JPEG or PNG bytes, stored untouched
    heatmap       [h, w] uint8 (value / 255) or float in [0, 1], stored as uint8 or float32
    regions       [H, W] crowd number per image pixel, 0 = none, at most 65535
    silhouettes   [H, W] bool; depth_m [H, W] metres along the camera's z axis, NaN = unknown
    segmentation  [H, W] class per pixel (`layout.CLASSES`); instances [H, W] person, 0 = none
    true_pose, exposure_ns, people   as in `recorded_truth.FrameTruth`
    layers        heatmaps of other classes, by the name of the layer
    """

    image: bytes | None = None
    heatmap: NDArray[Any] | None = None
    regions: NDArray[Any] | None = None
    silhouettes: NDArray[np.bool_] | None = None
    depth_m: NDArray[np.float32] | None = None
    segmentation: NDArray[Any] | None = None
    instances: NDArray[Any] | None = None
    true_pose: CameraPose | None = None
    exposure_ns: int | None = None
    people: RecordedPeople | None = None
    layers: Mapping[str, LayerContent] = field(default_factory=dict)


def encode_frame(
    content: FrameContent, camera: Camera, stamp_ns: int, camera_frame: str, *, depth_images: bool = False
) -> dict[FramePart, bytes]:
    """The CDR messages of one frame by part, in the order in which they are written.

    `depth_images`: depth as an image that viewers draw, never as a PNG of centimetres.

    ValueError for pixels that a mission file cannot hold.
    """
    fields: dict[FramePart, dict[str, Any]] = {"camera_info": camera_info_fields(camera)}
    if content.image is not None:
        fields["image"] = _compressed(content.image)
    if content.heatmap is not None:
        fields["heatmap"], fields["heatmap_info"] = _heatmap(content.heatmap, camera)
    if content.regions is not None:
        fields["regions"] = _raster(_numbers("crowd numbers", content.regions))
    if content.silhouettes is not None:
        fields["silhouettes"] = _raster(_silhouette_pixels(content.silhouettes))
    if content.depth_m is not None:
        depth_part, depth = _depth(np.asarray(content.depth_m, dtype=np.float32), depth_images)
        fields[depth_part] = depth
    if content.segmentation is not None:
        fields["segmentation"] = _raster(_numbers("classes", content.segmentation, 255))
    if content.instances is not None:
        fields["instances"] = _raster(_numbers("instance numbers", content.instances))
    if content.exposure_ns is not None:
        time_ref = ros2_messages.time(content.exposure_ns)
        fields["exposure"] = {"time_ref": time_ref, "source": CLOCK_OF_THE_WORLD}
    for name, layer in content.layers.items():
        fields |= _layer_fields(name, layer, camera)
    messages: dict[FramePart, bytes] = {}
    for part, message in fields.items():
        header = ros2_messages.header(stamp_ns, camera_frame)
        messages[part] = ros2_messages.encode(message_type(part), {"header": header, **message})
    if content.true_pose is not None:
        pose = pose_fields(content.true_pose.position, content.true_pose.quaternion)
        header = ros2_messages.header(stamp_ns, MAP_FRAME)
        messages["true_pose"] = ros2_messages.encode(
            ros2_messages.POSE_STAMPED, {"header": header, "pose": pose}
        )
    if content.people is not None:
        messages["people"] = encode_people(content.people, stamp_ns)
    return messages


def _heatmap(heatmap: NDArray[Any], camera: Camera) -> tuple[dict[str, Any], dict[str, Any]]:
    """The heatmap, and the camera at its size."""
    raster = _raster(_heatmap_pixels(heatmap))
    return raster, camera_info_fields(camera, (raster["width"], raster["height"]))


def _layer_fields(name: str, layer: LayerContent, camera: Camera) -> dict[FramePart, dict[str, Any]]:
    fields: dict[FramePart, dict[str, Any]] = {}
    if layer.heatmap is not None:
        raster, info = _heatmap(layer.heatmap, camera)
        fields[LayerPart(name, "heatmap")], fields[LayerPart(name, "heatmap_info")] = raster, info
    if layer.labels is not None:
        fields[LayerPart(name, "labels")] = _raster(_silhouette_pixels(layer.labels))
    return fields


def encode_layer_ground(ground: LayerGround, stamp_ns: int) -> bytes:
    """Where the class of a layer is, as a nav_msgs/OccupancyGrid in the local ENU frame."""
    east, north = ground.cells.shape
    message = {
        "header": ros2_messages.header(stamp_ns, MAP_FRAME),
        "info": {
            "map_load_time": ros2_messages.time(stamp_ns),
            "resolution": ground.cell_m,
            "width": east,
            "height": north,
            "origin": pose_fields((ground.west_m, ground.south_m, 0.0), (1.0, 0.0, 0.0, 0.0)),
        },
        # Rows run from south to north, each from west to east.
        "data": (ground.cells.T.astype(np.int8) * 100).ravel().tolist(),
    }
    return ros2_messages.encode(ros2_messages.OCCUPANCY_GRID, message)


def decode_layer_ground(data: bytes, people_m: float) -> LayerGround:
    """A grid as `encode_layer_ground` makes it. ValueError for any other: a grid may be turned, and a cell
    unknown or likely."""
    message = ros2_messages.decode(ros2_messages.OCCUPANCY_GRID, data)
    info = message.info
    cells = np.asarray(message.data, np.int8)
    if cells.size != info.width * info.height:
        raise ValueError(f"{cells.size} cells do not fill a grid of {info.width} x {info.height}")
    at, turn = info.origin.position, info.origin.orientation
    if any(abs(one) > _LEAST_TURN for one in (turn.x, turn.y, turn.z)):
        raise ValueError(f"the grid is turned (x {turn.x:g}, y {turn.y:g}, z {turn.z:g}, w {turn.w:g})")
    if other := set(np.unique(cells).tolist()) - {0, 100}:
        raise ValueError(f"a cell of the grid is {min(other)}; allowed: 0, not of the class, or 100")
    return LayerGround(
        cells.reshape(info.height, info.width).T == 100, float(info.resolution), at.x, at.y, people_m
    )


def pose_fields(position: ArrayLike, quaternion: ArrayLike) -> dict[str, dict[str, float]]:
    """geometry_msgs/Pose of a position [3] and a quaternion [4] (w, x, y, z)."""
    x, y, z = (float(value) for value in np.asarray(position, dtype=np.float64))
    qw, qx, qy, qz = (float(value) for value in np.asarray(quaternion, dtype=np.float64))
    return {"position": {"x": x, "y": y, "z": z}, "orientation": {"w": qw, "x": qx, "y": qy, "z": qz}}


def decode_pose(data: bytes) -> CameraPose:
    """A geometry_msgs/PoseStamped."""
    pose = ros2_messages.decode(ros2_messages.POSE_STAMPED, data).pose
    at, turn = pose.position, pose.orientation
    return CameraPose(np.array([at.x, at.y, at.z]), np.array([turn.w, turn.x, turn.y, turn.z]))


def decode_exposure_ns(data: bytes) -> int:
    """The world's time in a sensor_msgs/TimeReference."""
    return ros2_messages.time_ns(ros2_messages.decode(ros2_messages.TIME_REFERENCE, data).time_ref)


_FLOAT32, _UINT32 = 7, 6
_PEOPLE_FIELDS = {"x": _FLOAT32, "y": _FLOAT32, "z": _FLOAT32, "person": _UINT32, "crowd": _UINT32}
_FORMATS = {_FLOAT32: "<f4", _UINT32: "<u4"}


def encode_people(people: RecordedPeople, stamp_ns: int) -> bytes:
    """People as a sensor_msgs/PointCloud2 in the local ENU frame."""
    kinds = {**_PEOPLE_FIELDS, **({} if people.pixels is None else {"pixels": _UINT32})}
    table = np.zeros(len(people.person), np.dtype([(name, _FORMATS[kind]) for name, kind in kinds.items()]))
    for axis, name in enumerate("xyz"):
        table[name] = people.position[:, axis]
    table["person"], table["crowd"] = people.person, people.crowd
    if people.pixels is not None:
        table["pixels"] = people.pixels
    fields = [
        {"name": name, "offset": 4 * number, "datatype": kind, "count": 1}
        for number, (name, kind) in enumerate(kinds.items())
    ]
    message = {
        "header": ros2_messages.header(stamp_ns, MAP_FRAME),
        "height": 1,
        "width": len(table),
        "fields": fields,
        "is_bigendian": False,
        "point_step": table.itemsize,
        "row_step": table.nbytes,
        "data": table.tobytes(),
        "is_dense": True,
    }
    return ros2_messages.encode(ros2_messages.POINT_CLOUD2, message)


def decode_people(data: bytes) -> RecordedPeople:
    """The people of a PointCloud2 as `encode_people` makes it. ValueError for any other cloud."""
    message = ros2_messages.decode(ros2_messages.POINT_CLOUD2, data)
    found = {entry.name: entry for entry in message.fields}
    kinds = {**_PEOPLE_FIELDS, **({"pixels": _UINT32} if "pixels" in found else {})}
    for name, kind in kinds.items():
        if name not in found or found[name].datatype != kind or found[name].offset + 4 > message.point_step:
            raise ValueError(f"a cloud of people needs the fields {', '.join(kinds)}, got {', '.join(found)}")
    count = message.width * message.height
    if message.is_bigendian or len(message.data) != count * message.point_step:
        raise ValueError(
            f"{count} people of {message.point_step} bytes do not fill {len(message.data)} bytes of data"
        )
    offsets = [found[name].offset for name in kinds]
    row = np.dtype(
        {
            "names": list(kinds),
            "formats": [_FORMATS[kind] for kind in kinds.values()],
            "offsets": offsets,
            "itemsize": message.point_step,
        }
    )
    table = np.frombuffer(message.data, row, count)
    return RecordedPeople(
        ros2_messages.time_ns(message.header.stamp),
        np.stack([table[name] for name in "xyz"], axis=-1).astype(np.float32),
        table["person"].astype(np.uint32),
        table["crowd"].astype(np.uint32),
        table["pixels"].astype(np.uint32) if "pixels" in kinds else None,
    )


_ENCODINGS = {"uint8": "mono8", "uint16": "mono16", "float32": "32FC1"}
_DTYPES = {"mono8": "u1", "8UC1": "u1", "mono16": "u2", "16UC1": "u2", "32FC1": "f4"}


def decode_raster(data: bytes) -> NDArray[Any]:
    """sensor_msgs/Image with one channel -> [h, w]."""
    message = ros2_messages.decode(ros2_messages.IMAGE, data)
    if message.encoding not in _DTYPES:
        raise ValueError(f"image encoding {message.encoding!r} is not supported ({', '.join(_DTYPES)})")
    dtype = np.dtype(_DTYPES[message.encoding]).newbyteorder(">" if message.is_bigendian else "<")
    rows, columns, step = message.height, message.width, message.step
    if step < columns * dtype.itemsize or len(message.data) < rows * step:
        raise ValueError(
            f"{columns}x{rows} {message.encoding} with {step} bytes a row needs more than its "
            f"{len(message.data)} bytes of data"
        )
    bytes_2d = np.frombuffer(message.data, dtype=np.uint8, count=rows * step).reshape(rows, step)
    pixels = np.ascontiguousarray(bytes_2d[:, : columns * dtype.itemsize]).view(dtype)
    return pixels.astype(dtype.newbyteorder("="))


def decode_picture(data: bytes) -> bytes:
    """The file in a sensor_msgs/CompressedImage."""
    return bytes(ros2_messages.decode(ros2_messages.COMPRESSED_IMAGE, data).data)


def depth_in_whole_cm(depth_m: NDArray[np.floating]) -> NDArray[np.float32]:
    """Depth as it comes back from a mission file that keeps centimetres: rounded, NaN beyond 655.35 m."""
    with np.errstate(invalid="ignore"):
        centimetres = np.rint(np.asarray(depth_m, np.float64) * 100)
        kept = (centimetres >= 1) & (centimetres <= LARGEST_DEPTH_CM)
    metres = np.where(kept, centimetres, 0).astype(np.float32) / np.float32(100)
    return np.where(kept, metres, np.float32(np.nan)).astype(np.float32)


def _depth(depth_m: NDArray[np.float32], as_image: bool) -> tuple[Part, dict[str, Any]]:
    """Centimetres where that loses nothing: a third of the bytes."""
    if not as_image and np.array_equal(depth_in_whole_cm(depth_m), depth_m, equal_nan=True) and depth_m.size:
        from PIL import Image

        centimetres = np.rint(np.nan_to_num(depth_m) * 100).astype(np.uint16)
        encoded = io.BytesIO()
        # At level 6, the usual one, this is a third of a simulation's work, for a tenth fewer bytes.
        Image.fromarray(centimetres).save(encoded, format="PNG", compress_level=4)
        return "depth_cm", {"format": "png", "data": encoded.getvalue()}
    return "depth", _raster(depth_m)


def _compressed(image: bytes) -> dict[str, Any]:
    picture = picture_format(image)
    if picture is None:
        raise ValueError(f"an image must be JPEG or PNG, got bytes that begin with {image[:8]!r}")
    return {"format": picture, "data": bytes(image)}


def _heatmap_pixels(heatmap: NDArray[Any]) -> NDArray[Any]:
    if np.ma.is_masked(heatmap):
        raise ValueError(
            "cells of a heatmap are masked; a mission file has no word for what was not looked at"
        )
    heatmap = np.asarray(heatmap)
    if heatmap.dtype == np.uint8:
        return heatmap
    if not np.issubdtype(heatmap.dtype, np.floating):
        raise ValueError(f"a heatmap is uint8 or float, got {heatmap.dtype}")
    return heatmap.astype(np.float32)


def _numbers(what: str, pixels: NDArray[Any], largest: int = 65535) -> NDArray[Any]:
    """As uint8 where the numbers fit, else as uint16."""
    pixels = np.asarray(pixels)
    if pixels.dtype == np.uint8 or pixels.size == 0:
        return pixels.astype(np.uint8)
    low, high = int(pixels.min()), int(pixels.max())
    if not np.issubdtype(pixels.dtype, np.integer) or low < 0 or high > largest:
        raise ValueError(f"{what} are integers in [0, {largest}], got {pixels.dtype} from {low} to {high}")
    return pixels.astype(np.uint8 if high < 256 else np.uint16)


def _silhouette_pixels(silhouettes: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return np.asarray(silhouettes, dtype=np.bool_).astype(np.uint8) * np.uint8(255)


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
