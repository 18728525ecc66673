"""Options that say what a recording does not say about itself, for all commands that open one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from crowdfence.sources.recording import Recording

_PANEL = "Recordings of others"

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

NAMES = ("topics", "mount", "calibration")


def given(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """What a command was told about its recording, for `open_recording`."""
    return {name: parameters[name] for name in NAMES if parameters.get(name) not in (None, [], ())}


def open_source(path: Path, parameters: Mapping[str, Any]) -> Recording:
    """The recording of a command, with the options above."""
    from crowdfence.sources import open_recording

    return open_recording(path, **given(parameters))
