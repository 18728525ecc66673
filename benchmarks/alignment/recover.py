"""How much of a known error `crowdfence align` brings back, on simulated missions with true poses.

    python benchmarks/alignment/recover.py race-4001.mcap ...

The missions are rendered as benchmarks/evidence/README.md says. Every drone's poses are turned by 0.5 degrees
about an axis of its own, shifted by 100 ms to one side, and moved by 1 m to some side, on top of what the
scenario's own trouble did to them. What is left is held against the true camera: what was left alone counts
with all of its error.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crowdfence import Recording, Terrain, open_recording, open_terrain
from crowdfence.alignment import align
from crowdfence.alignment.ground_matches import ground_points
from crowdfence.detector.ground_sampling import rays_or_nan
from crowdfence.sources.pose_offset import PoseOffset, without_offsets
from crowdfence.sources.recording import Frame

ANGLE_DEG, TIME_S, PLACE_M = 0.5, 0.1, 1.0
ROWS, COLUMNS = 6, 8
REACH_M, LOST_M = 150.0, 10.0
"""Ground that is looked at, and what a pixel counts that meets none, or ground further off than that."""


def disturbance(drones: tuple[str, ...], seed: int) -> dict[str, PoseOffset]:
    rng = np.random.default_rng(seed)
    offsets = {}
    for drone in drones:
        axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        late = float(rng.choice([-1.0, 1.0])) * TIME_S
        offsets[drone] = PoseOffset(*(ANGLE_DEG * axis), late, tuple(PLACE_M * way))
    return offsets


def true_offset(recording: Recording, drone: str, time_s: float) -> NDArray[np.float64]:
    """Mean offset [7] of the recorded from the true camera, the drone's clock being `time_s` off."""
    track = recording.tracks()[drone].shifted(-round(time_s * 1e9))
    off = []
    for frame in recording.frames_of(drone):
        if track.stamps_ns[0] <= frame.stamp_ns <= track.stamps_ns[-1]:
            recorded, true = track.at(frame.stamp_ns, 1.0), frame.true_pose().world_from_camera()
            turn = Rotation.from_matrix(recorded[:3, :3].T @ true[:3, :3]).as_rotvec(degrees=True)
            off.append([*turn, time_s, *(true[:3, 3] - recorded[:3, 3])])
    return np.mean(off, axis=0)


def without_shared(offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Offsets [D, 7] less the east and north that all drones have in common."""
    left = offsets.copy()
    left[:, 4:6] -= left[:, 4:6].mean(axis=0)
    return left


def ground(frame: Frame, pose: NDArray[np.float64], terrain: Terrain) -> NDArray[np.float64]:
    """Where `ROWS` x `COLUMNS` pixels lie on the ground [N, 3]."""
    camera = frame.camera
    x, y = np.meshgrid(np.arange(COLUMNS) + 0.5, np.arange(ROWS) + 0.5)
    pixels = np.stack([x * camera.width / COLUMNS, y * camera.height / ROWS], axis=-1).reshape(-1, 2)
    rays = rays_or_nan(camera, pixels)
    points = np.full((len(rays), 3), np.nan)
    usable = np.isfinite(rays).all(axis=1)
    points[usable] = ground_points(terrain, pose, rays[usable])
    return points


def ground_off_m(recording: Recording, drone: str, terrain: Terrain) -> float:
    """Mean horizontal distance between where pixels are put on the ground and where they are."""
    off = []
    for frame in recording.frames_of(drone):
        true = frame.true_pose().world_from_camera()
        there = ground(frame, true, terrain)
        near = np.linalg.norm(there - true[:3, 3], axis=1) < REACH_M
        here = ground(frame, frame.world_from_camera, terrain)
        metres = np.linalg.norm((here - there)[near, :2], axis=1)
        off.append(np.minimum(np.nan_to_num(metres, nan=LOST_M), LOST_M))
    return float(np.concatenate(off).mean())


@dataclass(frozen=True)
class Recovered:
    """One drone."""

    name: str
    before: NDArray[np.float64]
    """[7]"""
    after: NDArray[np.float64]
    """[7]"""
    ground_m: tuple[float, float, float]
    """Before, after, and with all taken out that pictures can show."""
    worst: float
    """Largest error of what was told, in stated standard deviations; places against the other drones."""
    untold: str
    cpu_s: float

    @property
    def sizes(self) -> NDArray[np.float64]:
        """Attitude, time, place and ground [4], before and after [2]."""
        ends = (self.before, self.after)
        return np.array(
            [
                [np.linalg.norm(end[:3]) for end in ends],
                [1e3 * abs(end[3]) for end in ends],
                [np.linalg.norm(end[4:]) for end in ends],
                self.ground_m[:2],
            ]
        )

    def line(self) -> str:
        attitude, late, place, ground_m = (
            f"{a:.{n}f} -> {b:.{n}f}" for (a, b), n in zip(self.sizes, (2, 0, 2, 2), strict=True)
        )
        cells = (self.name, attitude, late, place, ground_m, f"{self.ground_m[2]:.2f}", f"{self.worst:.1f}")
        return f"| {' | '.join((*cells, self.untold or '-', f'{self.cpu_s:.0f}'))} |"


def recovered(path: Path, seed: int) -> list[Recovered]:
    recorded = open_recording(path)
    terrain = open_terrain(recorded)
    given = disturbance(recorded.drones, seed)
    flown = without_offsets(recorded, given)
    true = np.array([true_offset(flown, drone, -given[drone].time_s) for drone in sorted(recorded.drones)])
    started = time.process_time()
    found = align(flown, terrain)
    cpu_s = time.process_time() - started
    best = {
        drone: PoseOffset(*row[:4], tuple(row[4:]))
        for drone, row in zip(sorted(recorded.drones), without_shared(true), strict=True)
    }
    # What the relief says of the east and north of all is no error against the other drones.
    moved = np.zeros(7)
    moved[4:6] = np.mean([one.offset.position_m[:2] for one in found.drones], axis=0)
    stages = (flown, without_offsets(flown, found.offsets()), without_offsets(flown, best))
    results = []
    for one, row, shown in zip(found.drones, true, without_shared(true), strict=True):
        offset = one.offset
        told = np.array(
            [offset.pitch_deg, offset.yaw_deg, offset.roll_deg, offset.time_s, *offset.position_m]
        )
        sure = [
            abs(e.value - shift - t) / e.error
            for e, shift, t in zip(one.estimates, moved, shown, strict=False)
            if e.told
        ]
        results.append(
            Recovered(
                f"{path.stem} {one.drone}",
                row,
                row - told,
                tuple(ground_off_m(stage, one.drone, terrain) for stage in stages),
                max(sure, default=0.0),
                ", ".join(e.quantity for e in one.estimates if not e.told) or one.why_not,
                cpu_s,
            )
        )
    return results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", nargs="+", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    print(
        "| drone | attitude, deg | time, ms | place, m | ground, m | at best | worst error over stated "
        "| left alone | CPU s |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    sizes = []
    for path in arguments.missions:
        for one in recovered(path, arguments.seed):
            print(one.line(), flush=True)
            sizes.append(one.sizes)
    before, after = np.sum(sizes, axis=0).T
    back = dict(zip(("attitude", "time", "place", "ground"), 1 - after / before, strict=True))
    print("\nbrought back: " + ", ".join(f"{share:.0%} of the {what}" for what, share in back.items()))


if __name__ == "__main__":
    main()
