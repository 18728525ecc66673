"""Which heatmaps are better once on the terrain: `python compare_targets.py CHECKPOINT RECORDING...`.

Reads a checkpoint that was trained on both targets, projects each output, and the heatmaps that the recording
itself holds, with the true poses onto its map, and compares voxel by voxel with where the crowds stand: from
single views, and from the mean of all views of an instant. What marks bodies and not ground is projected at
several target heights. `--people` names the positions of people where the recording lacks them: an .npz
with `stamp_ns` [N] and `position_enu` [N, P, 3].
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from crowdfence import View, project
from crowdfence.detector_training.network import CrowdNet
from crowdfence.evaluation.cells.rates import crowd_cells, heatmap_values
from crowdfence.pipeline import open_terrain
from crowdfence.sources import open_recording
from crowdfence.sources.recording import Frame, Recording
from crowdfence.truth.at_exposure import crowd_definition, people_at, true_camera_pose
from crowdfence.truth.crowd_masks import crowd_mask, has_crowd_mask
from crowdfence.truth.world import truth_from_positions

MAX_RANGE_M = 150.0
BODY_HEIGHTS_M = (0.0, 0.4, 0.6, 0.9)
THRESHOLDS = np.round(np.arange(0.1, 0.91, 0.1), 1)

FeetAt = Callable[[Frame], NDArray[Any]]
HeatmapsOf = Callable[[Frame], dict[str, NDArray[Any]]]


class Agreement:
    """Places called crowd at each threshold against places that are."""

    def __init__(self) -> None:
        self.both, self.called = np.zeros(len(THRESHOLDS)), np.zeros(len(THRESHOLDS))
        self.crowd = self.places = 0

    def add(self, value: NDArray[np.floating], crowd: NDArray[np.bool_]) -> None:
        """Values and truth [N]."""
        called = value > THRESHOLDS[:, None]
        self.both += (called & crowd).sum(axis=1)
        self.called += called.sum(axis=1)
        self.crowd += int(crowd.sum())
        self.places += crowd.size

    def to_json(self) -> dict[str, float]:
        """IoU and rates at 0.5, and the best IoU with its threshold."""
        iou = self.both / np.maximum(self.called + self.crowd - self.both, 1)
        half, best = int(np.flatnonzero(THRESHOLDS == 0.5)[0]), int(iou.argmax())
        empty = self.places - self.crowd
        figures = {
            "iou": iou[half],
            "tpr": self.both[half] / max(self.crowd, 1),
            "fpr": (self.called[half] - self.both[half]) / max(empty, 1),
            "best_iou": iou[best],
            "best_threshold": THRESHOLDS[best],
        }
        return {name: round(float(value), 4) for name, value in figures.items()}


def compare(
    recordings: list[Recording], heatmaps_of: HeatmapsOf, feet_at: FeetAt | None
) -> dict[str, dict[str, dict[str, float]]]:
    """Over all seen voxels of all recordings, by heatmap and height, from one view and from all views; over
    the cells of heatmaps that mark bodies, against the recorded labels of the images."""
    agreement: dict[tuple[str, str], Agreement] = defaultdict(Agreement)
    for recording in recordings:
        terrain, definition = open_terrain(recording, None), crowd_definition(recording.manifest)
        for instant in recording.instants(150.0):
            looks = defaultdict(list)
            for frame in instant.frames:
                feet = people_at(frame, recording).position if feet_at is None else feet_at(frame)
                truth = truth_from_positions(feet, terrain, **definition, off_terrain="ignore")
                pose = true_camera_pose(frame)
                for kind, heatmap in heatmaps_of(frame).items():
                    if kind != "ground" and has_crowd_mask(frame):
                        values = heatmap_values(heatmap)
                        labels = crowd_cells(crowd_mask(frame), values.shape)
                        agreement[kind, "cells"].add(values.ravel(), labels.ravel())
                    view = View(frame.drone, frame.stamp_ns, frame.camera, pose, heatmap)
                    for height_m in (0.0,) if kind == "ground" else BODY_HEIGHTS_M:
                        seen = project(
                            view, terrain, max_range_m=MAX_RANGE_M, target_height_m=height_m, coverage="full"
                        )
                        name = f"{kind} at {height_m:g} m"
                        agreement[name, "one view"].add(seen.mean, truth[seen.voxel_ids])
                        looks[name].append((seen.voxel_ids, seen.mean))
            for name, views in looks.items():
                ids, look = np.unique(np.concatenate([ids for ids, _ in views]), return_inverse=True)
                mean = np.bincount(look, np.concatenate([mean for _, mean in views])) / np.bincount(look)
                agreement[name, "all views"].add(mean, truth[ids])
    result: dict[str, dict[str, dict[str, float]]] = defaultdict(dict)
    for (name, views), one in agreement.items():
        result[name][views] = one.to_json()
    return result


def heatmaps_of_checkpoint(path: Path) -> HeatmapsOf:
    """Both outputs of a network and, where a frame has one, the recorded heatmap."""
    state = torch.load(path, weights_only=True)
    targets = state["plan"]["targets"]
    network = CrowdNet(len(targets), width=state["plan"]["width"]).eval()
    network.load_state_dict(state["best"])

    @torch.no_grad()
    def heatmaps(frame: Frame) -> dict[str, NDArray[Any]]:
        pixels = torch.tensor(frame.image()).permute(2, 0, 1)[None].float() / 255.0
        found: dict[str, NDArray[Any]] = dict(
            zip(targets, torch.sigmoid(network(pixels))[0].numpy(), strict=True)
        )
        return found if frame.pixels.heatmap is None else found | {"recorded": frame.heatmap()}

    return heatmaps


def feet_of_table(path: Path) -> FeetAt:
    """Feet [P, 3] at the stamp of a frame."""
    table = np.load(path)
    row = {int(stamp): number for number, stamp in enumerate(table["stamp_ns"])}
    return lambda frame: table["position_enu"][row[frame.stamp_ns]]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--people", type=Path, help="positions of people (.npz)")
    given = parser.parse_args()
    compared = compare(
        [open_recording(path) for path in given.recordings],
        heatmaps_of_checkpoint(given.checkpoint),
        None if given.people is None else feet_of_table(given.people),
    )
    print(json.dumps(compared, indent=2))
