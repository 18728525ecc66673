"""Tunes method `evidence` on training missions: `python tune.py MISSION.mcap...`; see README.md.

One setting is changed at a time. A setting is judged by the share of the people in range who stand in a zone
with 5 m around it, where the zones close `CLOSED` times the crowds' own ground, and by the best mean IoU over
all thresholds, both averaged over missions. `paper` and `or` are tuned beside it with as many candidates.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from judge import FINE, Judged, judged
from numpy.typing import NDArray
from seen import Mission, seen

from crowdfence.config import EvidenceConfig, MethodConfig, OrConfig, PaperConfig

CLOSED = 1.75
"""Below the 2 that are allowed, so that other missions have some room."""
EVERY = 4
"""Moments between two that zones are looked at in."""
LOG_ODDS = np.arange(-3.0, 6.01, 0.75)
"""Thresholds of `evidence`, above the prior."""
SHIPPED_LOG_ODDS = np.array([0.5, 0.75, 1.0, 1.3, 1.6, 2.0, 2.5])
PAPER_THRESHOLDS = np.geomspace(0.02, 0.5, 13)


START = EvidenceConfig(doubt=0.5)
"""What each setting is changed from."""


def candidates() -> Iterator[MethodConfig]:
    yield START
    for memory_s in (2.5, 10.0, 20.0):
        yield replace(START, memory_s=memory_s)
    for sharp_gsd_m in (0.1, 0.3):
        yield replace(START, sharp_gsd_m=sharp_gsd_m)
    for doubt in (0.2, 1.5):
        yield replace(START, doubt=doubt)
    for agreement in (0.0, 0.25, 1.0):
        yield replace(START, agreement=agreement)
    for sharp_gsd_m, doubt in ((0.3, 0.2), (0.3, 0.1), (0.2, 0.1)):
        yield replace(START, sharp_gsd_m=sharp_gsd_m, doubt=doubt)
    yield PaperConfig()
    for prior in (0.2, 0.015):
        yield PaperConfig(prior=prior)
    for alpha in (0.02, 0.05, 0.3):
        yield PaperConfig(prior=0.2, alpha=alpha)
    for decay in (0.005, 0.02):
        yield PaperConfig(prior=0.2, decay=decay)
    yield PaperConfig(prior=0.2, unseen="visible", normalise=True)
    yield PaperConfig(prior=0.2, unseen="visible", normalise=True, alpha=0.03)
    for b_threshold in (0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95):
        yield OrConfig(b_threshold=b_threshold)


def thresholds(
    method: MethodConfig, mission: Mission, log_odds: NDArray[np.float64] = LOG_ODDS
) -> NDArray[np.float64]:
    if isinstance(method, EvidenceConfig):
        prior = method.with_detector(mission.contract).prior
        assert prior is not None
        return 1.0 / (1.0 + (1.0 - prior) / prior * np.exp(-log_odds))
    return PAPER_THRESHOLDS if isinstance(method, PaperConfig) else np.array([0.5])


def at_closed(one: Judged, closed: float = CLOSED) -> float:
    """Share of people in a zone where `closed` is closed, interpolated; where nothing closes as much, of
    the most."""
    share, blocked = one.curve()
    order = np.argsort(blocked)
    return float(np.interp(closed, blocked[order], share[order]))


def told(method: MethodConfig) -> str:
    default = type(method)()
    changed = {
        name: getattr(method, name)
        for name in type(method).__dataclass_fields__
        if getattr(method, name) != getattr(default, name)
    }
    return " ".join([method.name, *(f"{name}={value}" for name, value in changed.items())])


def print_thresholds(missions: list[Mission]) -> None:
    """People in a zone / closed ground of the shipped settings, one threshold for all missions."""
    print("| |", " | ".join(f"{one:g}" for one in SHIPPED_LOG_ODDS), "|")
    print("|---|" + "---|" * len(SHIPPED_LOG_ODDS))
    curves = []
    for mission in missions:
        shipped = EvidenceConfig()
        asked = thresholds(shipped, mission, SHIPPED_LOG_ODDS)
        curves.append(np.array(judged(mission, shipped, asked, every=EVERY).curve()))
        print(f"| {mission.name} |", _curve(curves[-1]), "|", flush=True)
    print("| mean |", _curve(np.mean(curves, axis=0)), "|")


def _curve(curve: np.ndarray) -> str:
    return " | ".join(f"{share:.3f} / {closed:.2f}" for share, closed in curve.T)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    parser.add_argument("--thresholds", action="store_true", help="Of the shipped settings alone.")
    arguments = parser.parse_args()
    missions = [seen(path) for path in arguments.missions]
    if arguments.thresholds:
        print_thresholds(missions)
        return
    print(
        "| settings | people in a zone | best mean IoU | at threshold | by mission |\n|---|---|---|---|---|"
    )
    for method in candidates():
        results = [judged(one, method, thresholds(method, one), every=EVERY) for one in missions]
        shares = [at_closed(one) for one in results]
        ious = [one.sweep.best()[1].mean for one in results]
        by_mission = ", ".join(f"{share:.3f} / {iou:.3f}" for share, iou in zip(shares, ious, strict=True))
        together = np.mean([np.nanmean(one.sweep.per_frame, axis=0) for one in results], axis=0)
        print(
            f"| {told(method)} | {np.mean(shares):.3f} | {np.mean(ious):.3f} | {FINE[together.argmax()]:.4f} "
            f"| {by_mission} |",
            flush=True,
        )
        for one in results:
            share, blocked = one.curve()
            print("<!--", share.round(3), blocked.round(2), one.empty_people, one.states, "-->", flush=True)


if __name__ == "__main__":
    sys.exit(main())
