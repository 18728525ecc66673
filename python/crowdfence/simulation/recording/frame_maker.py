"""One capture of the schedule -> what it shows: picture, labels, depth, truth."""

from __future__ import annotations

import io
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crowdfence._core import Camera
from crowdfence.simulation.landing_detector import LandingDetector, shown
from crowdfence.simulation.landing_ground import landing_ground
from crowdfence.simulation.picture_detector import detected_heatmap, picture_detector
from crowdfence.simulation.recording.frame_summary import FrameSummary
from crowdfence.simulation.rendering.frame import RenderedFrame
from crowdfence.simulation.rendering.raycast_labels import LabelRaycaster
from crowdfence.simulation.rendering.renderer import Renderer
from crowdfence.simulation.scenarios.scenario import ScenarioError
from crowdfence.simulation.scene import Scene
from crowdfence.simulation.scene_truth import PeopleTruth, Sight, people_truth, region_mask, sight_of_people
from crowdfence.simulation.scene_truth import visible_pixels as count_pixels
from crowdfence.simulation.schedule import Capture, Schedule, build_schedule
from crowdfence.simulation.simulated_detector import SimulatedDetector
from crowdfence.sources.layers import LANDING_SITE
from crowdfence.sources.mission.messages import FrameContent, LayerContent, depth_in_whole_cm
from crowdfence.sources.recorded_truth import CameraPose, RecordedPeople

SHUTTER_S = 1 / 250
"""How long a picture is exposed: what moves meanwhile is blurred."""

LAYERS = (LANDING_SITE,)
"""What can be recorded beside crowds."""

HIDDEN_WITHIN_M = 300.0
"""Hidden people are recorded up to here: behind the next mountain nobody is looked for."""


@dataclass(frozen=True, slots=True)
class FrameOptions:
    """What goes into the frames of a recording."""

    rgb: bool = True
    """Pictures, rendered with OpenGL. Without them labels and depth come from the raycaster, which knows
    neither trees nor other props and needs no OpenGL."""
    heatmaps: bool = True
    """Heatmaps: of the shipped detector where there are pictures, else of a stand-in that knows the truth."""
    picture_format: str = "JPEG"
    jpeg_quality: int = 88
    supersample: int = 2
    layers: tuple[str, ...] = ()
    """Further layers to record, with their truth; of `LAYERS`."""

    def __post_init__(self) -> None:
        unknown = sorted(set(self.layers) - set(LAYERS))
        if unknown:
            raise ValueError(f"no layer {unknown[0]!r} can be simulated; there is {', '.join(LAYERS)}")


