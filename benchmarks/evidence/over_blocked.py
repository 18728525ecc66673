"""What few misses cost, and mean IoU, of all methods on missions that nothing was tuned to:
`python over_blocked.py MISSION.mcap...`; see README.md.

Parameters and the threshold of the IoU are those of `tuned.py`.
Over-blocked is the ground closed for nothing, times the crowds' own, at the threshold that misses 5 or 1 % of
the people in range on this very mission: what the method can do, not what one threshold for all does.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from curves import Contender, Curve, curves
from heatmaps import model_sha
from judge import FINE
from seen import seen
from tuned import POOLS, TUNED

MISSED = (0.05, 0.01)


class Row(NamedTuple):
    iou: float
    best_iou: float
    at_5: float
    at_1: float


CONTENDERS = (*TUNED, *POOLS)
COLUMNS = ("mIoU", "best mIoU", "over-blocked at 5 %", "at 1 %")


def row(curve: Curve, threshold: float) -> Row:
    at = float(FINE[np.argmin(np.abs(FINE - threshold))])
    return Row(
        curve.sweep.at(at).mean, curve.sweep.best()[1].mean, *(curve.over_blocked(one) for one in MISSED)
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    parser.add_argument("--every", type=int, default=1, help="Count the IoU at every so many instants.")
    arguments = parser.parse_args()
    print(f"model {model_sha()}\n\n| mission | method |", " | ".join(COLUMNS), "|")
    print("|---|---|" + "---|" * len(COLUMNS))
    rows: dict[str, list[Row]] = {one.name: [] for one in CONTENDERS}
    for path in arguments.missions:
        mission = seen(path)
        found = curves(
            mission, [Contender(one.name, one.method) for one in CONTENDERS], every=arguments.every
        )
        for one, curve in zip(CONTENDERS, found, strict=True):
            rows[one.name].append(row(curve, one.iou_threshold))
            print(f"| {mission.name} | {one.name} |", _cells(rows[one.name][-1]), "|", flush=True)
    for name, own in rows.items():
        spread = [f"{np.nanmean(some):.3f} ± {np.nanstd(some):.3f}" for some in zip(*own, strict=True)]
        print(f"| **mean of {len(own)}** | **{name}** |", " | ".join(spread), "|")
    first = np.array(rows[CONTENDERS[0].name])
    print(f"\n| {CONTENDERS[0].name} against | mIoU | won | best mIoU | over-blocked at 5 %, ratio |")
    print("|---|---|---|---|---|")
    for name, own in list(rows.items())[1:]:
        apart = first - np.array(own)
        ratio = np.nanmean(first[:, 2]) / np.nanmean(np.array(own)[:, 2])
        difference = [f"{apart[:, at].mean():+.3f} ± {apart[:, at].std():.3f}" for at in (0, 1)]
        won = f"{np.count_nonzero(apart[:, 0] > 0.0)} of {len(apart)}"
        print(f"| {name} | {difference[0]} | {won} | {difference[1]} | {ratio:.2f} |")


def _cells(one: Row) -> str:
    return " | ".join(f"{value:.3f}" for value in one)


if __name__ == "__main__":
    sys.exit(main())
