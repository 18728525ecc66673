"""A small flight of three drones, written as an AirSim recording or as a plain folder.

The flight is made of smooth curves. What the AirSim form says in NED (body pose, gimbal, start offsets,
mount) and what the plain form says in ENU (the camera itself) are computed independently: the ENU camera
comes from direction vectors, not from quaternion products.
"""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from crowdfence import Terrain, _core

WIDTH, HEIGHT, FOV_DEG = 32, 24, 80.0
EPOCH_NS = 1_760_000_000_000_000_000
ORIGIN = (46.5, 8.0, 1200.0)
MOUNT = np.array([0.35, 0.0, 0.12])
STARTS = {
    "uav1": (106.36, -288.71, 0.05),
    "uav_2": (87.12, -256.26, -6.54),
    "uav3": (156.07, -192.87, -18.78),
}


@dataclass(frozen=True)
class Flight:
    """What was flown; the writers below put it on disk."""

    drones: tuple[str, ...] = tuple(STARTS)
    frame_stamps_ns: dict[str, list[int]] = field(default_factory=dict)
    telemetry_stamps_ns: dict[str, list[int]] = field(default_factory=dict)

    def with_frames(self, drone: str, stamps_ns: list[int]) -> "Flight":
        return replace(self, frame_stamps_ns={**self.frame_stamps_ns, drone: stamps_ns})

    def without_telemetry(self, drone: str, begin_ns: int, end_ns: int) -> "Flight":
        kept = [stamp for stamp in self.telemetry_stamps_ns[drone] if not begin_ns < stamp < end_ns]
        return replace(self, telemetry_stamps_ns={**self.telemetry_stamps_ns, drone: kept})


def flight(frames: int = 6) -> Flight:
    """10 Hz frames, the drones 0, 37 and 71 ms apart; 50 Hz telemetry on other stamps, from 0.2 s before."""
    offsets_ns = dict(zip(STARTS, (0, 37_000_000, 71_000_000), strict=True))
    frame_stamps = {
        drone: [EPOCH_NS + offset + number * 100_000_000 + 12_345 for number in range(frames)]
        for drone, offset in offsets_ns.items()
    }
    rows = range(-10, frames * 5 + 15)
    telemetry = {drone: [EPOCH_NS + row * 20_000_000 + 777 for row in rows] for drone in STARTS}
    return Flight(frame_stamps_ns=frame_stamps, telemetry_stamps_ns=telemetry)


def body_ned(drone: str, stamp_ns: int) -> tuple[NDArray[np.float64], Rotation, Rotation]:
    """Body position from the vehicle's start, body attitude, gimbal: forward-right-down in NED."""
    t = (stamp_ns - EPOCH_NS) / 1e9
    phase = float(sorted(STARTS).index(drone))
    position = np.array([3.0 * t + phase, np.sin(t + phase), -8.0 - 0.5 * t])
    body = Rotation.from_euler(
        "ZYX", [40 * np.sin(t + phase) + 60 * phase, -6 * t, 5 * np.cos(t)], degrees=True
    )
    gimbal = Rotation.from_euler("ZYX", [3 * t, -20 + 2 * t, 0.0], degrees=True)
    return position, body, gimbal


def camera_enu(drone: str, stamp_ns: int) -> NDArray[np.float64]:
    """world_from_camera [4, 4] from where the camera's right, down and forward point, each put into ENU."""
    position, body, gimbal = body_ned(drone, stamp_ns)
    eye_ned = np.array(STARTS[drone]) + position + body.apply(MOUNT)
    forward, right, down = ((body * gimbal).apply(axis) for axis in np.eye(3))
    columns = [np.array([v[1], v[0], -v[2]]) for v in (right, down, forward, eye_ned)]
    world_from_camera = np.eye(4)
    world_from_camera[:3] = np.stack(columns, axis=1)
    return world_from_camera


