"""One tiling texture of four noises: the grain of everything."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crowdfence.simulation.landscape.noise import fractal_noise

if TYPE_CHECKING:
    import moderngl

_SIZE = 512


def noise_texture(context: moderngl.Context, seed: int) -> moderngl.Texture:
    """RGBA texture, each channel an independent noise with mean 0.5 and standard deviation 0.2."""
    rng = np.random.default_rng([seed, 602])
    channels = []
    for _ in range(4):
        noise = fractal_noise(_SIZE, 8, 6, rng, gain=0.6)
        channels.append(np.clip(0.5 + 0.2 * (noise - noise.mean()) / noise.std(), 0, 1))
    pixels = np.round(255 * np.stack(channels, axis=-1)).astype(np.uint8)
    texture = context.texture((_SIZE, _SIZE), 4, pixels.tobytes())
    texture.build_mipmaps()
    texture.filter = (0x2701, 0x2601)  # GL_LINEAR_MIPMAP_NEAREST (half the cost of trilinear), GL_LINEAR
    return texture
