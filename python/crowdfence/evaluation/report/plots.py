"""The plots of a report, one file each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.evaluation.safety import BUFFERS_M, Safety
from crowdfence.evaluation.text_table import number
from crowdfence.zones.square_metres import square_metres

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from crowdfence.evaluation.replay import Score

COLOURS = ("#d9480f", "#1d5fa8", "#2b8a3e", "#862e9c", "#868e96", "#e8b90c", "#0b7285", "#5c3c1e")
MISSED = np.linspace(0.0, 0.3, 61)
"""Shares of people, along the curve of what few misses cost."""
MOST_COST = 12.0
"""Where that plot ends: what lies far above the rest would flatten what matters."""

Names = list[str]


def _looks() -> Iterator[dict[str, Any]]:
    """Colours and strokes of line after line; as many as somebody asks for."""
    for stroke in cycle(("-", "--", "-.", ":")):
        yield from ({"color": colour, "linestyle": stroke} for colour in COLOURS)


def draw_iou(axes: Axes, names: Names, scores: list[Score]) -> None:
    for name, row, look in zip(names, scores, _looks(), strict=False):
        axes.plot(row.iou.per_frame, **look, linewidth=1.4, label=f"{name}, mean {number(row.iou.mean, 2)}")
    axes.set(xlabel="instant", ylabel="IoU", ylim=(0.0, None), title="IoU over time")


def draw_reliability(axes: Axes, names: Names, scores: list[Score]) -> None:
    axes.plot([0.0, 1.0], [0.0, 1.0], color="#adb5bd", linewidth=1.0, linestyle=":")
    for name, row, look in zip(names, scores, _looks(), strict=False):
        assert row.quality is not None
        voxels, probability, crowd = row.quality.reliability.T
        some = voxels > 0
        claimed, true = probability[some] / voxels[some], crowd[some] / voxels[some]
        axes.plot(claimed, true, **look, linewidth=1.2, marker="o", markersize=3.5, label=name)
    axes.set(
        xlabel="probability claimed",
        ylabel="share that is so",
        title="Reliability",
        xlim=(0, 1),
        ylim=(0, 1),
    )


def draw_people(axes: Axes, names: Names, scores: list[Score]) -> None:
    for name, row, look in zip(names, scores, _looks(), strict=False):
        assert row.safety is not None
        share, closed = 100.0 * row.safety.share_in_zone, closed_words(row.safety, BUFFERS_M.index(5.0))
        label = f"{name}, closes {closed} at 5 m"
        axes.plot(BUFFERS_M, share, **look, linewidth=1.4, marker="o", markersize=5, label=label)
    axes.set(
        xlabel="metres around a zone",
        ylabel="% of people in a zone",
        title="People of crowds in view",
        xticks=BUFFERS_M,
        ylim=(0, 103),
    )


def closed_words(safety: Safety, at: int) -> str:
    """Ground closed with one of the buffers, as a multiple of the crowds' own; in square metres at a moment
    where none of that was in view, and "-" where nothing was counted."""
    times, area_m2 = float(safety.blocked_per_own[at]), float(safety.closed_m2[at])
    if np.isfinite(times):
        return f"{times:.2f} x"
    return square_metres(area_m2) if np.isfinite(area_m2) else "-"


def draw_cost(axes: Axes, names: Names, scores: list[Score]) -> None:
    for name, row, look in zip(names, scores, _looks(), strict=False):
        assert row.measures is not None
        cost = row.measures.cost.curve(MISSED)
        axes.plot(100.0 * MISSED, cost, **look, linewidth=1.4, label=f"{name}{_not_shown(cost)}")
    axes.axvline(5.0, color="#adb5bd", linewidth=1.0, linestyle=":")
    axes.set(
        xlabel="% of people missed, 5 m buffer",
        ylabel="ground closed for nothing, times the crowds' own",
        title="What few misses cost, over all thresholds",
        xlim=(0, 30),
        ylim=(0.0, MOST_COST),
    )


def _not_shown(cost: NDArray[np.float64]) -> str:
    """What of a curve, which falls, the plot leaves out."""
    if np.isnan(cost).all():
        return f", always misses more than {100.0 * MISSED[-1]:g} %"
    if not (cost > MOST_COST).any():
        return ""
    shown = 100.0 * MISSED[cost <= MOST_COST]
    return f", above {MOST_COST:g} x " + (f"below {shown[0]:g} %" if len(shown) else "throughout")


DRAWN: dict[str, Callable[[Axes, Names, list[Score]], None]] = {
    "people.png": draw_people,
    "cost.png": draw_cost,
    "iou.png": draw_iou,
    "reliability.png": draw_reliability,
}


OF_LAYERS = ("iou.png", "reliability.png")
"""Those of them that are drawn of a layer other than crowds."""


def write_plots(folder: Path, names: Names, scores: list[Score]) -> None:
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # The caller's own matplotlib settings must not change the picture.
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        chosen = DRAWN if scores[0].layer is None else {file: DRAWN[file] for file in OF_LAYERS}
        for file, draw in chosen.items():
            lines = -(-len(names) // 2)  # of the legend, which lies below: beside no curve is room for all
            figure = Figure(figsize=(6.4, 4.2 + 0.17 * lines), layout="constrained")
            FigureCanvasAgg(figure)
            axes = figure.add_subplot()
            draw(axes, names, scores)
            axes.spines[["top", "right"]].set_visible(False)
            axes.grid(color="#e9ecef", linewidth=0.8)
            axes.set_axisbelow(True)
            axes.title.set_fontsize(11)
            figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=8)
            figure.savefig(folder / file, dpi=130)
