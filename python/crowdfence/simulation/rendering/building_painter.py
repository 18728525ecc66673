"""Draws buildings: walls with windows, roofs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.building import Building
from crowdfence.simulation.rendering.shader_program import build_program, set_uniforms

if TYPE_CHECKING:
    import moderngl

_VERTEX = np.dtype(
    [
        ("position", np.float32, 3),
        ("normal", np.float32, 3),
        ("colour", np.uint8, 4),
        ("wall", np.float32, 2),
    ]
)
_NAMES = ("in_position", "in_normal", "in_colour", "in_wall")


def building_vertices(buildings: tuple[Building, ...]) -> NDArray[np.void]:
    """Three vertices per triangle [3 * M]: faces are flat."""
    parts = []
    for building in buildings:
        corners = building.mesh.vertices[building.mesh.triangles]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        part = np.zeros((len(corners), 3), _VERTEX)
        part["position"] = corners
        part["normal"] = normal[:, None]
        part["colour"][..., :3] = building.colour[:, None]
        part["wall"][..., 0] = building.windows[:, None]
        part["wall"][..., 1] = corners[..., 2] - building.foot_m
        parts.append(part.reshape(-1))
    return np.concatenate(parts) if parts else np.zeros(0, _VERTEX)


class BuildingPainter:
    """All buildings of a landscape in one call; nothing when there are none."""

    def __init__(self, context: moderngl.Context, buildings: tuple[Building, ...]) -> None:
        self._context = context
        self.program = build_program(context, "building.vert", "building.frag")
        self._shadow_program = build_program(context, "solid_shadow.vert", "shadow.frag")
        vertices = building_vertices(buildings)
        self._picture = self._shadow = None
        if len(vertices):
            buffer = context.buffer(vertices.tobytes())
            self._picture = context.vertex_array(
                self.program, [(buffer, "3f 3f 3f1 1x1 2f", *_NAMES)], skip_errors=True
            )
            self._shadow = context.vertex_array(self._shadow_program, [(buffer, "3f 24x", "in_position")])

    def paint(self) -> None:
        """Draw into the current picture."""
        if self._picture is not None:
            self._context.enable(self._context.CULL_FACE)
            self._picture.render()

    def cast(self, clip: NDArray[np.float64]) -> None:
        """Draw into the current shadow map."""
        if self._shadow is not None:
            set_uniforms(self._shadow_program, {"u_shadow_clip_from_world": clip})
            self._shadow.render()
