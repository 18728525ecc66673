"""What `--pose-noise estimate` takes out of poses: `python pose_noise.py MISSION.mcap...`; see README.md.

Of the pictures' poses against those that the cameras really had; what is constant of a drone is left out,
because `crowdfence align` is for that.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from trouble import ATTITUDE_DEG, POSITION_M, noisy_rows

import crowdfence as cf
from crowdfence.sources.pose_noise import PoseNoise, noise_of, without_noise
from crowdfence.truth.at_exposure import true_camera_pose


def errors(recording: cf.Recording) -> PoseNoise:
    """Root of the mean square per axis, over all pictures."""
    moved_m, turned_deg = [], []
    for drone in recording.drones:
        frames = recording.frames_of(drone)
        poses = [(one.world_from_camera, true_camera_pose(one)) for one in frames]
        moves = np.array([said[:3, 3] - true[:3, 3] for said, true in poses])
        turns = Rotation.from_matrix([true[:3, :3].T @ said[:3, :3] for said, true in poses]).as_rotvec()
        moved_m.append(moves - moves.mean(axis=0))
        turned_deg.append(np.degrees(turns - turns.mean(axis=0)))
    squares = [np.square(np.concatenate(some)).mean() for some in (moved_m, turned_deg)]
    return PoseNoise(*map(float, np.sqrt(squares)))


def found(recording: cf.Recording) -> PoseNoise:
    """By the rows themselves, mean over the drones."""
    of_drones = [noise_of(track) for track in recording.tracks().values()]
    told = [(one.position_m, one.attitude_deg) for one in of_drones if one is not None]
    return PoseNoise(*map(float, np.mean(told, axis=0)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    arguments = parser.parse_args()
    print("| mission | rows | rows tell | pictures are off by | smoothed |\n|---|---|---|---|---|")
    for path in arguments.missions:
        recording = cf.open_recording(path)
        rows = {
            "as recorded": recording,
            f"{POSITION_M:g} m, {ATTITUDE_DEG:g} deg more": noisy_rows(recording),
        }
        for name, one in rows.items():
            figures = found(one), errors(one), errors(without_noise(one, "estimate"))
            cells = (f"{each.position_m:.2f} m, {each.attitude_deg:.2f} deg" for each in figures)
            print(f"| {path.stem} | {name} |", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    sys.exit(main())
