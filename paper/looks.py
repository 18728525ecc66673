"""What the drones of a mission saw, and what their labels say: made once and kept, because it takes an hour.

A mission is simulated, looked at by the shipped detector and projected as the paper does it: rays of pixels
on the cubes of voxels. Whatever stops this on the way, the same command goes on where it stopped.
"""

from __future__ import annotations

import hashlib
import json
import pickle
import subprocess
import sys
from collections.abc import Iterator
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

import crowdfence as cf
from crowdfence.config import OrConfig, ProjectionConfig, RunConfig
from crowdfence.detector.contract.contract import Contract
from crowdfence.pipeline.detect import HeatmapSource, heatmap_source
from crowdfence.truth.over_time import ProjectedLabels
from crowdfence.truth.projected import ProjectedTruth

LITERAL = ProjectionConfig(coverage="rays", surface="voxels")
BLOCK = 32
"""Instants per file."""


class Rates(NamedTuple):
    """Of voxels seen, by the labels, at a mean heatmap value of 0.5."""

    true_positive: float
    false_positive: float


SHIPPED = Rates(0.763017, 0.00373697)
"""Of the shipped detector on its calibration missions, projected as the paper does. Its contract states
those of the default projection."""


class Look(NamedTuple):
    """One instant."""

    stamp_ns: int
    observations: list[cf.Observation]
    truth: list[ProjectedTruth]
    """The labels of the same pictures, projected alike."""


class Mission:
    """A recording with truth and what was seen in it."""

    rates = SHIPPED

    def __init__(self, name: str, recording: Path, kept: Path) -> None:
        """`kept` is the folder of the blocks."""
        self.name = name
        self._recording = cf.open_recording(recording)
        self.terrain = cf.open_terrain(self._recording)
        self.drones = len(self._recording.drones)
        self._detector = cf.Detector()
        self.kept = kept
        model = self._detector.path
        assert model is not None
        self.made_from = digest(cf.__version__, model.read_bytes(), LITERAL, self._recording.manifest)
        """What the looks follow from."""
        self.taken_as = digest(self.made_from, self.rates)
        """The same, with how good the detector is taken to be: what fused looks follow from."""

    @property
    def contract(self) -> Contract:
        return self._detector.contract

    @cached_property
    def prior(self) -> float:
        """Share of the map that is fit to land on."""
        return cf.landing_prior(self.terrain)

    def looks(self) -> Iterator[Look]:
        """Instant by instant; made where they are not kept yet."""
        self.kept.mkdir(parents=True, exist_ok=True)
        _require_made_from(self.kept, self.made_from)
        heatmaps = heatmap_source(self._detector, self.terrain, LITERAL.max_range_m)
        instants = self._recording.instants()
        number = 0
        while block := list(islice(instants, BLOCK)):
            path = self.kept / f"{number:04}.looks"
            if not path.exists():
                looks = list(self._made(block, heatmaps))
                part = path.with_suffix(".part")
                part.write_bytes(pickle.dumps(looks))
                part.rename(path)
            yield from pickle.loads(path.read_bytes())
            number += 1

    def _made(self, block: list, heatmaps: HeatmapSource) -> Iterator[Look]:
        config = RunConfig(OrConfig(), LITERAL).with_detector(heatmaps.contract)
        projection = config.projection
        assert projection.target_height_m is not None
        labels = ProjectedLabels(
            self._recording,
            self.terrain,
            max_range_m=projection.max_range_m,
            target_height_m=projection.target_height_m,
            coverage=projection.coverage,
            surface=projection.surface,
        )
        for instant, found in heatmaps.detected(block, self.drones):
            observations = [
                cf.project(
                    view,
                    self.terrain,
                    max_range_m=projection.max_range_m,
                    target_height_m=projection.target_height_m,
                    coverage=projection.coverage,
                    surface=projection.surface,
                )
                for view in found.views
            ]
            yield Look(instant.stamp_ns, observations, labels.projected(instant))


def digest(*told: object) -> str:
    """One word for all that something is made from."""
    whole = hashlib.sha256()
    for one in told:
        whole.update(hashlib.sha256(one if isinstance(one, bytes) else _text(one).encode()).digest())
    return whole.hexdigest()[:16]


