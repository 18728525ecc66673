"""What trouble costs: `python trouble.py MISSION.mcap...`; see README.md.

The same pictures, with the recorded telemetry disturbed before they are projected, or with some frames left
out; the same after `--pose-noise estimate` and `crowdfence align` have taken some of it back; and, the other
way round, with the poses that the cameras really had and with heatmaps that mark the ground of crowds. The
detector's heatmaps are made once (`heatmaps.py`): its choice of sizes follows the recorded poses.
"""

from __future__ import annotations

import argparse
import re
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
from tuned import TUNED, Tuned

import crowdfence as cf
from crowdfence.alignment.estimate import align
from crowdfence.pipeline.detect import RECORDED
from crowdfence.sources.placed_again import placed_again
from crowdfence.sources.pose_noise import without_noise
from crowdfence.sources.pose_offset import without_offsets
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.truth.at_exposure import true_camera_pose
from crowdfence.truth.frame_labels import label_functions

POSITION_M, ATTITUDE_DEG, CLOCK_S, LOST = 0.5, 0.5, 0.1, 0.2
FLAT_DEG = 15.0
SHOWN = ("evidence", "paper, tuned for people", "or, tuned for mIoU")
Change = Callable[[cf.Recording], cf.Recording]


def noisy_rows(recording: cf.Recording) -> cf.Recording:
    """Each row of the telemetry is off by itself, by `POSITION_M` and `ATTITUDE_DEG` (standard deviation an
    axis): what the simulator calls noise."""
    dice = np.random.default_rng(15)
    tracks = {drone: _noisy(track, dice) for drone, track in recording.tracks().items()}
    return placed_again(recording, tracks, "noise")


def noisy_pictures(recording: cf.Recording) -> cf.Recording:
    """The pose of each picture is off as much, and nothing tells that from motion."""
    dice = np.random.default_rng(15)

    def moved(frame: cf.sources.Frame) -> cf.sources.Frame:
        pose = frame.world_from_camera.copy()
        turn = Rotation.from_rotvec(np.radians(ATTITUDE_DEG) * dice.standard_normal(3))
        pose[:3, :3] = pose[:3, :3] @ turn.as_matrix()
        pose[:3, 3] += POSITION_M * dice.standard_normal(3)
        return replace(frame, world_from_camera=pose)

    return replace(recording, frames=tuple(moved(frame) for frame in recording.frames))


def _noisy(track: PoseTrack, dice: np.random.Generator) -> PoseTrack:
    turns = Rotation.from_rotvec(np.radians(ATTITUDE_DEG) * dice.standard_normal((len(track), 3)))
    attitudes = Rotation.from_quat(np.roll(track.quaternions, -1, axis=1)) * turns
    positions = track.positions + POSITION_M * dice.standard_normal((len(track), 3))
    return PoseTrack(track.stamps_ns, positions, np.roll(attitudes.as_quat(), 1, axis=1))


def wrong_clocks(recording: cf.Recording) -> cf.Recording:
    """Pictures get the poses of `CLOCK_S` earlier and later, drone by drone in turn."""
    late_ns = {drone: round(CLOCK_S * 1e9) * (-1) ** n for n, drone in enumerate(recording.drones)}
    tracks = {drone: track.shifted(-late_ns[drone]) for drone, track in recording.tracks().items()}
    return placed_again(recording, tracks, "its clock")


def steady(recording: cf.Recording) -> cf.Recording:
    """As `--pose-noise estimate` makes it."""
    return without_noise(recording, "estimate")


def aligned(recording: cf.Recording, terrain: cf.Terrain) -> cf.Recording:
    """As `crowdfence align` and `--alignment` make it."""
    return without_offsets(recording, align(recording, terrain).offsets())


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
    off = f"off by {POSITION_M:g} m and {ATTITUDE_DEG:g} deg"
    clocks = f"clocks off by {1000 * CLOCK_S:g} ms"
    three = lambda one: lost_frames(wrong_clocks(noisy_rows(one)))  # noqa: E731
    changes: dict[str, Change] = {
        "as it is": lambda one: one,
        "as it is, smoothed": steady,
        f"rows of telemetry {off}": noisy_rows,
        f"rows of telemetry {off}, smoothed": lambda one: steady(noisy_rows(one)),
        f"the pose of each picture {off}": noisy_pictures,
        clocks: wrong_clocks,
        f"{clocks}, aligned": lambda one: aligned(wrong_clocks(one), terrain),
        f"{LOST:.0%} of the frames lost": lost_frames,
        "rows, clocks and lost frames together": three,
        "together, smoothed": lambda one: steady(three(one)),
        "together, smoothed and aligned": lambda one: aligned(steady(three(one)), terrain),
        "together, the pose of each picture instead of rows": lambda one: lost_frames(
            noisy_pictures(wrong_clocks(one))
        ),
        "a drone gone from the middle on": dropped_drone,
        "the poses as they were": true_poses,
        "heatmaps that mark the ground of crowds": perfect,
        "both": lambda one: perfect(true_poses(one)),
    }
    flat = {f"looks no steeper than {FLAT_DEG:g} deg": (changes["as it is"], FLAT_DEG)}
    return {name: (change, 90.0) for name, change in changes.items()} | flat


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    parser.add_argument("--every", type=int, default=2, help="Count the IoU at every so many instants.")
    parser.add_argument("--only", default="", help="Troubles whose names match this regular expression.")
    parser.add_argument("--methods", type=int, default=len(SHOWN), help="So many of the methods.")
    arguments = parser.parse_args()
    contenders = [one for one in TUNED if one.name in SHOWN[: arguments.methods]]
    print(f"model {model_sha()}\n\n| mission | |", " | ".join(one.name for one in contenders), "|")
    print("|---|---|" + "---|" * len(contenders))
    for path in arguments.missions:
        recording = with_heatmaps(path)
        terrain = cf.open_terrain(recording)
        for name, (change, tilt_deg) in variants(terrain).items():
            if not re.search(arguments.only, name):
                continue
            mission = flown(change(recording), terrain, tilt_deg=tilt_deg)
            found = curves(
                mission, [Contender(one.name, one.method) for one in contenders], every=arguments.every
            )
            cells = [_cells(mission, curve, one) for curve, one in zip(found, contenders, strict=True)]
            print(f"| {path.stem} | {name} |", " | ".join(cells), "|", flush=True)


def _cells(mission: Mission, curve: Curve, one: Tuned) -> str:
    """mIoU at the threshold of the training missions, at the best; people in range in a zone of the moment
    and what is closed farther than 5 m from any crowd, per crowds' own; the same where 5 % are missed."""
    at = float(FINE[np.argmin(np.abs(FINE - one.iou_threshold))])
    ious = f"{curve.sweep.at(at).mean:.3f} / {curve.sweep.best()[1].mean:.3f}"
    zone = one.zone_threshold or _own_threshold(mission, one)
    far = np.count_nonzero(curve.far >= zone) / curve.own
    people = np.mean(curve.people >= zone)
    return f"{ious} / {people:.3f} at {far:.2f} / {curve.over_blocked(0.05):.2f}"


def _own_threshold(mission: Mission, one: Tuned) -> float:
    config = cf.RunConfig(one.method).with_detector(mission.contract)
    return config.crowd_map(mission.terrain, mission.drones).default_threshold()


if __name__ == "__main__":
    sys.exit(main())
