"""The bundled recording written the way others record: by their own writers, from positions on Earth and
angles that are worked out here from direction vectors, not by the package's quaternions."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import av
import numpy as np
import rasterio
import rasterio.transform
import shapely
from numpy.typing import NDArray
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational
from pyproj import Transformer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation
from shapely import unary_union

import crowdfence
from crowdfence import RunConfig, Terrain, ZoneConfig, open_recording
from crowdfence.sources.recording import Frame, Recording
from support.flight_logs import ulog

DEMO = Path(crowdfence.__file__).parent / "demo_data" / "race.mcap"
DRONE = "uav1"
FRAMES = 6


@cache
def mission() -> Recording:
    return open_recording(DEMO)


LOW, HIGH = np.array([-690.0, 20.0]), np.array([-520.0, 160.0])
"""The part of the map that the frames show, local metres."""


@cache
def whole_map() -> Terrain:
    return crowdfence.open_terrain(mission())


def heights(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Height of the map's surface at places [N, 2]."""
    origins = np.column_stack([xy, np.full(len(xy), 300.0)])
    _, down = whole_map().raycast(origins, np.tile([0.0, 0.0, -1.0], (len(xy), 1)), 1000.0)
    return 300.0 - down


def ground(offset: NDArray[np.float64] | None = None) -> Terrain:
    """That part of the map at a metre, in the mission's frame or one that is shifted against it."""
    x, y, z = np.zeros(3) if offset is None else offset
    return Terrain.from_height_map(_ground_cells(), 1.0, origin=(LOW[0] + x, LOW[1] + y, z))


@cache
def _ground_cells() -> NDArray[np.float32]:
    size = (HIGH - LOW).astype(int)
    cells = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in size), indexing="ij"), axis=-1)
    z = heights(cells.reshape(-1, 2) + LOW).reshape(size)
    return z.astype(np.float32)


def write_dem(path: Path) -> Path:
    """That part of the map as a GeoTIFF in UTM 32N at a metre, heights above the ellipsoid."""
    anchor = mission().georeference
    assert anchor is not None
    corners = [(x, y, 0.0) for x in (LOW[0], HIGH[0]) for y in (LOW[1], HIGH[1])]
    utm = anchor.projected_from_local("EPSG:32632", corners)
    west, south = np.floor(utm[:, :2].min(axis=0))
    east, north = np.ceil(utm[:, :2].max(axis=0))
    columns, rows_ = np.arange(west, east) + 0.5, np.arange(north, south, -1) - 0.5
    x, y = (values.reshape(-1) for values in np.meshgrid(columns, rows_))
    local = anchor.local_from_projected("EPSG:32632", x, y, np.full(len(x), anchor.height_m))
    z = heights(local[:, :2])
    height = anchor.projected_from_local("EPSG:32632", np.column_stack([local[:, :2], z]))[:, 2]
    raster = height.reshape(len(rows_), len(columns)).astype(np.float32)
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=raster.shape[1],
        height=raster.shape[0],
        count=1,
        dtype="float32",
        crs="EPSG:32632",
        transform=rasterio.transform.from_origin(west, north, 1.0, 1.0),
    ) as file:
        file.write(raster, 1)
    return path


def frames(drone: str = DRONE, count: int = FRAMES) -> list[Frame]:
    """Frames a second apart, so that few of them see much ground."""
    return mission().frames_of(drone)[2 : 2 + 5 * count : 5]


