"""The native mission file: MCAP, profile `ros2`, CDR, so that Foxglove, rosbag2 and Rerun open it.

Per drone, all with the image's stamp in the header and the same number as log time:

    /<drone>/camera/image/compressed  sensor_msgs/CompressedImage  JPEG or PNG, bytes untouched
    /<drone>/camera/camera_info       sensor_msgs/CameraInfo       one per frame
    /<drone>/heatmap                  sensor_msgs/Image            mono8 (value / 255) or 32FC1
    /<drone>/heatmap/camera_info      sensor_msgs/CameraInfo       the camera at the heatmap's size
    /<drone>/truth/regions            sensor_msgs/Image            mono8 or mono16, crowd number, 0 = none
    /<drone>/truth/silhouettes        sensor_msgs/Image            mono8, 255 = a person of a crowd
    /<drone>/truth/depth              sensor_msgs/Image            32FC1, metres along z (REP 118), or NaN
    /<drone>/truth/depth_cm           sensor_msgs/CompressedImage  the same where whole centimetres up to
                                                                   655.35 m say it all: 16-bit PNG, 0 = NaN
    /<drone>/truth/segmentation       sensor_msgs/Image            mono8, class (`CLASSES`)
    /<drone>/truth/instances          sensor_msgs/Image            mono8 or mono16, person, 0 = none
    /<drone>/truth/pose               geometry_msgs/PoseStamped    the camera as it was, not as it was logged
    /<drone>/truth/exposure           sensor_msgs/TimeReference    true time of the picture
    /<drone>/truth/people             sensor_msgs/PointCloud2      people inside the picture at that time:
                                                                   x, y, z, person, crowd, pixels (0 = hidden)

of every further layer (class of heatmaps), whose name has `_` for `-` here, as ROS wants it:

    /<drone>/layers/<layer>/heatmap              sensor_msgs/Image       as the heatmap of crowds
    /<drone>/layers/<layer>/heatmap/camera_info  sensor_msgs/CameraInfo
    /<drone>/layers/<layer>/truth/labels         sensor_msgs/Image       mono8, 0 = not of the class

and at telemetry rate, the camera's optical frame in the local ENU frame `map`:

    /<drone>/camera/pose              geometry_msgs/PoseStamped
    /tf                               tf2_msgs/TFMessage           the same: map -> <drone>/camera_optical

and on the clock of the world:

    /truth/people                     sensor_msgs/PointCloud2      everybody: x, y, z, person, crowd
    /truth/layers/<layer>             nav_msgs/OccupancyGrid       once: 100 = the ground is of the class, 0 =
                                                                   not; how near people take it away stands
                                                                   in the metadata `crowdfence.layer`

A frame that arrives late or out of order keeps its stamp in the header; its log time is the arrival.

CameraInfo counts pixels as ROS and OpenCV do, the centre of the first one at (0, 0), ours is at (0.5, 0.5).
Its cx and cy are ours minus a half; the subtraction is exact for cx, cy >= 0.5.

Metadata records: `crowdfence` (format version, georeference, terrain, how that is read as `terrain_options`
in JSON, source), `crowdfence.drone` (one per drone: its name and its topic prefix, written before its first
message, and `pose_gap_s` where its frames lie between poses further apart than readers bridge of themselves),
`crowdfence.refused` (frames that a conversion had to leave out), `crowdfence.warnings` (what was doubtful
about the recording that was converted), `crowdfence.alignment` and `crowdfence.pose_noise` (by what its poses
were put right and smoothed), `crowdfence.detector` (the contract of the model that made its heatmaps), and of
a simulated mission `crowdfence.simulation` (scenario, seed and renderer, first of all) and
`crowdfence.statistics` (what came out, last of all). All from `crowdfence.refused` on hold JSON.

A map may lie inside as an attachment (`attached_map`), before the first message, behind those of the files
that lay beside it and belong to it.

Readers skip topics that they do not know, so everything that was added since version 1 began is of
version 1 too.
"""

import re
from typing import Literal, NamedTuple, get_args

from crowdfence.sources.mission import ros2_messages

FORMAT_VERSION = 1
MAGIC = b"\x89MCAP0\r\n"

METADATA = "crowdfence"
METADATA_DRONE = "crowdfence.drone"
METADATA_LAYER = "crowdfence.layer"
METADATA_REFUSED = "crowdfence.refused"
METADATA_WARNINGS = "crowdfence.warnings"
METADATA_SIMULATION = "crowdfence.simulation"
METADATA_STATISTICS = "crowdfence.statistics"
METADATA_ALIGNMENT = "crowdfence.alignment"
METADATA_DETECTOR = "crowdfence.detector"
METADATA_POSE_NOISE = "crowdfence.pose_noise"

OF_THE_SOURCE = "before it was converted: "
"""Begins a warning that a file was converted with."""

MAP_FRAME = "map"

PEOPLE_TOPIC = "/truth/people"

