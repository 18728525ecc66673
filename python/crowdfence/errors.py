"""The exceptions of crowdfence: one tree under `CrowdfenceError`, which is a ValueError.

CrowdfenceError  parameters, arrays of a wrong shape or content, terrains
  ViewError      a camera, heatmap, pose or drone's name
  StampError     a stamp, or an instant out of order
  MapFileError   a map file or crowd map; `maps.MapError` also names the file
  FrameError     a frame of a recording
  DetectorError  a model, its contract or its output
"""

from crowdfence._core import CrowdfenceError, MapFileError, StampError, ViewError

__all__ = ["CrowdfenceError", "DetectorError", "FrameError", "MapFileError", "StampError", "ViewError"]

_LONGEST_QUOTE = 300


class FrameError(CrowdfenceError):
    """Something of this frame cannot be used; the message names drone, stamp and reason."""

    def __init__(self, drone: str, stamp_ns: int, reason: str) -> None:
        super().__init__(drone, stamp_ns, reason)  # what pickle makes it from again
        self.drone = drone
        self.stamp_ns = stamp_ns
        self.reason = reason

    def __str__(self) -> str:
        return f"frame of {self.drone} at {self.stamp_ns}: {self.reason}"


class DetectorError(CrowdfenceError):
    """A model that cannot be used, a contract that does not hold, an image of a wrong kind, or output that
    is no heatmap. The message is one line and names the model or key, the value and what is allowed."""


def one_line(error: BaseException) -> str:
    """What a library says of a file, for a message of ours: it may be of several lines, or as long as the
    file."""
    if isinstance(error, MemoryError):
        return "it needs more memory than there is"
    said = " ".join(str(error).split()) or type(error).__name__
    return said if len(said) <= _LONGEST_QUOTE else f"{said[:_LONGEST_QUOTE]} ..."
