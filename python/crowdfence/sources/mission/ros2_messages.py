"""The ROS 2 message types of a mission file and of live fleets, and the few fields of them that we read
without a decoder.

The definitions are the interfaces of common_interfaces, geometry2 and geographic_info as of ROS 2 Humble to
Kilted, without comments. CDR does not describe itself; we decode with these texts, never with those found in
a file.
"""

import struct
from collections.abc import Callable
from functools import cache
from typing import Any

_TIME = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec")
_HEADER = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id")
_POINT = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z")
_VECTOR3 = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z")
_QUATERNION = ("geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1")
_POSE = ("geometry_msgs/Pose", "Point position\nQuaternion orientation")
_COVARIANT_POSE = ("geometry_msgs/PoseWithCovariance", "Pose pose\nfloat64[36] covariance")
_COVARIANT_TWIST = ("geometry_msgs/TwistWithCovariance", "Twist twist\nfloat64[36] covariance")
_TWIST = ("geometry_msgs/Twist", "Vector3 linear\nVector3 angular")
_TRANSFORM = ("geometry_msgs/Transform", "Vector3 translation\nQuaternion rotation")
_TRANSFORM_STAMPED = (
    "geometry_msgs/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\nTransform transform",
)
_REGION = (
    "sensor_msgs/RegionOfInterest",
    "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify",
)
_CAMERA_INFO = """\
std_msgs/Header header
uint32 height
uint32 width
string distortion_model
float64[] d
float64[9] k
float64[9] r
float64[12] p
uint32 binning_x
uint32 binning_y
RegionOfInterest roi"""
_IMAGE = """\
std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data"""

_POINT_FIELD = (
    "sensor_msgs/PointField",
    "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\n"
    "uint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count",
)
_POINT_CLOUD2 = """\
std_msgs/Header header
uint32 height
uint32 width
PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense"""
_NAV_SAT_FIX = """\
uint8 COVARIANCE_TYPE_UNKNOWN=0
uint8 COVARIANCE_TYPE_APPROXIMATED=1
uint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2
uint8 COVARIANCE_TYPE_KNOWN=3
std_msgs/Header header
NavSatStatus status
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance
uint8 position_covariance_type"""
_NAV_SAT_STATUS = (
    "sensor_msgs/NavSatStatus",
    "int8 STATUS_NO_FIX=-1\nint8 STATUS_FIX=0\nint8 STATUS_SBAS_FIX=1\nint8 STATUS_GBAS_FIX=2\n"
    "uint16 SERVICE_GPS=1\nuint16 SERVICE_GLONASS=2\nuint16 SERVICE_COMPASS=4\nuint16 SERVICE_GALILEO=8\n"
    "int8 status\nuint16 service",
)
_DURATION = ("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec")
_COMPRESSED_IMAGE = "std_msgs/Header header\nstring format\nuint8[] data"
_OCCUPANCY_GRID = "std_msgs/Header header\nMapMetaData info\nint8[] data"
_MAP_META_DATA = (
    "nav_msgs/MapMetaData",
    "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\n"
    "geometry_msgs/Pose origin",
)
_COLOR = ("std_msgs/ColorRGBA", "float32 r\nfloat32 g\nfloat32 b\nfloat32 a")
_MARKER = (
    "visualization_msgs/Marker",
    """\
int32 ARROW=0
int32 CUBE=1
int32 SPHERE=2
int32 CYLINDER=3
int32 LINE_STRIP=4
int32 LINE_LIST=5
int32 CUBE_LIST=6
int32 SPHERE_LIST=7
int32 POINTS=8
int32 TEXT_VIEW_FACING=9
int32 MESH_RESOURCE=10
int32 TRIANGLE_LIST=11
int32 ADD=0
int32 MODIFY=0
int32 DELETE=2
int32 DELETEALL=3
std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string texture_resource
sensor_msgs/CompressedImage texture
UVCoordinate[] uv_coordinates
string text
string mesh_resource
MeshFile mesh_file
bool mesh_use_embedded_materials""",
)
_UV_COORDINATE = ("visualization_msgs/UVCoordinate", "float32 u\nfloat32 v")
_MESH_FILE = ("visualization_msgs/MeshFile", "string filename\nuint8[] data")


def _definition(text: str, *parts: tuple[str, str]) -> str:
    separator = "\n" + "=" * 80 + "\n"
    return separator.join([text, *(f"MSG: {name}\n{part}" for name, part in parts)]) + "\n"


IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
POINT_CLOUD2 = "sensor_msgs/msg/PointCloud2"
TIME_REFERENCE = "sensor_msgs/msg/TimeReference"
OCCUPANCY_GRID = "nav_msgs/msg/OccupancyGrid"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"
NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
GEO_POINT_STAMPED = "geographic_msgs/msg/GeoPointStamped"