@dataclass(frozen=True)
class Row:
    """The camera at one moment of telemetry."""

    stamp_ns: int
    position: NDArray[np.float64]
    """Local ENU."""
    turn: Rotation
    """world_from_camera, optical axes."""

    @property
    def forward_right_down_ned(self) -> Rotation:
        """Attitude as autopilots tell it, from where its axes point."""
        right, down, forward = self.turn.as_matrix().T
        axes = [np.array([v[1], v[0], -v[2]]) for v in (forward, right, down)]
        return Rotation.from_matrix(np.stack(axes, axis=1))

    @property
    def yaw_pitch_roll_deg(self) -> NDArray[np.float64]:
        return self.forward_right_down_ned.as_euler("ZYX", degrees=True)

    @property
    def geodetic(self) -> tuple[float, float, float]:
        """Latitude, longitude, ellipsoidal height through Earth-centred coordinates."""
        anchor = mission().georeference
        assert anchor is not None
        lat, lon = np.radians([anchor.latitude_deg, anchor.longitude_deg])
        east = [-np.sin(lon), np.cos(lon), 0]
        north = [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]
        up = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
        to_ecef = _to_ecef()
        start = to_ecef.transform(anchor.longitude_deg, anchor.latitude_deg, anchor.height_m)
        ecef = np.array(start) + self.position @ np.array([east, north, up])
        longitude, latitude, height = to_ecef.transform(*ecef, direction="INVERSE")
        return latitude, longitude, height


@cache
def _to_ecef() -> Transformer:
    return Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)


@cache
def rows(drone: str = DRONE) -> list[Row]:
    """The drone's telemetry at 50 Hz, as recorded."""
    track = mission().tracks()[drone]
    turns = Rotation.from_quat(track.quaternions[:, [1, 2, 3, 0]])
    return [Row(int(s), p, t) for s, p, t in zip(track.stamps_ns, track.positions, turns, strict=True)]


# --- bags ---


def write_bag(path: Path, kind: str, messages: list[tuple[str, str, int, Any]]) -> Path:
    """Messages (topic, type, stamp, fields) as a bag by rosbags: ros1, sqlite3 or mcap."""
    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    if kind == "ros1":
        text = "geometry_msgs/TransformStamped[] transforms"
        store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
    build = _Builder(store, ros1=kind == "ros1")
    if kind == "ros1":
        writer: Any = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        connections: dict[str, Any] = {}
        for topic, type_name, stamp_ns, fields in sorted(messages, key=lambda message: message[2]):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, type_name, typestore=store)
            message = build(type_name, fields)
            serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
            writer.write(connections[topic], stamp_ns, serialize(message, type_name))
    return path


class _Builder:
    """Nested dictionaries -> messages of a type store."""

    def __init__(self, store: Any, *, ros1: bool) -> None:
        self.store, self.ros1 = store, ros1

    def __call__(self, type_name: str, fields: dict[str, Any]) -> Any:
        _, described = self.store.fielddefs[type_name]
        values = {}
        for name, description in described:
            if name == "seq":
                values[name] = 0
                continue
            given = fields.get(name, fields.get(name.lower()))
            values[name] = self._value(description, given)
        return self.store.types[type_name](**values)

    def _value(self, description: Any, given: Any) -> Any:
        kind, detail = int(description[0]), description[1]
        if kind == 1:  # a plain value
            return given if given is not None else ("" if detail[0] == "string" else 0)
        if kind == 2:  # a message
            return self(detail, given or {})
        (inner, inner_detail), length = detail
        if int(inner) == 2:
            return [self(inner_detail, one) for one in given or []]
        dtype = {"float64": np.float64, "uint8": np.uint8}[inner_detail[0]]
        return np.array(given if given is not None else [0] * length, dtype)


