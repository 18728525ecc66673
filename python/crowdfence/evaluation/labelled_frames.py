"""Frames of a recording as labelled heatmaps, with the ground sampling and the tilt of every cell."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.evaluation.detector_quality import LabelledHeatmap
from crowdfence.evaluation.labelled_projection import MaskOf, true_camera_pose
from crowdfence.sources.recording import Frame, FrameError, Recording, RefusedFrame

if TYPE_CHECKING:
    from crowdfence._core import Terrain


def labelled_heatmaps(
    recording: Recording,
    heatmap_of: Callable[[Frame], NDArray[Any]],
    mask_of: MaskOf,
    *,
    ignore_of: MaskOf | None = None,
    terrain: Terrain | None = None,
    max_range_m: float = 300.0,
) -> Iterator[LabelledHeatmap]:
    """Every frame that has a heatmap and a label, for `DetectorQuality`.

    `heatmap_of` is a detector (`lambda frame: detector(frame.image())`) or `Frame.heatmap`; `mask_of` and
    `ignore_of` give bool [H, W] of a frame. With a `terrain` every cell knows its ground sample distance and
    tilt. Scenario and season of a simulated mission become groups. Frames that cannot be used are added to
    the recording's `refused`.
    """
    groups = mission_groups(recording)
    for frame in recording.frames:
        try:
            heatmap, mask = heatmap_of(frame), mask_of(frame)
            ignore = None if ignore_of is None else ignore_of(frame)
            gsd_m, tilt_deg = (None, None)
            if terrain is not None:
                gsd_m, tilt_deg = cell_sampling(frame, terrain, heatmap.shape, max_range_m)
        except FrameError as error:
            recording.refused.append(RefusedFrame(frame.drone, frame.stamp_ns, error.reason))
            continue
        yield LabelledHeatmap(heatmap, mask, recording.name, ignore, gsd_m, tilt_deg, groups)


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
    scenario = (recording.manifest.get("simulation") or {}).get("scenario") or {}
    named = {"scenario": scenario.get("name"), "season": scenario.get("season")}
    return {name: str(value) for name, value in named.items() if value}