DEFINITIONS = {
    IMAGE: _definition(_IMAGE, _HEADER, _TIME),
    COMPRESSED_IMAGE: _definition(_COMPRESSED_IMAGE, _HEADER, _TIME),
    CAMERA_INFO: _definition(_CAMERA_INFO, _REGION, _HEADER, _TIME),
    POSE_STAMPED: _definition(
        "std_msgs/Header header\nPose pose", _POSE, _POINT, _QUATERNION, _HEADER, _TIME
    ),
    POSE_WITH_COVARIANCE: _definition(
        "std_msgs/Header header\nPoseWithCovariance pose",
        _COVARIANT_POSE,
        _POSE,
        _POINT,
        _QUATERNION,
        _HEADER,
        _TIME,
    ),
    ODOMETRY: _definition(
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
        "geometry_msgs/TwistWithCovariance twist",
        _COVARIANT_POSE,
        _COVARIANT_TWIST,
        _TWIST,
        _VECTOR3,
        _POSE,
        _POINT,
        _QUATERNION,
        _HEADER,
        _TIME,
    ),
    TF_MESSAGE: _definition(
        "geometry_msgs/TransformStamped[] transforms",
        _TRANSFORM_STAMPED,
        _TRANSFORM,
        _VECTOR3,
        _QUATERNION,
        _HEADER,
        _TIME,
    ),
    POINT_CLOUD2: _definition(_POINT_CLOUD2, _POINT_FIELD, _HEADER, _TIME),
    TIME_REFERENCE: _definition(
        "std_msgs/Header header\nbuiltin_interfaces/Time time_ref\nstring source", _HEADER, _TIME
    ),
    OCCUPANCY_GRID: _definition(_OCCUPANCY_GRID, _MAP_META_DATA, _POSE, _POINT, _QUATERNION, _HEADER, _TIME),
    NAV_SAT_FIX: _definition(_NAV_SAT_FIX, _NAV_SAT_STATUS, _HEADER, _TIME),
    GEO_POINT_STAMPED: _definition(
        "std_msgs/Header header\nGeoPoint position",
        ("geographic_msgs/GeoPoint", "float64 latitude\nfloat64 longitude\nfloat64 altitude"),
        _HEADER,
        _TIME,
    ),
    MARKER_ARRAY: _definition(
        "Marker[] markers",
        _MARKER,
        _UV_COORDINATE,
        _MESH_FILE,
        ("sensor_msgs/CompressedImage", _COMPRESSED_IMAGE),
        _COLOR,
        _POSE,
        _POINT,
        _QUATERNION,
        _VECTOR3,
        _DURATION,
        _HEADER,
        _TIME,
    ),
}


def header(stamp_ns: int, frame_id: str) -> dict[str, Any]:
    """std_msgs/Header as the encoder takes it."""
    return {"stamp": time(stamp_ns), "frame_id": frame_id}


def time(stamp_ns: int) -> dict[str, int]:
    """builtin_interfaces/Time as the encoder takes it."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return {"sec": sec, "nanosec": nanosec}


def time_ns(message: Any) -> int:
    """Nanoseconds of a decoded builtin_interfaces/Time."""
    return int(message.sec) * 1_000_000_000 + int(message.nanosec)


def encode(message_type: str, fields: dict[str, Any]) -> bytes:
    """A message of one of the types above as CDR; a field that is missing is zero or empty."""
    return bytes(_encoder(message_type)(fields))


def decode(message_type: str, data: bytes) -> Any:
    """A CDR message of one of the types above as an object with its fields.

    ValueError when the bytes are too short or hold text that is not UTF-8.
    """
    try:
        return _decoder(message_type)(data)
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise ValueError(f"{len(data)} bytes are no {message_type}: {error}") from error


def header_stamp_ns(data: bytes) -> int:
    """Stamp of a CDR message that begins with a std_msgs/Header, without decoding the rest."""
    if len(data) < 12:
        raise ValueError(f"{len(data)} bytes are too few for a message header (12)")
    order = "<" if data[1] & 1 else ">"
    sec, nanosec = struct.unpack_from(f"{order}iI", data, 4)
    return int(sec) * 1_000_000_000 + int(nanosec)


@cache
def _encoder(message_type: str) -> Callable[[dict[str, Any]], bytes]:
    # The package has no public encoder apart from its writer, which takes no message that is already encoded.
    from mcap_ros2._dynamic import serialize_dynamic

    return serialize_dynamic(message_type, DEFINITIONS[message_type])[message_type]  # type: ignore[no-any-return]


@cache
def _decoder(message_type: str) -> Callable[[bytes], Any]:
    from mcap.records import Schema
    from mcap.well_known import MessageEncoding, SchemaEncoding
    from mcap_ros2.decoder import DecoderFactory

    text = DEFINITIONS[message_type].encode()
    schema = Schema(id=1, name=message_type, encoding=SchemaEncoding.ROS2, data=text)
    decoder = DecoderFactory().decoder_for(MessageEncoding.CDR, schema)
    assert decoder is not None
    return decoder
