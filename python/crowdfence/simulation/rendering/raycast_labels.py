"""Labels and depth of a scene without OpenGL: the core's raycaster, exact triangles, and capsules for people.

The ground and the buildings are the very triangles that the renderer draws. A person is an upright capsule of
the person's height, a cyclist three capsules. Trees, cars and other props are left out, and so is the land
beyond the map's edge: what they would hide is seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence._core import Camera, Terrain
from crowdfence.simulation.rendering.frame import RenderedFrame
from crowdfence.simulation.rendering.ray_surface import (
    box_candidates,
    capsule_hits,
    ground_hits,
    triangle_hits,
)
from crowdfence.simulation.scene_class import SceneClass

if TYPE_CHECKING:
    from crowdfence.simulation.scene import Scene

Array = NDArray[np.float64]

_MAX_RANGE_M = 4000.0
_UP = np.array([0.0, 0.0, 1.0])
_BODY_RADIUS_SHARE = 0.11  # of a person's height
# A cyclist of scale 1: bicycle, back and legs, as (start, end, radius) in metres, front along +x.
_CYCLIST = (
    ((-0.55, 0.0, 0.34), (0.55, 0.0, 0.34), 0.10),
    ((-0.16, 0.0, 0.98), (0.32, 0.0, 1.38), 0.20),
    ((-0.16, 0.0, 0.95), (0.02, 0.0, 0.35), 0.15),
)


@dataclass(frozen=True, slots=True)
class _Capsule:
    start: Array
    end: Array
    radius_m: float
    class_id: int
    instance_id: int


class LabelRaycaster:
    """Makes `RenderedFrame`s whose `rgb` is None; used like `Renderer`, as exact at pixel centres."""

    description = "labels by raycasting, no OpenGL"

    def __init__(self, scene: Scene, camera: Camera) -> None:
        self._scene, self._camera = scene, camera
        ground = scene.landscape.ground
        low = ground.vertices.min(axis=0) - 2.0
        step_m = 2.0 * scene.landscape.surface.lattice.step_m
        # The voxels hold every ground triangle, so the first cube along a ray is no farther than the ground.
        self._voxels = Terrain.from_triangles(ground.vertices, ground.triangles, step_m, tuple(low))
        u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        rays = camera.unproject(np.stack([u, v], axis=-1).reshape(-1, 2))
        if (rays[:, 2] <= 0).any():
            raise ValueError("the lens sees 180 degrees or more: depth along the optical axis is not defined")
        self._rays_camera = rays / rays[:, 2:]

    def __enter__(self) -> LabelRaycaster:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None

    def render(self, t_s: float, world_from_camera: ArrayLike) -> RenderedFrame:
        """Labels and depth at `t_s` from a camera at `world_from_camera` [4, 4] (OpenCV axes, local ENU)."""
        pose = np.asarray(world_from_camera, np.float64)
        # The rays' third camera coordinate is 1, so their parameter is the depth along the optical axis.
        rays, origin = self._rays_camera @ pose[:3, :3].T, pose[:3, 3]
        depth = self._ground_depth(origin, rays)
        label = np.where(np.isfinite(depth), int(SceneClass.GROUND), int(SceneClass.SKY)).astype(np.uint8)
        seen = np.flatnonzero(np.isfinite(depth))
        hit = origin + depth[seen, None] * rays[seen]
        label[seen[self._scene.landscape.on_road(hit[:, 0], hit[:, 1])]] = SceneClass.ROAD
        for mesh in self._scene.landscape.solids:
            near = box_candidates(origin, rays, mesh.vertices.min(axis=0), mesh.vertices.max(axis=0))
            t = triangle_hits(origin, rays[near], mesh.vertices[mesh.triangles])
            closer = t < depth[near]
            depth[near[closer]], label[near[closer]] = t[closer], SceneClass.GROUND
        instance = np.zeros(len(rays), np.uint16)
        self._draw_capsules(self._capsules(t_s), pose, rays, depth, label, instance)
        shape = (self._camera.height, self._camera.width)
        return RenderedFrame(
            None, label.reshape(shape), instance.reshape(shape), depth.astype(np.float32).reshape(shape)
        )

    def _ground_depth(self, origin: Array, rays: Array) -> Array:
        def skip(points: Array, directions: Array) -> Array:
            _, distance = self._voxels.raycast(points, directions, _MAX_RANGE_M, surface="voxels")
            return distance / np.linalg.norm(directions, axis=1)

        return ground_hits(self._scene.landscape.surface, origin, rays, skip)

    def _capsules(self, t_s: float) -> list[_Capsule]:
        scene = self._scene
        people, cyclists = scene.people.at(t_s), scene.cyclists.at(t_s)
        capsules = []
        for index, (foot, height) in enumerate(zip(people.position, scene.people.height_m, strict=True)):
            radius = _BODY_RADIUS_SHARE * float(height)
            label = SceneClass.CROWD if people.in_crowd[index] else SceneClass.GROUND
            low, high = foot + radius * _UP, foot + (float(height) - radius) * _UP
            capsules.append(_Capsule(low, high, radius, int(label), index + 1))
        for index, (foot, heading) in enumerate(zip(cyclists.position, cyclists.heading_rad, strict=True)):
            c, s = np.cos(heading), np.sin(heading)
            turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
            for start, end, radius in _CYCLIST:
                a, b = foot + turn @ np.array(start), foot + turn @ np.array(end)
                capsules.append(
                    _Capsule(a, b, radius, int(SceneClass.CYCLIST), scene.people.count + 1 + index)
                )
        return capsules

    def _draw_capsules(
        self,
        capsules: list[_Capsule],
        pose: Array,
        rays: Array,
        depth: Array,
        label: NDArray[np.uint8],
        instance: NDArray[np.uint16],
    ) -> None:
        for capsule in capsules:
            pixels = self._pixels_around(capsule, pose)
            if not len(pixels):
                continue
            t = capsule_hits(pose[:3, 3], rays[pixels], capsule.start, capsule.end, capsule.radius_m)
            closer = t < depth[pixels]
            mine = pixels[closer]
            depth[mine], label[mine], instance[mine] = t[closer], capsule.class_id, capsule.instance_id

    def _pixels_around(self, capsule: _Capsule, pose: Array) -> NDArray[np.int64]:
        """Flat indices of a rectangle of pixels that holds the capsule's image; none when it is behind."""
        ends = (np.stack([capsule.start, capsule.end]) - pose[:3, 3]) @ pose[:3, :3]
        nearest = float(ends[:, 2].min()) - capsule.radius_m
        if nearest < 0.1:
            return np.zeros(0, np.int64)
        camera = self._camera
        image = camera.project(ends)
        if not np.isfinite(image).all():
            return np.zeros(0, np.int64)
        # Twice the radius: room for perspective and lens distortion.
        margin = 2.0 * capsule.radius_m * max(camera.fx, camera.fy) / nearest + 1.0
        left, top = np.floor(image.min(axis=0) - margin)
        right, bottom = np.ceil(image.max(axis=0) + margin)
        columns = np.arange(max(left, 0), min(right, camera.width), dtype=np.int64)
        rows = np.arange(max(top, 0), min(bottom, camera.height), dtype=np.int64)
        return np.asarray((rows[:, None] * camera.width + columns[None]).ravel())


def raycast_labels(scene: Scene, camera: Camera, t_s: float, world_from_camera: ArrayLike) -> RenderedFrame:
    """One frame of labels and depth without OpenGL; `LabelRaycaster` is quicker for many."""
    return LabelRaycaster(scene, camera).render(t_s, world_from_camera)
