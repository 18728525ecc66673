"""Missions that were recorded without the layer `landing-site`, with it: the simulator's ground, and its
stand-in detector on the recorded depth, as `crowdfence simulate --layer landing-site` would have written
them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import crowdfence as cf
from crowdfence.simulation.landing_detector import LandingDetector, shown
from crowdfence.simulation.landing_ground import landing_ground
from crowdfence.simulation.landscape import build_landscape
from crowdfence.simulation.scenarios.scenario_file import load_scenario
from crowdfence.sources.layers import LANDING_SITE, LayerGround, LayerPixels
from crowdfence.sources.recording import Frame, Recording
from crowdfence.truth.at_exposure import people_at, true_camera_pose


def with_landing(path: Path, every: int = 1) -> Recording:
    """The recording of a mission, every so manieth frame of it, with the layer beside crowds."""
    recording = cf.open_recording(path)
    simulation = recording.manifest["simulation"]
    plan = load_scenario(simulation["scenario"]["name"]).landscape
    if simulation["scenario"]["landscape"] != _plain(plan):
        raise ValueError(f"{path}: its landscape is not the one of this version")
    ground = landing_ground(build_landscape(plan, simulation["seed"]))
    mistakes = LandingDetector().mistakes(ground, simulation["seed"])
    frames = [
        replace(
            one,
            pixels=replace(one.pixels, layers={LANDING_SITE: _layer(recording, ground, mistakes, one, n)}),
        )
        for n, one in enumerate(recording.frames)
        if n // len(recording.drones) % every == 0
    ]
    return replace(recording, frames=tuple(frames), layer_grounds={LANDING_SITE: ground})


def _plain(plan: Any) -> Any:
    import json
    from dataclasses import asdict

    return json.loads(json.dumps(asdict(plan)))


def _layer(
    recording: Recording, ground: LayerGround, mistakes: NDArray[np.float64], frame: Frame, number: int
) -> LayerPixels:
    labels = partial(_labels, recording, ground, frame)
    return LayerPixels(partial(_heatmap, recording, ground, mistakes, frame, number), labels)


def _labels(recording: Recording, ground: LayerGround, frame: Frame) -> NDArray[np.uint8]:
    fits = ground.without(people_at(frame, recording).position)
    pose = true_camera_pose(frame)
    return shown(ground, fits, frame.depth_m(), frame.camera, pose).astype(np.uint8)


def _heatmap(
    recording: Recording, ground: LayerGround, mistakes: NDArray[np.float64], frame: Frame, number: int
) -> NDArray[np.uint8]:
    labels = _labels(recording, ground, frame) > 0
    of_place = shown(ground, mistakes, frame.depth_m(), frame.camera, true_camera_pose(frame))
    seed = recording.manifest["simulation"]["seed"]
    drone = recording.drones.index(frame.drone)
    return LandingDetector().heatmap(labels, of_place, seed, drone, number)
