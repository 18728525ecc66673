"""Where views come from: recordings of one or more drones, one file per kind."""

from collections.abc import Mapping
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

KINDS = "mission file or other MCAP, rosbag2 folder, ROS 1 .bag, AirSim folder, folder with poses.csv"
"""What can be opened, for messages."""


def open_recording(
    path: str | PathLike[str],
    *,
    max_pose_gap_s: float = 0.25,
    max_jump_s: float = 3600.0,
    **options: Any,
) -> Recording:
    """Open a recording, whatever it is:

    * a mission file (MCAP with our topics, see `mission.layout`),
    * a rosbag2 folder, a ROS 1 bag, or an MCAP file with other topics (see `ros_bag.reader`),
    * a folder with airsim_rec.txt, or the folder above it (AirSim, Cosys-AirSim; see `airsim.reader`),
    * a folder with poses.csv (plain heatmaps and poses; see `folder`).

    A frame is refused, with its reason in `Recording.refused`, where the telemetry rows around it are more
    than `max_pose_gap_s` apart, or its stamp repeats, goes backwards, or lies more than `max_jump_s` away
    from the others. `options` are those of the kind: `airsim.reader.AirSimOptions`,
    `ros_bag.reader.BagOptions`.

    OSError when the path cannot be read, ValueError when it holds no recording or one that cannot be used;
    TypeError for an unknown option, ValueError for an option of another kind of recording.
    """
    path = Path(path)
    limits = Limits(max_pose_gap_s, max_jump_s)
    if path.is_dir():
        return _open_folder(path, limits, options)
    if path.is_fifo():
        raise ValueError(f"{path} is a pipe; save what it gives in a file, and name that")
    from crowdfence.sources.mission.layout import MAGIC

    with path.open("rb") as file:
        is_mcap = file.read(len(MAGIC)) == MAGIC
    if is_mcap:
        return _open_mcap(path, limits, options)
    from crowdfence.sources.ros_bag.bag_file import is_bag

    if is_bag(path):
        return _open_bag(path, limits, options)
    raise ValueError(f"{path} is not a recording: {KINDS}")


def is_recording(path: Path) -> bool:
    """Whether `open_recording` would take it for a recording, intact or not. OSError when it is not there."""
    from crowdfence.sources.airsim.reader import find_airsim_folder
    from crowdfence.sources.folder import POSES_NAME
    from crowdfence.sources.mission.layout import MAGIC
    from crowdfence.sources.ros_bag.bag_file import is_bag

    if path.is_dir():
        own = find_airsim_folder(path) is not None or (path / POSES_NAME).is_file()
        return own or is_bag(path)
    with path.open("rb") as file:
        return path.suffix == ".mcap" or file.read(len(MAGIC)) == MAGIC or is_bag(path)


def _open_folder(path: Path, limits: Limits, options: Mapping[str, Any]) -> Recording:
    from crowdfence.sources.airsim.reader import AirSimOptions, find_airsim_folder, read_airsim
    from crowdfence.sources.folder import POSES_NAME, read_folder
    from crowdfence.sources.reader_options import reader_options, refuse_options
    from crowdfence.sources.ros_bag.bag_file import is_bag

    airsim = find_airsim_folder(path)
    if airsim is not None:
        return read_airsim(airsim, limits, reader_options(AirSimOptions, path, options))
    if (path / POSES_NAME).is_file():
        refuse_options(path, options)
        return read_folder(path, limits)
    if is_bag(path):
        return _open_bag(path, limits, options)
    raise ValueError(
        f"{path} holds no recording: neither airsim_rec.txt (here or one folder below) nor poses.csv nor a "
        "rosbag2"
    )


def _open_mcap(path: Path, limits: Limits, options: Mapping[str, Any]) -> Recording:
    from crowdfence.sources.mission.reader import NoMissionError, read_mission
    from crowdfence.sources.reader_options import refuse_options

    if "topics" in options:
        return _open_bag(path, limits, options)
    try:
        mission = read_mission(path, limits)
    except NoMissionError as no_mission:
        try:
            return _open_bag(path, limits, options)
        except ValueError as no_bag:
            raise ValueError(f"{no_mission}; {no_bag}") from no_bag
    if not any(len(track) for track in mission.tracks().values()) and "version" not in mission.manifest:
        # Topics of others that happen to be named like ours.
        try:
            return _open_bag(path, limits, options)
        except ValueError:
            return mission
    refuse_options(path, options)
    return mission


def _open_bag(path: Path, limits: Limits, options: Mapping[str, Any]) -> Recording:
    from crowdfence.sources.reader_options import reader_options
    from crowdfence.sources.ros_bag.reader import BagOptions, read_bag

    return read_bag(path, limits, reader_options(BagOptions, path, options))
