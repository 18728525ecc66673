"""Where a camera was over time, and where it was at the moment of an image."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.sources.pose_leaps import leaps
from crowdfence.sources.rotation import normalise, rotation_matrix, slerp
from crowdfence.sources.stamps import stamp_faults
from crowdfence.sources.told_by_two import told_by_two

QUATERNION_LENGTH_TOLERANCE = 1e-2
"""How far from one a recorded quaternion's length may be: logs round to a few digits, but not to this."""
_LONGEST_STEP_NS = 5_000_000_000
"""From one row to the next of the same telling."""


class PoseGapError(ValueError):
    """The telemetry does not say where the camera was at this stamp."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseTrack:
    """Camera poses over time: `world_from_camera`, camera axes as in OpenCV, world = local ENU metres.

    stamps_ns    int64 [N], strictly increasing
    positions    float64 [N, 3], metres
    quaternions  float64 [N, 4], w x y z, kept exactly as given; lengths within 1 % of one

    The arrays are copied and become read-only. ValueError for wrong shapes, stamps that do not increase,
    values that are not finite and quaternions that are not unit length.
    """

    stamps_ns: NDArray[np.int64]
    positions: NDArray[np.float64]
    quaternions: NDArray[np.float64]

    def __repr__(self) -> str:
        span_ns = int(self.stamps_ns[-1] - self.stamps_ns[0]) if self.stamps_ns.size else 0
        return f"PoseTrack({self.stamps_ns.size} poses in {span_ns / 1e9:.1f} s)"

    def __post_init__(self) -> None:
        stamps = np.array(self.stamps_ns, dtype=np.int64)
        positions = np.array(self.positions, dtype=np.float64)
        quaternions = np.array(self.quaternions, dtype=np.float64)
        count = stamps.size
        if stamps.shape != (count,) or positions.shape != (count, 3) or quaternions.shape != (count, 4):
            raise ValueError(
                f"a pose track needs stamps [N], positions [N, 3] and quaternions [N, 4], got "
                f"{stamps.shape}, {positions.shape}, {quaternions.shape}"
            )
        if count > 1 and not np.all(np.diff(stamps) > 0):
            row = int(np.flatnonzero(np.diff(stamps) <= 0)[0]) + 1
            raise ValueError(
                f"stamps of a pose track must increase: row {row} has {stamps[row]} after {stamps[row - 1]}"
            )
        bad = np.flatnonzero(~_usable(positions, quaternions))
        if bad.size:
            row = int(bad[0])
            raise ValueError(
                f"row {row} of the pose track is not a pose: position {positions[row].tolist()}, "
                f"quaternion {quaternions[row].tolist()} (finite values, length 1 within 1 %)"
            )
        for name, array in (("stamps_ns", stamps), ("positions", positions), ("quaternions", quaternions)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return int(self.stamps_ns.size)

    def at(self, stamp_ns: int, max_gap_s: float) -> NDArray[np.float64]:
        """`world_from_camera` [4, 4] at a stamp: positions linear, attitudes by slerp; exact at the samples.

        PoseGapError outside the track (nothing is extrapolated) and where the two neighbouring samples are
        more than `max_gap_s` apart.
        """
        after = int(np.searchsorted(self.stamps_ns, stamp_ns, side="right"))
        before = after - 1
        if before >= 0 and self.stamps_ns[before] == stamp_ns:
            return _transform(self.positions[before], normalise(self.quaternions[before]))
        self._check_gap(stamp_ns, before, after, max_gap_s)
        start_ns, end_ns = int(self.stamps_ns[before]), int(self.stamps_ns[after])
        fraction = (stamp_ns - start_ns) / (end_ns - start_ns)
        position = self.positions[before] + fraction * (self.positions[after] - self.positions[before])
        first, second = normalise(self.quaternions[before : after + 1])
        return _transform(position, slerp(first, second, fraction))

    def shifted(self, offset_ns: int) -> "PoseTrack":
        """The same poses with `offset_ns` added to every stamp."""
        return PoseTrack(self.stamps_ns + np.int64(offset_ns), self.positions, self.quaternions)

    def _check_gap(self, stamp_ns: int, before: int, after: int, max_gap_s: float) -> None:
        if len(self) == 0:
            raise PoseGapError(
                f"no pose at stamp {stamp_ns}: there is no telemetry row of the drone that can be used"
            )
        if before < 0:
            early_s = (int(self.stamps_ns[0]) - stamp_ns) / 1e9
            raise PoseGapError(f"no pose at stamp {stamp_ns}: it lies {early_s:.3f} s before the first pose")
        if after == len(self):
            late_s = (stamp_ns - int(self.stamps_ns[-1])) / 1e9
            raise PoseGapError(f"no pose at stamp {stamp_ns}: it lies {late_s:.3f} s after the last pose")
        gap_s = (int(self.stamps_ns[after]) - int(self.stamps_ns[before])) / 1e9
        if gap_s > max_gap_s:
            raise PoseGapError(
                f"no pose at stamp {stamp_ns}: the telemetry has a gap of {gap_s:.3f} s there "
                f"(limit max_pose_gap_s = {max_gap_s:g} s)"
            )


def track_from_rows(
    stamps_ns: Sequence[int], positions: ArrayLike, quaternions: ArrayLike
) -> tuple[PoseTrack, list[str]]:
    """A track from rows as they were logged, and one line for every kind of row that had to be left out.

    Left out are rows with values that are not finite, quaternions that are not unit length, stamps that
    repeat or go backwards, and rows that are elsewhere for a moment (`pose_leaps`). Where a whole stretch of
    time was told twice, as by a clock that was set back, neither is taken, because frames of that time may
    be of either. What that leaves open is a gap, which `PoseTrack.at` refuses to bridge.
    """
    positions = np.asarray(positions, dtype=np.float64).reshape(-1, 3)
    quaternions = np.asarray(quaternions, dtype=np.float64).reshape(-1, 4)
    usable = _usable(positions, quaternions)
    remarks = []
    if not usable.all():
        row = int(np.flatnonzero(~usable)[0])
        remarks.append(
            f"{int((~usable).sum())} of {usable.size} pose rows are no poses (not finite, or a quaternion "
            f"not of length 1), first at row {row}: {positions[row].tolist()} {quaternions[row].tolist()}"
        )
    rows = np.flatnonzero(usable).tolist()
    faults = stamp_faults([int(stamps_ns[row]) for row in rows], float("inf"))
    bad = [(row, fault) for row, fault in zip(rows, faults, strict=True) if fault is not None]
    if bad:
        remarks.append(
            f"{len(bad)} of {usable.size} pose rows are out of order, first at row {bad[0][0]}: {bad[0][1]}"
        )
    kept = [row for row, fault in zip(rows, faults, strict=True) if fault is None]
    stamps = np.array([int(stamps_ns[row]) for row in kept], dtype=np.int64)
    poses = np.column_stack([positions, quaternions])
    twice = np.zeros(len(kept), np.bool_)
    for first_ns, last_ns in _told_again([(int(stamps_ns[row]), poses[row]) for row in rows], faults):
        twice |= (stamps >= first_ns) & (stamps <= last_ns)
    if twice.any():
        remarks.append(
            f"{int(twice.sum())} more are left out, from stamp {stamps[twice][0]} to {stamps[twice][-1]}: "
            "that time was told twice, with other poses (was the clock set back?), and nobody knows which of "
            "them frames belong to"
        )
        kept = [row for row, out in zip(kept, twice, strict=True) if not out]
        stamps = stamps[~twice]
    elsewhere, said = leaps(stamps, positions[kept])
    used = np.array(kept, np.int64)[~elsewhere]
    track = PoseTrack(stamps[~elsewhere], positions[used], quaternions[used])
    apart = None if said else told_by_two(track.stamps_ns, track.positions, track.quaternions)
    if apart is not None:
        said.append(
            f"pose rows are {apart} away and back, again and again: two tell them by turns, and what is seen "
            "is put on either or in between; let one node tell them"
        )
    return track, [*remarks, *said]


def _told_again(
    rows: Sequence[tuple[int, NDArray[np.float64]]], faults: Sequence[str | None]
) -> list[tuple[int, int]]:
    """First and last stamp of every stretch of rows (stamp, pose) that was refused in one piece, though it
    runs on as a flight does. Rows that say again what was said before are none, nor is a single one, which
    was overtaken on its way."""
    known = {stamp_ns: pose for (stamp_ns, pose), fault in zip(rows, faults, strict=True) if fault is None}
    stretches: list[list[int]] = []
    runs_on = False
    for (stamp_ns, pose), fault in zip(rows, faults, strict=True):
        if fault is not None and stamp_ns in known and np.array_equal(pose, known[stamp_ns]):
            continue
        if fault is None:
            runs_on = False
            continue
        if runs_on and 0 < stamp_ns - stretches[-1][-1] <= _LONGEST_STEP_NS:
            stretches[-1].append(stamp_ns)
        else:
            stretches.append([stamp_ns])
        runs_on = True
    return [(stretch[0], stretch[-1]) for stretch in stretches if len(stretch) > 1]


def _usable(positions: NDArray[np.float64], quaternions: NDArray[np.float64]) -> NDArray[np.bool_]:
    finite = np.isfinite(positions).all(axis=1) & np.isfinite(quaternions).all(axis=1)
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.sqrt(np.sum(quaternions * quaternions, axis=1))
    return finite & (np.abs(length - 1.0) < QUATERNION_LENGTH_TOLERANCE)


def _transform(position: NDArray[np.float64], quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = rotation_matrix(quaternion)
    world_from_camera[:3, 3] = position
    return world_from_camera
