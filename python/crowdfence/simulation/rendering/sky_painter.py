"""Draws the sky behind everything."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crowdfence.simulation.rendering.shader_program import build_program

if TYPE_CHECKING:
    import moderngl

_ROWS = 16  # strips, so that a rolling exposure bends the horizon


class SkyPainter:
    """Horizontal strips over the whole image."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self.program = build_program(context, "sky.vert", "sky.frag")
        y = np.linspace(-1.0, 1.0, _ROWS + 1)
        strips = np.stack([np.tile([-1.0, 1.0], _ROWS + 1), np.repeat(y, 2)], axis=-1).astype(np.float32)
        self._strips = context.vertex_array(
            self.program, [(context.buffer(strips.tobytes()), "2f", "in_corner")]
        )

    def paint(self) -> None:
        """Fill what nothing has covered."""
        self._context.disable(self._context.CULL_FACE)
        self._context.depth_func = "<="
        self._strips.render(self._context.TRIANGLE_STRIP)
        self._context.depth_func = "<"