def heatmap(drone: str, stamp_ns: int) -> NDArray[np.uint8]:
    """8x6 heatmap that is different for every frame."""
    seed = [stamp_ns % 2**32, sorted(STARTS).index(drone)]
    return np.random.default_rng(seed).integers(0, 256, size=(HEIGHT // 4, WIDTH // 4), dtype=np.uint8)


def regions(drone: str, stamp_ns: int) -> NDArray[np.uint8]:
    """Crowd numbers 0-3 per image pixel."""
    small = heatmap(drone, stamp_ns) // 64
    return np.kron(small, np.ones((4, 4), dtype=np.uint8))


def write_airsim(folder: Path, flown: Flight, *, telemetry: bool = True, settings: bool = True) -> Path:
    """AirSim layout with images of types 0, 1 and 5, as the recent Cosys-AirSim names them."""
    for name in ("images", "heatmaps", "telemetry", "truth/regions", "terrain"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "terrain" / "dem.tif").write_bytes(b"not read here")
    table = []
    for drone in flown.drones:
        for stamp_ns in flown.frame_stamps_ns[drone]:
            position, body, _ = body_ned(drone, stamp_ns)
            names = [_image_name(drone, kind, stamp_ns) for kind in ((0, "png"), (1, "pfm"), (5, "png"))]
            cells = [drone, stamp_ns // 1_000_000, *position, *_wxyz(body), ";".join(names)]
            table.append("\t".join(str(cell) for cell in cells))
            _write_pixels(folder, drone, stamp_ns, names)
        if telemetry:
            _write_telemetry(folder / "telemetry" / f"{drone}.csv", flown, drone)
    header = "VehicleName TimeStamp POS_X POS_Y POS_Z Q_W Q_X Q_Y Q_Z ImageFile".replace(" ", "\t")
    (folder / "airsim_rec.txt").write_text("\n".join([header, *table]) + "\n")
    if settings:
        (folder / "settings.json").write_text(json.dumps(airsim_settings(flown.drones)))
    return folder


def airsim_settings(drones: tuple[str, ...]) -> dict:
    kinds = [{"ImageType": n, "Width": WIDTH, "Height": HEIGHT, "FOV_Degrees": FOV_DEG} for n in (0, 1, 5)]
    mount = dict(zip("XYZ", MOUNT.tolist(), strict=True))
    camera = {**mount, "Pitch": 0, "Roll": 0, "Yaw": 0, "CaptureSettings": kinds}
    return {
        "SettingsVersion": 1.2,
        "OriginGeopoint": dict(zip(("Latitude", "Longitude", "Altitude"), ORIGIN, strict=True)),
        "Vehicles": {
            drone: {**dict(zip("XYZ", STARTS[drone], strict=True)), "Cameras": {"front_center": camera}}
            for drone in drones
        },
    }


def write_folder(folder: Path, flown: Flight) -> Path:
    """The plain form: camera poses in ENU at telemetry rate."""
    (folder / "heatmaps").mkdir(parents=True)
    lines = ["drone,stamp_ns,x,y,z,qw,qx,qy,qz"]
    for drone in flown.drones:
        for stamp_ns in flown.telemetry_stamps_ns[drone]:
            pose = camera_enu(drone, stamp_ns)
            cells = [drone, stamp_ns, *pose[:3, 3], *_wxyz(Rotation.from_matrix(pose[:3, :3]))]
            lines.append(",".join(str(cell) for cell in cells))
        for stamp_ns in flown.frame_stamps_ns[drone]:
            Image.fromarray(heatmap(drone, stamp_ns)).save(folder / "heatmaps" / f"{drone}_{stamp_ns}.png")
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    focal = WIDTH / 2 / np.tan(np.radians(FOV_DEG / 2))
    camera = {"width": WIDTH, "height": HEIGHT, "fx": focal, "fy": focal, "cx": WIDTH / 2, "cy": HEIGHT / 2}
    georeference = dict(zip(("latitude_deg", "longitude_deg", "height_m"), ORIGIN, strict=True))
    description = {"cameras": {"*": camera}, "georeference": georeference}
    (folder / "recording.json").write_text(json.dumps(description))
    return folder


def write_pfm(path: Path, values: NDArray[np.float32]) -> None:
    """PFM as AirSim writes it: little-endian, first row on top."""
    header = f"Pf\n{values.shape[1]} {values.shape[0]}\n-1\n".encode()
    path.write_bytes(header + values.astype("<f4").tobytes())


def _write_pixels(folder: Path, drone: str, stamp_ns: int, names: list[str]) -> None:
    truth = regions(drone, stamp_ns)
    Image.fromarray(heatmap(drone, stamp_ns)).save(folder / "heatmaps" / f"heatmap_{drone}_{stamp_ns}.png")
    Image.fromarray(truth).save(folder / "truth" / "regions" / f"region_{drone}_{stamp_ns}.png")
    Image.fromarray(np.stack([truth * 60] * 3, axis=-1)).save(folder / "images" / names[0])
    depth = np.arange(HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)
    write_pfm(folder / "images" / names[1], depth)
    segmented = np.full((HEIGHT, WIDTH, 3), (153, 108, 6), dtype=np.uint8)
    segmented[truth == 2] = (89, 121, 72)
    Image.fromarray(segmented).save(folder / "images" / names[2])


def _write_telemetry(path: Path, flown: Flight, drone: str) -> None:
    header = "stamp_ns,position_x,position_y,position_z,q_w,q_x,q_y,q_z,gimbal_w,gimbal_x,gimbal_y,gimbal_z"
    lines = [header]
    for stamp_ns in flown.telemetry_stamps_ns[drone]:
        position, body, gimbal = body_ned(drone, stamp_ns)
        lines.append(",".join(str(cell) for cell in [stamp_ns, *position, *_wxyz(body), *_wxyz(gimbal)]))
    path.write_text("\n".join(lines) + "\n")


def _image_name(drone: str, kind: tuple[int, str], stamp_ns: int) -> str:
    return f"img_{drone}_front_center_{kind[0]}_{stamp_ns}.{kind[1]}"


def _wxyz(rotation: Rotation) -> list[float]:
    x, y, z, w = rotation.as_quat()
    return [w, x, y, z]


def ground() -> NDArray[np.float64]:
    """Points on a level plain 25 m below the fleet's start, wide enough for every view."""
    north, east, _ = np.array(list(STARTS.values())).mean(axis=0)
    side = np.arange(-250.0, 250.0, 2.0)
    x, y = np.meshgrid(east + side, north + side)
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -24.5)])


