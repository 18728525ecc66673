"""Draws the ground tile by tile, and the land behind it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.rendering.backdrop import backdrop
from crowdfence.simulation.rendering.clip_space import inside
from crowdfence.simulation.rendering.ground_tiles import LAYOUT, NAMES, ground_tiles
from crowdfence.simulation.rendering.season_palette import SeasonPalette
from crowdfence.simulation.rendering.shader_program import build_program, set_uniforms

if TYPE_CHECKING:
    import moderngl

_COMMAND_WORDS = 5  # count, instances, first index, base vertex, base instance


class GroundPainter:
    """The ground at full detail everywhere: labels and depth stay true at any distance."""

    def __init__(
        self,
        context: moderngl.Context,
        landscape: Landscape,
        palette: SeasonPalette,
        sun_direction: tuple[float, float, float],
        seed: int,
    ) -> None:
        self._context = context
        self.program = build_program(context, "ground.vert", "ground.frag")
        self._tiles = ground_tiles(landscape.surface, sun_direction)
        self._near = self._vertex_array(self._tiles.vertices, self._tiles.pattern)
        heights = landscape.surface.height_m
        relief_m = max(float(heights.max() - heights.min()), 30.0)
        self._far = self._vertex_array(*backdrop(landscape.surface, relief_m, seed))
        self._commands = context.buffer(reserve=len(self._tiles.centre) * _COMMAND_WORDS * 4, dynamic=True)
        road = landscape.road
        set_uniforms(
            self.program,
            {
                "u_cover_colour": palette.covers(),
                "u_road_half_width_m": road.half_width_m if road else 3.0,
                "u_road_marked": road.marked if road else False,
            },
        )

    def _vertex_array(self, vertices: NDArray[np.void], index: NDArray[np.uint32]) -> moderngl.VertexArray:
        buffer = self._context.buffer(vertices.tobytes())
        content = [(buffer, LAYOUT, *NAMES)]
        return self._context.vertex_array(
            self.program, content, self._context.buffer(index.tobytes()), skip_errors=True
        )

    def paint(self, planes: NDArray[np.float64], eye: NDArray[np.float64]) -> None:
        """Draw what lies inside `planes`, nearest tiles first, so that hidden fragments cost nothing."""
        tiles = self._tiles
        seen = np.flatnonzero(inside(planes, tiles.centre, tiles.radius_m))
        self._context.enable(self._context.CULL_FACE)
        if len(seen):
            order = seen[np.argsort(np.linalg.norm(tiles.centre[seen] - eye, axis=1))]
            commands = np.zeros((len(order), _COMMAND_WORDS), np.uint32)
            commands[:, 0], commands[:, 1] = len(tiles.pattern), 1
            commands[:, 3] = tiles.first_vertex[order]
            self._commands.write(commands.tobytes())
            self._near.render_indirect(self._commands, count=len(order))
        self._context.disable(self._context.CULL_FACE)
        self._far.render()
