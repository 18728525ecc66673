"""Does recorded depth put the road where the landscape has it?

    python benchmarks/simulated_depth.py RECORDING.mcap [--seed 7] [--frames 24]

RECORDING is one of `crowdfence simulate race` with the same seed. Every road pixel nearer than 250 m of the
sampled frames is back-projected with its recorded depth and the true pose of its frame, and its height is
compared with the landscape's.
"""

import argparse
from pathlib import Path

import numpy as np

from crowdfence import open_recording
from crowdfence.simulation.scenarios.scenario_file import load_scenario
from crowdfence.simulation.scene import build_scene
from crowdfence.simulation.scene_class import SceneClass

RANGE_M = 250.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--frames", type=int, default=24)
    arguments = parser.parse_args()

    recording = open_recording(arguments.recording)
    landscape = build_scene(load_scenario("race"), arguments.seed).landscape
    errors = []
    for index in np.linspace(0, len(recording.frames) - 1, arguments.frames).astype(int):
        frame = recording.frames[index]
        depth_m = frame.depth_m()
        road = (frame.segmentation() == SceneClass.ROAD) & (depth_m < RANGE_M)
        row, column = np.nonzero(road)
        rays = frame.camera.unproject(np.column_stack([column + 0.5, row + 0.5]))
        points = rays * (depth_m[road] / rays[:, 2])[:, None]
        pose = frame.true_pose().world_from_camera()
        world = points @ pose[:3, :3].T + pose[:3, 3]
        errors.append(np.abs(world[:, 2] - landscape.height_m(world[:, 0], world[:, 1])))
    error_m = np.concatenate(errors)
    median, p99, largest = np.percentile(error_m, [50, 99, 100])
    print(f"{error_m.size} road pixels under {RANGE_M:g} m in {len(errors)} frames")
    print(
        f"height error: median {median * 100:.2f} cm, p99 {p99 * 100:.2f} cm, largest {largest * 100:.1f} cm"
    )


if __name__ == "__main__":
    main()
