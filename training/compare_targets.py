"""Which target is better once it lies on the terrain: `python compare_targets.py CHECKPOINT MISSION...`.

Reads a checkpoint that was trained on both targets, projects each output with the true poses onto the map of
the mission and compares voxel by voxel with where the crowds stand: from single views, and from the mean of
all views of an instant. Silhouettes are projected at several target heights.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from pathlib import Path

import numpy as np
import torch

from crowdfence import View, project
from crowdfence.evaluation.labelled_projection import crowd_definition, true_camera_pose
from crowdfence.evaluation.world_truth import truth_from_positions
from crowdfence.pipeline import open_terrain
from crowdfence.sources import open_recording
from crowdfence.training.network import CrowdNet

MAX_RANGE_M = 150.0
HEIGHTS_M = {"ground": (0.0,), "silhouettes": (0.0, 0.4, 0.6, 0.9)}


@torch.no_grad()
def compare(checkpoint: Path, missions: list[Path]) -> dict[str, dict[str, float]]:
    """IoU over all seen voxels of all missions, per target and height, one view and all views."""
    state = torch.load(checkpoint, weights_only=True)
    targets = state["plan"]["targets"]
    network = CrowdNet(len(targets), width=state["plan"]["width"]).eval()
    network.load_state_dict(state["best"])
    counts: dict[tuple[str, str], list[int]] = defaultdict(lambda: [0, 0])
    for path in missions:
        recording = open_recording(path)
        terrain, definition = open_terrain(recording, None), crowd_definition(recording.manifest)
        for instant in recording.instants(150.0):
            looks = defaultdict(list)
            for frame in instant.frames:
                pixels = torch.tensor(frame.image()).permute(2, 0, 1)[None].float() / 255.0
                heatmaps = torch.sigmoid(network(pixels))[0].numpy()
                people = recording.people_truth(frame.exposure_ns(), max_gap_s=0.5)
                assert people is not None
                truth = truth_from_positions(people.position, terrain, **definition, off_terrain="ignore")
                pose = true_camera_pose(frame)
                for target, heatmap in zip(targets, heatmaps, strict=True):
                    view = View(frame.drone, frame.stamp_ns, frame.camera, pose, heatmap)
                    for height_m in HEIGHTS_M[target]:
                        seen = project(
                            view, terrain, max_range_m=MAX_RANGE_M, target_height_m=height_m, coverage="full"
                        )
                        name = f"{target} at {height_m:g} m"
                        _count(counts[name, "one view"], seen.mean > 0.5, truth[seen.voxel_ids])
                        looks[name].append((seen.voxel_ids, seen.mean))
            for name, views in looks.items():
                ids, look = np.unique(np.concatenate([ids for ids, _ in views]), return_inverse=True)
                mean = np.bincount(look, np.concatenate([mean for _, mean in views])) / np.bincount(look)
                _count(counts[name, "all views"], mean > 0.5, truth[ids])
    result: dict[str, dict[str, float]] = defaultdict(dict)
    for (name, views), (both, either) in counts.items():
        result[name][views] = both / max(1, either)
    return result


def _count(counts: list[int], called: np.ndarray, crowd: np.ndarray) -> None:
    counts[0] += int((called & crowd).sum())
    counts[1] += int((called | crowd).sum())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("missions", type=Path, nargs="+")
    given = parser.parse_args()
    print(json.dumps(compare(given.checkpoint, given.missions), indent=2))
