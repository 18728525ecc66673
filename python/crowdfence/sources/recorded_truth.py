"""What a recording can know beside its images: where everybody really was, and the camera itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class CameraPose(NamedTuple):
    """A camera in the local ENU frame."""

    position: NDArray[np.float64]
    """[3] metres."""
    quaternion: NDArray[np.float64]
    """[4] w, x, y, z: camera axes (OpenCV) -> ENU."""

    def world_from_camera(self) -> NDArray[np.float64]:
        """The same as a rigid transform [4, 4]."""
        from crowdfence.sources.rotation import rotation_matrix

        transform = np.eye(4)
        transform[:3, :3] = rotation_matrix(self.quaternion)
        transform[:3, 3] = self.position
        return transform


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPeople:
    """People at one instant (arrays of length P)."""

    stamp_ns: int
    position: NDArray[np.float32]
    """[P, 3] feet, local ENU metres."""
    person: NDArray[np.uint32]
    """Number of the person in the instance images, from 1."""
    crowd: NDArray[np.uint32]
    """Number of the person's crowd, 0 = in none."""
    pixels: NDArray[np.uint32] | None = None
    """How many pixels of an image show the person, 0 = hidden; None where no image is meant."""

    def __post_init__(self) -> None:
        count = len(self.person)
        shapes = [self.position.shape, self.crowd.shape]
        if shapes != [(count, 3), (count,)] or (self.pixels is not None and self.pixels.shape != (count,)):
            raise ValueError(
                f"{count} people need positions [{count}, 3] and one crowd (and pixel count) each"
            )
        lost = ~np.isfinite(self.position).all(axis=1)
        if lost.any():
            first = int(lost.argmax())
            place = ", ".join(f"{metres:g}" for metres in self.position[first])
            raise ValueError(f"person {self.person[first]} stands at ({place}) m, which is no place")


@dataclass(frozen=True, slots=True)
class FrameTruth:
    """Where the truth of one frame comes from: functions called when it is wanted, None = not recorded.

    pose         the camera as it was, where `Frame.world_from_camera` is what the drone believed
    exposure_ns  when the picture was taken on the clock of the world, not the drone's
    people       everybody inside the picture, visible or hidden, as they stood at the exposure
    """

    pose: Callable[[], CameraPose] | None = None
    exposure_ns: Callable[[], int] | None = None
    people: Callable[[], RecordedPeople] | None = None


@dataclass(frozen=True, slots=True)
class PeopleLog:
    """Everybody in the world over time, read when asked for."""

    stamps_ns: Sequence[int] = ()
    """Stamps on the clock of the world, increasing."""
    read: Callable[[int], RecordedPeople] | None = field(default=None, repr=False)
    """The people at one of the stamps."""
    unreadable: str = ""
    """Why nothing is known of people who were recorded."""

    def nearest(self, stamp_ns: int, max_gap_s: float) -> RecordedPeople | None:
        """The recorded instant that is closest in time; None when there is none within `max_gap_s`."""
        closest = self.nearest_ns(stamp_ns, max_gap_s)
        return None if closest is None or self.read is None else self.read(closest)

    def nearest_ns(self, stamp_ns: int, max_gap_s: float) -> int | None:
        """Its stamp, without reading it."""
        if not len(self.stamps_ns):
            return None
        stamps = np.asarray(self.stamps_ns, np.int64)
        after = int(np.searchsorted(stamps, stamp_ns))
        around = stamps[max(after - 1, 0) : after + 1]
        closest = int(around[np.argmin(np.abs(around - stamp_ns))])
        return closest if abs(closest - stamp_ns) <= max_gap_s * 1e9 else None
