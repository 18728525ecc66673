"""At which sizes the shipped detector is shown pictures: `python picture_sizes.py MODEL MISSIONS...`.

Writes two things into the contract of a calibrated model, both measured on the calibration missions:

- `sizes.weights` and `sizes.bias`, which make one heatmap of a picture of unknown scale seen at three sizes:
  every frame is enlarged 1, 2 and 4 times, each as likely as the others, and a line in the three sorted
  logits is fitted to the labels. No photograph takes part. Photographs hold more that resembles a crowd than
  rendered pictures do: `--doubt` is taken off the bias.
- `pictures`, what those frames look like (`calibrate` writes it too; here for a model calibrated before).

`sizes.gsd_m` is stated here: below 0.05 m per pixel half the size finds more than the whole, above 0.3 m
twice the size does (training/README.md).
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crowdfence.calibration.correction import sigmoid
from crowdfence.calibration.logit_counts import cell_logits
from crowdfence.calibration.model_file import write_with_contract
from crowdfence.detector.contract.picture_sizes import PictureSizes
from crowdfence.detector.detector import Detector
from crowdfence.detector.inference.picture_parts import resized
from crowdfence.detector.picture_statistics import picture_statistics, range_of_missions
from crowdfence.errors import FrameError
from crowdfence.evaluation.cells.rates import crowd_cells
from crowdfence.pipeline import open_terrain
from crowdfence.sources import open_recording
from crowdfence.truth.frame_labels import label_functions

KNOWN_GSD_M = (0.05, 0.3)
SIZES = (1.0, 0.5, 0.25)
ENLARGED = (1, 2, 4)
EVERY = 8
"""Of the frames of a mission, for the line; every second one for what pictures look like."""
EMPTY_KEPT = 0.15
"""Share of the empty cells that is fitted on; each counts for the others."""

Cells = tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]
"""Sorted logits [N, 3], crowd [N], weight [N]."""


def cells_of(detector: Detector, path: Path, rng: np.random.Generator) -> list[Cells]:
    """Of the frames of a mission, as pictures of three scales."""
    recording = open_recording(path)
    mask_of, ignore_of = label_functions("ground", recording, open_terrain(recording))
    found = []
    for frame in recording.frames[::EVERY]:
        try:
            image, mask = frame.image(), mask_of(frame)
            hidden = None if ignore_of is None else ignore_of(frame)
        except FrameError:
            continue
        shape = image.shape[0] // 4, image.shape[1] // 4
        crowd = crowd_cells(mask, shape)
        known = np.ones(shape, np.bool_) if hidden is None else ~crowd_cells(hidden, shape)
        maps = {
            size: on_cells(detector(resized(image, size) if size != 1 else image, as_it_is=True), shape)
            for size in sorted({scale * size for scale in ENLARGED for size in SIZES})
        }
        for scale in ENLARGED:
            logits = np.stack([cell_logits(maps[scale * size]) for size in SIZES], axis=-1)
            kept = known & (crowd | (rng.random(shape) < EMPTY_KEPT))
            weight = np.where(crowd, 1.0, 1.0 / EMPTY_KEPT)
            found.append((-np.sort(-logits[kept], axis=1), crowd[kept], weight[kept]))
    return found


def on_cells(values: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float32]:
    from PIL import Image

    picture = Image.fromarray(values).resize(shape[::-1], Image.Resampling.BILINEAR)
    return np.asarray(picture).clip(0.0, 1.0)


def fitted_line(cells: list[Cells]) -> NDArray[np.float64]:
    """Weights and bias [4] of least log loss (Newton's method)."""
    logits, crowd, weight = (np.concatenate(parts) for parts in zip(*cells, strict=True))
    features = np.column_stack([logits, np.ones(len(logits))])
    line = np.zeros(4)
    for _ in range(50):
        share = sigmoid(features @ line)
        gradient = features.T @ (weight * (share - crowd))
        curvature = (features * (weight * share * (1.0 - share))[:, None]).T @ features
        step = np.linalg.solve(curvature + 1e-9 * weight.sum() * np.eye(4), gradient)
        line -= step
        if np.abs(step).max() < 1e-8:
            break
    return line


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", type=Path)
    parser.add_argument("missions", type=Path, nargs="+")
    parser.add_argument("--doubt", type=float, default=0.0, help="taken off the bias, in logits")
    given = parser.parse_args()
    paths = sorted(
        path for place in given.missions for path in ([place] if place.is_file() else place.glob("*.mcap"))
    )
    detector, rng = Detector(given.model), np.random.default_rng(0)
    line = fitted_line([one for path in paths for one in cells_of(detector, path, rng)])
    looks = {
        path.stem: np.array([picture_statistics(frame.image()) for frame in open_recording(path).frames[::2]])
        for path in paths
    }
    line[-1] -= given.doubt
    *weights, bias = (round(float(value), 2) for value in line)
    contract = replace(
        detector.contract,
        sizes=PictureSizes(KNOWN_GSD_M, SIZES, tuple(weights), bias),
        pictures=range_of_missions(looks),
    )
    write_with_contract(given.model, contract, given.model)
    print(f"weights {weights}, bias {bias}, pictures within {contract.pictures and contract.pictures.limit}")


if __name__ == "__main__":
    main()
