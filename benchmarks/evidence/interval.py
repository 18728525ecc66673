"""How often the intervals of method `evidence` hold: `python interval.py MISSION.mcap...`; see README.md.

Voxels of a mission are put into bins of alike ones: half a unit of log odds, and a factor of two in the looks
that are remembered. A bin is covered where the share of its voxels that crowds stand on lies between the mean
bounds; where there is no crowd at all, also where the lower bound expects at most three such voxels.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from seen import Mission, seen

import crowdfence as cf

LEVELS = (0.5, 0.8, 0.9, 0.99)
EVERY = 5
"""Instants between two that are looked at."""
LEAST_VOXELS = 300
_LOG_ODDS = np.arange(-16.0, 8.01, 0.5)
_LOOKS = np.array([0.1, 0.2, 0.5, 1.0, 2.0, 4.0, 8.0])


class Coverage(NamedTuple):
    """Shares of the bins of one mission at one level."""

    bins: int
    covered: float
    above: float
    """More crowd than the interval allows."""
    below: float
    crowd_above: float
    """Share of the voxels with crowd that lie in bins with more than that."""


def coverages(mission: Mission) -> dict[float, Coverage]:
    config = cf.RunConfig(cf.EvidenceConfig()).with_detector(mission.contract)
    crowd_map = config.crowd_map(mission.terrain, mission.drones)
    columns = 2 + 2 * len(LEVELS)
    sums = np.zeros(((len(_LOG_ODDS) + 1) * (len(_LOOKS) + 1), columns))
    for number, moment in enumerate(mission.moments, start=1):
        crowd_map.integrate_observations(moment.observations, moment.stamp_ns)
        if number % EVERY == 0:
            sums += _binned(crowd_map, moment.stamp_ns, moment.crowd_ids)
    sums = sums[sums[:, 0] >= LEAST_VOXELS]
    count, crowd = sums[:, 0], sums[:, 1]
    return {
        level: _coverage(count, crowd, sums[:, 2 + 2 * at], sums[:, 3 + 2 * at])
        for at, level in enumerate(LEVELS)
    }


def _binned(crowd_map: cf.CrowdMap, stamp_ns: int, crowd_ids: NDArray[np.int64]) -> NDArray[np.float64]:
    """[bins, 2 + 2 levels]: voxels, crowd, and sums of the bounds at each level."""
    ids, probability = crowd_map.seen_probability(stamp_ns)
    looks = crowd_map.knowledge(ids, stamp_ns).looks
    odds = np.digitize(np.log(probability / (1.0 - probability)), _LOG_ODDS)
    bins = odds * (len(_LOOKS) + 1) + np.digitize(looks, _LOOKS)
    crowd = np.isin(ids, crowd_ids, assume_unique=True)
    weights: list[NDArray[np.float64] | None] = [None, crowd.astype(np.float64)]
    for level in LEVELS:
        bounds = crowd_map.interval(stamp_ns, ids, level=level)
        assert bounds is not None
        weights += [bounds[:, 0], bounds[:, 1]]
    size = (len(_LOG_ODDS) + 1) * (len(_LOOKS) + 1)
    return np.stack([np.bincount(bins, weight, minlength=size) for weight in weights], axis=1)


def _coverage(
    count: NDArray[np.float64],
    crowd: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> Coverage:
    """`low` and `high` are the sums of the bounds: how much crowd they expect."""
    above = crowd > high
    below = (crowd < low) & ~((crowd == 0) & (low <= 3.0))
    return Coverage(
        len(count),
        float(1.0 - (above | below).mean()),
        float(above.mean()),
        float(below.mean()),
        float(crowd[above].sum() / crowd.sum()),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    print("| mission | level | bins | covered | more crowd | less crowd | crowd above |")
    print("|---|---|---|---|---|---|---|")
    found: dict[float, list[Coverage]] = {level: [] for level in LEVELS}
    for path in parser.parse_args().missions:
        mission = seen(path)
        for level, one in coverages(mission).items():
            found[level].append(one)
            print(f"| {mission.name} | {level:g} |", _cells(one), "|", flush=True)
    for level, ones in found.items():
        mean = Coverage(*np.mean(ones, axis=0))
        print(f"| **mean of {len(ones)}** | {level:g} |", _cells(mean), "|")


def _cells(one: Coverage) -> str:
    return " | ".join([f"{one.bins:.0f}", *(f"{share:.3f}" for share in one[1:])])


if __name__ == "__main__":
    sys.exit(main())
