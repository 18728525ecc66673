"""Offsets of all drones that put shared ground on the same place of the map, by robust least squares.

A point of the ground in one picture is put on the map and looked for in the other picture. What it is off
there is explained by offsets of both poses that are the same all the time, and by noise of each frame's pose.

What stands on the ground and is not on the map (people, bushes, trees) moves a point along its epipolar line
and never across it. So the part across holds every point to the precision of a corner and tells angles, clock
and the drones' places among each other, whatever the map; the part along tells heights, where the ground is
the lowest of what is seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation, Slerp

from crowdfence._core import Terrain
from crowdfence.alignment.ground_matches import GroundMatches, ground_points
from crowdfence.detector.ground_sampling import rays_or_nan
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.recording import Frame

QUANTITIES = ("pitch", "yaw", "roll", "time", "east", "north", "up")
UNITS = ("deg", "deg", "deg", "s", "m", "m", "m")
PRIOR = np.array([2.0, 2.0, 2.0, 0.3, 1.0, 1.0, 1.0])
"""How large offsets usually are, in those units: what the pictures do not tell stays near 0."""

JITTER = np.array([0.15, 0.15, 0.15, 0.1, 0.1, 0.1])
"""Noise of each frame's pose: pitch, yaw, roll, east, north, up."""

OF_FRAME = [0, 1, 2, 4, 5, 6]
"""Quantities that each frame has besides its drone."""
_DIFFERENCE = np.array([0.3, 0.3, 0.3, 0.05, 0.3, 0.3, 0.3])
"""Steps of the derivatives, wide enough to look past the facets of the surface."""
_PIXEL = 0.4
"""Error of a matched corner, in pixels of a picture 640 wide; Cauchy's scale of what is off across."""
_HEIGHTS_M = (1.0, 0.6, 0.3, 0.15)
"""Error of the map's heights, step by step: at first the offsets blur them."""
_GROUND = 0.15
"""Share of the matches that lie on the ground of the map; corners are mostly on what stands there."""
_TALL_M, _LOWER, _ANYWHERE = 3.0, 0.001, 0.005
"""Mean height of the others, and the density per metre of those that seem to lie lower, or anywhere."""
_SHARED_M = 0.05
"""East and north that all drones over the same ground have in common, as good as held at 0: nothing but the
relief shows them, and what stands on it pulls harder."""
_POINTS_A_PAIR = 15.0
"""What the matches of two frames weigh at most: their errors are largely common."""
_STEPS = 7
_RISE_M = 0.3
"""Step of the derivative by height."""
_ROW_S, _SMOOTH_S, _AROUND_S = 0.02, 0.1, 3.0

COMMON = np.array([0.1, 0.1, 0.1, 0.005, 0.15, 0.15, 0.2])
"""What is the same all over a flight, and so in no spread of its matches: heights of trees and of the map,
angles that are not quite constant. From benchmarks/alignment."""
SLICES = 10
"""Stretches of time that are left out in turn."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Offsets of D drones, in the order of QUANTITIES."""

    values: NDArray[np.float64]
    """[D, 7]"""
    covariance: NDArray[np.float64]
    """[7 D, 7 D] by the Jacobian and the prior."""
    before_px: NDArray[np.float64]
    """Disagreement of each match without offsets, in pixels of a picture 640 wide."""
    after_px: NDArray[np.float64]
    """The same by what is told, estimated from other stretches of time."""
    drones: NDArray[np.int64]
    """[M, 2] numbers of the drones of each match."""
    error: NDArray[np.float64]
    """Standard deviations [D, 7]: the larger of what the covariance says and of what changes when stretches
    of time are left out in turn, and what neither can show."""
    shown: NDArray[np.bool_]
    """[D, 7] what the pictures show at all."""
    told: NDArray[np.bool_]
    """[D, 7] what they show surely enough."""
    jitter: NDArray[np.float64]
    """[F, 6] what each frame's pose is off besides: pitch, yaw, roll, east, north, up."""


