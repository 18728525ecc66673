"""What a simulated mission says about itself."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from crowdfence._core import __version__
from crowdfence.simulation.landing_detector import LandingDetector
from crowdfence.simulation.landing_ground import landing_manifest
from crowdfence.simulation.picture_detector import picture_detector_manifest
from crowdfence.simulation.recording.frame_maker import HIDDEN_WITHIN_M, SHUTTER_S, FrameOptions
from crowdfence.simulation.scene import Scene
from crowdfence.simulation.scene_class import SceneClass
from crowdfence.simulation.scene_truth import CLOSING_M
from crowdfence.simulation.schedule import Schedule
from crowdfence.simulation.simulated_detector import SimulatedDetector
from crowdfence.sources.layers import LANDING_SITE


def mission_manifest(scene: Scene, schedule: Schedule, options: FrameOptions, made_by: str) -> dict[str, Any]:
    """Everything that the recording follows from, ready for JSON: equal manifests mean equal recordings.

    `made_by` describes the OpenGL driver or the raycaster.
    """
    cyclists = scene.cyclist_instance_ids()
    manifest = {
        "made_with": f"crowdfence {__version__}",
        "scenario": asdict(scene.scenario),
        "seed": scene.seed,
        "renderer": made_by,
        "frame_options": asdict(options),
        "shutter_s": SHUTTER_S,
        "heatmaps": _heatmaps(options),
        "classes": {kind.name.lower(): int(kind) for kind in SceneClass},
        "people": scene.people.count,
        "people_per_planned_crowd": [len(crowd.slots) for crowd in scene.people.crowds],
        "single_people_are_crowd": scene.scenario.crowd_definition.min_people <= 1,
        "cyclist_instance_ids": [cyclists.start, cyclists.stop - 1] if len(cyclists) else None,
        "region_closing_m": CLOSING_M,
        "hidden_people_within_m": HIDDEN_WITHIN_M,
        "trouble": schedule.manifest(),
        **_layers(options),
    }
    plain: dict[str, Any] = json.loads(json.dumps(manifest))
    return plain


def _heatmaps(options: FrameOptions) -> dict[str, Any] | None:
    """Who makes the heatmaps."""
    if not options.heatmaps:
        return None
    return picture_detector_manifest() if options.rgb else SimulatedDetector().manifest()


def _layers(options: FrameOptions) -> dict[str, Any]:
    """What further layers are and who makes their heatmaps; nothing where there are none."""
    if LANDING_SITE not in options.layers:
        return {}
    return {"layers": {LANDING_SITE: {"truth": landing_manifest(), "heatmaps": LandingDetector().manifest()}}}


def first_difference(one: Any, other: Any, where: str = "") -> str | None:
    """Name of the first entry in which two manifests differ, with both values; None when they are equal."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in [*one, *(key for key in other if key not in one)]:
            if found := first_difference(one.get(key), other.get(key), f"{where}.{key}" if where else key):
                return found
        return None
    return None if one == other else f"{where} is {one!r}, was {other!r}"
