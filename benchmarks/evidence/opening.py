"""When ground that is closed may be opened: `python opening.py MISSION.mcap...`; see README.md.

Every rule closes a column from some log odds above the prior on, and opens it at a look that finds it below
others, perhaps only at the second such look in a row. Forgetting opens nothing.
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
from crowdfence.config import EvidenceConfig
from crowdfence.evaluation.safety import BUFFERS_M, Cells, CrowdsInView, areas_m2, distance_m
from crowdfence.zones.tracker import column_keys, column_places

EVERY = 4
"""Of the moments that say who stands where, one in so many is counted."""
AT = BUFFERS_M.index(5.0)


class Rule(NamedTuple):
    closes: float
    """Log odds above the prior."""
    opens: float
    looks: int = 1
    """In a row that must find it below `opens`."""


RULES = (
    *(Rule(closes, closes) for closes in (0.7, 1.0, 1.3, 1.6)),
    *(Rule(closes, opens) for closes in (1.3, 2.0) for opens in (0.0, -0.5, -1.0, -2.5)),
    *(Rule(closes, opens, 2) for closes, opens in ((1.3, 1.3), (1.3, 0.0), (1.6, 1.6))),
)


class Ground:
    """Columns that a rule holds closed."""

    def __init__(self, rule: Rule, columns: int) -> None:
        self.rule = rule
        self.closed = np.zeros(columns, np.bool_)
        self._below = np.zeros(columns, np.int64)

    def step(self, above: NDArray[np.float64], looked: NDArray[np.bool_]) -> None:
        """`above` the prior, in log odds, per column; `looked` at this instant."""
        below = above < self.rule.opens
        self._below = np.where(looked, np.where(below, self._below + 1, 0), self._below)
        self.closed &= ~(looked & (self._below >= self.rule.looks))
        self.closed |= above >= self.rule.closes


def shares(mission: Mission) -> NDArray[np.float64]:
    """[rules, 3] people in view in a zone, people in range in one, closed ground per crowds' own."""
    config = cf.RunConfig(EvidenceConfig()).with_detector(mission.contract)
    crowd_map = config.crowd_map(mission.terrain, mission.drones)
    prior = crowd_map.method.parameters["prior"]
    seen_ids = np.unique(
        np.concatenate([one.voxel_ids for now in mission.moments for one in now.observations])
    )
    voxel_keys = column_keys(mission.terrain.voxel_indices(seen_ids)[:, :2])
    keys, column_of_seen = np.unique(voxel_keys, return_inverse=True)
    column = np.empty(mission.terrain.voxel_count, np.int64)
    column[seen_ids] = column_of_seen
    place = column_places(keys)
    grounds = [Ground(rule, len(keys)) for rule in RULES]
    counts = np.zeros((len(RULES), 6))
    watched = [moment.stamp_ns for moment in mission.moments if moment.in_view is not None][::EVERY]
    for moment in mission.moments:
        crowd_map.integrate_observations(moment.observations, moment.stamp_ns)
        ids, probability = crowd_map.seen_probability(moment.stamp_ns)
        odds = np.log(probability / (1.0 - probability)) - np.log(prior / (1.0 - prior))
        above = np.full(len(keys), -np.inf)
        np.maximum.at(above, column[ids], odds)
        looked = np.zeros(len(keys), np.bool_)
        for observation in moment.observations:
            looked[column[observation.voxel_ids]] = True
        for ground in grounds:
            ground.step(above, looked)
        if moment.in_view is not None and moment.stamp_ns in watched:
            zones = [place[ground.closed] for ground in grounds]
            counts += _counted(moment.in_view, zones, mission.terrain.voxel_size_m)
    people, in_range, in_zone, in_zone_in_range, closed_m2, own_m2 = counts.T
    return np.stack([in_zone / people, in_zone_in_range / in_range, closed_m2 / own_m2], axis=1)


def _counted(crowds: CrowdsInView, zones: list[Cells], size_m: float) -> NDArray[np.float64]:
    """[Z, 6] people of crowds in view and in range, those of both in each zone, what it closes, and the
    crowds' own ground."""
    own_m2 = areas_m2(crowds.ground, size_m)[AT]
    rows = []
    for zone in zones:
        inside = distance_m(crowds.people, zone, size_m) <= BUFFERS_M[AT]
        people = len(inside), np.count_nonzero(crowds.in_range)
        rows.append(
            (*people, inside.sum(), inside[crowds.in_range].sum(), areas_m2(zone, size_m)[AT], own_m2)
        )
    return np.array(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    found = {}
    for path in parser.parse_args().missions:
        mission = seen(path)
        found[mission.name] = shares(mission)
        print(mission.name, np.round(found[mission.name], 3).tolist(), flush=True, file=sys.stderr)
    names = " | ".join(found)
    print(f"| closes | opens | looks | in a zone | of those in range | closed / own | {names} |")
    print("|" + "---|" * (6 + len(found)))
    every = np.array(list(found.values()))
    for number, rule in enumerate(RULES):
        mean = " | ".join(f"{value:.3f}" for value in every[:, number].mean(axis=0))
        each = " | ".join(f"{row[number, 1]:.3f} at {row[number, 2]:.2f}" for row in found.values())
        print(f"| {rule.closes:+.1f} | {rule.opens:+.1f} | {rule.looks} | {mean} | {each} |")


if __name__ == "__main__":
    main()