@dataclass(frozen=True, slots=True, eq=False)
class SmoothTrack:
    """A camera's way without the noise of single rows: what their times differ by would be all noise."""

    start_ns: int
    times_s: NDArray[np.float64]
    turns: Slerp
    positions: NDArray[np.float64]

    @classmethod
    def of(cls, track: PoseTrack, stamps_ns: NDArray[np.int64]) -> SmoothTrack:
        """Around the stamps of frames only: between them lie hours where a drone was away, and years where a
        row is of a clock that was not set yet."""
        start = int(stamps_ns[0])
        rows_s = (track.stamps_ns - start) / 1e9
        near = np.arange(-_AROUND_S, _AROUND_S, _ROW_S)
        steps = np.unique(np.rint(((stamps_ns - start)[:, None] / 1e9 + near) / _ROW_S).astype(np.int64))
        times = steps * _ROW_S
        times = times[(times > rows_s[0] - _ROW_S) & (times < rows_s[-1] + _ROW_S)]
        at = np.clip(times, rows_s[0], rows_s[-1])
        turns = Slerp(rows_s, Rotation.from_quat(track.quaternions[:, [1, 2, 3, 0]]))(at).as_quat()
        ahead = np.sign(np.sum(turns[1:] * turns[:-1], axis=1))
        turns[1:] *= np.cumprod(np.where(ahead == 0, 1.0, ahead))[:, None]
        positions = np.stack([np.interp(at, rows_s, track.positions[:, axis]) for axis in range(3)], axis=1)
        turns, positions = (
            gaussian_filter1d(values, _SMOOTH_S / _ROW_S, axis=0, mode="nearest")
            for values in (turns, positions)
        )
        return cls(start, times, Slerp(times, Rotation.from_quat(turns)), positions)

    def at(self, stamps_ns: NDArray[np.int64]) -> tuple[Rotation, NDArray[np.float64]]:
        """Attitudes and positions [N, 3]; nothing is extrapolated."""
        at = np.clip((stamps_ns - self.start_ns) / 1e9, self.times_s[0], self.times_s[-1])
        flown = [np.interp(at, self.times_s, self.positions[:, axis]) for axis in range(3)]
        return self.turns(at), np.stack(flown, axis=1)


