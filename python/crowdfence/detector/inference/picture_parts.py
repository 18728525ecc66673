"""A picture in parts, each at the size at which a model knows the people in it.

Metres per pixel differ within a picture: the ground below a drone is near, the ground at the horizon far.
Every cell of the heatmap is answered for by one part alone. Parts are cut out with a margin beyond those
cells, so that what decides about a cell lies in its part, and answers are not blended, which would undo their
calibration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.ground_scale import Gsd, across, at_cells, with_nearest
from crowdfence.detector.inference.covering_boxes import covering_boxes
from crowdfence.detector.inference.image_tensor import Image

MARGIN_PX = 32
"""Pixels around the cells of a part, at the size that the model sees."""
PART_COST_PX = 16_384
"""What a part costs beside its pixels: cut out, resized and put back, and one more start of the model."""
SMALLEST_SIZE = 1.0 / 64.0
ENLARGED = (2.0, 2.0**0.5)
"""Sizes of ground that is too far away, the better one first."""
AFFORDABLE_PX = 640 * 480
AFFORDABLE_SHARE = 1.15
"""Far ground is enlarged as long as the model sees at most this share of the picture's own pixels, or of
those of a 640 x 480 picture where it is smaller: meant for 30 frames a second on one core."""

SUSPICION = 0.05
"""Where a whole far part is not affordable, its cells above this are looked at again, enlarged."""
_AROUND_CELLS = 3

Enlarge = Literal["never", "affordable", "always"]


@dataclass(frozen=True, slots=True, eq=False)
class PicturePart:
    """A rectangle of a picture, shown at `size` (0.5: half as wide and half as high)."""

    size: float
    rows: slice
    """Pixels of the picture that are cut out; the ends are whole cells, but for the picture's own edge."""
    columns: slice
    own: NDArray[np.bool_] | None
    """Cells [h, w] of the whole heatmap that the part answers for; None: all."""

    @property
    def is_whole_picture(self) -> bool:
        return self.size == 1.0 and self.own is None

    @property
    def scales(self) -> tuple[float, float]:
        """`size` downwards and across as it is: the pixels that the model sees are whole ones."""
        height, width = (span.stop - span.start for span in (self.rows, self.columns))
        return _shown_px(height, self.size) / height, _shown_px(width, self.size) / width

    @property
    def shown_pixels(self) -> int:
        height, width = (span.stop - span.start for span in (self.rows, self.columns))
        return round(height * width * self.size**2)

    def shown(self, image: Image) -> Image:
        """Pixels that the model sees."""
        cut = image[self.rows, self.columns]
        return cut if self.size == 1.0 else resized(cut, self.size)


def parts_by_gsd(
    gsd_m: Gsd,
    known_m: tuple[float, float],
    image: Image,
    stride: int,
    enlarge: Enlarge = "affordable",
    *,
    whole: bool = False,
) -> list[PicturePart]:
    """The parts of an image [H, W, 3] whose heatmap has cells of `stride` pixels: few for each size needed.

    known_m: metres per pixel that the model knows. whole: every part shows the whole picture, at its size,
    so that pictures of a camera have a handful of shapes. ValueError for metres per pixel that are none.
    """
    across_m = across(gsd_m)
    pixels = image.shape[0] * image.shape[1]
    for enlarged in () if enlarge == "never" else ENLARGED:
        parts = _parts(_sizes(across_m, known_m, enlarged), image, stride, whole)
        shown = sum(part.shown_pixels for part in parts)
        if enlarge == "always" or shown <= AFFORDABLE_SHARE * max(pixels, AFFORDABLE_PX):
            return parts
    return _parts(_sizes(across_m, known_m, 1.0), image, stride, whole)


