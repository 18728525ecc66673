"""What limits `evidence`: `python ablation.py MISSION.mcap...`; see README.md.

The shipped settings, with the detector's heatmaps or with perfect ones, which mark the ground of crowds in
the picture, and with the poses of the telemetry or those that the cameras really had.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from judge import judged
from seen import Mission, moments_of

import crowdfence as cf
from crowdfence.config import EvidenceConfig, ProjectionConfig
from crowdfence.pipeline.detect import heatmap_source
from crowdfence.truth.at_exposure import true_camera_pose
from crowdfence.truth.frame_labels import label_functions

EVERY = 2


class Row(NamedTuple):
    in_range: float
    closed: float
    best_iou: float


def row(recording: cf.Recording, *, perfect_heatmaps: bool, perfect_poses: bool) -> Row:
    detector = cf.Detector()
    terrain = cf.open_terrain(recording)
    if perfect_poses:
        frames = (replace(one, world_from_camera=true_camera_pose(one)) for one in recording.frames)
        recording = replace(recording, frames=tuple(frames))
    found: cf.Detector | object = detector
    if perfect_heatmaps:
        ground, _ = label_functions("ground", recording, terrain)
        found = lambda frame: ground(frame).astype(np.uint8) * np.uint8(255)  # noqa: E731
    heatmaps = heatmap_source(found, terrain, ProjectionConfig().max_range_m)
    moments = list(moments_of(recording, terrain, heatmaps, detector.contract))
    mission = Mission(recording.name, terrain, detector.contract, len(recording.drones), moments)
    shipped = EvidenceConfig().with_detector(detector.contract)
    threshold = shipped.fusion_method(terrain, mission.drones).default_threshold
    result = judged(mission, shipped, np.array([threshold]), every=EVERY)
    (share,), (closed,) = result.curve()
    return Row(float(share), float(closed), result.sweep.best()[1].mean)


VARIANTS = {
    "as it is": {"perfect_heatmaps": False, "perfect_poses": False},
    "perfect poses": {"perfect_heatmaps": False, "perfect_poses": True},
    "perfect heatmaps": {"perfect_heatmaps": True, "perfect_poses": False},
    "both perfect": {"perfect_heatmaps": True, "perfect_poses": True},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    print("| mission | | in a zone, of those in range | closed / own | best mIoU |\n|---|---|---|---|---|")
    for path in parser.parse_args().missions:
        recording = cf.open_recording(path)
        for name, variant in VARIANTS.items():
            numbers = " | ".join(f"{value:.3f}" for value in row(recording, **variant))
            print(f"| {path.stem} | {name} | {numbers} |", flush=True)


if __name__ == "__main__":
    sys.exit(main())
