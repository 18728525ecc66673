"""How often `crowdfence align` finds a jump of one drone's poses, and takes something else for one.

    python benchmarks/alignment/jumps.py race-4001.mcap ... --seeds 3

In every mission one drone is turned or moved for good somewhere in the middle half of its flight, on top of
the scenario's own trouble; `nothing` only makes the poses of all drones tremble, by 0.2 degrees and 0.1 m a
row.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from crowdfence import Recording, open_recording, open_terrain
from crowdfence.alignment import align
from crowdfence.sources.placed_again import placed_again
from crowdfence.sources.pose_track import PoseTrack

TREMBLE_DEG, TREMBLE_M = 0.2, 0.1
JUMPS = {
    "nothing": (0.0, (0.0, 0.0, 0.0)),
    "heading by 1 degree": (1.0, (0.0, 0.0, 0.0)),
    "heading by 2 degrees": (2.0, (0.0, 0.0, 0.0)),
    "place by 2 m to the east": (0.0, (2.0, 0.0, 0.0)),
    "height by 2 m": (0.0, (0.0, 0.0, 2.0)),
}
"""Degrees about the vertical, and metres."""


def jumped(recording: Recording, drone: str, jump: str, rng: np.random.Generator) -> Recording:
    """The recording with `drone` off by the jump from some time on."""
    turn_deg, metres = JUMPS[jump]
    tracks = {}
    for name, track in recording.tracks().items():
        stamps_ns = [frame.stamp_ns for frame in recording.frames_of(name)]
        at_ns = stamps_ns[0] + rng.uniform(0.25, 0.75) * (stamps_ns[-1] - stamps_ns[0])
        later = ((track.stamps_ns >= at_ns) & (name == drone)).astype(float)[:, None]
        turns = Rotation.from_quat(track.quaternions[:, [1, 2, 3, 0]])
        turns = Rotation.from_rotvec(np.radians(turn_deg) * later * [0.0, 0.0, 1.0]) * turns
        positions = track.positions + later * metres
        if jump == "nothing":
            turns *= Rotation.from_rotvec(np.radians(rng.normal(0.0, TREMBLE_DEG, positions.shape)))
            positions = positions + rng.normal(0.0, TREMBLE_M, positions.shape)
        tracks[name] = PoseTrack(track.stamps_ns, positions, turns.as_quat()[:, [3, 0, 1, 2]])
    return placed_again(recording, tracks, "a jump")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("missions", nargs="+", type=Path)
    parser.add_argument("--seeds", type=int, default=1)
    given = parser.parse_args()
    counts: dict[str, Counter[str]] = {jump: Counter() for jump in JUMPS}
    for path in given.missions:
        recording = open_recording(path)
        terrain = open_terrain(recording)
        for seed in range(given.seeds):
            drone = recording.drones[seed % len(recording.drones)]
            for jump, count in counts.items():
                flown = jumped(recording, drone, jump, np.random.default_rng(seed))
                for one in align(flown, terrain).drones:
                    whose = "it" if one.drone == drone and jump != "nothing" else "others"
                    count[whose] += 1
                    count[f"{whose} refused as jumping"] += "jump between" in one.why_not
                    count[f"{whose} told"] += one.told
                print(path.stem, seed, jump, dict(count), flush=True)
    print("\n| jump | found | drones without one: refused as jumping | aligned |\n|---|---|---|---|")
    for jump, count in counts.items():
        found = f"{count['it refused as jumping']} of {count['it']}" if count["it"] else "-"
        others = count["others"]
        refused, told = count["others refused as jumping"], count["others told"]
        print(f"| {jump} | {found} | {refused} of {others} | {told} |")


if __name__ == "__main__":
    main()