def near_parts(
    gsd_m: Gsd, known_m: tuple[float, float], image: Image, stride: int, *, whole: bool = False
) -> tuple[list[PicturePart], NDArray[np.bool_]]:
    """The same without ground that is too far away and the sky above it: none of the parts answers for their
    cells [h, w], which are the second."""
    across_m = across(gsd_m)
    far = with_nearest(across_m) > known_m[1]
    parts = _parts(np.where(far, 0.0, _sizes(across_m, known_m, 1.0)), image, stride, whole)
    return parts, at_cells(far, (-(-image.shape[0] // stride), -(-image.shape[1] // stride)))


def suspicious_parts(
    heatmap: NDArray[np.float32], parts: list[PicturePart], far: NDArray[np.bool_], image: Image, stride: int
) -> list[PicturePart]:
    """Parts of the ground that is too far (cells [h, w]) where the model, which saw it at its own size, is
    not sure that nobody is: those with most crowd to be expected below one half, as far as is affordable."""
    from scipy.ndimage import binary_dilation, find_objects, label

    expected = np.where(far & (heatmap <= 0.5), heatmap, 0.0)
    near_suspicion = binary_dilation(far & (heatmap > SUSPICION), iterations=_AROUND_CELLS) & far
    numbers, count = label(near_suspicion, structure=np.ones((3, 3)))
    left_px = AFFORDABLE_SHARE * max(image.shape[0] * image.shape[1], AFFORDABLE_PX)
    left_px -= sum(part.shown_pixels for part in parts)
    found: list[tuple[float, PicturePart]] = []
    for number, box in enumerate(find_objects(numbers, count), start=1):
        part = _part(ENLARGED[0], numbers == number, box, image, stride)
        found.append((float(expected[part.own].sum()), part))
    chosen = []
    for mass, part in sorted(found, key=lambda one: -one[0] / one[1].shown_pixels):
        if mass > 0.0 and part.shown_pixels <= left_px:
            chosen.append(part)
            left_px -= part.shown_pixels
    return chosen


def far_cells(gsd_m: Gsd, known_m: tuple[float, float], cells: tuple[int, int]) -> NDArray[np.bool_]:
    """Cells [h, w] of ground that is coarser than the model knows; never of what is no ground."""
    across_m = across(gsd_m)
    return np.asarray(at_cells(across_m, cells) > known_m[1])


def resized(image: Image, size: float) -> Image:
    """The image at another size, softened first where it shrinks."""
    from PIL import Image as Pillow

    height, width = (_shown_px(side, size) for side in image.shape[:2])
    method = Pillow.Resampling.BILINEAR if size < 1.0 else Pillow.Resampling.BICUBIC
    return np.asarray(Pillow.fromarray(np.ascontiguousarray(image)).resize((width, height), method))


def _shown_px(side: int, size: float) -> int:
    return max(1, round(side * size))


def _sizes(gsd_m: NDArray[np.float32], known_m: tuple[float, float], enlarged: float) -> NDArray[np.float32]:
    """Size for each metres per pixel; where no ground is seen that of the nearest, but never enlarged: nobody
    stands in the sky."""
    filled, (low, high) = with_nearest(gsd_m), known_m
    halvings = np.ceil(np.log2(np.maximum(low / filled, 1.0)) - 1e-6)
    sizes = np.maximum(0.5**halvings, SMALLEST_SIZE)
    return np.where((filled > high) & np.isfinite(gsd_m), enlarged, sizes).astype(np.float32)


def _parts(sizes: NDArray[np.float32], image: Image, stride: int, whole: bool = False) -> list[PicturePart]:
    """The parts of each size [r, c] over the image; none of size 0."""
    height, width = image.shape[:2]
    if (sizes == 1.0).all():
        return [PicturePart(1.0, slice(0, height), slice(0, width), None)]
    size_of_cell = at_cells(sizes, (-(-height // stride), -(-width // stride)))
    parts = []
    for size in np.unique(size_of_cell[size_of_cell > 0.0]).tolist():
        cells = size_of_cell == size
        if whole:
            parts.append(PicturePart(size, slice(0, height), slice(0, width), cells))
            continue
        cost = PART_COST_PX / (size * stride) ** 2
        for box in covering_boxes(cells, _margin_cells(size, stride), cost):
            own = np.zeros_like(cells)
            own[box] = cells[box]
            parts.append(_part(size, own, box, image, stride))
    return parts


def _part(
    size: float, own: NDArray[np.bool_], box: tuple[slice, slice], image: Image, stride: int
) -> PicturePart:
    """Answers for its own cells, which lie in a box of rows and columns of cells."""
    margin = _margin_cells(size, stride)
    rows, columns = (
        slice(max(0, (cells.start - margin) * stride), min(pixels, (cells.stop + margin) * stride))
        for cells, pixels in zip(box, image.shape[:2], strict=True)
    )
    return PicturePart(size, rows, columns, own)


def _margin_cells(size: float, stride: int) -> int:
    """Cells of the picture around a part."""
    return int(np.ceil(MARGIN_PX / (size * stride)))
