"""Options that say what a recording does not say about itself, for all commands that open one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from crowdfence.sources.recording import Recording

_PANEL = "Recordings of others"


class BoxesChoice(str, Enum):
    """What heatmaps made from boxes show."""

    contact = "contact"
    bodies = "bodies"


class HeightChoice(str, Enum):
    """What recorded heights count from."""

    ellipsoid = "ellipsoid"
    sea = "sea"
    take_off = "take-off"
    ground = "ground"


Topics = Annotated[
    list[str] | None,
    typer.Option(
        "--topics",
        metavar="ROLE=TOPIC,...",
        rich_help_panel=_PANEL,
        help="ROS topics of one drone: camera, info, pose (of the body) or camera_pose, tf, fix, imu, "
        "heatmap, origin; drone=NAME where there are several; may be repeated. Default: by types and names.",
    ),
]
Mount = Annotated[
    str | None,
    typer.Option(
        "--mount",
        metavar="KIND:PITCH[,YAW[,ROLL]]",
        rich_help_panel=_PANEL,
        help="How the camera hangs where nothing recorded it, in degrees: body (fixed to the drone), level "
        "(on a gimbal, follows the heading), north (same direction all the time). Straight down is -90.",
    ),
]
Calibration = Annotated[
    str | None,
    typer.Option(
        "--calibration",
        metavar="FILE",
        rich_help_panel=_PANEL,
        help="Intrinsics of the camera: OpenCV YAML, ROS camera_info, kalibr camchain (FILE:cam1).",
    ),
]

Telemetry = Annotated[
    Path | None,
    typer.Option(
        "--telemetry",
        metavar="FILE",
        rich_help_panel=_PANEL,
        help="Flight log of a film: .SRT (DJI), .ulg (PX4) or .tlog (MAVLink). Default: by the film's name.",
    ),
]
ClockOffset = Annotated[
    float | None,
    typer.Option(
        "--clock-offset",
        metavar="SECONDS",
        rich_help_panel=_PANEL,
        help="When the film begins, in seconds after the beginning of its .ulg or .tlog; with an .SRT, how "
        "late it is.",
    ),
]
Heights = Annotated[
    HeightChoice | None,
    typer.Option(
        "--heights",
        rich_help_panel=_PANEL,
        help="Which recorded heights to use: above the take-off (the map's ground there), the sea (needs the "
        "geoid), the ellipsoid, the ground below. Default: ellipsoid, take-off, sea, whichever is first.",
    ),
]
GeoidM = Annotated[
    float | None,
    typer.Option(
        "--geoid-m",
        rich_help_panel=_PANEL,
        help="Height of the geoid above the ellipsoid there, where PROJ has no grid of it.",
    ),
]
TakeOff = Annotated[
    str | None,
    typer.Option(
        "--take-off",
        metavar="LAT,LON",
        rich_help_panel=_PANEL,
        help="Where the drone took off, for heights above that. Default: the recorded home, else the first "
        "position.",
    ),
]
GroundStart = Annotated[
    bool,
    typer.Option(
        "--ground-start",
        rich_help_panel=_PANEL,
        help="Every drone stood on the ground at its first pose: takes the barometer's bias out and says it.",
    ),
]
FramesPerS = Annotated[
    float | None,
    typer.Option(
        "--fps",
        min=0.01,
        rich_help_panel=_PANEL,
        help="Frames of a film to use per second. Default: 2.",
    ),
]
Boxes = Annotated[
    BoxesChoice | None,
    typer.Option(
        "--boxes",
        rich_help_panel=_PANEL,
        help="Of Wildtrack or MultiviewX: heatmaps show the ground that people stand on, or their whole "
        "boxes. Default: contact.",
    ),
]
PoseNoise = Annotated[
    str | None,
    typer.Option(
        "--pose-noise",
        metavar="M,DEG",
        rich_help_panel=_PANEL,
        help="Smooth the poses: each row of telemetry is off by itself by so much (standard deviation of an "
        "axis), such as 0.5,0.5; or `estimate`, from the rows.",
    ),
]

MaxJumpS = Annotated[
    float | None,
    typer.Option(
        "--max-jump-s",
        metavar="SECONDS",
        rich_help_panel=_PANEL,
        help="Longest pause of a drone after which its clock is believed. Default: 3600, or a day where "
        "several frames show that it is back.",
    ),
]

AlignmentFile = Annotated[
    Path | None,
    typer.Option(
        "--alignment",
        metavar="FILE",
        rich_help_panel=_PANEL,
        help="What the poses are constantly off, as `crowdfence align` found it.",
    ),
]

Without = Annotated[
    list[str] | None,
    typer.Option(
        "--without",
        metavar="DRONE",
        help="Leave this drone out, because it saw nothing: a covered lens, a detector that failed; may be "
        "repeated.",
    ),
]

CameraMasks = Annotated[
    list[str] | None,
    typer.Option(
        "--camera-mask",
        metavar="DRONE=FILE",
        help="Picture that is black where this drone's camera sees no ground but its own legs, or writing, "
        "and white elsewhere: that part is not looked at; may be repeated.",
    ),
]

NAMES = (
    "topics",
    "mount",
    "calibration",
    "telemetry",
    "clock_offset_s",
    "heights",
    "geoid_m",
    "take_off",
    "ground_start",
    "frames_per_s",
    "boxes",
    "pose_noise",
    "max_jump_s",
    "alignment",
    "without",
    "camera_masks",
)


def given(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """What a command was told about its recording, for `open_recording`. ValueError for a --take-off that is
    no place, a --pose-noise that is none, and a --camera-mask of nobody or of one drone twice."""
    from crowdfence.sources.pose_noise import given_noise

    told: dict[str, Any] = {name: parameters.get(name) for name in NAMES}
    # A zero is said like any other number, and equals False.
    told = {name: value for name, value in told.items() if value is not False and value not in (None, [], ())}
    if "heights" in told:
        told["heights"] = HeightChoice(told["heights"]).value
    if "boxes" in told:
        told["boxes"] = BoxesChoice(told["boxes"]).value
    if "take_off" in told:
        told["take_off"] = _place(told["take_off"])
    if "pose_noise" in told:
        told["pose_noise"] = given_noise(told["pose_noise"])
    if "camera_masks" in told:
        told["camera_masks"] = _by_drone(told["camera_masks"])
    return told


def open_source(path: Path | Sequence[Path], parameters: Mapping[str, Any]) -> Recording:
    """The recording of a command, with the options above; several files are one fleet."""
    from crowdfence.sources import open_recording

    if not isinstance(path, Path):
        path = path[0] if len(path) == 1 else path
    return open_recording(path, **given(parameters))


def _by_drone(masks: Sequence[str]) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for text in masks:
        drone, _, file = text.partition("=")
        if not drone or not file:
            raise ValueError(f"--camera-mask {text!r} must be DRONE=FILE, such as uav1=legs.png")
        if drone in found:
            raise ValueError(f"--camera-mask gives {drone} two masks: paint both into one")
        found[drone] = Path(file)
    return found


def _place(text: str) -> tuple[float, float]:
    try:
        latitude_deg, longitude_deg = map(float, text.split(","))
    except ValueError:
        raise ValueError(f"--take-off {text!r} must be LAT,LON, such as 46.5,8.0") from None
    return latitude_deg, longitude_deg
