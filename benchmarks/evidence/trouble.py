"""What trouble costs: `python trouble.py MISSION.mcap...`; see README.md.

The same pictures, with the recorded poses and stamps disturbed before they are projected, or with some frames
left out; and, the other way round, with the poses that the cameras really had and with heatmaps that mark the
ground of crowds. The detector's heatmaps are made once (`heatmaps.py`): its choice of sizes follows the
recorded poses.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from curves import Contender, Curve, curves
from heatmaps import model_sha, with_heatmaps
from judge import FINE
from scipy.spatial.transform import Rotation
from seen import Mission, moments_of, part_of
from tuned import TUNED

import crowdfence as cf
from crowdfence.pipeline.detect import RECORDED
from crowdfence.truth.at_exposure import true_camera_pose
from crowdfence.truth.frame_labels import label_functions

POSITION_M, ATTITUDE_DEG, CLOCK_S, LOST = 0.5, 0.5, 0.1, 0.2
FLAT_DEG = 15.0
SHOWN = ("evidence", "paper, tuned for people", "or, tuned for mIoU")
Change = Callable[[cf.Recording], cf.Recording]


def noisy_poses(recording: cf.Recording) -> cf.Recording:
    """Each pose is off by itself, by `POSITION_M` and `ATTITUDE_DEG` (standard deviation an axis)."""
    dice = np.random.default_rng(15)

    def moved(frame: cf.sources.Frame) -> cf.sources.Frame:
        pose = frame.world_from_camera.copy()
        turn = Rotation.from_rotvec(np.radians(ATTITUDE_DEG) * dice.standard_normal(3))
        pose[:3, :3] = pose[:3, :3] @ turn.as_matrix()
        pose[:3, 3] += POSITION_M * dice.standard_normal(3)
        return replace(frame, world_from_camera=pose)

    return replace(recording, frames=tuple(moved(frame) for frame in recording.frames))


def wrong_clocks(recording: cf.Recording) -> cf.Recording:
    """Pictures get the poses of `CLOCK_S` earlier and later, drone by drone in turn."""
    late_s = {drone: CLOCK_S * (-1) ** number for number, drone in enumerate(recording.drones)}

    def moved(frame: cf.sources.Frame) -> cf.sources.Frame:
        track = recording.tracks()[frame.drone]
        stamp_ns = frame.stamp_ns + round(late_s[frame.drone] * 1e9)
        stamp_ns = int(np.clip(stamp_ns, track.stamps_ns[0], track.stamps_ns[-1]))
        return replace(frame, world_from_camera=track.at(stamp_ns, 1.0))

    return replace(recording, frames=tuple(moved(frame) for frame in recording.frames))


def lost_frames(recording: cf.Recording) -> cf.Recording:
    kept = np.random.default_rng(15).random(len(recording.frames)) >= LOST
    return replace(recording, frames=tuple(f for f, keep in zip(recording.frames, kept, strict=True) if keep))


def dropped_drone(recording: cf.Recording) -> cf.Recording:
    """The first one is gone from the middle of the flight on."""
    first_ns, last_ns = recording.span_ns or (0, 0)
    middle_ns = (first_ns + last_ns) // 2
    gone = recording.drones[0]
    frames = (one for one in recording.frames if one.drone != gone or one.stamp_ns < middle_ns)
    return replace(recording, frames=tuple(frames))


def true_poses(recording: cf.Recording) -> cf.Recording:
    frames = (replace(one, world_from_camera=true_camera_pose(one)) for one in recording.frames)
    return replace(recording, frames=tuple(frames))


def true_heatmaps(recording: cf.Recording, terrain: cf.Terrain) -> cf.Recording:
    ground, _ = label_functions("ground", recording, terrain)

    def marked(frame: cf.sources.Frame) -> cf.sources.Frame:
        heatmap = lambda: ground(frame).astype(np.uint8) * np.uint8(255)  # noqa: E731
        return replace(frame, pixels=replace(frame.pixels, heatmap=heatmap))

    return replace(recording, frames=tuple(marked(frame) for frame in recording.frames))


def flown(recording: cf.Recording, terrain: cf.Terrain, *, tilt_deg: float = 90.0) -> Mission:
    """Projected anew; of the looks those alone that are no steeper than `tilt_deg`."""
    contract = cf.Detector().contract
    moments = [
        moment._replace(observations=[_flat(terrain, one, tilt_deg) for one in moment.observations])
        for moment in moments_of(recording, terrain, RECORDED, contract)
    ]
    return Mission(recording.name, terrain, contract, len(recording.drones), moments)


def _flat(terrain: cf.Terrain, one: cf.Observation, tilt_deg: float) -> cf.Observation:
    some = one.tilt_deg <= tilt_deg
    return one if some.all() else part_of(terrain, one, some)


def variants(terrain: cf.Terrain) -> dict[str, tuple[Change, float]]:
    """By name: what becomes of the recording, and the steepest look that is kept."""
    perfect = partial(true_heatmaps, terrain=terrain)
    return {
        "as it is": (lambda one: one, 90.0),
        f"poses off by {POSITION_M:g} m and {ATTITUDE_DEG:g} deg": (noisy_poses, 90.0),
        f"clocks off by {1000 * CLOCK_S:g} ms": (wrong_clocks, 90.0),
        f"{LOST:.0%} of the frames lost": (lost_frames, 90.0),
        "these three together": (lambda one: lost_frames(noisy_poses(wrong_clocks(one))), 90.0),
        "a drone gone from the middle on": (dropped_drone, 90.0),
        f"looks no steeper than {FLAT_DEG:g} deg": (lambda one: one, FLAT_DEG),
        "the poses as they were": (true_poses, 90.0),
        "heatmaps that mark the ground of crowds": (perfect, 90.0),
        "both": (lambda one: perfect(true_poses(one)), 90.0),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    parser.add_argument("--every", type=int, default=2, help="Count the IoU at every so many instants.")
    arguments = parser.parse_args()
    contenders = [one for one in TUNED if one.name in SHOWN]
    print(f"model {model_sha()}\n\n| mission | |", " | ".join(one.name for one in contenders), "|")
    print("|---|---|" + "---|" * len(contenders))
    for path in arguments.missions:
        recording = with_heatmaps(path)
        terrain = cf.open_terrain(recording)
        for name, (change, tilt_deg) in variants(terrain).items():
            mission = flown(change(recording), terrain, tilt_deg=tilt_deg)
            found = curves(
                mission, [Contender(one.name, one.method) for one in contenders], every=arguments.every
            )
            cells = [_cells(curve, one.iou_threshold) for curve, one in zip(found, contenders, strict=True)]
            print(f"| {path.stem} | {name} |", " | ".join(cells), "|", flush=True)


def _cells(curve: Curve, threshold: float) -> str:
    """mIoU at the threshold of the training missions, at the best, and over-blocked at 5 % missed."""
    at = float(FINE[np.argmin(np.abs(FINE - threshold))])
    ious = f"{curve.sweep.at(at).mean:.3f} / {curve.sweep.best()[1].mean:.3f}"
    return f"{ious} / {curve.over_blocked(0.05):.2f}"


if __name__ == "__main__":
    sys.exit(main())
