"""Journaled views on their way into the map."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdMap, Observation, View, project
from crowdfence.pipeline import FrameLoop, Step
from crowdfence.sources.recording import RefusedFrame

Content = View | Observation | RefusedFrame


@dataclass(frozen=True, slots=True, eq=False)
class Arrival:
    """One view with its place in the journal; what it shows may still be in the making."""

    seq: int
    drone: str
    stamp_ns: int
    content: Content | Future[Content]
    image: bytes | None = None
    position: NDArray[np.float64] | None = None
    """Of its camera, local metres [3]; None for an observation."""
    near: bool = False
    """Whether the detector was shown near ground alone."""

    def arrived(self) -> Content:
        """Wait for it."""
        return self.content.result() if isinstance(self.content, Future) else self.content


def stepped(loop: FrameLoop, contents: Sequence[Content], stamp_ns: int) -> Step:
    """One step of the loop with views, observations, or both. Errors as for `FrameLoop.step`."""
    views = [one for one in contents if isinstance(one, View)]
    observations = [one for one in contents if isinstance(one, Observation)]
    refused = [one for one in contents if isinstance(one, RefusedFrame)]
    if not observations:
        return loop.step(views, stamp_ns, refused)
    projected = [_projected(view, loop.crowd_map) for view in views]
    together = sorted([*observations, *projected], key=lambda one: (one.stamp_ns, one.drone))
    return loop.step_observed(together, stamp_ns, refused)


def _projected(view: View, crowd_map: CrowdMap) -> Observation:
    """As the crowd map itself would."""
    return project(
        view,
        crowd_map.terrain,
        max_range_m=crowd_map.max_range_m,
        target_height_m=crowd_map.target_height_m,
        coverage=crowd_map.coverage,
        surface=crowd_map.surface,
        crowd_threshold=crowd_map.method.b_threshold,
    )
