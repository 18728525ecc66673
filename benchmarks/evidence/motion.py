"""What motion prediction gives: `python motion.py MISSION.mcap...`; see README.md.

`evidence` again on the columns of a map, with all that its looks left there moving between two instants: it
spreads with time, or it drifts with the crowd. The drift is the true one, of the people themselves, and
bounds what any drift that is estimated from looks could give. Zones are those of the moment.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from heatmaps import model_sha
from judge import FINE
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree
from seen import Mission, Moment, seen

import crowdfence as cf
from crowdfence.config import EvidenceConfig
from crowdfence.evaluation.closing_cost import BUFFER_M
from crowdfence.evaluation.threshold_sweep import ThresholdSweep

NEAR_M = 4.0
"""Ground so near to somebody who walks in a crowd drifts with those."""
FAR = 1.0
"""People are counted where so much ground is closed farther than 5 m from any crowd, per crowds' own."""
DRONES = 3


@dataclass(frozen=True, slots=True)
class Motion:
    name: str
    memory_s: float = 5.0
    spread_m: float = 0.0
    """Standard deviation after a second."""
    drifts: bool = False


MOTIONS = (
    Motion("as it is"),
    Motion("memory 2.5 s", memory_s=2.5),
    Motion("memory 10 s", memory_s=10.0),
    Motion("spread by .25 m after a second", spread_m=0.25),
    Motion("spread by .5 m after a second", spread_m=0.5),
    Motion("spread by 1 m after a second", spread_m=1.0),
    Motion("drift as the people do", drifts=True),
    Motion("drift, memory 10 s", memory_s=10.0, drifts=True),
    Motion("drift and spread by .25 m", spread_m=0.25, drifts=True),
)


class Columns:
    """A map from above: of each column the voxel that was seen most often."""

    def __init__(self, mission: Mission) -> None:
        looks = np.zeros(mission.terrain.voxel_count, np.int64)
        for moment in mission.moments:
            for one in moment.observations:
                looks[one.voxel_ids] += 1
        ids = np.flatnonzero(looks)
        ids = ids[np.argsort(-looks[ids], kind="stable")]
        places = mission.terrain.voxel_indices(ids)[:, :2].astype(np.int64)
        self.lowest = places.min(axis=0)
        self.shape = tuple((places.max(axis=0) - self.lowest + 1).tolist())
        flat = np.ravel_multi_index((places - self.lowest).T, self.shape)
        column, first = np.unique(flat, return_index=True)
        self.of_voxel = np.full(mission.terrain.voxel_count, -1, np.int64)
        self.of_voxel[ids[first]] = column
        self.size_m = mission.terrain.voxel_size_m
        self.origin = np.asarray(mission.terrain.origin)[:2] + self.lowest * self.size_m


class Sums(NamedTuple):
    """[X, Y] and [DRONES, X, Y]: E and W_d of `evidence`, and which columns were seen."""

    evidence: NDArray[np.float32]
    weights: NDArray[np.float32]
    seen: NDArray[np.bool_]

    @staticmethod
    def none(shape: tuple[int, ...]) -> Sums:
        zeros = np.zeros((1 + DRONES, *shape), np.float32)
        return Sums(zeros[0], zeros[1:], np.zeros(shape, np.bool_))

    def later(self, seconds: float, motion: Motion, velocity: NDArray[np.float64], size_m: float) -> Sums:
        """`velocity` [2, X, Y], m/s, is that at the end."""
        fading = np.float32(np.exp(-seconds / motion.memory_s))
        layers = [fading * self.evidence, *(fading * self.weights)]
        if motion.drifts:
            moving = velocity.any(axis=0)
            source = np.argwhere(moving).T - velocity[:, moving] * seconds / size_m
            for layer in layers:
                layer[moving] = map_coordinates(layer, source, order=1)
        if motion.spread_m:
            sigma = motion.spread_m * np.sqrt(seconds) / size_m
            layers = [gaussian_filter(layer, sigma, truncate=3.0) for layer in layers]
        return Sums(layers[0], np.stack(layers[1:]), self.seen)

    def looked(self, looks: list[Look]) -> None:
        for look in looks:
            self.evidence.flat[look.column] += look.weight * look.log_ratio
            self.weights[look.drone].flat[look.column] += look.weight
            self.seen.flat[look.column] = True

    def probability(self, settings: EvidenceConfig) -> NDArray[np.float64]:
        """[X, Y], 0 where nobody has looked."""
        assert settings.prior is not None
        weight = self.weights.sum(axis=0, dtype=np.float64)
        drones = weight**2 / np.maximum(np.square(self.weights, dtype=np.float64).sum(axis=0), 1e-30)
        mean = self.evidence / (weight + settings.doubt)
        log_odds = np.log(settings.prior / (1.0 - settings.prior)) + mean * drones**settings.agreement
        return np.where(self.seen, 1.0 / (1.0 + np.exp(-np.clip(log_odds, -16.0, 8.0))), 0.0)


class Look(NamedTuple):
    drone: int
    column: NDArray[np.int64]
    weight: NDArray[np.float32]
    log_ratio: NDArray[np.float32]


