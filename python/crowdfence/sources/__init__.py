"""Where views come from: recordings of one or more drones, one file per kind."""

from os import PathLike
from pathlib import Path
from typing import Any

from crowdfence.errors import FrameError
from crowdfence.sources.place_camera import Limits
from crowdfence.sources.pose_track import PoseGapError, PoseTrack
from crowdfence.sources.recording import Frame, Instant, PixelSources, Recording, RefusedFrame

__all__ = [
    "Frame",
    "FrameError",
    "Instant",
    "PixelSources",
    "PoseGapError",
    "PoseTrack",
    "Recording",
    "RefusedFrame",
    "is_recording",
    "open_recording",
]


def open_recording(
    path: str | PathLike[str],
    *,
    max_pose_gap_s: float = 0.25,
    max_jump_s: float = 3600.0,
    **airsim_options: Any,
) -> Recording:
    """Open a recording, whatever it is:

    * a mission file (MCAP with our topics, see `mission.layout`),
    * a folder with airsim_rec.txt, or the folder above it (AirSim, Cosys-AirSim; see `airsim.reader`),
    * a folder with poses.csv (plain heatmaps and poses; see `folder`).

    A frame is refused, with its reason in `Recording.refused`, where the telemetry rows around it are more
    than `max_pose_gap_s` apart, or its stamp repeats, goes backwards, or lies more than `max_jump_s` away
    from the others. `airsim_options` are the fields of `airsim.reader.AirSimOptions`: settings, camera,
    crowd_colors, pose_delay_ms.

    OSError when the path cannot be read, ValueError when it holds no recording or one that cannot be used;
    TypeError for an unknown option, ValueError for an AirSim option with another kind of recording.
    """
    from crowdfence.sources.mission.layout import MAGIC

    path = Path(path)
    limits = Limits(max_pose_gap_s, max_jump_s)
    if path.is_dir():
        return _open_folder(path, limits, airsim_options)
    if path.is_fifo():
        raise ValueError(f"{path} is a pipe; save what it gives in a file, and name that")
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ValueError(
                f"{path} is not a recording: no MCAP file and no folder with airsim_rec.txt or poses.csv"
            )
    _refuse_options(path, airsim_options)
    from crowdfence.sources.mission.reader import read_mission

    return read_mission(path, limits)


def is_recording(path: Path) -> bool:
    """Whether `open_recording` would take it for a recording, intact or not. OSError when it is not there."""
    from crowdfence.sources.airsim.reader import find_airsim_folder
    from crowdfence.sources.folder import POSES_NAME
    from crowdfence.sources.mission.layout import MAGIC

    if path.is_dir():
        return find_airsim_folder(path) is not None or (path / POSES_NAME).is_file()
    with path.open("rb") as file:
        return path.suffix == ".mcap" or file.read(len(MAGIC)) == MAGIC


def _open_folder(path: Path, limits: Limits, airsim_options: dict[str, Any]) -> Recording:
    from crowdfence.sources.airsim.reader import AirSimOptions, find_airsim_folder, read_airsim
    from crowdfence.sources.folder import POSES_NAME, read_folder

    airsim = find_airsim_folder(path)
    if airsim is not None:
        return read_airsim(airsim, limits, AirSimOptions(**airsim_options))
    _refuse_options(path, airsim_options)
    if (path / POSES_NAME).is_file():
        return read_folder(path, limits)
    raise ValueError(
        f"{path} holds no recording: neither airsim_rec.txt (here or one folder below) nor poses.csv"
    )


def _refuse_options(path: Path, airsim_options: dict[str, Any]) -> None:
    if airsim_options:
        raise ValueError(f"{path} is no AirSim recording: {', '.join(airsim_options)} does not apply")