def write_hovering(folder: Path, stamps_ns: dict[str, list[int]]) -> Path:
    """Drones that hang 40 m above the origin and look straight down; a row of poses.csv for every frame."""
    (folder / "heatmaps").mkdir(parents=True)
    rows = ["drone,stamp_ns,x,y,z,qw,qx,qy,qz"]
    for drone, stamps in stamps_ns.items():
        for stamp_ns in stamps:
            rows.append(f"{drone},{stamp_ns},0,0,40,0,1,0,0")
            Image.new("L", (8, 6)).save(folder / "heatmaps" / f"{drone}_{stamp_ns}.png")
    (folder / "poses.csv").write_text("\n".join(rows) + "\n")
    camera = {"width": 32, "height": 24, "fx": 24.0, "fy": 24.0, "cx": 16.0, "cy": 12.0}
    (folder / "recording.json").write_text(json.dumps({"cameras": {"*": camera}}))
    return folder


def write_labelled_missions(folder: Path) -> list[Path]:
    """Two missions with labels over a plane, whose map lies beside them."""
    terrain = Terrain.from_points(ground(), 2.0)
    missions = [folder / f"mission-{number}" for number in range(2)]
    for number, mission in enumerate(missions):
        flown = flight(frames=4)
        for drone, stamps_ns in flown.frame_stamps_ns.items():  # else they would be copies
            flown = flown.with_frames(drone, [stamp_ns + number * 20_000_001 for stamp_ns in stamps_ns])
        write_airsim(mission, flown)
        written = _core.write_octomap_binary(terrain, np.arange(terrain.voxel_count))
        (mission / "terrain" / "terrain.bt").write_bytes(written)
    return missions


def write_walled_map(mission: Path) -> None:
    """In place of a mission's map a mesh of which it is doubtful what is the ground: 100 m by 100 m below a
    wall of 1000 m by 100 m."""
    (mission / "terrain" / "terrain.bt").unlink()
    (mission / "terrain" / "dem.tif").unlink()
    east, north, _ = ground().mean(axis=0)
    corners = [(-50, -50, -24.5), (50, -50, -24.5), (50, 50, -24.5), (-50, 50, -24.5)]
    corners += [(-500, 50, -24.5), (500, 50, -24.5), (500, 50, 75.5), (-500, 50, 75.5)]
    lines = [f"v {east + x} {north + y} {z}" for x, y, z in corners]
    (mission / "terrain" / "site.obj").write_text("\n".join([*lines, "f 1 2 3 4", "f 5 6 7 8"]) + "\n")