def header(stamp_ns: int, frame: str) -> dict[str, Any]:
    return {"stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}, "frame_id": frame}


def pose(position: NDArray[np.float64], turn: Rotation) -> dict[str, Any]:
    return {
        "position": dict(zip("xyz", map(float, position), strict=True)),
        "orientation": dict(zip("xyzw", map(float, turn.as_quat()), strict=True)),
    }


def transform(
    stamp_ns: int, parent: str, child: str, position: NDArray[np.float64], turn: Rotation
) -> dict[str, Any]:
    placed = pose(position, turn)
    return {
        "header": header(stamp_ns, parent),
        "child_frame_id": child,
        "transform": {"translation": placed["position"], "rotation": placed["orientation"]},
    }


def picture_messages(drone: str, frame_id: str, *, raw: bool = False) -> list[tuple[str, str, int, Any]]:
    """Pictures, intrinsics (pixel centres at whole numbers, as ROS has them) and heatmaps of the frames."""
    messages: list[tuple[str, str, int, Any]] = []
    for frame in frames(drone):
        stamp, camera = frame.stamp_ns, frame.camera
        top = header(stamp, frame_id)
        if raw:
            rgb = frame.image()
            fields = {"height": rgb.shape[0], "width": rgb.shape[1], "encoding": "bgr8"}
            fields |= {"step": rgb.shape[1] * 3, "data": rgb[..., ::-1].reshape(-1)}
            messages.append(
                (f"/{drone}/cam/image_raw", "sensor_msgs/msg/Image", stamp, {"header": top} | fields)
            )
        else:
            fields = {"header": top, "format": "jpeg", "data": np.frombuffer(frame.encoded_image(), np.uint8)}
            topic = f"/{drone}/cam/image_raw/compressed"
            messages.append((topic, "sensor_msgs/msg/CompressedImage", stamp, fields))
        k = [camera.fx, 0, camera.cx - 0.5, 0, camera.fy, camera.cy - 0.5, 0, 0, 1]
        info = {"header": top, "height": camera.height, "width": camera.width, "k": k, "d": [0.0] * 5}
        info["distortion_model"] = "plumb_bob"
        messages.append((f"/{drone}/cam/camera_info", "sensor_msgs/msg/CameraInfo", stamp, info))
        values = frame.heatmap()
        grey = {"height": values.shape[0], "width": values.shape[1], "encoding": "mono8"}
        grey |= {"step": values.shape[1], "data": np.asarray(values, np.uint8).reshape(-1)}
        messages.append((f"/{drone}/heatmap", "sensor_msgs/msg/Image", stamp, {"header": top} | grey))
    return messages


def camera_pose_messages(drone: str = DRONE, topic: str | None = None) -> list[tuple[str, str, int, Any]]:
    name = topic or f"/{drone}/cam/pose"
    return [
        (
            name,
            "geometry_msgs/msg/PoseStamped",
            row.stamp_ns,
            {"header": header(row.stamp_ns, "map"), "pose": pose(row.position, row.turn)},
        )
        for row in rows(drone)
    ]


# --- films ---


def write_film(
    path: Path, drone: str = DRONE, pixel_aspect: str = "1:1", part: slice = slice(None)
) -> tuple[Path, int]:
    """The pictures, or a part of them, as a film that begins at the last row half a second before: (path, its
    begin)."""
    chosen = frames(drone)[part]
    start_ns = max(row.stamp_ns for row in rows(drone) if row.stamp_ns <= chosen[0].stamp_ns - 500_000_000)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10, options={"aspect": pixel_aspect})
        stream.width, stream.height, stream.pix_fmt = (
            chosen[0].camera.width,
            chosen[0].camera.height,
            "yuv420p",
        )
        stream.bit_rate, stream.gop_size = 8_000_000, 3
        stream.codec_context.time_base = Fraction(1, 1000)
        black = np.zeros((chosen[0].camera.height, chosen[0].camera.width, 3), np.uint8)
        shown = [(0, black), *(((one.stamp_ns - start_ns) // 1_000_000, one.image()) for one in chosen)]
        for time_ms, picture in shown:
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = time_ms, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path, start_ns


def focal_35mm(frame: Frame) -> float:
    """CIPA: 35 mm film has a diagonal of 43.27 mm."""
    camera = frame.camera
    return float(camera.fx / np.hypot(camera.width, camera.height) * np.hypot(36, 24))


Dialect = Callable[[int, float, Row, tuple[float, float, float]], str]


def arrow(time_s: float) -> str:
    return f"00:00:{time_s:06.3f} --> 00:00:{time_s + 0.033:06.3f}".replace(".", ",")


def mini(number: int, time_s: float, row: Row, place: tuple[float, float, float]) -> str:
    """As recent DJI drones write it, a block per frame."""
    yaw, pitch, roll = row.yaw_pitch_roll_deg
    latitude, longitude, above = place
    return (
        f'{number}\n{arrow(time_s)}\n<font size="28">FrameCnt: {number}, DiffTime: 33ms\n'
        f"{datetime.fromtimestamp(row.stamp_ns / 1e9, timezone.utc):%Y-%m-%d %H:%M:%S.%f}"[:-3]
        + "\n"
        f"[iso: 110] [shutter: 1/320.0] [fnum: 1.7] [ev: 0] [color_md: default] "
        f"[focal_len: {focal_35mm(frames()[0]):.2f}] [latitude: {latitude:.6f}] [longitude: {longitude:.6f}] "
        f"[rel_alt: {above:.3f} abs_alt: {above + 999:.3f}] "
        f"[gb_yaw: {yaw:.1f} gb_pitch: {pitch:.1f} gb_roll: {roll:.1f}] </font>\n\n"
    )


def rtk(number: int, time_s: float, row: Row, place: tuple[float, float, float]) -> str:
    """As a Phantom 4 RTK writes it: longitude first, home, degree signs, CRLF."""
    yaw, pitch, roll = row.yaw_pitch_roll_deg
    latitude, longitude, above = place
    home_at = rows()[0].geodetic
    return (
        f"{number}\n{arrow(time_s)}\nF/5.6, SS 400, ISO 100, EV 0, "
        f"GPS ({longitude:.6f}, {latitude:.6f}, 15), HOME ({home_at[1]:.6f}, {home_at[0]:.6f}, -57.98m), "
        f"D 8.70m, H {above:.2f}m, H.S 0.00m/s, "
        f"F.PRY (2.7°, -7.0°, 110.1°), G.PRY ({pitch:.1f}°, {roll:.1f}°, {yaw:.1f}°)\n\n"
    ).replace("\n", "\r\n")


def write_subtitles(
    path: Path, start_ns: int, dialect: Dialect | None = None, *, every: int = 2, end_ns: int | None = None
) -> Path:
    """The telemetry during the film; heights above the ground below the first row, where the drone is taken
    to have started."""
    last_ns = end_ns or rows()[-1].stamp_ns
    flown = [row for row in rows() if start_ns <= row.stamp_ns <= last_ns][::every]
    below = heights(rows()[0].position[None, :2])[0]
    text = "".join(
        (dialect or mini)(
            number,
            (row.stamp_ns - start_ns) / 1e9,
            row,
            (*row.geodetic[:2], row.position[2] - below),
        )
        for number, row in enumerate(flown, start=1)
    )
    path.write_text(text, encoding="utf-8-sig")
    return path


def write_ulog(path: Path, *, gimbal: bool = True, first_fix: int = 0) -> tuple[Path, int]:
    """(path, stamp of its beginning). The gimbal tells its yaw against the drone's heading, which is 30
    degrees off the camera's. Before the row `first_fix` the receiver counts its time from 1970."""
    zero_us = 5_000_000
    flown = rows()
    begin_us = flown[0].stamp_ns // 1000
    topics = {
        "vehicle_global_position": "double lat;double lon;float alt;float alt_ellipsoid;",
        "vehicle_attitude": "float[4] q;",
        "gimbal_device_attitude_status": "float[4] q;uint16_t device_flags;",
        "vehicle_gps_position": "uint64_t time_utc_usec;",
    }
    records = []
    for count, row in enumerate(flown):
        stamp_us = zero_us + row.stamp_ns // 1000 - begin_us
        latitude, longitude, height = row.geodetic
        yaw, pitch, roll = row.yaw_pitch_roll_deg
        w, x, y, z = Rotation.from_euler("ZYX", [yaw + 30, 3, -2], degrees=True).as_quat()[[3, 0, 1, 2]]
        records.append(struct.pack("<HQ4f", 1, stamp_us, w, x, y, z))
        if gimbal:
            w, x, y, z = Rotation.from_euler("ZYX", [-30, pitch, roll], degrees=True).as_quat()[[3, 0, 1, 2]]
            records.append(struct.pack("<HQ4fH", 2, stamp_us, w, x, y, z, 0))
        if count % 5 == 0:
            records.append(struct.pack("<HQddff", 0, stamp_us, latitude, longitude, height - 48.0, height))
            utc_us = row.stamp_ns // 1000 if count >= first_fix else stamp_us
            records.append(struct.pack("<HQQ", 3, stamp_us, utc_us))
    path.write_bytes(ulog(zero_us, topics, records))
    return path, flown[0].stamp_ns


# --- photographs ---

Angles = tuple[float, float, float]
"""Yaw, pitch, roll of a camera whose pitch of 0 is the horizon."""


def dji(angles: Angles, extra: str = "") -> str:
    yaw, pitch, roll = angles
    return (
        f'drone-dji:GimbalYawDegree="{yaw:+.2f}" drone-dji:GimbalPitchDegree="{pitch:+.2f}" '
        f'drone-dji:GimbalRollDegree="{roll:+.2f}" {extra}'
    )


def degrees(value: float) -> tuple[IFDRational, ...]:
    """Degrees, minutes and seconds to 1e-4, as cameras write them: 3 mm."""
    whole = int(abs(value))
    minutes = int((abs(value) - whole) * 60)
    seconds = ((abs(value) - whole) * 60 - minutes) * 60
    return IFDRational(whole), IFDRational(minutes), IFDRational(round(seconds * 10_000), 10_000)


def write_photograph(
    path: Path,
    image: np.ndarray,
    stamp_ns: int,
    place: tuple[float, float, float],
    xmp: str,
    *,
    make: str = "DJI",
    model: str = "X1",
    focal_mm35: float | None = None,
    focal_mm: float | None = None,
    digital_zoom: float | None = None,
    size_taken: tuple[int, int] | None = None,
    datum: str | None = None,
    exif_version: bytes | None = None,
    altitude_ref: bytes = b"\0",
) -> Path:
    picture, exif = Image.fromarray(image), Image.Exif()
    taken = datetime.fromtimestamp(stamp_ns // 10**9, timezone.utc)
    exif[ExifTags.Base.Make], exif[ExifTags.Base.Model] = make, model
    more = exif.get_ifd(ExifTags.IFD.Exif)
    more[ExifTags.Base.DateTimeOriginal] = f"{taken:%Y:%m:%d %H:%M:%S}"
    more[ExifTags.Base.SubsecTimeOriginal] = f"{stamp_ns % 10**9 // 1000:06d}"
    if exif_version is not None:
        more[ExifTags.Base.ExifVersion] = exif_version
    if focal_mm35 is not None:
        more[ExifTags.Base.FocalLengthIn35mmFilm] = round(focal_mm35)
    if focal_mm is not None:
        more[ExifTags.Base.FocalLength] = IFDRational(round(focal_mm * 100), 100)
    if digital_zoom is not None:
        more[ExifTags.Base.DigitalZoomRatio] = IFDRational(round(digital_zoom * 100), 100)
    if size_taken is not None:
        more[ExifTags.Base.ExifImageWidth], more[ExifTags.Base.ExifImageHeight] = size_taken
    gps = exif.get_ifd(ExifTags.IFD.GPSInfo)
    latitude, longitude, height = place
    gps |= {1: "N" if latitude >= 0 else "S", 2: degrees(latitude), 3: "E" if longitude >= 0 else "W"}
    gps |= {4: degrees(longitude), 5: altitude_ref, 6: IFDRational(round(abs(height) * 1000), 1000)}
    if datum is not None:
        gps[ExifTags.GPS.GPSMapDatum] = datum
    exif.get_ifd(ExifTags.IFD.GPSInfo).update(gps)
    packet = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF><rdf:Description rdf:about="" '
        f"{xmp}></rdf:Description></rdf:RDF></x:xmpmeta>"
    )
    if "skydio" in xmp:
        packet = f"<x:xmpmeta><rdf:RDF><rdf:Description {xmp}></rdf:Description></rdf:RDF></x:xmpmeta>"
    picture.save(path, "JPEG", quality=95, exif=exif, xmp=packet.encode())
    return path


def row_at(stamp_ns: int) -> Row:
    """The camera at a picture; its pose is the mission's own."""
    frame = next(one for one in frames() if one.stamp_ns == stamp_ns)
    pose = frame.world_from_camera
    return Row(stamp_ns, pose[:3, 3], Rotation.from_matrix(pose[:3, :3]))


Maker = Callable[..., str]


def write_photographs(folder: Path, maker: Maker | None = None, **options: Any) -> Path:
    folder.mkdir()
    camera = frames()[0].camera
    dewarp = f'drone-dji:DewarpData="2026-01-01;{camera.fx},{camera.fy},0,0,0,0,0,0,0"'
    below = heights(rows()[0].position[None, :2])[0]
    for number, frame in enumerate(frames()):
        row = row_at(frame.stamp_ns)
        latitude, longitude, height = row.geodetic
        extra = (
            f'{dewarp} drone-dji:RelativeAltitude="{row.position[2] - below:+.2f}"'
            if maker in (None, dji)
            else ""
        )
        place = latitude, longitude, height - 48.0
        xmp = (maker or dji)(tuple(row.yaw_pitch_roll_deg), extra)
        write_photograph(folder / f"{number:03}.JPG", frame.image(), frame.stamp_ns, place, xmp, **options)
    return folder


# --- what must come out ---


def reference(drones: tuple[str, ...] = (DRONE,)) -> Recording:
    """The mission itself, cut down to the frames that the other forms hold."""
    chosen = sorted(
        (frame for drone in drones for frame in frames(drone)), key=lambda f: (f.stamp_ns, f.drone)
    )
    return replace(mission(), drones=drones, frames=tuple(chosen), refused=())


def closed(recording: Recording, terrain: Terrain | None = None) -> Any:
    """All ground that a run closes, as one shape in local metres of the mission."""

    def recorded(frame: Frame) -> NDArray[Any]:
        """What the mission recorded then; films and photographs hold no heatmaps."""
        of_drone = frames(frame.drone if frame.drone in mission().drones else DRONE)
        nearest = min(of_drone, key=lambda other: abs(other.stamp_ns - frame.stamp_ns))
        heatmap = nearest.heatmap()
        return heatmap if abs(nearest.stamp_ns - frame.stamp_ns) < 50_000_000 else np.zeros_like(heatmap)

    run = crowdfence.run(
        recording, terrain or ground(), RunConfig(zones=ZoneConfig(min_area_m2=4.0)), detector=recorded
    )
    assert not run.refused
    anchor, local = mission().georeference, recording.georeference
    shape = unary_union([zone.polygon for zone in run.zones])
    if local is None or local == anchor:
        return shape
    assert anchor is not None

    def moved(points: NDArray[np.float64]) -> NDArray[np.float64]:
        flat = np.column_stack([points, np.zeros(len(points))])
        return anchor.local_from_geodetic(*local.geodetic_from_local(flat))[:, :2]

    return shapely.transform(shape, moved)


def agreement(a: Any, b: Any) -> float:
    """Area that both close over area that either closes."""
    return float(a.intersection(b).area / a.union(b).area)


def beyond(a: Any, b: Any, reach_m: float) -> float:
    """Share of the ground of `a` or of `b` that lies further than `reach_m` from the other, the larger of the
    two."""
    return float(
        max(
            a.difference(b.buffer(reach_m)).area / a.area,
            b.difference(a.buffer(reach_m)).area / b.area,
        )
    )
