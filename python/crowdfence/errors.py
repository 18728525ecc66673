"""The exceptions of crowdfence, one tree under `CrowdfenceError`, which is a ValueError; and how a message
quotes errors and values of others.

CrowdfenceError  parameters, arrays of a wrong shape or content, terrains
  ViewError      a camera, heatmap, pose or drone's name
  StampError     a stamp, or an instant out of order
  MapFileError   a map file or crowd map; `maps.MapError` also names the file
  FrameError     a frame of a recording
  DetectorError  a model, its contract or its output
"""

from crowdfence._core import CrowdfenceError, MapFileError, StampError, ViewError

__all__ = ["CrowdfenceError", "DetectorError", "FrameError", "MapFileError", "StampError", "ViewError"]

_LINE_CHARACTERS = 300
_VALUE_CHARACTERS = 80


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


def one_line(error: BaseException, *, whole: bool = False) -> str:
    """An error as one line, which names the file where the system does. What a library says of a file may be
    as long as the file: of that a message of ours has the beginning, unless the `whole` is asked for."""
    if isinstance(error, MemoryError):
        return "it needs more memory than there is"
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    said = " ".join(str(error).split()) or type(error).__name__
    return said if whole else _beginning(said, _LINE_CHARACTERS)


def quoted(value: object, characters: int = _VALUE_CHARACTERS) -> str:
    """A value that somebody gave as one short line for a message."""
    text = " ".join((value if isinstance(value, str) else repr(value))[: 4 * characters].split())
    text = _beginning(text, characters)
    return repr(text) if isinstance(value, str) else text


def _beginning(text: str, characters: int) -> str:
    return f"{text[:characters]}..." if len(text) > characters else text


def beyond(value: float, bound: float, grouped: str = "") -> str:
    """A value with as many digits, up to nine, as show that it is above a bound; one digit where it is not.
    `grouped`: what stands between thousands."""
    told = [f"{value:{grouped}.{digits}f}" for digits in range(1, 10)]
    return next((text for text in told if float(text.replace(grouped or ",", "")) > bound), told[0])
