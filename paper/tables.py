"""Table 1 and the sensitivity tables, as CSV and Markdown."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from fused import WAYS, Fused
from settings import (
    ALPHAS,
    CHOICES,
    DECAYS,
    EVIDENCE,
    NO_FUSION,
    REPORTED,
    REPORTED_NO_FUSION,
    TABLE,
    Setting,
    table_setting,
)

from crowdfence.config import PaperConfig


class Regime(NamedTuple):
    """Everything fused with the looks of one detector."""

    name: str
    missions: Mapping[str, Mapping[str, Fused]]
    """Mission -> setting -> what it reached."""

    def mean(self, setting: Setting, *, best: bool = False) -> float:
        """Mean IoU, at the method's own threshold or the best of each mission, over missions."""
        return float(np.mean([_mean(fused[setting.name], best=best) for fused in self.missions.values()]))

    @property
    def decays(self) -> list[float]:
        """Those that were fused."""
        (fused, *_) = self.missions.values()
        return [decay for decay in DECAYS if table_setting(ALPHAS[0], decay).name in fused]

    def best_decay(self, alpha: float, *, best: bool = False) -> float:
        """Mean IoU at the decay that is best for `alpha`, as Table 1 is quoted here."""
        return max(self.mean(table_setting(alpha, decay), best=best) for decay in self.decays)

    def at_way(self, setting: Setting, way: int) -> float:
        """Mean IoU of a `paper` at the threshold `WAYS[way]`."""
        swept = []
        for fused in self.missions.values():
            sweep = fused[setting.name].sweep
            first, last = sweep.thresholds[0], sweep.thresholds[-1]
            wanted = first + (last - first) * (WAYS[way] - WAYS[0]) / (WAYS[-1] - WAYS[0])
            swept.append(sweep.at(float(sweep.thresholds[np.abs(sweep.thresholds - wanted).argmin()])).mean)
        return float(np.mean(swept))


def _mean(fused: Fused, *, best: bool) -> float:
    return fused.sweep.best()[1].mean if best else fused.sweep.at(fused.threshold).mean


COLUMNS = (
    "detector",
    "mission",
    "frames",
    "setting",
    "alpha",
    "decay",
    "threshold",
    "mean_iou",
    "std_iou",
    "best_threshold",
    "best_mean_iou",
    "best_std_iou",
    "paper_mean_iou",
)


