"""What the scores of a frame are grouped by: ground sampling and tilt of its cells, scenario and season."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.recording import Frame, Recording
from crowdfence.truth.at_exposure import true_camera_pose

if TYPE_CHECKING:
    from crowdfence._core import Terrain


def cell_sampling(
    frame: Frame, terrain: Terrain, shape: tuple[int, ...], max_range_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Metres per image pixel and tilt [h, w] of the cells of a heatmap, by the true pose where recorded;
    NaN where no ground is seen."""
    from crowdfence.detector.ground_sampling import ground_sampling

    sampling = ground_sampling(
        frame.camera,
        true_camera_pose(frame),
        terrain,
        max_range_m=max_range_m,
        rows=shape[0],
        columns=shape[1],
    )
    return sampling.gsd_m, sampling.tilt_deg


def mission_groups(recording: Recording) -> dict[str, str]:
    """Scenario and season of a simulated mission; nothing for other recordings."""
    scenario: Any = recording.manifest
    for key in ("simulation", "scenario"):
        scenario = scenario.get(key) if isinstance(scenario, dict) else None
    if not isinstance(scenario, dict):
        return {}
    named = {"scenario": scenario.get("name"), "season": scenario.get("season")}
    return {name: str(value) for name, value in named.items() if value}
