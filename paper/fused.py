"""Settings -> IoU of every instant at many thresholds (equation 4), in one pass over the looks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from looks import LITERAL, Mission, Weakened, digest
from numpy.typing import NDArray
from settings import Setting

import crowdfence as cf
from crowdfence import _core
from crowdfence.config import MethodConfig, OrConfig, PaperConfig, RunConfig
from crowdfence.evaluation.replay import MEANS
from crowdfence.evaluation.threshold_sweep import SweepResult, ThresholdSweep
from crowdfence.truth.projected import TruthMap

WAYS = np.unique(np.concatenate([np.geomspace(0.002, 1.0, 40), [0.25]]))
"""Thresholds of `paper`: how far from P of a place that all see empty to that of one where all are sure."""
LOG_ODDS = np.arange(0.25, 8.01, 0.25)
"""Thresholds of `evidence`, above the prior."""
SHOWS_NOTHING = 0.005
"""Mean heatmap value that speaks against crowd at any distance."""


class Fused(NamedTuple):
    """What a setting reached."""

    threshold: float
    """The method's own: for `or` the b threshold, its only knob."""
    sweep: SweepResult
    stamps_ns: NDArray[np.int64]
    """[T]"""


def fused(mission: Mission | Weakened, settings: Sequence[Setting], kept: Path) -> dict[str, Fused]:
    """Of every setting by its name; what the folder `kept` holds already of the same looks, method and
    compiled core is not made again."""
    kept.mkdir(parents=True, exist_ok=True)
    core = Path(_core.__file__).read_bytes()
    made_from = {one.name: digest(mission.taken_as, core, one.method) for one in settings}
    missing = [one for one in settings if _made_from(_file(kept, one)) != made_from[one.name]]
    judged = [_Judged(one, mission) for one in missing]
    truth = TruthMap(mission.terrain.voxel_count)
    stamps_ns = []
    # False alarms are everywhere, so that nearly everything counts.
    counts = _counting(mission) if judged and isinstance(mission, Mission) else None
    for look in mission.looks() if judged else ():
        truth.update(look.truth)
        crowd = truth.crowd
        stamps_ns.append(look.stamp_ns)
        counting = look.observations
        if counts is not None:
            counting = [_among(one, counts, mission.terrain) for one in counting]
        for one in judged:
            one.take_in(look.observations if one.counts_all else counting, look.stamp_ns, crowd)
    for one in judged:
        one.save(_file(kept, one.setting), np.array(stamps_ns), made_from[one.setting.name])
    return {one.name: _read(_file(kept, one)) for one in settings}


def _counting(mission: Mission) -> NDArray[np.bool_]:
    """Voxels [V] that can count in equation 4 at all: ever labelled crowd, or above `SHOWS_NOTHING` in some
    look. The others are never called crowd: below any b threshold they stay at P(A | 0) or under it, where no
    threshold lies, and `evidence` holds them for emptier than ground that nobody has seen."""
    counts = np.zeros(mission.terrain.voxel_count, np.bool_)
    for look in mission.looks():
        for seen in look.observations:
            counts[seen.voxel_ids[seen.mean > SHOWS_NOTHING]] = True
        for label in look.truth:
            counts[label.crowd_ids] = True
    return counts


def _among(seen: cf.Observation, counts: NDArray[np.bool_], terrain: cf.Terrain) -> cf.Observation:
    chosen = counts[seen.voxel_ids]
    return cf.Observation(
        terrain,
        seen.drone,
        seen.stamp_ns,
        voxel_ids=seen.voxel_ids[chosen],
        mean=seen.mean[chosen],
        pixel_count=seen.pixel_count[chosen],
        range_m=seen.range_m[chosen],
        tilt_deg=seen.tilt_deg[chosen],
        occluded_ids=[],
        focal_px=seen.focal_px,
    )


class _Judged:
    """One setting at work."""

    def __init__(self, setting: Setting, mission: Mission | Weakened) -> None:
        self.setting = setting
        config = RunConfig(_complete(setting.method, mission), LITERAL).with_detector(mission.contract)
        self._map = config.crowd_map(mission.terrain, mission.drones)
        self._highest: NDArray[np.float32] | None = None
        self.counts_all = isinstance(config.method, PaperConfig) and config.method.initial == "prior"
        """From a prior on it takes some looks until voxels that show nothing fall below P(A | 0)."""
        self.threshold = self._map.default_threshold()
        knobs = _thresholds(self._map.method)
        if isinstance(config.method, OrConfig):
            # One map tells what `or` would say at every b threshold.
            self._highest = np.zeros(mission.terrain.voxel_count, np.float32)
            self.threshold, knobs = config.method.b_threshold, MEANS
        above = isinstance(config.method, OrConfig)
        self._sweep = ThresholdSweep([*knobs, self.threshold], above=above)
        self._lowest = min(knobs.min(), self.threshold)

    def take_in(
        self, observations: Sequence[cf.Observation], stamp_ns: int, crowd: NDArray[np.bool_]
    ) -> None:
        self._map.integrate_observations(observations, stamp_ns)
        if self._highest is None:
            ids, probability = self._map.seen_probability(stamp_ns)
        else:
            ids, probability = self._highest_seen(observations)
        is_crowd = crowd[ids]
        # What lies below all thresholds and is no crowd counts nowhere.
        counts = (probability >= self._lowest) | is_crowd
        self._sweep.update(probability[counts], is_crowd[counts])

    def _highest_seen(
        self, observations: Iterable[cf.Observation]
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        assert self._highest is not None
        for seen in observations:
            self._highest[seen.voxel_ids] = np.maximum(self._highest[seen.voxel_ids], seen.mean)
        ids = self._map.seen_ids()
        return ids, self._highest[ids]

    def save(self, path: Path, stamps_ns: NDArray[np.int64], made_from: str) -> None:
        result = self._sweep.result()
        part = path.with_suffix(".part.npz")
        np.savez_compressed(
            part,
            threshold=self.threshold,
            thresholds=result.thresholds,
            per_frame=result.per_frame,
            stamps_ns=stamps_ns,
            made_from=made_from,
        )
        part.rename(path)


def _complete(method: MethodConfig, mission: Mission | Weakened) -> MethodConfig:
    """`paper` with the prior of the map, and the rates of these looks."""
    if not isinstance(method, PaperConfig):
        return method
    method = replace(method, prior=mission.prior if method.prior is None else method.prior)
    rates = mission.rates
    return replace(method, true_positive_rate=rates.true_positive, false_positive_rate=rates.false_positive)


def _thresholds(method: cf.Paper | cf.Or | cf.Evidence) -> NDArray[np.float64]:
    if isinstance(method, cf.Paper):
        return method.post_negative + (method.post_positive - method.post_negative) * WAYS
    if isinstance(method, cf.Evidence):
        prior = float(method.parameters["prior"])
        return 1.0 / (1.0 + (1.0 - prior) / prior * np.exp(-LOG_ODDS))
    return MEANS


def _file(kept: Path, setting: Setting) -> Path:
    return kept / f"{setting.name.replace(' ', '_').replace(',', '').replace('/', '')}.npz"


def _made_from(path: Path) -> str | None:
    """What a kept result follows from; None where there is none, or it does not say."""
    if not path.exists():
        return None
    with np.load(path) as stored:
        return str(stored["made_from"]) if "made_from" in stored else None


def _read(path: Path) -> Fused:
    with np.load(path) as stored:
        sweep = SweepResult(stored["thresholds"], stored["per_frame"])
        return Fused(float(stored["threshold"]), sweep, stored["stamps_ns"])
