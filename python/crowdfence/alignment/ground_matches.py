"""The same ground in two pictures.

Pose and map say nearly where every point of one picture lies in another. So the second picture is drawn as
the first camera would see it, which takes out height, heading and tilt, and what is left is a small shift of
every corner: Lucas-Kanade follows it there and back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.detector.ground_sampling import rays_or_nan
from crowdfence.sources.recording import Frame

MAX_RANGE_M = 200.0
_WIDTH = 640
"""Pictures are looked at in this width; more shows the same."""
_STEP = 4
"""Rays are cast to every fourth pixel and what they meet is interpolated."""
_TILE_PX, _RIM_PX = 32, 8
_FAINTEST = 1e-5
"""Least eigenvalue of a corner."""
_WINDOW_PX = 21
_LEVELS = 3
_EVEN_PX, _EVEN_CONTRAST, _LEAST_SPREAD = 43, 40.0, 1.0
"""Contrast in so wide a square around every pixel becomes the second; the third, in grey values, is noise."""
_THERE_AND_BACK_PX = 0.5
_LEAST_ALIKE = 0.75
_PATCH = 13
_HIDDEN_M, _HIDDEN_SHARE = 1.0, 0.05


@dataclass(frozen=True, slots=True, eq=False)
class GroundMatches:
    """N points of the ground in two frames; pixels are those of the recorded pictures."""

    first: int
    second: int
    """Numbers of the frames."""
    pixels_first: NDArray[np.float64]
    """[N, 2]"""
    pixels_second: NDArray[np.float64]
    """[N, 2]"""

    def __len__(self) -> int:
        return len(self.pixels_first)

    def thinned(self, most: int) -> GroundMatches:
        """At most `most` of them, from all over the picture."""
        some = np.unique(np.linspace(0, len(self) - 1, min(most, len(self))).round().astype(int))
        return GroundMatches(self.first, self.second, self.pixels_first[some], self.pixels_second[some])


@dataclass(eq=False)
class SeenGround:
    """A frame, and the ground that it sees by the pose it has now."""

    frame: Frame
    terrain: Terrain
    pose: NDArray[np.float64]
    """world_from_camera [4, 4]"""
    grey: NDArray[np.uint8]
    """[h, w] at working size."""

    @cached_property
    def evened(self) -> NDArray[np.uint8]:
        """`grey` as it is followed."""
        return _evened(self.grey)

    @property
    def scale(self) -> float:
        """Working pixels per recorded pixel."""
        return self.grey.shape[1] / self.frame.camera.width

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """Ground at every `_STEP`th working pixel [rows, columns, 3]; NaN where there is none."""
        pixels, shape = _grid(self.grey.shape)
        rays = rays_or_nan(self.frame.camera, pixels / self.scale)
        points = np.full((len(pixels), 3), np.nan)
        usable = np.isfinite(rays).all(axis=1)
        points[usable] = ground_points(self.terrain, self.pose, rays[usable])
        return points.reshape(*shape, 3)

    @cached_property
    def _away_m(self) -> NDArray[np.float64]:
        """How far `points` are [rows, columns]."""
        return np.asarray(np.linalg.norm(self.points - self.pose[:3, 3], axis=-1))

    @cached_property
    def corners(self) -> NDArray[np.float32]:
        """[N, 2] working pixels where the picture can be recognised, one in each tile: the strongest of a
        whole picture are all on people, trees and roofs, which are not on the map."""
        seen = _full(np.isfinite(self.points[..., 0]).astype(np.float32), self.grey.shape) > 0.99
        strength = np.where(seen, cv2.cornerMinEigenVal(self.grey, 5), 0.0)
        height, width = strength.shape
        found = []
        for top in range(_RIM_PX, height - _RIM_PX, _TILE_PX):
            for left in range(_RIM_PX, width - _RIM_PX, _TILE_PX):
                bottom, right = min(top + _TILE_PX, height - _RIM_PX), min(left + _TILE_PX, width - _RIM_PX)
                tile = strength[top:bottom, left:right]
                row, column = np.unravel_index(tile.argmax(), tile.shape)
                if tile[row, column] > _FAINTEST:
                    found.append((left + column, top + row))
        return np.array(found, np.float32).reshape(-1, 2)

    def sees(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Working pixels [N, 2] of world points [N, 3], and which of them nothing hides."""
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        ahead = np.flatnonzero(local[:, 2] > 0)
        pixels = np.full((len(points), 2), np.nan)
        pixels[ahead] = self.frame.camera.project(local[ahead]) * self.scale
        height, width = self.grey.shape
        x, y = pixels.T
        inside = np.flatnonzero((x >= 0) & (x < width) & (y >= 0) & (y < height))
        rows, columns = self._away_m.shape
        column = np.minimum((x[inside] / _STEP).astype(int), columns - 1)
        row = np.minimum((y[inside] / _STEP).astype(int), rows - 1)
        away_m = np.linalg.norm(local[inside], axis=1)
        behind_m = np.abs(away_m - self._away_m[row, column])
        open_ = np.zeros(len(points), np.bool_)
        open_[inside] = behind_m < _HIDDEN_M + _HIDDEN_SHARE * away_m
        return pixels, open_


