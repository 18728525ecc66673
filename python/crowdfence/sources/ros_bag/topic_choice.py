"""Which topics of a bag are whose camera, intrinsics and pose: as the user says, or by types and names."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace

from crowdfence.sources.ros_bag.bag_file import BagTopic

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
FIX, IMU = "sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/Imu"
ORIGIN = "geographic_msgs/msg/GeoPointStamped"

POSES = (POSE, ODOMETRY, POSE_WITH_COVARIANCE, TRANSFORM)
ROLES: dict[str, tuple[str, ...]] = {
    "camera": (COMPRESSED, IMAGE),
    "info": (CAMERA_INFO,),
    "heatmap": (IMAGE,),
    "camera_pose": POSES,
    "pose": POSES,
    "tf": TF_TYPES,
    "fix": (FIX,),
    "imu": (IMU,),
    "origin": (ORIGIN, FIX),
}
"""What `--topics` can name, and the message types that each may have."""

_NO_CAMERA = re.compile(r"depth|disparity|heatmap|truth|mask|segment|confidence|theora|thermal|/ir\b|infra")
_NO_POSE = re.compile(r"setpoint|target|goal|cmd|command|reference|truth|home|trajectory|desired")
_ORIGIN = re.compile(r"(origin|datum)[^/]*$")
_HEATMAP = re.compile(r"heatmap")


@dataclass(frozen=True, slots=True)
class DroneTopics:
    """The topics of one drone's camera; None = there is none."""

    drone: str
    camera: str | None = None
    info: str | None = None
    heatmap: str | None = None
    """Recorded heatmaps (sensor_msgs/Image, mono8 or 32FC1), with the stamps of their pictures."""
    camera_pose: str | None = None
    """Pose of the camera's optical frame in a level, north-aligned world (ENU)."""
    pose: str | None = None
    """Pose of the drone's body, forward-left-up, in the same."""
    tf: str | None = None
    fix: str | None = None
    imu: str | None = None
    origin: str | None = None
    """Where on Earth the (0, 0, 0) of the poses lies."""

    def __str__(self) -> str:
        named = ((field.name, getattr(self, field.name)) for field in fields(self)[1:])
        return f"{self.drone}: " + ",".join(f"{role}={topic}" for role, topic in named if topic)


def stated_topics(texts: Sequence[str], topics: Mapping[str, BagTopic]) -> list[DroneTopics]:
    """From ROLE=TOPIC,... for one drone each, with drone=NAME where there are several.

    ValueError for a role or topic that there is not, or a topic of a type that does not serve the role.
    """
    drones = []
    for number, text in enumerate(texts, start=1):
        named = each_once((_pair(part, text) for part in text.split(",")), text)
        drone = named.pop("drone", None)
        for role, topic in named.items():
            _check_role(role, topic, topics)
        namespace = _namespace(named.get("camera") or named.get("heatmap") or "")
        drones.append(DroneTopics(drone or namespace or f"drone{number}", **named))
    names = [one.drone for one in drones]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ValueError(f"--topics: two drones are called {min(twice)!r}; name them with drone=NAME,...")
    return drones


def guessed_topics(topics: Mapping[str, BagTopic]) -> list[DroneTopics]:
    """One camera per drone: of the cameras that share a namespace, the one that has intrinsics. Heatmaps
    stand for pictures that were not recorded. Empty when nothing looks like a camera with a pose."""
    drones: dict[str, DroneTopics] = {}
    for eye in _eyes(topics):
        found = _around(eye, topics)
        other = drones.get(found.drone)
        if other is None or (other.info is None and found.info is not None):
            drones[found.drone] = found
    placed = [
        one for one in drones.values() if one.camera_pose or one.pose or one.tf or (one.fix and one.imu)
    ]
    # Heatmaps are of one camera: those that lie beside several are nobody's.
    claims = Counter(one.heatmap for one in placed)
    return [replace(one, heatmap=None) if claims[one.heatmap] > 1 else one for one in placed]


