"""Gradient noise on a grid (Perlin 1985), summed over octaves: the irregularity of ground and textures."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def _fade(t: NDArray[np.float64]) -> NDArray[np.float64]:
    return t * t * t * (t * (t * 6 - 15) + 10)


def gradient_noise(size: int, cells: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """One octave [size, size], periodic, about -0.7 to 0.7, with `cells` lattice cells along each side."""
    angle = rng.uniform(0.0, 2.0 * np.pi, (cells, cells))
    gradient_x, gradient_y = np.cos(angle), np.sin(angle)
    t = np.arange(size) * cells / size
    low = t.astype(np.int64) % cells
    high = (low + 1) % cells
    offset = t - np.floor(t)
    weight = _fade(offset)

    def corner(
        row: NDArray[np.int64], column: NDArray[np.int64], dy: float, dx: float
    ) -> NDArray[np.float64]:
        at = np.ix_(row, column)
        return np.asarray(gradient_x[at] * (offset - dx)[None, :] + gradient_y[at] * (offset - dy)[:, None])

    south = corner(low, low, 0, 0) * (1 - weight) + corner(low, high, 0, 1) * weight
    north = corner(high, low, 1, 0) * (1 - weight) + corner(high, high, 1, 1) * weight
    return np.asarray(south * (1 - weight)[:, None] + north * weight[:, None])


def fractal_noise(
    size: int, cells: int, octaves: int, rng: np.random.Generator, *, gain: float = 0.5, ridged: bool = False
) -> NDArray[np.float64]:
    """Octaves of `gradient_noise`, each twice as fine and `gain` as strong; [size, size], periodic.

    Plain noise lies around 0 within about +-0.6; `ridged` folds it into crests, about 0 to 1."""
    total = np.zeros((size, size))
    amplitude, weight = 1.0, 0.0
    for _ in range(octaves):
        if cells > size // 2:
            break
        octave = gradient_noise(size, cells, rng)
        total += amplitude * ((1.0 - 2.2 * np.abs(octave)) if ridged else 1.4 * octave)
        weight += amplitude
        amplitude *= gain
        cells *= 2
    return total / weight


def closed(periodic: NDArray[np.float64]) -> NDArray[np.float64]:
    """Periodic noise [N, N] with its first row and column repeated at the end: N + 1 lattice points."""
    return np.pad(periodic, (0, 1), mode="wrap")


def smooth_step(low: float, high: float, value: ArrayLike) -> NDArray[np.float64]:
    """0 below `low`, 1 above `high`, smooth in between."""
    t = np.clip((np.asarray(value, np.float64) - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))