def _text(told: object) -> str:
    return json.dumps(told, sort_keys=True, default=str) if isinstance(told, dict) else repr(told)


def _require_made_from(folder: Path, made_from: str) -> None:
    """Kept looks of another detector or mission would stand in the table as those of this one."""
    note = folder / "made_from.txt"
    if any(folder.glob("*.looks")) and (not note.exists() or note.read_text() != made_from):
        raise SystemExit(
            f"{folder} holds looks that another crowdfence, detector or mission has left: remove this folder "
            "to make them anew, or name another with --work"
        )
    note.write_text(made_from)


def simulated(seed: int, frames: int, size: str, folder: Path) -> Path:
    """The race of a seed, simulated as far as it is not there yet. Its name says what was asked for: one of
    fewer or smaller pictures is another mission."""
    name = f"race-{seed}-{frames}x{size}"
    path = folder / f"{name}.mcap"
    whole = folder / f"{name}.whole"
    if not whole.exists():
        command = ["simulate", "race", "--seed", seed, "--frames", frames, "--size", size]
        asked = [*command, "--no-heatmaps", "--resume", "-o", path]
        subprocess.run([sys.executable, "-m", "crowdfence", *map(str, asked)], check=True)
        whole.touch()
    return path


class Weakened:
    """The looks of a detector that is weaker by chance: for a moment it misses places, or sees crowd where
    there is none. That is what the paper's own figures suggest of its detector."""

    MISSED, INVENTED = 0.7, 0.012
    SIDE_M, MOMENT_S = 4.0, 0.4
    """How large a place and how long a moment."""
    PLACES = 512
    """Along each side of the map, at most."""

    def __init__(self, mission: Mission) -> None:
        self.name, self.terrain, self.drones = mission.name, mission.terrain, mission.drones
        self.contract, self.prior = mission.contract, mission.prior
        self._mission = mission
        weaker_by = (self.MISSED, self.INVENTED, self.SIDE_M, self.MOMENT_S)
        self.taken_as = digest(mission.made_from, *weaker_by)
        """What the weakened looks follow from; how good they are is measured on them."""

    def looks(self) -> Iterator[Look]:
        for look in self._mission.looks():
            yield look._replace(observations=[self._weak(one) for one in look.observations])

    @cached_property
    def rates(self) -> Rates:
        """As measured: what the detector states of itself does not hold any more."""
        return measured_rates(self)

    def _weak(self, seen: cf.Observation) -> cf.Observation:
        columns = self.terrain.voxel_indices(seen.voxel_ids)[:, :2]
        place = columns // max(round(self.SIDE_M / self.terrain.voxel_size_m), 1)
        drone = int.from_bytes(seen.drone.encode(), "little")
        dice = np.random.default_rng([seen.stamp_ns // int(self.MOMENT_S * 1e9), drone])
        chance = dice.random((self.PLACES, self.PLACES))[tuple(place.T)]
        mean = np.where(chance < self.MISSED, 0.2 * seen.mean, seen.mean)
        invented = 1.0 + (chance - 1.0) / self.INVENTED / 2.0
        mean = np.where(chance > 1.0 - self.INVENTED, np.maximum(mean, invented), mean)
        return cf.Observation(
            self.terrain,
            seen.drone,
            seen.stamp_ns,
            voxel_ids=seen.voxel_ids,
            mean=mean,
            pixel_count=seen.pixel_count,
            range_m=seen.range_m,
            tilt_deg=seen.tilt_deg,
            occluded_ids=seen.occluded_ids,
            focal_px=seen.focal_px,
        )


def measured_rates(mission: Mission | Weakened) -> Rates:
    """What the labels say of the looks."""
    found = crowd = alarms = empty = 0
    for look in mission.looks():
        for observation, label in zip(look.observations, look.truth, strict=True):
            called = observation.mean > 0.5
            is_crowd = np.isin(observation.voxel_ids, label.crowd_ids, assume_unique=True)
            crowd += np.count_nonzero(is_crowd)
            empty += np.count_nonzero(~is_crowd)
            found += np.count_nonzero(called & is_crowd)
            alarms += np.count_nonzero(called & ~is_crowd)
    return Rates(found / max(crowd, 1), alarms / max(empty, 1))