class Disagreement:
    """Matches of frames, as a function of the drones' offsets [D, 7]."""

    def __init__(
        self,
        frames: Sequence[Frame],
        tracks: Sequence[PoseTrack],
        matches: Sequence[GroundMatches],
        terrain: Terrain,
    ) -> None:
        """`tracks` of the drones in the order of their names."""
        names = sorted({frame.drone for frame in frames})
        self.terrain, self.frames, self.tracks = terrain, frames, tracks
        self.drone = np.array([names.index(frame.drone) for frame in frames])
        self.first = np.concatenate([np.full(len(m), m.first) for m in matches])
        self.second = np.concatenate([np.full(len(m), m.second) for m in matches])
        self.seen = np.concatenate([m.pixels_second for m in matches])
        self.rays = np.concatenate([rays_or_nan(frames[m.first].camera, m.pixels_first) for m in matches])
        self.weight = np.concatenate(
            [np.full(len(m), min(1.0, _POINTS_A_PAIR / max(1, len(m)))) for m in matches]
        )
        self.cameras = list(dict.fromkeys(frame.camera for frame in frames))
        self.camera = np.array([self.cameras.index(frame.camera) for frame in frames])
        self.stamps_ns = np.array([frame.stamp_ns for frame in frames])
        self.slice = _slices(self.stamps_ns)
        self.smooth = [
            SmoothTrack.of(track, self.stamps_ns[self.drone == number]) for number, track in enumerate(tracks)
        ]

    def __len__(self) -> int:
        return len(self.first)

    def poses(self, offsets: NDArray[np.float64], jitter: NDArray[np.float64]) -> NDArray[np.float64]:
        """world_from_camera of every frame [F, 4, 4] by offsets [D, 7] of the drones and noise [F, 6] of the
        frames; nothing is extrapolated beyond the tracks."""
        poses = np.tile(np.eye(4), (len(self.frames), 1, 1))
        for drone, offset in enumerate(offsets):
            mine = self.drone == drone
            at = self.stamps_ns[mine] + round(offset[3] * 1e9)
            turn, flown = self.smooth[drone].at(at)
            turn = turn * Rotation.from_rotvec(np.radians(offset[:3] + jitter[mine, :3]))
            poses[mine, :3, :3] = turn.as_matrix()
            poses[mine, :3, 3] = flown + offset[4:] + jitter[mine, 3:]
        return poses

    def points(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Ground that the matches show in their first frames [M, 3]."""
        return ground_points(self.terrain, poses[self.first], self.rays)

    def pixels(self, points: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far points [M, 3] lie from where the second frames show them [M, 2], in pixels of a picture 640
        wide; NaN where they cannot be compared."""
        pose = poses[self.second]
        local = np.einsum("mji,mj->mi", pose[:, :3, :3], points - pose[:, :3, 3])
        off = np.full((len(self), 2), np.nan)
        for number, camera in enumerate(self.cameras):
            mine = (self.camera[self.second] == number) & np.isfinite(local).all(axis=1)
            off[mine] = (camera.project(local[mine]) - self.seen[mine]) * (640.0 / camera.width)
        return off

    def linear(self, offsets: NDArray[np.float64], jitter: NDArray[np.float64], height_m: float) -> Linear:
        """Around offsets [D, 7] and noise [F, 6], by differences; the map's heights are `height_m` off."""
        poses = self.poses(offsets, jitter)
        points = self.points(poses)
        off = self.pixels(points, poses)
        by_first, by_second = np.zeros((2, len(self), 2, 7))
        for q, step in enumerate(_DIFFERENCE):
            ends = []
            for sign in (-1.0, 1.0):
                moved = offsets.copy()
                moved[:, q] += sign * step
                other = self.poses(moved, jitter)
                ends.append((self.pixels(self.points(other), poses), self.pixels(points, other)))
            by_first[..., q] = (ends[1][0] - ends[0][0]) / (2 * step)
            by_second[..., q] = (ends[1][1] - ends[0][1]) / (2 * step)
        along, across = self._epipolar(points, poses, off)
        sigma = np.stack([np.hypot(_PIXEL, along * height_m), np.full(len(self), _PIXEL)], axis=1)
        turn = np.stack([across[:, ::-1] * [1.0, -1.0], across], axis=1) / sigma[..., None]
        off, by_first, by_second = (
            np.einsum("mij,mj...->mi...", turn, part) for part in (off, by_first, by_second)
        )
        weight = self.weight[:, None] * _trust(off, sigma, along)
        usable = np.isfinite(weight).all(axis=1) & np.isfinite(by_first + by_second).all(axis=(1, 2))
        weight[~usable] = 0.0
        return Linear(
            np.nan_to_num(off),
            self._rows(np.nan_to_num(by_first), np.nan_to_num(by_second), offsets.size),
            weight,
            self.slice[np.stack([self.first, self.second], axis=1)],
        )

    def _epipolar(
        self, points: NDArray[np.float64], poses: NDArray[np.float64], off: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """How far points [M, 3] would move in the second frames [M], were they a metre higher on their rays,
        and the unit vectors [M, 2] across."""
        ray = points - poses[self.first][:, :3, 3]
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        higher = points - ray * (_RISE_M / np.maximum(np.abs(ray[:, 2:]), 0.1))
        moved = (self.pixels(higher, poses) - off) / _RISE_M
        along = np.maximum(np.linalg.norm(moved, axis=1), 1e-6)
        return along, np.stack([-moved[:, 1], moved[:, 0]], axis=1) / along[:, None]

    def _rows(self, by_first: NDArray[np.float64], by_second: NDArray[np.float64], drones: int) -> csr_matrix:
        """Sparse [2 M, 7 D + 6 F]: the drones' quantities, then the frames'."""
        columns, values = [], []
        for frame, by in ((self.first, by_first), (self.second, by_second)):
            own = 7 * self.drone[frame][:, None] + np.arange(7)
            jitter = drones + 6 * frame[:, None] + np.arange(6)
            columns.append(np.repeat(np.hstack([own, jitter]), 2, axis=0))
            values.append(np.concatenate([by, by[..., OF_FRAME]], axis=2).reshape(-1, 13))
        column, value = np.hstack(columns), np.hstack(values)
        row = np.repeat(np.arange(len(column)), column.shape[1])
        shape = (len(column), drones + 6 * len(self.frames))
        return csr_matrix((value.ravel(), (row, column.ravel())), shape)


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """The weighted problem around some offsets."""

    off: NDArray[np.float64]
    """[M, 2] along and across the epipolar lines, in standard deviations."""
    rows: csr_matrix
    """[2 M, P]"""
    weight: NDArray[np.float64]
    """[M, 2]"""
    slices: NDArray[np.int64]
    """[M, 2] stretches of time of both frames."""

    def step(
        self, state: NDArray[np.float64], prior: NDArray[np.float64], without: int | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The change of the state [P] that is best, and the covariance; `prior` [P, P] is the weight of 0.
        `without` leaves a stretch of time out."""
        weight = self.weight
        if without is not None:
            weight = np.where((self.slices == without).any(axis=1)[:, None], 0.0, weight)
        weighted = self.rows.multiply(weight.reshape(-1, 1)).T.tocsr()
        normal = (weighted @ self.rows).toarray() + prior
        gradient = weighted @ self.off.ravel() + prior @ state
        covariance = np.linalg.inv(normal)
        return -covariance @ gradient, covariance


def fit_offsets(
    disagreement: Disagreement,
    free: NDArray[np.bool_],
    groups: NDArray[np.int64],
    sure: NDArray[np.float64],
) -> Fit:
    """The offsets of the drones that explain the disagreement best; those not `free` [D, 7] stay 0. `groups`
    [D] numbers the drones that see the same ground: east and north are 0 on the mean of each. `sure` [7]:
    largest errors of what counts as told."""
    drones, count = len(free), len(disagreement.frames)
    prior = _prior(free, groups, count)
    state = np.zeros(len(prior))

    def split(state: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return state[: 7 * drones].reshape(drones, 7), state[7 * drones :].reshape(count, 6)

    for number in range(_STEPS):
        height_m = _HEIGHTS_M[min(number, len(_HEIGHTS_M) - 1)]
        step, _ = disagreement.linear(*split(state), height_m).step(state, prior)
        state = state + step
        if number >= len(_HEIGHTS_M) and np.abs(step[: 7 * drones].reshape(drones, 7) / PRIOR).max() < 1e-2:
            break
    linear = disagreement.linear(*split(state), _HEIGHTS_M[-1])
    _, covariance = linear.step(state, prior)
    others = np.array([(state + linear.step(state, prior, k)[0])[: 7 * drones] for k in range(SLICES)])
    spread = np.sqrt((SLICES - 1) / SLICES * ((others - others.mean(axis=0)) ** 2).sum(axis=0))
    covariance = covariance[: 7 * drones, : 7 * drones]
    jacobian = np.sqrt(np.diag(covariance))
    error = np.hypot(np.maximum(jacobian, spread).reshape(drones, 7), COMMON)
    shown = free.copy()
    shown[:, 4:6] &= (np.bincount(groups)[groups] > 1)[:, None]
    told = shown & (error <= sure)
    zero = np.zeros((count, 6))
    poses = disagreement.poses(np.zeros((drones, 7)), zero)
    before = np.linalg.norm(disagreement.pixels(disagreement.points(poses), poses), axis=1)
    after = np.full(len(before), np.nan)
    for k, other in enumerate(others):
        poses = disagreement.poses(np.where(told, other.reshape(drones, 7), 0.0), zero)
        mine = (linear.slices == k).any(axis=1)
        after[mine] = np.linalg.norm(disagreement.pixels(disagreement.points(poses), poses), axis=1)[mine]
    return Fit(
        split(state)[0],
        covariance,
        before,
        after,
        disagreement.drone[np.stack([disagreement.first, disagreement.second], axis=1)],
        error,
        shown,
        told,
        split(state)[1],
    )


def _trust(
    off: NDArray[np.float64], sigma: NDArray[np.float64], along: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How far matches [M, 2] are believed along and across: what moved is off across, what stands on the
    ground along, on the side of heights above the map."""
    across = 1.0 / (1.0 + off[:, 1] ** 2)
    spread_m = sigma[:, 0] / along
    above_m = -off[:, 0] * spread_m
    ground = _GROUND * np.exp(-0.5 * off[:, 0] ** 2) / (spread_m * np.sqrt(2 * np.pi))
    taller = np.exp(-np.maximum(above_m, 0.0) / _TALL_M) / _TALL_M
    others = (1.0 - _GROUND) * np.where(above_m > 0, np.maximum(taller, _ANYWHERE), _LOWER)
    return np.stack([across * ground / (ground + others), across], axis=1)


def _prior(free: NDArray[np.bool_], groups: NDArray[np.int64], frames: int) -> NDArray[np.float64]:
    """Weight of 0 [P, P] for offsets, `free` [D, 7] or not, and for the noise of frames."""
    fixed = np.where(free, PRIOR**-2.0, 1e12).ravel()
    prior = np.diag(np.concatenate([fixed, np.tile(JITTER**-2.0, frames)]))
    for quantity in (QUANTITIES.index("east"), QUANTITIES.index("north")):
        for group in np.unique(groups):
            together = 7 * np.flatnonzero(free[:, quantity] & (groups == group)) + quantity
            if len(together):
                prior[np.ix_(together, together)] += (len(together) * _SHARED_M) ** -2.0
    return prior


def _slices(stamps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Stretches of equal numbers of frames, by time."""
    order = np.argsort(np.argsort(stamps_ns, kind="stable"), kind="stable")
    return np.asarray(order * SLICES // len(stamps_ns))
