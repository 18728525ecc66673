"""A recording in another local frame: the same flight at the same places on Earth, counted from elsewhere.

Local frames are topocentric (`georeference`), so one lies to another by a rotation and a shift, and nothing
is bent: two frames 1 km apart are turned against each other by about 0.009 degrees, and z = 0 of one is 8 cm
below that of the other there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.georeference import Georeference
from crowdfence.sources.placed_again import placed_again
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.recorded_truth import CameraPose, FrameTruth, PeopleLog, RecordedPeople
from crowdfence.sources.recording import GroundContact, Recording
from crowdfence.sources.rotation import multiply, rotation_matrix


def in_frame(recording: Recording, georeference: Georeference) -> Recording:
    """The recording with all that it knows in local metres counted from `georeference`; itself where it is.

    The ground of other classes than crowd (`Recording.layer_grounds`), whose cells lie along the axes of
    their own frame, stays behind, with a warning. ValueError for a recording without a place on Earth.
    """
    if recording.georeference is None:
        raise ValueError(f"{recording.name} does not say where on Earth its (0, 0, 0) lies")
    if recording.georeference == georeference:
        return recording
    move = FrameMove.between(recording.georeference, georeference)
    contacts = recording.ground_contacts
    above_ground = {drone for drone, contact in contacts.items() if contact.place is None}
    tracks = {
        drone: move.track(track, keep_heights=drone in above_ground)
        for drone, track in recording.tracks().items()
    }
    moved = placed_again(recording, tracks, "another local frame")
    left_behind = [
        f"where {layer} is in the world of {recording.name} is not known beside the others: it was recorded "
        "along the axes of another local frame"
        for layer in recording.layer_grounds
    ]
    return replace(
        moved,
        frames=tuple(replace(frame, truth=move.truth(frame.truth)) for frame in moved.frames),
        georeference=georeference,
        people=move.log(recording.people),
        ground_contacts={drone: move.contact(contact) for drone, contact in contacts.items()},
        layer_grounds={},
        warnings=(*recording.warnings, *left_behind),
    )


@dataclass(frozen=True, slots=True)
class FrameMove:
    """How one local frame lies in another."""

    turn: NDArray[np.float64]
    """Quaternion [4] (w, x, y, z), axes of the old frame -> of the new one."""
    shift: NDArray[np.float64]
    """[3], where (0, 0, 0) of the old frame lies in the new one."""

    @classmethod
    def between(cls, old: Georeference, new: Georeference) -> FrameMove:
        """From the frame of `old` to that of `new`."""
        back = _earth_from_local(new) * (1.0, -1.0, -1.0, -1.0)
        shift = new.local_from_geodetic(old.latitude_deg, old.longitude_deg, old.height_m)[0]
        return cls(multiply(back, _earth_from_local(old)), shift)

    def points(self, points: ArrayLike) -> NDArray[np.float64]:
        """Points [..., 3] of the old frame in the new one."""
        return np.asarray(points, np.float64) @ rotation_matrix(self.turn).T + self.shift

    def track(self, track: PoseTrack, *, keep_heights: bool = False) -> PoseTrack:
        """The same poses in the new frame; `keep_heights` where these are above the ground below."""
        positions = self.points(track.positions)
        if keep_heights:
            positions[:, 2] = track.positions[:, 2]
        return PoseTrack(track.stamps_ns, positions, multiply(self.turn, track.quaternions))

    def contact(self, contact: GroundContact) -> GroundContact:
        if contact.place is None:
            return contact
        x, y, z = self.points(contact.place).tolist()
        return replace(contact, place=(x, y, z))

    def truth(self, truth: FrameTruth) -> FrameTruth:
        pose, people = truth.pose, truth.people
        return replace(
            truth,
            pose=None if pose is None else lambda: self.pose(pose()),
            people=None if people is None else lambda: self.people(people()),
        )

    def pose(self, pose: CameraPose) -> CameraPose:
        return CameraPose(self.points(pose.position), multiply(self.turn, pose.quaternion))

    def people(self, people: RecordedPeople) -> RecordedPeople:
        return replace(people, position=self.points(people.position).astype(np.float32))

    def log(self, log: PeopleLog) -> PeopleLog:
        read = log.read
        return log if read is None else replace(log, read=lambda stamp_ns: self.people(read(stamp_ns)))


def _earth_from_local(anchor: Georeference) -> NDArray[np.float64]:
    """Quaternion [4], east-north-up at the anchor -> Earth-centred axes (EPSG method 9837)."""
    about_z = np.radians(90.0 + anchor.longitude_deg) / 2
    about_x = np.radians(90.0 - anchor.latitude_deg) / 2
    return multiply(
        (np.cos(about_z), 0.0, 0.0, np.sin(about_z)), (np.cos(about_x), np.sin(about_x), 0.0, 0.0)
    )
