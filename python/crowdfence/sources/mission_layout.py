"""The native mission file: MCAP, profile `ros2`, CDR, so that Foxglove, rosbag2 and Rerun open it.

Per drone, all with the image's stamp in the header and the same number as log time:

    /<drone>/camera/image/compressed  sensor_msgs/CompressedImage  JPEG or PNG, bytes untouched
    /<drone>/camera/camera_info       sensor_msgs/CameraInfo       one per frame
    /<drone>/heatmap                  sensor_msgs/Image            mono8 (value / 255) or 32FC1
    /<drone>/truth/regions            sensor_msgs/Image            mono8 or mono16, crowd number, 0 = none
    /<drone>/truth/silhouettes        sensor_msgs/Image            mono8, 255 = a person of a crowd
    /<drone>/truth/depth              sensor_msgs/Image            32FC1, metres along z (REP 118), or NaN

and at telemetry rate, the camera's optical frame in the local ENU frame `map`:

    /<drone>/camera/pose              geometry_msgs/PoseStamped
    /tf                               tf2_msgs/TFMessage           the same: map -> <drone>/camera_optical

CameraInfo counts pixels as ROS and OpenCV do, the centre of the first one at (0, 0), ours is at (0.5, 0.5).
Its cx and cy are ours minus a half; the subtraction is exact for cx, cy >= 0.5.

Metadata records: `crowdfence` (format version, georeference, terrain, source), `crowdfence.drone` (one per
drone: its name and its topic prefix, written before its first message) and `crowdfence.refused` (frames that
a conversion had to leave out, as JSON).
"""

import re
from typing import Literal, get_args

from crowdfence.sources import ros2_messages

FORMAT_VERSION = 1
MAGIC = b"\x89MCAP0\r\n"

METADATA = "crowdfence"
METADATA_DRONE = "crowdfence.drone"
METADATA_REFUSED = "crowdfence.refused"

MAP_FRAME = "map"

Part = Literal["image", "camera_info", "heatmap", "regions", "silhouettes", "depth", "pose"]

TOPICS: dict[Part, tuple[str, str]] = {
    "image": ("camera/image/compressed", ros2_messages.COMPRESSED_IMAGE),
    "camera_info": ("camera/camera_info", ros2_messages.CAMERA_INFO),
    "heatmap": ("heatmap", ros2_messages.IMAGE),
    "regions": ("truth/regions", ros2_messages.IMAGE),
    "silhouettes": ("truth/silhouettes", ros2_messages.IMAGE),
    "depth": ("truth/depth", ros2_messages.IMAGE),
    "pose": ("camera/pose", ros2_messages.POSE_STAMPED),
}
"""What each topic below `/<drone>/` holds and its message type."""

assert set(TOPICS) == set(get_args(Part))

_PARTS = {suffix: part for part, (suffix, _) in TOPICS.items()}


def topic(prefix: str, part: Part) -> str:
    """Topic of one part of the drone with this topic prefix."""
    return f"{prefix}/{TOPICS[part][0]}"


def split_topic(name: str) -> tuple[str, Part] | None:
    """(topic prefix, part) of a topic, None for one that is not ours."""
    match = re.fullmatch(r"(/[^/]+)/(.+)", name)
    if match is None or match[2] not in _PARTS:
        return None
    return match[1], _PARTS[match[2]]


def topic_prefix(drone: str, taken: set[str]) -> str:
    """A topic prefix for a drone: its name without what ROS does not allow, different from those taken."""
    token = re.sub(r"[^A-Za-z0-9_]", "_", drone)
    if not re.match(r"[A-Za-z]", token):
        token = f"drone_{token}"
    prefix, number = f"/{token}", 2
    while prefix in taken:
        prefix, number = f"/{token}_{number}", number + 1
    return prefix
