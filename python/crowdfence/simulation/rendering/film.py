"""The sample lattice on the GPU, and its development into an image with labels and depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.rendering.frame import RenderedFrame
from crowdfence.simulation.rendering.sample_lattice import SampleLattice
from crowdfence.simulation.rendering.shader_program import build_program, set_uniforms

if TYPE_CHECKING:
    import moderngl

_SKY_DEPTH = 1.0e29
_SCREEN = np.array([-1, -1, 3, -1, -1, 3], np.float32)


@dataclass(frozen=True, slots=True)
class Development:
    """What happens to the colours on the way from the lattice to the image."""

    noise_sigma: float
    noise_seed: int
    later_from_now: NDArray[np.float64] | None
    """[4, 4] camera at the end of the exposure from camera at its start; None = no motion blur."""


class Film:
    """Framebuffer of the lattice (colour, label, depth) and of the image."""

    def __init__(self, context: moderngl.Context, lattice: SampleLattice) -> None:
        self._context, self._lattice = context, lattice
        self._colour, self._label, self._depth, self.lattice_target = self._targets(
            lattice.width, lattice.height, with_depth_test=True
        )
        rows, columns = lattice.pixel_samples.shape[:2]
        self._shape = (rows, columns)
        self._image, self._image_label, self._image_depth, self._image_target = self._targets(columns, rows)
        self._samples = context.texture((columns, rows), 2, lattice.pixel_samples.tobytes(), dtype="f4")
        self._program = build_program(context, "screen.vert", "develop.frag")
        self._screen = context.vertex_array(
            self._program, [(context.buffer(_SCREEN.tobytes()), "2f", "in_corner")]
        )

    def _targets(
        self, width: int, height: int, *, with_depth_test: bool = False
    ) -> tuple[moderngl.Texture, moderngl.Texture, moderngl.Texture, moderngl.Framebuffer]:
        context, size = self._context, (width, height)
        colour = context.texture(size, 4)
        colour.repeat_x = colour.repeat_y = False
        label = context.texture(size, 2, dtype="u2")
        depth = context.texture(size, 1, dtype="f4")
        for exact in (label, depth):
            exact.filter = (context.NEAREST, context.NEAREST)
        tested = context.depth_renderbuffer(size) if with_depth_test else None
        return colour, label, depth, context.framebuffer([colour, label, depth], tested)

    def develop(self, how: Development) -> RenderedFrame:
        """Filter the lattice into the image and read it back."""
        lattice, context = self._lattice, self._context
        context.disable(context.DEPTH_TEST | context.CULL_FACE)
        self._image_target.use()
        for unit, texture in enumerate((self._colour, self._label, self._depth, self._samples)):
            texture.use(unit)
        set_uniforms(
            self._program,
            {
                "u_colour": 0,
                "u_label": 1,
                "u_depth": 2,
                "u_sample": 3,
                "u_samples_per_pixel": lattice.samples_per_pixel,
                "u_distorted": lattice.distorted,
                "u_pinhole": (lattice.fx, lattice.fy, lattice.cx, lattice.cy),
                "u_blurred": how.later_from_now is not None,
                "u_later_from_now": np.eye(4) if how.later_from_now is None else how.later_from_now,
                "u_noise_sigma": how.noise_sigma,
                "u_seed": how.noise_seed & 0xFFFFFFFF,
            },
        )
        self._screen.render()
        return self._read()

    def _read(self) -> RenderedFrame:
        rows, columns = self._shape
        rgba = np.frombuffer(self._image.read(), np.uint8).reshape(rows, columns, 4)
        label = np.frombuffer(self._image_label.read(), np.uint16).reshape(rows, columns, 2)
        depth = np.frombuffer(self._image_depth.read(), np.float32).reshape(rows, columns).copy()
        depth[depth > _SKY_DEPTH] = np.inf
        return RenderedFrame(
            np.ascontiguousarray(rgba[..., :3]),
            label[..., 0].astype(np.uint8),
            np.ascontiguousarray(label[..., 1]),
            depth,
        )
