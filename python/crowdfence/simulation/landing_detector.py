"""A stand-in for a detector of landing sites: the truth, seen through mistakes of two kinds.

Some change from picture to picture, as those of the stand-in for crowds do. Others stay with a place, at
every look and of every drone, as a meadow that looks like a marsh does: no number of looks mends them. It
says nothing about how well a real detector does.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from crowdfence.block_means import block_means
from crowdfence.simulation.random_streams import Stream, stream
from crowdfence.simulation.simulated_detector import STRIDE
from crowdfence.sources.layers import LayerGround

if TYPE_CHECKING:
    from crowdfence._core import Camera


@dataclass(frozen=True, slots=True)
class LandingDetector:
    """Logit of a cell = `gain` * (blurred share of landing ground - 0.5) + `noise` * smooth noise of the
    picture + `place_noise` * smooth noise of the ground."""

    gain: float = 6.0
    blur_cells: float = 1.0
    noise: float = 1.6
    noise_cells: float = 2.0
    place_noise: float = 1.6
    place_m: float = 8.0

    def mistakes(self, ground: LayerGround, seed: int) -> NDArray[np.float64]:
        """What stays with every place [X, Y] of a mission."""
        smooth_cells = self.place_m / ground.cell_m
        rng = stream(seed, Stream.LANDING_PLACES)
        return self.place_noise * _smooth(rng, ground.cells.shape, smooth_cells)

    def heatmap(
        self,
        labels: NDArray[np.bool_],
        mistakes: NDArray[np.float64],
        seed: int,
        drone: int,
        frame: int,
    ) -> NDArray[np.uint8]:
        """Heatmap [H / 4, W / 4] (value / 255) of one image from what its pixels show [H, W]: landing ground,
        and the mistakes of the place (0 = sky). Equal for equal arguments; H and W are multiples of 4."""
        share = block_means(labels, STRIDE).astype(np.float64)
        rng = stream(seed, Stream.LANDING_FRAMES, drone, frame)
        logit = self.gain * (gaussian_filter(share, self.blur_cells) - 0.5)
        logit += self.noise * _smooth(rng, share.shape, self.noise_cells)
        logit += block_means(mistakes, STRIDE)
        return np.rint(255.0 / (1.0 + np.exp(-logit))).astype(np.uint8)

    def manifest(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {"made_by": "simulated detector: true ground with mistakes", "stride": STRIDE, **asdict(self)}


def shown(
    ground: LayerGround,
    values: NDArray[Any],
    depth_m: NDArray[np.floating[Any]],
    camera: Camera,
    world_from_camera: NDArray[np.float64],
) -> NDArray[Any]:
    """The value of the cell [X, Y] of the ground that each pixel of an image shows [H, W], from its depth
    along the camera's axis; 0 without depth and off the ground."""
    rows, columns = depth_m.shape
    u, v = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    rays = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=-1))
    with np.errstate(invalid="ignore"):
        along = rays * (depth_m.ravel().astype(np.float64) / rays[:, 2])[:, None]
        xy = (along @ world_from_camera[:3, :3].T + world_from_camera[:3, 3])[:, :2]
    return ground.values_at(values, xy).reshape(depth_m.shape)


def _smooth(rng: np.random.Generator, shape: tuple[int, ...], cells: float) -> NDArray[np.float64]:
    """Noise with a standard deviation of about 1."""
    smooth = gaussian_filter(rng.normal(size=shape), cells, mode="wrap")
    return np.asarray(smooth * 2.0 * np.sqrt(np.pi) * cells)