def look(one: cf.Observation, drone: int, columns: Columns, settings: EvidenceConfig) -> Look:
    assert settings.likelihood is not None
    column = columns.of_voxel[one.voxel_ids]
    here = column >= 0
    gsd_m = (np.asarray(one.range_m)[here] / one.focal_px).astype(np.float32)
    table = settings.likelihood
    bins = (
        np.searchsorted(table.gsd_m, gsd_m, side="right"),
        np.searchsorted(table.tilt_deg, np.asarray(one.tilt_deg)[here], side="right"),
        np.searchsorted(table.mean, np.asarray(one.mean, np.float32)[here], side="left"),
    )
    weight = np.minimum(1.0, (settings.sharp_gsd_m / gsd_m) ** 2).astype(np.float32)
    return Look(drone % DRONES, column[here], weight, table.log_ratio[bins])


def velocities(recording: cf.Recording, columns: Columns, stamp_ns: int) -> NDArray[np.float64]:
    """[2, X, Y] m/s of the nearest of those who are in crowds, 0 where none is near."""
    field = np.zeros((2, *columns.shape))
    before, after = (recording.people_truth(stamp_ns + step_ns, max_gap_s=0.5) for step_ns in (-(10**9), 0))
    if before is None or after is None or before.stamp_ns == after.stamp_ns:
        return field
    _, at, earlier = np.intersect1d(after.person, before.person, return_indices=True)
    in_crowd = after.crowd[at] > 0
    at, earlier = at[in_crowd], earlier[in_crowd]
    if not len(at):
        return field
    seconds = (after.stamp_ns - before.stamp_ns) / 1e9
    walked = (after.position[at, :2] - before.position[earlier, :2]) / seconds
    centres = (
        np.indices(columns.shape).reshape(2, -1).T * columns.size_m + columns.origin + columns.size_m / 2
    )
    away, nearest = cKDTree(after.position[at, :2]).query(centres, k=5, distance_upper_bound=NEAR_M)
    near = np.isfinite(away[:, 0])
    there = np.minimum(nearest[near], len(at) - 1)
    counts = np.isfinite(away[near])[..., None]
    field.reshape(2, -1)[:, near] = ((walked[there] * counts).sum(axis=1) / counts.sum(axis=1)).T
    return field


class Ground:
    """Who stands where at one moment, on the columns `seen` [X, Y] so far."""

    def __init__(self, columns: Columns, moment: Moment, seen: NDArray[np.bool_]) -> None:
        crowd = np.zeros(columns.shape, np.bool_)
        ids = columns.of_voxel[moment.crowd_ids]
        crowd.flat[ids[ids >= 0]] = True
        self.seen, self.crowd = seen, crowd[seen]
        assert moment.in_view is not None
        places, buffer = np.argwhere(seen), BUFFER_M / columns.size_m
        own = moment.in_view.ground - columns.lowest
        away, _ = cKDTree(own).query(places, distance_upper_bound=buffer)
        self.far, self.own = np.isinf(away), len(own)
        feet = (moment.in_view.people - columns.lowest)[moment.in_view.in_range]
        self.near = cKDTree(places).query_ball_point(feet, buffer + 0.5)


class Score:
    def __init__(self) -> None:
        self._sweep = ThresholdSweep(FINE)
        self._people: list[NDArray[np.float64]] = []
        self._far: list[NDArray[np.float64]] = []
        self._own = 0

    def add(self, sums: Sums, ground: Ground, settings: EvidenceConfig) -> None:
        value = sums.probability(settings)[ground.seen]
        self._sweep.update(value, ground.crowd)
        self._far.append(value[ground.far])
        self._people.append(np.array([value[at].max() if at else 0.0 for at in ground.near]))
        self._own += ground.own

    def cells(self) -> str:
        """Best mean IoU, and the share of people in range in a zone."""
        people, far = np.concatenate(self._people), np.sort(np.concatenate(self._far))[::-1]
        closed = min(int(FAR * self._own), len(far) - 1)
        return f"{self._sweep.result().best()[1].mean:.3f} / {np.mean(people > far[closed]):.3f}"


def scores(path: Path) -> list[Score]:
    """One for each of `MOTIONS`."""
    mission, recording = seen(path), cf.open_recording(path)
    columns = Columns(mission)
    settings = EvidenceConfig().with_detector(mission.contract)
    drones = {drone: number for number, drone in enumerate(recording.drones)}
    kept = [Sums.none(columns.shape) for _ in MOTIONS]
    found = [Score() for _ in MOTIONS]
    last_ns = mission.moments[0].stamp_ns
    for moment in mission.moments:
        looks = [look(one, drones[one.drone], columns, settings) for one in moment.observations]
        velocity = velocities(recording, columns, moment.stamp_ns)
        for at, motion in enumerate(MOTIONS):
            seconds = (moment.stamp_ns - last_ns) / 1e9
            kept[at] = kept[at].later(seconds, motion, velocity, columns.size_m)
            kept[at].looked(looks)
        if moment.in_view is not None:
            ground = Ground(columns, moment, kept[0].seen)
            for score, sums in zip(found, kept, strict=True):
                score.add(sums, ground, settings)
        last_ns = moment.stamp_ns
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("missions", type=Path, nargs="+")
    arguments = parser.parse_args()
    print(f"model {model_sha()}; best mean IoU / people in range in a zone\n")
    rows = [scores(path) for path in arguments.missions]
    print("| |", " | ".join(path.stem for path in arguments.missions), "|")
    print("|---|" + "---|" * len(rows))
    for at, motion in enumerate(MOTIONS):
        print(f"| {motion.name} |", " | ".join(row[at].cells() for row in rows), "|")


if __name__ == "__main__":
    sys.exit(main())
