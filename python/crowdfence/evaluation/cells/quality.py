"""How good a detector is on labelled frames: in all, by ground sample distance, tilt, mission and group."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.evaluation.cells.rates import crowd_cells, heatmap_values
from crowdfence.evaluation.cells.scores import (
    PrecisionRecall,
    Quality,
    precision_recall,
    quality,
    reliability_of,
)
from crowdfence.evaluation.cells.value_histogram import value_histogram
from crowdfence.evaluation.statistics.bin_edges import increasing_edges
from crowdfence.evaluation.statistics.unit_bootstrap import RESAMPLES

GSD_EDGES_M = (0.0, 0.025, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.5, np.inf)
"""Metres on the ground per image pixel."""
TILT_EDGES_DEG = (-90.0, 10.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0)
"""Angle of a ray below the horizon."""

ALL = "all"
GSD, TILT, MISSION = "gsd_m", "tilt_deg", "mission"


@dataclass(frozen=True, slots=True, eq=False)
class LabelledHeatmap:
    """A heatmap, the truth of its image, and where it comes from."""

    heatmap: ArrayLike
    """[h, w] floating point in [0, 1] or uint8 (value / 255)."""
    mask: ArrayLike
    """[H, W] bool or integer, non-zero is crowd. A cell is crowd when more than half of its area is."""
    mission: str
    ignore: ArrayLike | None = None
    """[H, W] True where the label does not count; a cell is left out when more than half of it is."""
    gsd_m: ArrayLike | None = None
    """Metres on the ground per image pixel, one number or [h, w]; NaN where unknown (sky)."""
    tilt_deg: ArrayLike | None = None
    """Angle of the cell's ray below the horizon, one number or [h, w]; NaN where unknown."""
    groups: Mapping[str, str] = field(default_factory=dict)
    """Further breakdowns, such as {"scenario": "race", "season": "autumn"}."""
    unit: str | None = None
    """Frames of one unit are resampled together. None: the mission. With fewer than about five missions,
    name blocks of consecutive frames instead, long enough that blocks differ."""
    stride: int | None = None
    """Pixels of the mask along the cells of a detector, see `crowd_cells`; None: they divide it evenly."""


@dataclass(frozen=True, slots=True, eq=False)
class QualityReport:
    """Quality in all and broken down."""

    overall: Quality
    by: dict[str, dict[str, Quality]]
    """Name of a breakdown ("gsd_m", "tilt_deg", "mission", groups) -> its bins or members -> quality."""
    curve: PrecisionRecall
    reliability: tuple[NDArray[np.float64], ...]
    """Cells, mean value and crowd share [15] of all cells."""

    def to_json(self) -> dict[str, Any]:
        """Ready for JSON; unknown is null."""
        cells, mean_value, crowd_share = self.reliability
        return {
            "overall": self.overall.to_json(),
            "by": {
                name: {member: one.to_json() for member, one in members.items()}
                for name, members in self.by.items()
            },
            "reliability": {
                "cells": cells.astype(int).tolist(),
                "mean_value": _or_none(mean_value),
                "crowd_share": _or_none(crowd_share),
            },
            "precision_recall": {
                "threshold": self.curve.threshold.tolist(),
                "precision": _or_none(self.curve.precision),
                "recall": _or_none(self.curve.recall),
            },
        }


