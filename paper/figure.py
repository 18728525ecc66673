"""Fig. 3: IoU over time, and Table 1 as bars beside the paper's."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from fused import Fused
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from settings import ALPHAS, EVIDENCE, NO_FUSION, REPORTED, REPORTED_NO_FUSION, Setting, table_setting
from tables import Regime

INK, FAINT = "#1f2933", "#9aa5b1"
SHADES = ("#0b2545", "#1d5fa8", "#3aa0c8", "#6cc5b5", "#b5d99c")
"""alpha .1 to 1: the darker, the longer the memory."""
OURS, BASELINE = "#d9480f", "#868e96"


def write_figure(path: Path, regimes: list[Regime]) -> None:
    figure = Figure(figsize=(13.0, 3.9 * len(regimes)), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(len(regimes), 2, width_ratios=(2.6, 1.0))
    for row, regime in enumerate(regimes):
        _over_time(figure.add_subplot(grid[row, 0]), regime, legend=row == 0)
        _bars(figure.add_subplot(grid[row, 1]), regime, legend=row == 0)
    figure.savefig(path, dpi=110)


def _over_time(axes: Axes, regime: Regime, *, legend: bool) -> None:
    mission, by_setting = next(iter(regime.missions.items()))
    for alpha, shade in zip(ALPHAS, SHADES, strict=True):
        best = max(regime.decays, key=lambda decay: _mean(by_setting[table_setting(alpha, decay).name]))
        _line(axes, by_setting, table_setting(alpha, best), f"alpha {alpha:g}", color=shade)
    _line(axes, by_setting, NO_FUSION, "no fusion", color=BASELINE, linewidth=1.6)
    _line(
        axes, by_setting, NO_FUSION, "no fusion, best b threshold", best=True, color=BASELINE, linestyle=":"
    )
    _line(axes, by_setting, EVIDENCE, "evidence", color=OURS)
    axes.set(xlabel="seconds of flight", ylabel="IoU", ylim=(0.0, None))
    axes.set_xlim(0.0, None)
    axes.set_title(f"{mission}: {regime.name}", loc="left", color=INK, fontsize=11, fontweight="bold")
    _plain(axes)
    if legend:
        axes.legend(
            ncols=8, frameon=False, fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.06), columnspacing=1
        )


def _line(
    axes: Axes,
    by_setting: Mapping[str, Fused],
    setting: Setting,
    label: str,
    *,
    best: bool = False,
    **look: Any,
) -> None:
    fused = by_setting[setting.name]
    iou = fused.sweep.best()[1] if best else fused.sweep.at(fused.threshold)
    seconds = (fused.stamps_ns - fused.stamps_ns[0]) / 1e9
    axes.plot(seconds, iou.per_frame, **{"linewidth": 1.1, "label": label, **look})


def _mean(fused: Fused) -> float:
    return fused.sweep.at(fused.threshold).mean


def _bars(axes: Axes, regime: Regime, *, legend: bool) -> None:
    names = ["no\nfusion", *(f"{alpha:g}" for alpha in ALPHAS)]
    places = np.arange(len(names))
    reported = [REPORTED_NO_FUSION, *(REPORTED[alpha] for alpha in ALPHAS)]
    ours = [regime.mean(NO_FUSION), *(regime.best_decay(alpha) for alpha in ALPHAS)]
    seeds = len(regime.missions)
    for shift, values, colour, label in (
        (-0.2, reported, FAINT, "the paper"),
        (0.2, ours, SHADES[1], f"here, {seeds} missions" if seeds > 1 else "here"),
    ):
        bars = axes.bar(places + shift, values, 0.38, color=colour, label=label)
        axes.bar_label(bars, fmt="%.2f", fontsize=7, color=INK, padding=1)
    axes.set_xticks(places, names)
    axes.set(xlabel="alpha, at its best decay", ylabel="mean IoU", ylim=(0.0, 1.25 * max(*ours, *reported)))
    axes.set_title("Table 1", loc="left", color=INK, fontsize=11, fontweight="bold")
    _plain(axes)
    if legend:
        axes.legend(frameon=False, fontsize=8.5)


def _plain(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="#e4e7eb", linewidth=0.8)
    axes.set_axisbelow(True)
