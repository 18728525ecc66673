"""What blurring heatmaps by the error of a pose gives: `python pose_blur.py MISSION.mcap...`; see README.md.

The pose of each picture is off (`trouble.py`), which no smoothing of its track can tell. Its heatmap is
blurred before it is projected, by its values or by the odds that they stand for: crowd where it may be, and
nobody only where surely nobody is.
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
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from trouble import flown, noisy_pictures
from tuned import TUNED

import crowdfence as cf

CELLS = (0.75, 1.5)
"""Of a heatmap: .45 and .9 degrees in the middle of the picture."""
FAR = (0.5, 1.0)
Blur = Callable[[NDArray[np.float32], float], NDArray[np.float32]]


def of_values(heatmap: NDArray[np.float32], cells: float) -> NDArray[np.float32]:
    return np.clip(gaussian_filter(heatmap, cells, mode="nearest"), 0.0, 1.0)


def of_odds(heatmap: NDArray[np.float32], cells: float) -> NDArray[np.float32]:
    within = np.clip(heatmap, 0.003, 0.985)
    odds = gaussian_filter(within / (1.0 - within), cells, mode="nearest")
    return odds / (1.0 + odds)


def blurred(recording: cf.Recording, blur: Blur, cells: float) -> cf.Recording:
    def one(frame: cf.sources.Frame) -> cf.sources.Frame:
        made = lambda: blur(np.asarray(frame.heatmap(), np.float32), cells)  # noqa: E731
        return replace(frame, pixels=replace(frame.pixels, heatmap=made))

    return replace(recording, frames=tuple(map(one, recording.frames)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    parser.add_argument("--every", type=int, default=3, help="Count the IoU at every so many instants.")
    arguments = parser.parse_args()
    changes = {"as it is": lambda recording: recording}
    for name, blur in (("values", of_values), ("odds", of_odds)):
        changes |= {f"{name}, {cells:g} cells": partial(blurred, blur=blur, cells=cells) for cells in CELLS}
    print(f"model {model_sha()}\n\n| mission | blur | mIoU | best | in a zone at .5 | at 1 |")
    print("|---|---|---|---|---|---|")
    evidence = TUNED[0]
    for path in arguments.missions:
        recording = with_heatmaps(path)
        terrain = cf.open_terrain(recording)
        off = noisy_pictures(recording)
        for name, change in changes.items():
            contender = Contender(evidence.name, evidence.method)
            (curve,) = curves(flown(change(off), terrain), [contender], every=arguments.every)
            print(f"| {path.stem} | {name} |", _cells(curve, evidence.iou_threshold), "|", flush=True)


def _cells(curve: Curve, threshold: float) -> str:
    at = float(FINE[np.argmin(np.abs(FINE - threshold))])
    far = np.sort(curve.far)[::-1]
    people = [np.mean(curve.people > far[min(int(share * curve.own), len(far) - 1)]) for share in FAR]
    figures = curve.sweep.at(at).mean, curve.sweep.best()[1].mean, *people
    return " | ".join(f"{figure:.3f}" for figure in figures)


if __name__ == "__main__":
    sys.exit(main())
