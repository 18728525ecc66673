"""What a report shows of a layer beside IoU: whether its probability means what it says, and what the ground
that it calls of the class really is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap
from crowdfence.evaluation.probability_quality import ProbabilityQuality
from crowdfence.zones.sorted_keys import are_among
from crowdfence.zones.tracker import column_keys


@dataclass(slots=True)
class LayerMeasures:
    """Sums over moments, once a second."""

    quality: ProbabilityQuality = field(default_factory=ProbabilityQuality)
    called: int = 0
    """Voxels at or above the threshold."""
    called_true: int = 0
    true: int = 0
    """Voxels that were seen and are of the class."""
    people: int = 0
    """Everybody, in a crowd or not, on ground that was seen."""
    people_on_called: int = 0

    def add(
        self,
        crowd_map: CrowdMap,
        stamp_ns: int,
        threshold: float,
        truth: NDArray[np.bool_],
        people_enu: NDArray[np.floating[Any]] | None,
    ) -> None:
        """One moment: the truth of every voxel [V], and where everybody stands [P, 3], if that is known."""
        ids, probability = crowd_map.seen_probability(stamp_ns)
        self.quality.add(probability, truth[ids])
        called = probability >= threshold
        self.called += int(np.count_nonzero(called))
        self.called_true += int(np.count_nonzero(called & truth[ids]))
        self.true += int(np.count_nonzero(truth[ids]))
        if people_enu is not None:
            seen, on_called = (_columns(crowd_map, some) for some in (ids, ids[called]))
            terrain = crowd_map.terrain
            feet = np.floor((people_enu[:, :2] - np.asarray(terrain.origin)[:2]) / terrain.voxel_size_m)
            keys = column_keys(feet.astype(np.int64))
            self.people += int(np.count_nonzero(are_among(keys, seen)))
            self.people_on_called += int(np.count_nonzero(are_among(keys, on_called)))

    @property
    def precision(self) -> float:
        """Of the ground that is called of the class, the share that is."""
        return self.called_true / self.called if self.called else float("nan")

    @property
    def recall(self) -> float:
        """Of the ground of the class that was seen, the share that is called so."""
        return self.called_true / self.true if self.true else float("nan")

    @property
    def share_of_people_on_called(self) -> float:
        """Of the people on ground that was seen."""
        return self.people_on_called / self.people if self.people else float("nan")

    def to_json(self) -> dict[str, Any]:
        """Every figure by its name; None where it is not known."""
        figures = {
            "average_precision": self.quality.average_precision,
            "brier": self.quality.brier,
            "calibration_error": self.quality.calibration_error,
            "precision": self.precision,
            "recall": self.recall,
            "share_of_people_on_called": self.share_of_people_on_called,
            "people": self.people,
        }
        return {name: None if value != value else value for name, value in figures.items()}


def _columns(crowd_map: CrowdMap, ids: NDArray[np.int64]) -> NDArray[np.int64]:
    return column_keys(crowd_map.terrain.voxel_indices(ids)[:, :2])