class FrameMaker:
    """Makes the frames of one scene, each without those before it. Use as a context manager.

    NoOpenGL when pictures are wanted and this machine cannot render; ScenarioError for what the raycaster
    cannot do.
    """

    def __init__(self, scene: Scene, options: FrameOptions) -> None:
        self._scene, self._options = scene, options
        self._schedule: Schedule = build_schedule(scene)
        self._camera = scene.scenario.intrinsics()
        self._detector = picture_detector() if options.rgb and options.heatmaps else None
        self._stand_in = SimulatedDetector()
        self._landing = _Landing(scene, self._camera) if LANDING_SITE in options.layers else None
        self._eye: Renderer | LabelRaycaster
        if options.rgb:
            self._eye = Renderer(scene, self._camera, supersample=options.supersample)
        else:
            rolling_ms = scene.scenario.trouble.rolling_exposure_ms
            if rolling_ms > 0:
                raise ScenarioError(
                    f"trouble.rolling_exposure_ms is {rolling_ms:g}: a rolling exposure needs pictures; "
                    "set it to 0 to record labels alone"
                )
            self._eye = LabelRaycaster(scene, self._camera)
        self.description = self._eye.description
        """What makes the frames: the OpenGL driver, or the raycaster."""

    def __enter__(self) -> FrameMaker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(self._eye, Renderer):
            self._eye.close()

    def make(self, capture: Capture) -> FrameContent:
        """What arrives for this capture. A frame that is delivered twice shows its first exposure."""
        exposed = capture.frame if capture.duplicate_of is None else capture.duplicate_of
        t_s = self._schedule.exposure_s(capture.drone, exposed)
        rendered = self._render(capture.drone, exposed, t_s)
        truth = people_truth(self._scene, t_s)
        regions = region_mask(truth, rendered.instance_id, rendered.depth_m, self._camera.fx)
        pose = self._scene.flight.at(capture.drone, t_s).world_from_camera
        image = None if rendered.rgb is None else self._encoded(rendered.rgb)
        if self._detector is None or image is None:
            heatmap = self._stand_in_heatmap(regions, rendered.instance_id, capture.drone, exposed)
        else:
            heatmap = detected_heatmap(self._detector, image, rendered.depth_m, self._camera)
        return FrameContent(
            image=image,
            heatmap=heatmap,
            regions=regions,
            depth_m=depth_in_whole_cm(rendered.depth_m),
            segmentation=rendered.class_id,
            instances=rendered.instance_id,
            true_pose=camera_pose(pose),
            exposure_ns=self._scene.scenario.epoch_ns + round(t_s * 1e9),
            people=self._people_in_view(truth, rendered, pose, capture.stamp_ns),
            layers=self._layers(truth, rendered, pose, capture.drone, exposed),
        )

    def summary(self, content: FrameContent, *, footprint: bool) -> FrameSummary:
        """Statistics of a frame that was made here."""
        assert content.segmentation is not None and content.depth_m is not None
        assert content.people is not None and content.true_pose is not None
        return FrameSummary.of(
            content.segmentation,
            content.depth_m,
            content.people,
            self._camera,
            content.true_pose.world_from_camera() if footprint else None,
        )

    def _render(self, drone: int, exposed: int, t_s: float) -> RenderedFrame:
        flight, eye = self._scene.flight, self._eye
        if isinstance(eye, LabelRaycaster):
            return eye.render(t_s, flight.at(drone, t_s).world_from_camera)
        rolling_s = 1e-3 * self._scene.scenario.trouble.rolling_exposure_ms
        first, last, blurred = (
            flight.at(drone, t_s + offset_s).world_from_camera
            for offset_s in (-rolling_s / 2, rolling_s / 2, SHUTTER_S - rolling_s / 2)
        )
        return eye.render(
            t_s,
            first,
            world_from_camera_end=last if rolling_s > 0 else None,
            world_from_camera_blurred=blurred,
            noise_seed=(exposed * self._scene.scenario.drones + drone) % 2**31,
        )

    def _encoded(self, rgb: NDArray[np.uint8]) -> bytes:
        from PIL import Image

        encoded = io.BytesIO()
        Image.fromarray(rgb).save(
            encoded,
            format=self._options.picture_format,
            quality=self._options.jpeg_quality,
            optimize=self._options.picture_format == "JPEG",
        )
        return encoded.getvalue()

    def _stand_in_heatmap(
        self, regions: NDArray[np.uint16], instances: NDArray[np.uint16], drone: int, exposed: int
    ) -> NDArray[np.uint8] | None:
        if not self._options.heatmaps:
            return None
        return self._stand_in.heatmap(regions, instances, self._scene.seed, drone, exposed)

    def _layers(
        self, truth: PeopleTruth, rendered: RenderedFrame, pose: NDArray[np.float64], drone: int, exposed: int
    ) -> dict[str, LayerContent]:
        if self._landing is None:
            return {}
        content = self._landing.content(truth, rendered.depth_m, pose, drone, exposed)
        # Labels are the truth and stay; heatmaps are left out as those of crowds are.
        return {LANDING_SITE: content if self._options.heatmaps else LayerContent(labels=content.labels)}

    def _people_in_view(
        self, truth: PeopleTruth, rendered: RenderedFrame, pose: NDArray[np.float64], stamp_ns: int
    ) -> RecordedPeople:
        sight = sight_of_people(self._scene, truth, rendered.instance_id, self._camera, pose)
        distance_m = np.linalg.norm(truth.position - pose[:3, 3], axis=1)
        hidden = (sight == Sight.HIDDEN) & (distance_m <= HIDDEN_WITHIN_M)
        chosen = np.flatnonzero(hidden | (sight == Sight.VISIBLE))
        pixels = count_pixels(rendered.instance_id, len(truth.position))
        return RecordedPeople(
            stamp_ns,
            truth.position[chosen].astype(np.float32),
            (chosen + 1).astype(np.uint32),
            truth.crowd[chosen].astype(np.uint32),
            pixels[chosen].astype(np.uint32),
        )


class _Landing:
    """What the frames of a scene say about landing sites."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        self._seed, self._camera = scene.seed, camera
        self._ground = landing_ground(scene.landscape)
        self._detector = LandingDetector()
        self._mistakes = self._detector.mistakes(self._ground, scene.seed)

    def content(
        self,
        truth: PeopleTruth,
        depth_m: NDArray[np.floating[Any]],
        pose: NDArray[np.float64],
        drone: int,
        exposed: int,
    ) -> LayerContent:
        fits = self._ground.without(truth.position)
        labels = shown(self._ground, fits, depth_m, self._camera, pose)
        mistakes = shown(self._ground, self._mistakes, depth_m, self._camera, pose)
        return LayerContent(self._detector.heatmap(labels, mistakes, self._seed, drone, exposed), labels)


def camera_pose(world_from_camera: NDArray[np.float64]) -> CameraPose:
    """Position and quaternion (w, x, y, z) of a rigid transform [4, 4]."""
    quaternion = Rotation.from_matrix(world_from_camera[:3, :3]).as_quat(scalar_first=True)
    return CameraPose(world_from_camera[:3, 3].copy(), np.asarray(quaternion))
