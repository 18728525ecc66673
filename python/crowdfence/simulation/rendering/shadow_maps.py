"""Two shadow maps: one of all that stands still, drawn once; one around the view, drawn every frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.rendering.clip_space import light_from_world, side_planes, texture_from_clip

if TYPE_CHECKING:
    import moderngl

_FAR_TEXELS, _NEAR_TEXELS = 4096, 2048
_FAR_DEPTH_M, _NEAR_DEPTH_M = 2500.0, 400.0
_FAR_BIAS_M, _NEAR_BIAS_M = 0.6, 0.12
_FOCUS_REACH_M, _NEAR_RADIUS_M = 110.0, (40.0, 120.0)
NEAR_UNIT, FAR_UNIT = 1, 2

Cast = Callable[[NDArray[np.float64]], None]
"""Draws the casters inside a clip space [4, 4] into the current framebuffer."""


class ShadowMaps:
    """Depth along the sun's rays, near and far."""

    def __init__(self, context: moderngl.Context, sun_direction: tuple[float, float, float]) -> None:
        self._context, self._sun = context, sun_direction
        self._near, self._near_target = self._map(_NEAR_TEXELS)
        self._far, self._far_target = self._map(_FAR_TEXELS)
        self._near_matrix = self._far_matrix = np.eye(4)

    def _map(self, texels: int) -> tuple[moderngl.Texture, moderngl.Framebuffer]:
        depth = self._context.depth_texture((texels, texels))
        depth.compare_func = "<="
        depth.repeat_x = depth.repeat_y = False
        return depth, self._context.framebuffer([], depth)

    def draw_far(self, centre: NDArray[np.float64], radius_m: float, cast: Cast) -> None:
        """Draw the map of what stands still."""
        clip = light_from_world(self._sun, centre, radius_m, _FAR_TEXELS, _FAR_DEPTH_M)
        self._far_matrix = texture_from_clip(_FAR_BIAS_M, _FAR_DEPTH_M) @ clip
        self._draw(self._far_target, clip, cast)

    def draw_near(self, focus: NDArray[np.float64], radius_m: float, cast: Cast) -> None:
        """Draw the map around `focus`."""
        clip = light_from_world(self._sun, focus, radius_m, _NEAR_TEXELS, _NEAR_DEPTH_M)
        self._near_matrix = texture_from_clip(_NEAR_BIAS_M, _NEAR_DEPTH_M) @ clip
        self._draw(self._near_target, clip, cast)

    def _draw(self, target: moderngl.Framebuffer, clip: NDArray[np.float64], cast: Cast) -> None:
        target.use()
        target.clear(depth=1.0)
        self._context.disable(self._context.CULL_FACE)
        cast(clip)

    def uniforms(self) -> dict[str, Any]:
        """What air.glsl needs; also binds the two textures."""
        self._near.use(NEAR_UNIT)
        self._far.use(FAR_UNIT)
        return {
            "u_near_shadow": NEAR_UNIT,
            "u_far_shadow": FAR_UNIT,
            "u_near_shadow_from_world": self._near_matrix,
            "u_far_shadow_from_world": self._far_matrix,
            "u_shadow_texel": (1.0 / _NEAR_TEXELS, 1.0 / _FAR_TEXELS),
        }


def caster_planes(clip: NDArray[np.float64]) -> NDArray[np.float64]:
    """The four sides of a light's clip space; nothing is too far up or down to cast."""
    return side_planes(clip)[:4]


def shadow_focus(
    world_from_camera: NDArray[np.float64], landscape: Landscape
) -> tuple[NDArray[np.float64], float]:
    """Where the optical axis meets the ground (at most 110 m ahead), and how far to draw around it."""
    eye, ahead = world_from_camera[:3, 3], world_from_camera[:3, 2]
    reach = np.linspace(2.0, _FOCUS_REACH_M, 60)
    points = eye + reach[:, None] * ahead
    below = points[:, 2] < landscape.height_m(points[:, 0], points[:, 1])
    distance = float(reach[np.argmax(below)]) if below.any() else _FOCUS_REACH_M
    return eye + distance * ahead, float(np.clip(1.1 * distance, *_NEAR_RADIUS_M))