class DetectorQuality:
    """Collects labelled frames one at a time.

    Keeps one histogram of values (31 kB) for each unit in each bin of each breakdown, however many frames
    there are. Intervals come from resampling units, not cells: cells of a frame and frames of a flight show
    the same crowds, so counting them as independent would make any interval look far too narrow.
    """

    def __init__(
        self,
        *,
        gsd_edges_m: ArrayLike = GSD_EDGES_M,
        tilt_edges_deg: ArrayLike = TILT_EDGES_DEG,
    ) -> None:
        self._edges = {
            GSD: increasing_edges("gsd_edges_m", gsd_edges_m),
            TILT: increasing_edges("tilt_edges_deg", tilt_edges_deg),
        }
        self._histograms: dict[tuple[str, str], dict[str, NDArray[np.float64]]] = {}
        self._frames = 0

    def add(self, frame: LabelledHeatmap) -> None:
        """Count one frame. ValueError, with the mission, for a heatmap, mask or map that cannot be used; what
        was counted before stays."""
        try:
            counted = list(self._parts_of(frame))
        except ValueError as error:
            raise ValueError(f"{frame.mission}, frame {self._frames}: {error}") from error
        unit = frame.mission if frame.unit is None else frame.unit
        for key, histogram in counted:
            units = self._histograms.setdefault(key, {})
            if unit in units:
                units[unit] += histogram
            else:
                units[unit] = histogram.copy()
        self._frames += 1

    def report(self, *, resamples: int = RESAMPLES, seed: int = 0) -> QualityReport:
        """Scores with 95 % intervals. ValueError before the first frame."""
        if not self._histograms:
            raise ValueError("no frames: add at least one labelled heatmap")
        scored = {
            key: quality(np.stack(list(units.values())), resamples=resamples, seed=seed)
            for key, units in self._histograms.items()
        }
        by: dict[str, dict[str, Quality]] = {}
        for name, member in sorted(scored, key=self._order):
            if name != ALL:
                by.setdefault(name, {})[member] = scored[name, member]
        total = np.sum(list(self._histograms[ALL, ALL].values()), axis=0)
        return QualityReport(scored[ALL, ALL], by, precision_recall(total), reliability_of(total))

    def _parts_of(self, frame: LabelledHeatmap) -> Iterable[tuple[tuple[str, str], NDArray[np.float64]]]:
        if reserved := {ALL, GSD, TILT, MISSION} & set(frame.groups):
            raise ValueError(f"{min(reserved)!r} cannot name a group, it is a breakdown of its own")
        values = heatmap_values(np.asarray(frame.heatmap))
        crowd = crowd_cells(np.asarray(frame.mask), values.shape, frame.stride)
        counts = np.ones(values.shape, np.bool_)
        if frame.ignore is not None:
            counts = ~crowd_cells(np.asarray(frame.ignore), values.shape, frame.stride)
        whole = value_histogram(values[counts], crowd[counts])
        for name, member in {ALL: ALL, MISSION: frame.mission, **frame.groups}.items():
            yield (name, member), whole
        for name, given in ((GSD, frame.gsd_m), (TILT, frame.tilt_deg)):
            if given is None:
                continue
            bin_of = _bin_of(name, given, self._edges[name], values.shape)
            for number in np.unique(bin_of[counts & (bin_of >= 0)]):
                chosen = counts & (bin_of == number)
                yield (name, self._label(name, int(number))), value_histogram(values[chosen], crowd[chosen])

    def _label(self, name: str, number: int) -> str:
        low, high = self._edges[name][number : number + 2]
        return f"{low:g} to {high:g}"

    def _order(self, key: tuple[str, str]) -> tuple[str, int, str]:
        """Bins by size, everything else by name."""
        name, member = key
        if name not in self._edges:
            return name, 0, member
        labels = [self._label(name, number) for number in range(len(self._edges[name]) - 1)]
        return name, labels.index(member), member


def detector_quality(
    frames: Iterable[LabelledHeatmap], *, resamples: int = RESAMPLES, seed: int = 0
) -> QualityReport:
    """Quality over labelled frames, one in memory at a time. See `DetectorQuality`."""
    collected = DetectorQuality()
    for frame in frames:
        collected.add(frame)
    return collected.report(resamples=resamples, seed=seed)


def _bin_of(
    name: str, given: ArrayLike, edges: NDArray[np.float64], shape: tuple[int, ...]
) -> NDArray[np.int64]:
    """Bin number per cell [h, w], -1 for NaN and what lies outside the edges."""
    values = np.asarray(given, np.float64)
    if values.ndim != 0 and values.shape != shape:
        raise ValueError(f"{name} must be one number or {list(shape)}, got {list(values.shape)}")
    values = np.broadcast_to(values, shape)
    inside = (values >= edges[0]) & (values <= edges[-1])  # False for NaN
    number = np.minimum(np.searchsorted(edges, values, side="right") - 1, len(edges) - 2)
    return np.where(inside, number, -1)


def _or_none(values: NDArray[np.float64]) -> list[float | None]:
    return [None if value != value else value for value in values.tolist()]
