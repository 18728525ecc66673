"""Other likelihood tables than the detector's own: `python refit.py TRAINING_MISSION.mcap...`; see README.md.

A table is counted anew from the looks of all missions but the one that it is tried on, by metres per pixel
and tilt, few looks leaning on what all have in common. Beside it the detector's own table with everything
that speaks for crowd made twice as strong.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from judge import judged
from numpy.typing import NDArray
from seen import Mission, seen
from tune import at_closed, thresholds

import crowdfence as cf
from crowdfence.config import EvidenceConfig

GSD_M = np.array([0.06, 0.1, 0.15, 0.2, 0.3, 0.45])
TILT_DEG = np.array([12.0, 25.0, 45.0])
MEAN = np.array([0.005, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98])
LEANING = 3000.0
"""Looks that what all have in common counts as."""
LOG_ODDS = np.array([0.75, 1.0, 1.3, 1.6, 2.0])
EVERY = 6

Table = NDArray[np.float64]


def counted(mission: Mission) -> Table:
    """Looks [2, G, T, M] at ground without and with crowd, by metres per pixel, tilt and mean value."""
    counts = np.zeros((2, len(GSD_M) + 1, len(TILT_DEG) + 1, len(MEAN) + 1))
    for moment in mission.moments:
        for look in moment.observations:
            crowd = np.isin(look.voxel_ids, moment.crowd_ids, assume_unique=True).astype(int)
            gsd = np.searchsorted(GSD_M, look.range_m / look.focal_px)
            place = (crowd, gsd, np.searchsorted(TILT_DEG, look.tilt_deg))
            np.add.at(counts, (*place, np.searchsorted(MEAN, look.mean, side="right")), 1)
    return counts


def table(counts: Table) -> cf.LikelihoodRatio:
    """Log likelihood ratios that rise with the mean value."""
    common = counts.sum(axis=(1, 2)) + 1.0
    common /= common.sum(axis=1, keepdims=True)
    leant = counts + LEANING * common[:, None, None, :]
    empty, crowd = leant / leant.sum(axis=3, keepdims=True)
    weight = counts[1] + 0.02 * counts[0] + 1.0
    ratio = np.log(crowd / empty)
    for place in np.ndindex(ratio.shape[:2]):
        ratio[place] = _rising(ratio[place], weight[place])
    return cf.LikelihoodRatio(GSD_M, TILT_DEG, MEAN, ratio)


def _rising(values: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.optimize import isotonic_regression

    return np.asarray(isotonic_regression(values, weights=weights).x)


def twice_for_crowd(own: cf.LikelihoodRatio) -> cf.LikelihoodRatio:
    ratio = np.asarray(own.log_ratio)
    stronger = np.clip(np.where(ratio > 0.0, 2.0 * ratio, ratio), -19.0, 19.0)
    return cf.LikelihoodRatio(own.gsd_m, own.tilt_deg, own.mean, stronger)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    missions = [seen(path) for path in parser.parse_args().missions]
    counts = {mission.name: counted(mission) for mission in missions}

    def without(mission: Mission) -> cf.LikelihoodRatio:
        return table(sum(one for name, one in counts.items() if name != mission.name))

    def own(mission: Mission) -> cf.LikelihoodRatio:
        found = EvidenceConfig().with_detector(mission.contract).likelihood
        assert found is not None
        return found

    variants: dict[str, Callable[[Mission], cf.LikelihoodRatio]] = {
        "the detector's": own,
        "counted anew": without,
        "twice as strong for crowd": lambda mission: twice_for_crowd(own(mission)),
    }
    print("| table | in a zone at 1.75 x | best mIoU |", " | ".join(f"{one:g}" for one in LOG_ODDS), "|")
    print("|---|---|---|" + "---|" * len(LOG_ODDS))
    for name, likelihood in variants.items():
        print(f"| {name} |", _row(missions, likelihood), "|", flush=True)


def _row(missions: list[Mission], likelihood: Callable[[Mission], cf.LikelihoodRatio]) -> str:
    """Means over missions; at one threshold for all, people in a zone / closed ground."""
    results = []
    for mission in missions:
        method = replace(EvidenceConfig(), likelihood=likelihood(mission))
        results.append(judged(mission, method, thresholds(method, mission, LOG_ODDS), every=EVERY))
    share = np.mean([at_closed(one) for one in results])
    iou = np.mean([one.sweep.best()[1].mean for one in results])
    curve = np.mean([one.curve() for one in results], axis=0)
    return " | ".join([f"{share:.3f}", f"{iou:.3f}", *(f"{a:.3f} / {b:.2f}" for a, b in curve.T)])


if __name__ == "__main__":
    sys.exit(main())