CLASSES = {0: "sky", 1: "ground", 2: "road", 3: "crowd", 4: "cyclist"}
"""What the numbers of a segmentation mean."""
CROWD_CLASS = 3

Part = Literal[
    "image",
    "camera_info",
    "heatmap",
    "heatmap_info",
    "regions",
    "silhouettes",
    "depth",
    "depth_cm",
    "segmentation",
    "instances",
    "true_pose",
    "exposure",
    "people",
    "pose",
]

TOPICS: dict[Part, tuple[str, str]] = {
    "image": ("camera/image/compressed", ros2_messages.COMPRESSED_IMAGE),
    "camera_info": ("camera/camera_info", ros2_messages.CAMERA_INFO),
    "heatmap": ("heatmap", ros2_messages.IMAGE),
    "heatmap_info": ("heatmap/camera_info", ros2_messages.CAMERA_INFO),
    "regions": ("truth/regions", ros2_messages.IMAGE),
    "silhouettes": ("truth/silhouettes", ros2_messages.IMAGE),
    "depth": ("truth/depth", ros2_messages.IMAGE),
    "depth_cm": ("truth/depth_cm", ros2_messages.COMPRESSED_IMAGE),
    "segmentation": ("truth/segmentation", ros2_messages.IMAGE),
    "instances": ("truth/instances", ros2_messages.IMAGE),
    "true_pose": ("truth/pose", ros2_messages.POSE_STAMPED),
    "exposure": ("truth/exposure", ros2_messages.TIME_REFERENCE),
    "people": ("truth/people", ros2_messages.POINT_CLOUD2),
    "pose": ("camera/pose", ros2_messages.POSE_STAMPED),
}
"""What each topic below `/<drone>/` holds and its message type."""

assert set(TOPICS) == set(get_args(Part))


class LayerPart(NamedTuple):
    """One part of a further layer of a frame."""

    layer: str
    what: Literal["heatmap", "heatmap_info", "labels"]


LAYER_TOPICS: dict[str, tuple[str, str]] = {
    "heatmap": ("heatmap", ros2_messages.IMAGE),
    "heatmap_info": ("heatmap/camera_info", ros2_messages.CAMERA_INFO),
    "labels": ("truth/labels", ros2_messages.IMAGE),
}
"""What each topic below `/<drone>/layers/<layer>/` holds and its message type."""

FramePart = Part | LayerPart

_PARTS = {suffix: part for part, (suffix, _) in TOPICS.items()}
_LAYER_PARTS = {suffix: what for what, (suffix, _) in LAYER_TOPICS.items()}
_LAYER_GROUND = "/truth/layers/"


def topic(prefix: str, part: FramePart) -> str:
    """Topic of one part of the drone with this topic prefix."""
    if isinstance(part, LayerPart):
        return f"{prefix}/layers/{_token(part.layer)}/{LAYER_TOPICS[part.what][0]}"
    return f"{prefix}/{TOPICS[part][0]}"


def message_type(part: FramePart) -> str:
    """Message type of a part."""
    return LAYER_TOPICS[part.what][1] if isinstance(part, LayerPart) else TOPICS[part][1]


def split_topic(name: str) -> tuple[str, FramePart] | None:
    """(topic prefix, part) of a topic, None for one that is not ours."""
    match = re.fullmatch(r"(/[^/]+)/(.+)", name)
    if match is None:
        return None
    if match[2] in _PARTS:
        return match[1], _PARTS[match[2]]
    of_layer = re.fullmatch(r"layers/([a-z][a-z0-9_]*)/(.+)", match[2])
    if of_layer is None or of_layer[2] not in _LAYER_PARTS:
        return None
    return match[1], LayerPart(_layer(of_layer[1]), _LAYER_PARTS[of_layer[2]])  # type: ignore[arg-type]


def layer_ground_topic(layer: str) -> str:
    """Topic of where in the world the class of a layer is."""
    return _LAYER_GROUND + _token(layer)


def layer_of_ground_topic(name: str) -> str | None:
    """The layer of such a topic, None for another one."""
    match = re.fullmatch(_LAYER_GROUND + r"([a-z][a-z0-9_]*)", name)
    return None if match is None else _layer(match[1])


def _token(layer: str) -> str:
    return layer.replace("-", "_")


def _layer(token: str) -> str:
    return token.replace("_", "-")


def topic_prefix(drone: str, taken: set[str]) -> str:
    """A topic prefix for a drone: its name without what ROS does not allow, different from those taken."""
    token = re.sub(r"[^A-Za-z0-9_]", "_", drone)
    if not re.match(r"[A-Za-z]", token):
        token = f"drone_{token}"
    prefix, number = f"/{token}", 2
    while prefix in taken:
        prefix, number = f"/{token}_{number}", number + 1
    return prefix


def camera_frame(prefix: str) -> str:
    """Name of the camera's optical frame of the drone with this topic prefix."""
    return f"{prefix[1:]}/camera_optical"