def working_picture(frame: Frame) -> NDArray[np.uint8]:
    """The picture of a frame, grey. FrameError when it cannot be read."""
    grey = cv2.cvtColor(frame.image(), cv2.COLOR_RGB2GRAY)
    if grey.shape[1] > _WIDTH:
        height = round(grey.shape[0] * _WIDTH / grey.shape[1])
        grey = cv2.resize(grey, (_WIDTH, height), interpolation=cv2.INTER_AREA)
    return np.asarray(grey, np.uint8)


def ground_points(
    terrain: Terrain, pose: NDArray[np.float64], rays: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Where rays [N, 3] in camera axes meet the ground [N, 3]; NaN where they do not. One pose [4, 4], or one
    each [N, 4, 4]."""
    directions = np.einsum("...ij,...j->...i", pose[..., :3, :3], rays)
    origins = np.broadcast_to(pose[..., :3, 3], directions.shape)
    _, metres = terrain.raycast(origins, directions, MAX_RANGE_M)
    metres = np.where(np.isfinite(metres) & (metres > 0.5), metres, np.nan)
    return np.asarray(origins + directions * metres[:, None])


def shared_ground(first: SeenGround, second: SeenGround) -> float:
    """Share of the first picture whose ground the second shows."""
    points = first.points[::4, ::4].reshape(-1, 3)
    _, open_ = second.sees(points)
    return float(open_.mean())


def match_ground(
    first: SeenGround, second: SeenGround, numbers: tuple[int, int], reach_px: float
) -> GroundMatches:
    """Corners of the first picture found in the second, at most `reach_px` from where the poses put them."""
    shape = first.grey.shape
    pixels, open_ = second.sees(first.points.reshape(-1, 3))
    rows, columns, _ = first.points.shape
    pixels[~np.isfinite(pixels).all(axis=1)] = -1e4
    places = _full(pixels.reshape(rows, columns, 2).astype(np.float32), shape)
    shown = _full(open_.reshape(rows, columns).astype(np.float32), shape) > 0.99
    # OpenCV counts from the centre of the first pixel, cameras from its corner.
    drawn: Any = cv2.remap(second.grey, places - np.float32(0.5), cast(Any, None), cv2.INTER_LINEAR)
    corners = first.corners
    corners = corners[shown[_at(corners, shape)]]
    none = GroundMatches(*numbers, np.zeros((0, 2)), np.zeros((0, 2)))
    if len(corners) == 0:
        return none
    found, good = _followed(first.evened, _evened(drawn), corners, reach_px)
    inside = (found >= 0).all(axis=1) & (found < [shape[1] - 1, shape[0] - 1]).all(axis=1)
    good &= inside
    corners, found = corners[good], found[good]
    if len(corners) == 0:
        return none
    alike = shown[_at(found, shape)] & (_likeness(first.grey, drawn, corners, found) > _LEAST_ALIKE)
    corners, found = corners[alike], found[alike]
    if len(corners) == 0:
        return none
    back: Any = cv2.remap(places, found[:, 0].reshape(-1, 1), found[:, 1].reshape(-1, 1), cv2.INTER_LINEAR)
    here, there = ((corners + 0.5) / first.scale, back.reshape(-1, 2) / second.scale)
    return GroundMatches(*numbers, np.asarray(here, np.float64), np.asarray(there, np.float64))


def _evened(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture of the same brightness and contrast everywhere: Lucas-Kanade takes it that the same ground is
    as bright in two pictures, and cameras differ in exposure, and in haze."""
    here = grey.astype(np.float32)
    around = (_EVEN_PX, _EVEN_PX)
    off = here - cv2.blur(here, around)
    spread = np.sqrt(np.maximum(cv2.blur(off * off, around), _LEAST_SPREAD**2))
    even = 128.0 + _EVEN_CONTRAST * off / spread
    return np.clip(even, 0, 255).astype(np.uint8)


def _followed(
    here: NDArray[np.uint8], there: NDArray[np.uint8], corners: NDArray[np.float32], reach_px: float
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    def follow(a: Any, b: Any, places: Any) -> tuple[Any, Any, Any]:
        return cv2.calcOpticalFlowPyrLK(
            a, b, places, cast(Any, None), winSize=(_WINDOW_PX, _WINDOW_PX), maxLevel=_LEVELS
        )

    start = corners.reshape(-1, 1, 2)
    found, status, _ = follow(here, there, start)
    again, back_status, _ = follow(there, here, found)
    off = np.linalg.norm((again - start).reshape(-1, 2), axis=1)
    moved = np.linalg.norm((found - start).reshape(-1, 2), axis=1)
    good = (
        (status.ravel() == 1) & (back_status.ravel() == 1) & (off < _THERE_AND_BACK_PX) & (moved < reach_px)
    )
    return found.reshape(-1, 2), good


def _likeness(
    here: NDArray[np.uint8],
    there: NDArray[np.uint8],
    corners: NDArray[np.float32],
    found: NDArray[np.float32],
) -> NDArray[np.float64]:
    """Normalised correlation of the patches around each pair of places."""
    a, b = (_patches(picture, at) for picture, at in ((here, corners), (there, found)))
    a, b = (p - p.mean(axis=1, keepdims=True) for p in (a, b))
    return np.asarray((a * b).sum(axis=1) / np.sqrt((a**2).sum(axis=1) * (b**2).sum(axis=1) + 1e-6))


def _patches(picture: NDArray[np.uint8], at: NDArray[np.float32]) -> NDArray[np.float64]:
    side = np.arange(_PATCH, dtype=np.float32) - _PATCH // 2
    dx, dy = (grid.ravel() for grid in np.meshgrid(side, side))
    drawn = cv2.remap(
        picture, at[:, :1] + dx, at[:, 1:] + dy, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return drawn.astype(np.float64)


def _grid(shape: tuple[int, ...]) -> tuple[NDArray[np.float64], tuple[int, int]]:
    """Middles of the blocks of `_STEP` pixels, as continuous pixels [N, 2], and how many rows and columns."""
    height, width = shape
    rows, columns = height // _STEP, width // _STEP
    x, y = np.meshgrid((np.arange(columns) + 0.5) * _STEP, (np.arange(rows) + 0.5) * _STEP)
    return np.stack([x, y], axis=-1).reshape(-1, 2), (rows, columns)


def _full(grid: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """A grid of blocks at the working size; the blocks cover it but for a remainder of pixels."""
    rows, columns = grid.shape[:2]
    drawn = cv2.resize(grid, (columns * _STEP, rows * _STEP), interpolation=cv2.INTER_LINEAR)
    below, right = shape[0] - rows * _STEP, shape[1] - columns * _STEP
    return np.asarray(cv2.copyMakeBorder(drawn, 0, below, 0, right, cv2.BORDER_REPLICATE))


def _at(places: NDArray[np.float32], shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    column = np.clip(np.rint(places[:, 0]), 0, shape[1] - 1).astype(np.int64)
    row = np.clip(np.rint(places[:, 1]), 0, shape[0] - 1).astype(np.int64)
    return row, column
