"""What a training leaves beside the model: figures as JSON, curves and example pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path
from crowdfence.detector_training.frame_store import StoredMission
from crowdfence.detector_training.labels import STRIDE
from crowdfence.detector_training.network import CrowdNet, padded
from crowdfence.detector_training.plan import TrainingPlan
from crowdfence.detector_training.trainer import Checkup, Trained

EXAMPLES = 12
_COLUMNS = 4


def write_report(
    folder: Path,
    trained: Trained,
    plan: TrainingPlan,
    missions: Sequence[StoredMission],
    validation: Sequence[StoredMission],
) -> None:
    """report.json, curves.png and examples.png in `folder`, which is made if needed."""
    folder.mkdir(parents=True, exist_ok=True)
    facts = training_facts(trained, plan, missions, validation)
    with atomic_path(folder / "report.json") as part:
        part.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    _draw_curves(folder / "curves.png", trained, plan)
    _draw_examples(folder / "examples.png", trained.network, validation)


def training_facts(
    trained: Trained,
    plan: TrainingPlan,
    missions: Sequence[StoredMission],
    validation: Sequence[StoredMission],
) -> dict[str, Any]:
    """Plan, missions and the course of the training, ready for JSON."""
    return {
        "plan": asdict(plan),
        "parameters": sum(value.numel() for value in trained.network.deployed(0).parameters()),
        "torch": torch.__version__,
        "teacher": None if trained.teacher is None else asdict(trained.teacher),
        "missions": {mission.name: len(mission) for mission in missions},
        "validation_missions": {mission.name: len(mission) for mission in validation},
        "skipped_frames": [why for mission in [*missions, *validation] for why in mission.skipped],
        "doubts": [
            f"{mission.name}: {doubt}" for mission in [*missions, *validation] for doubt in mission.doubts
        ],
        "stopped_early": trained.stopped_early,
        "best": _row(trained.best),
        "start": None if trained.start is None else _row(trained.start),
        "worse_than_start": trained.worse_than_start(plan.targets[0]),
        "history": [_row(checkup) for checkup in trained.history],
    }


def _row(checkup: Checkup) -> dict[str, Any]:
    score = checkup.score
    row: dict[str, Any] = {
        "step": checkup.step,
        "seconds": round(checkup.seconds, 1),
        "loss": checkup.loss,
        "validation_loss": score.loss,
    }
    for target, cells in score.cells.items():
        row[target] = {
            "iou": _or_none(score.iou(target)),
            "true_positive_rate": _or_none(cells.true_positive_rate().rate),
            "false_positive_rate": _or_none(cells.false_positive_rate().rate),
        }
    return row


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _draw_curves(path: Path, trained: Trained, plan: TrainingPlan) -> None:
    from matplotlib.figure import Figure

    history = trained.history
    steps = [checkup.step for checkup in history]
    figure = Figure(figsize=(10, 4), layout="constrained")
    losses, quality = figure.subplots(1, 2)
    learned = [np.nan if checkup.loss is None else checkup.loss for checkup in history]
    losses.plot(steps, learned, label="training (with Dice until the line)")
    losses.plot(steps, [checkup.score.loss for checkup in history], label="validation, cross-entropy")
    losses.set_yscale("log")
    losses.set_ylabel("loss")
    for target in plan.targets:
        quality.plot(steps, [checkup.score.iou(target) for checkup in history], label=target)
    quality.set_ylabel("pixel IoU on validation missions")
    quality.set_ylim(0, 1)
    quality.axvline(trained.best.step, color="0.6", linestyle=":", label="kept")
    for axes in (losses, quality):
        axes.axvline(plan.calm_from, color="0.8")
        axes.set_xlabel("step")
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    with atomic_path(path) as part:
        figure.savefig(part, format="png", dpi=110)


@torch.no_grad()
def _draw_examples(path: Path, network: CrowdNet, missions: Sequence[StoredMission]) -> None:
    """Frames spread evenly over the validation missions, with what the first target's output says."""
    from PIL import Image

    from crowdfence.detector.overlay import overlay

    device = next(network.parameters()).device
    tiles = []
    for mission, frame in _spread(missions, EXAMPLES):
        height, width = mission.size_of(frame)
        image = np.array(mission.images[frame, :height, :width])
        pixels = torch.from_numpy(image).to(device).permute(2, 0, 1)[None].float() / 255.0
        logits = network(padded(pixels))[0, 0, : height // STRIDE, : width // STRIDE]
        heatmap = torch.sigmoid(logits).float().cpu().numpy()
        tiles.append(np.asarray(Image.fromarray(overlay(image, heatmap)).resize((480, 360))))
    while len(tiles) % _COLUMNS:
        tiles.append(np.full_like(tiles[0], 255))
    rows = [np.hstack(tiles[first : first + _COLUMNS]) for first in range(0, len(tiles), _COLUMNS)]
    page: NDArray[np.uint8] = np.vstack(rows)
    with atomic_path(path) as part:
        Image.fromarray(page).save(part, format="PNG")


def _spread(missions: Sequence[StoredMission], count: int) -> list[tuple[StoredMission, int]]:
    """`count` frames, as many of each mission as of any other, those with most crowd and others in turn."""
    chosen = []
    for index in range(count):
        mission = missions[index % len(missions)]
        by_crowd = np.argsort(-mission.crowd[:, 0].mean(axis=(1, 2)), kind="stable")
        chosen.append((mission, int(by_crowd[(index // len(missions)) * 3 % len(by_crowd)])))
    return chosen