def transform_topics(
    one: DroneTopics, chosen: Sequence[DroneTopics], static: Sequence[str]
) -> tuple[str, ...]:
    """Topics whose transforms are those of a drone; `static`: all that tell fixed ones. In a fleet each drone
    may have topics of its own (/uav1/tf), in which frames of all are called alike."""
    common = [name for name in static if not _place(name)]
    own = [name for name in static if _is_of(name, one)]
    if not own:
        taken = [name for name in static if any(_is_of(name, other) for other in chosen)]
        left = [name for name in static if name not in (*common, *taken)]
        # Those of a robot whose camera is called otherwise; of several robots nobody knows which.
        own = left if not common or len(left) == 1 else []
    return tuple(dict.fromkeys([*([one.tf] if one.tf else []), *own, *common]))


def _place(topic: str) -> str:
    return topic.rpartition("/")[0]


def _is_of(static: str, one: DroneTopics) -> bool:
    return _place(static) in places_of(one)


def places_of(one: DroneTopics) -> set[str]:
    """Namespaces of a drone's own: those that its camera and its pose lie in, from their own outwards but for
    the outermost, and that of its transforms."""
    places = {_place(one.tf or "")} - {""}
    for topic in (one.camera, one.heatmap, one.pose):
        place = topic or ""
        while place := _place(place):
            places.add(place)
    return places


def left_out(topics: Mapping[str, BagTopic], chosen: Sequence[DroneTopics]) -> list[str]:
    """Topics of cameras and heatmaps that were not chosen, such as the second camera of a drone."""
    taken = {topic for one in chosen for topic in (one.camera, one.heatmap)}
    return [name for name in (*_cameras(topics), *_heatmaps(topics)) if name not in taken]


def shared_pose(
    topics: Mapping[str, BagTopic], told_by: Mapping[str, Iterable[str]]
) -> Iterator[tuple[list[str], str, str]]:
    """Where cameras in namespaces of their own were given one topic of poses though a robot of another
    namespace tells some that nobody was given: the drones, the topic, the other. `told_by`: topics of poses
    by drone."""
    used = {topic for names in told_by.values() for topic in names}
    for topic in sorted(used):
        drones = [drone for drone, names in told_by.items() if topic in names]
        kinds = next((kinds for kinds in (POSES, (FIX,)) if topics[topic].type in kinds), ())
        others = [
            name
            for name, other in topics.items()
            if other.type in kinds
            and other.count
            and not _NO_POSE.search(name.lower())
            and _namespace(name) not in {_namespace(one) for one in used}
        ]
        if len(drones) > 1 and others:
            yield drones, topic, min(others)


def topic_list(topics: Mapping[str, BagTopic]) -> str:
    """What is there, for a message."""
    rows = (f"{name} ({topic.type}, {topic.count})" for name, topic in sorted(topics.items()))
    return "; ".join(rows) or "none"


def each_once(pairs: Iterable[tuple[str, str]], text: str) -> dict[str, str]:
    """Topic by role of one drone. ValueError for a role given twice: which one is meant, nobody knows."""
    named: dict[str, str] = {}
    for role, topic in pairs:
        if role in named:
            raise ValueError(
                f"--topics {text!r}: {role} is given twice, a drone has one; another drone has --topics too"
            )
        named[role] = topic
    return named


def _pair(part: str, text: str) -> tuple[str, str]:
    role, equals, topic = part.strip().partition("=")
    if not (equals and topic):
        raise ValueError(f"--topics {text!r}: {part!r} must be ROLE=TOPIC, roles: drone, {', '.join(ROLES)}")
    return role, topic


def _check_role(role: str, topic: str, topics: Mapping[str, BagTopic]) -> None:
    if role not in ROLES:
        raise ValueError(f"--topics: no role {role!r}; roles are drone, {', '.join(ROLES)}")
    if topic not in topics:
        raise ValueError(f"--topics: no topic {topic} in the bag; it has {topic_list(topics)}")
    if topics[topic].type not in ROLES[role]:
        raise ValueError(
            f"--topics: {topic} holds {topics[topic].type}; {role} needs {' or '.join(ROLES[role])}"
        )


