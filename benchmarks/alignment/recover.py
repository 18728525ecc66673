"""How much of a known error `crowdfence align` brings back, on simulated missions with true poses.

    crowdfence simulate race --seed 4001 --fps 1.5 --frames 30 -o race-4001.mcap
    python benchmarks/alignment/recover.py race-4001.mcap ...

Every drone's poses are turned by 0.5 degrees about an axis of its own, shifted by 100 ms to one side, and
moved by 1 m to some side, on top of what the scenario's own trouble did to them. The error that is left is
what was put right held against the true camera: what was left alone counts with all of its error.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crowdfence import Recording, Terrain, open_recording, open_terrain
from crowdfence.alignment import Alignment, align
from crowdfence.detector.ground_sampling import ground_sampling
from crowdfence.sources.pose_offset import PoseOffset, without_offsets

ANGLE_DEG, TIME_S, PLACE_M = 0.5, 0.1, 1.0


def disturbance(drones: tuple[str, ...], seed: int) -> dict[str, PoseOffset]:
    rng = np.random.default_rng(seed)
    offsets = {}
    for drone in drones:
        axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        late = float(rng.choice([-1.0, 1.0])) * TIME_S
        offsets[drone] = PoseOffset(*(ANGLE_DEG * axis), late, tuple(PLACE_M * way))
    return offsets


def attitude_off_deg(recording: Recording, drone: str, time_s: float) -> NDArray[np.float64]:
    """Mean turn [3] from the recorded to the true camera, with the drone's clock put right by `time_s`."""
    track = recording.tracks()[drone].shifted(-round(time_s * 1e9))
    turns = []
    for frame in recording.frames_of(drone):
        if track.stamps_ns[0] <= frame.stamp_ns <= track.stamps_ns[-1]:
            recorded = Rotation.from_matrix(track.at(frame.stamp_ns, 1.0)[:3, :3])
            w, x, y, z = frame.true_pose().quaternion
            turns.append((recorded.inv() * Rotation.from_quat([x, y, z, w])).as_rotvec(degrees=True))
    return np.mean(turns, axis=0)


def middle_off_m(recording: Recording, drone: str, terrain: Terrain) -> float:
    """Median distance on the ground between where the middle of a picture is put and where it is."""
    off = []
    for frame in recording.frames_of(drone):
        middles = []
        for pose in (frame.world_from_camera, frame.true_pose().world_from_camera()):
            seen = ground_sampling(frame.camera, pose, terrain, max_range_m=200, rows=1, columns=1)
            middles.append(pose[:3, 3] + pose[:3, 2] * seen.distance_m[0, 0])
        off.append(float(np.linalg.norm(middles[0] - middles[1])))
    return float(np.nanmedian(off))


def rows(path: Path, seed: int) -> tuple[list[str], list[NDArray[np.float64]]]:
    """A line per drone, and (attitude, time) before and after of each."""
    recorded = open_recording(path)
    terrain = open_terrain(recorded)
    given = disturbance(recorded.drones, seed)
    flown = without_offsets(recorded, given)
    started = time.process_time()
    found: Alignment = align(flown, terrain)
    cpu_s = time.process_time() - started
    righted = without_offsets(flown, found.offsets())
    lines, errors = [], []
    for one in found.drones:
        late = -given[one.drone].time_s
        true = attitude_off_deg(flown, one.drone, late)
        offset = one.offset
        left = true - [offset.pitch_deg, offset.yaw_deg, offset.roll_deg]
        error = np.array(
            [np.linalg.norm(true), np.linalg.norm(left), 1e3 * abs(late), 1e3 * abs(late - offset.time_s)]
        )
        ground = [middle_off_m(which, one.drone, terrain) for which in (flown, righted)]
        untold = ", ".join(e.quantity for e in one.estimates[:4] if not e.told) or one.why_not or "-"
        sure = [abs(e.value - t) / e.error for e, t in zip(one.estimates, [*true, late], strict=False)]
        cells = [
            f"{path.stem} {one.drone}",
            f"{error[0]:.2f} -> {error[1]:.2f}",
            f"{error[2]:.0f} -> {error[3]:.0f}",
            f"{ground[0]:.2f} -> {ground[1]:.2f}",
            f"{max(sure, default=0.0):.1f}",
            untold,
            f"{cpu_s:.0f}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
        errors.append(error)
    return lines, errors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", nargs="+", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    print("| drone | attitude, deg | time, ms | ground, m | worst error over stated | left alone | CPU s |")
    print("|---|---|---|---|---|---|---|")
    everything = []
    for path in arguments.missions:
        lines, errors = rows(path, arguments.seed)
        print("\n".join(lines), flush=True)
        everything += errors
    attitude, attitude_left, late, late_left = np.sum(everything, axis=0)
    back, back_late = 1 - attitude_left / attitude, 1 - late_left / late
    print(f"\nbrought back: {back:.0%} of the attitude, {back_late:.0%} of the time")


if __name__ == "__main__":
    main()
