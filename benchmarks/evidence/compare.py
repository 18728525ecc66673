"""The methods on missions that nothing was tuned to: `python compare.py MISSION.mcap...`; see README.md.

What each of them is told stands in `tuned.py`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from judge import FINE, Judged, judged
from seen import Mission, seen
from tuned import PUBLISHED, TUNED, Tuned

from crowdfence.evaluation.safety import BUFFERS_M
from crowdfence.voxel_state import VoxelState

CONTENDERS = (TUNED[0], PUBLISHED, *TUNED[1:])
AT = BUFFERS_M.index(5.0)


class Row(NamedTuple):
    in_zone: float
    in_range: float
    closed: float
    on_empty: float
    empty_ground: float
    iou: float
    best_iou: float
    ece: float


COLUMNS = (
    "in a zone",
    "of those in range",
    "closed / own",
    "on empty",
    "ground empty",
    "mIoU",
    "best mIoU",
    "ECE",
)


def row(mission: Mission, contender: Tuned) -> Row:
    own = contender.method.with_detector(mission.contract).fusion_method(mission.terrain, mission.drones)
    threshold = own.default_threshold if contender.zone_threshold is None else contender.zone_threshold
    result = judged(mission, contender.method, np.array([threshold]), every=2)
    (safety,) = result.safety
    at = int(np.argmin(np.abs(FINE - contender.iou_threshold)))
    return Row(
        float(safety.share_in_zone[AT]),
        float(safety.share_in_zone_in_range[AT]),
        float(safety.blocked_per_own[AT]),
        result.empty_people / max(safety.people, 1),
        _share_empty(result),
        result.sweep.at(float(FINE[at])).mean,
        result.sweep.best()[1].mean,
        result.ece,
    )


def _share_empty(result: Judged) -> float:
    """Of the voxels that were seen, at the end."""
    seen_states = [state for state in VoxelState if state not in (VoxelState.NEVER_SEEN, VoxelState.OCCLUDED)]
    return float(result.states[VoxelState.EMPTY] / result.states[seen_states].sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    parser.add_argument("--only", help="Name of the one method to look at.")
    arguments = parser.parse_args()
    contenders = [one for one in CONTENDERS if arguments.only in (None, one.name)]
    rows: dict[str, list[Row]] = {contender.name: [] for contender in contenders}
    print("| mission | method |", " | ".join(COLUMNS), "|")
    print("|---|---|" + "---|" * len(COLUMNS))
    for path in arguments.missions:
        mission = seen(path)
        for contender in contenders:
            rows[contender.name].append(row(mission, contender))
            print(f"| {mission.name} | {contender.name} |", _cells(rows[contender.name][-1]), "|", flush=True)
    for name, own in rows.items():
        print(f"| **mean of {len(own)}** | **{name}** |", _cells(Row(*np.nanmean(own, axis=0))), "|")


def _cells(one: Row) -> str:
    return " | ".join(f"{value:.3f}" for value in one)


if __name__ == "__main__":
    sys.exit(main())