def _cameras(topics: Mapping[str, BagTopic]) -> list[str]:
    """Camera topics by name; of a picture that was recorded both packed and raw, the packed one."""
    names = [
        name
        for name, topic in topics.items()
        if topic.type in (COMPRESSED, IMAGE) and topic.count and not _NO_CAMERA.search(name.lower())
    ]
    packed = {name.removesuffix("/compressed") for name in names if topics[name].type == COMPRESSED}
    return sorted(name for name in names if topics[name].type == COMPRESSED or name not in packed)


def _heatmaps(topics: Mapping[str, BagTopic]) -> list[str]:
    return sorted(
        name
        for name, topic in topics.items()
        if topic.type == IMAGE
        and topic.count
        and _HEATMAP.search(name.lower())
        and not _NO_POSE.search(name.lower())
    )


def _eyes(topics: Mapping[str, BagTopic]) -> list[str]:
    """Topics of cameras, and those of heatmaps that have intrinsics but no camera in their namespace."""
    cameras = _cameras(topics)
    seeing = {_namespace(name) for name in cameras}
    known = {_namespace(name) for name, topic in topics.items() if topic.type == CAMERA_INFO and topic.count}
    alone = known - seeing
    return [*cameras, *(name for name in _heatmaps(topics) if _namespace(name) in alone)]


def _around(eye: str, topics: Mapping[str, BagTopic]) -> DroneTopics:
    drones = {_namespace(name) for name in _eyes(topics)}
    several = len(drones) > 1

    def nearest(
        kinds: Sequence[str], *, named: re.Pattern[str] | None = None, but: re.Pattern[str] = _NO_POSE
    ) -> str | None:
        found = [
            name
            for name, topic in topics.items()
            if topic.type in kinds
            and topic.count
            and not _NO_POSE.search(name.lower())
            and not but.search(name.lower())
            and (named is None or named.search(name.lower()))
            and not (several and _namespace(name) in drones - {_namespace(eye)})
        ]
        # What is beside the camera is its own, before what another drone tells in a better message.
        return min(
            found,
            key=lambda name: (-_shared(eye, name), kinds.index(topics[name].type), len(name), name),
            default=None,
        )

    infos = [name for name, topic in topics.items() if topic.type == CAMERA_INFO and topic.count]
    near = [name for name in infos if _shared(eye, name) >= max(1, eye.count("/") - 2)]
    # That of a depth camera or of the other eye of a stereo pair lies beside the camera, not above it.
    own = [name for name in near if eye.startswith(f"{_place(name)}/")]
    is_camera = eye in _cameras(topics)
    if not is_camera and not own:
        # Heatmaps may lie beside what tells of their camera, if there is one camera alone.
        own = near if len(near) == 1 and not _NO_CAMERA.search(near[0].lower()) else []
    return DroneTopics(
        _namespace(eye) or "drone",
        camera=eye if is_camera else None,
        info=max(own, key=lambda name: _shared(eye, name), default=None),
        heatmap=nearest((IMAGE,), named=_HEATMAP) if is_camera else eye,
        camera_pose=nearest((POSE,), named=re.compile("cam")),
        tf=nearest(TF_TYPES, but=re.compile("_static$")) or nearest(TF_TYPES),
        pose=nearest((ODOMETRY, *POSES)),
        fix=nearest((FIX,), but=_ORIGIN),
        imu=nearest((IMU,)),
        origin=nearest((ORIGIN,)) or nearest((FIX,), named=_ORIGIN),
    )


def _namespace(topic: str) -> str:
    """First part of a topic's name."""
    return topic.strip("/").partition("/")[0]


def _shared(a: str, b: str) -> int:
    """How many leading parts two topic names have in common."""
    count = 0
    for one, other in zip(a.strip("/").split("/"), b.strip("/").split("/"), strict=False):
        if one != other:
            break
        count += 1
    return count