def write_csv(path: Path, regimes: Iterable[Regime]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for regime in regimes:
            for mission, by_setting in regime.missions.items():
                for setting in (one for one in [*TABLE, EVIDENCE] if one.name in by_setting):
                    writer.writerow([regime.name, mission, *_row(setting, by_setting[setting.name])])


def _row(setting: Setting, fused: Fused) -> list[object]:
    own = fused.sweep.at(fused.threshold)
    best_threshold, best = fused.sweep.best()
    numbers = [fused.threshold, own.mean, own.std, best_threshold, best.mean, best.std]
    alpha = decay = reported = None
    if isinstance(setting.method, PaperConfig):
        alpha, decay = setting.method.alpha, setting.method.decay
        reported = REPORTED[alpha]
    elif setting == NO_FUSION:
        reported = REPORTED_NO_FUSION
    rounded = [round(number, 4) for number in numbers]
    return [len(own.per_frame), setting.name, alpha, decay, *rounded, reported]


def markdown(regimes: list[Regime], settled: str) -> str:
    """`settled`: how the figures were made, one paragraph."""
    lines = ["# Table 1", "", settled, ""]
    for regime in regimes:
        lines += [f"## {regime.name}", "", *_table(regime), "", *_by_mission(regime)]
    lines += ["# What the paper leaves open", ""]
    lines += [
        "One choice changed at a time, from alpha 0.1 and decay 0.0005 on, with the shipped detector: mean",
        "IoU at the default threshold and at the best of each mission. Bold is what Table 1 is made with.",
        "",
    ]
    lines += _sensitivity(regimes[0])
    lines += ["", "## Binarisation threshold", "", *_thresholds(regimes)]
    return "\n".join(lines) + "\n"


def _table(regime: Regime) -> Iterator[str]:
    yield "| | no fusion | " + " | ".join(f"alpha {alpha:g}" for alpha in ALPHAS) + " | best / no fusion |"
    yield "|---|---|" + "---|" * len(ALPHAS) + "---|"
    yield _cells("the paper, best decay of each", REPORTED_NO_FUSION, [REPORTED[alpha] for alpha in ALPHAS])
    for best in (False, True):
        at = "best threshold" if best else "default threshold"
        baseline = regime.mean(NO_FUSION, best=best)
        for decay in regime.decays:
            row = [regime.mean(table_setting(alpha, decay), best=best) for alpha in ALPHAS]
            yield _cells(f"ours, {at}, decay {decay:g}", baseline, row)
    yield ""
    knobs = [fused[NO_FUSION.name].sweep.best()[0] for fused in regime.missions.values()]
    told = ", ".join(f"{knob:g}" for knob in knobs)
    yield (
        "No fusion calls a voxel crowd from a mean heatmap value of 0.5 on, in the rows of the best "
        f"threshold from {told} on, the best b threshold of each mission. `evidence` on the same looks: "
        f"{regime.mean(EVIDENCE):.3f} at its own threshold, {regime.mean(EVIDENCE, best=True):.3f} at the "
        "best."
    )


def _by_mission(regime: Regime, decay: float = 0.0005) -> Iterator[str]:
    """How much depends on the seed; nothing for one mission."""
    if len(regime.missions) < 2:
        return
    columns = [NO_FUSION, *(table_setting(alpha, decay) for alpha in ALPHAS), EVIDENCE]
    yield f"Mission by mission, at the default threshold, decay {decay:g}:"
    yield ""
    alphas = " | ".join(f"alpha {alpha:g}" for alpha in ALPHAS)
    yield f"| | no fusion | {alphas} | evidence | best alpha / no fusion |"
    yield "|---|" + "---|" * (len(columns) + 1)
    rows = np.array(
        [[_mean(fused[one.name], best=False) for one in columns] for fused in regime.missions.values()]
    )
    ratios = rows[:, 1:-1].max(axis=1) / rows[:, 0]
    for name, row, ratio in zip(regime.missions, rows, ratios, strict=True):
        yield f"| {name} | " + " | ".join(f"{value:.3f}" for value in row) + f" | {ratio:.2f} |"
    spread = " | ".join(f"{value:.3f}" for value in rows.std(axis=0, ddof=1))
    yield f"| standard deviation | {spread} | {ratios.std(ddof=1):.2f} |"
    yield ""


def _cells(name: str, baseline: float, row: list[float]) -> str:
    cells = " | ".join(f"{value:.3f}" for value in row)
    return f"| {name} | {baseline:.3f} | {cells} | {max(row) / baseline:.2f} |"


def _sensitivity(regime: Regime) -> Iterator[str]:
    yield "| question | answer | at the default threshold | at the best threshold |"
    yield "|---|---|---|---|"
    for question, answer, setting, ours in CHOICES:
        told = f"**{answer}**" if ours else answer
        yield f"| {question} | {told} | {regime.mean(setting):.3f} | {regime.mean(setting, best=True):.3f} |"


def _thresholds(regimes: list[Regime]) -> Iterator[str]:
    yield (
        "Mean IoU by how far the threshold lies from P(A | 0), what a place reaches that all drones see "
        "empty, to P(A | 1), what one reaches that all are sure of; decay 0.0005. The default of a fleet of "
        "three lies 1 / 12 of the way."
    )
    yield ""
    shown = [int(np.abs(WAYS - way).argmin()) for way in (0.002, 0.02, 0.05, 0.08, 0.15, 0.25, 0.5, 1.0)]
    yield "| | " + " | ".join(f"{WAYS[way]:.3f}" for way in shown) + " |"
    yield "|---|" + "---|" * len(shown)
    for regime in regimes:
        for alpha in ALPHAS:
            setting = table_setting(alpha, 0.0005)
            cells = " | ".join(f"{regime.at_way(setting, way):.3f}" for way in shown)
            yield f"| {regime.name}, alpha {alpha:g} | {cells} |"
