"""Annotations -> the pixels that are crowd: outlined crowds, and people to whom the definition is applied."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.contract.two_corners import are_two_corners
from crowdfence.labelled_pictures.annotated_picture import (
    AnnotatedPicture,
    AnnotationError,
    Polygon,
    distinct,
)
from crowdfence.truth.at_exposure import DEFAULT_CROWD
from crowdfence.truth.crowd_ground import PERSON_RADIUS_M
from crowdfence.truth.morphology import close_with_disc

PERSON_HEIGHT_M = 1.7
"""What an upright person's box stands for, where nobody says how many metres a pixel is."""
_POINT_PX = 1.0
"""Boxes up to this size are people marked as points by programs that know boxes only."""
_NEAREST = 5
"""Boxes whose median tells the scale at a person: some sit, some are cut off by others."""
_MOST_PIXELS = 400_000_000
_FARTHEST_PX = 1_000_000
"""From the picture's corner, of a mark: whoever draws counts in whole numbers, which end."""
_GRID = 4
"""Pixels per cell on which the ground of crowds is drawn."""


class PictureLabels(NamedTuple):
    """Pixels [H, W]."""

    crowd: NDArray[np.bool_]
    ignored: NDArray[np.bool_]


def picture_labels(picture: AnnotatedPicture) -> PictureLabels:
    """Crowds as outlined, and the ground of every group of at least three people within 2 m: discs of 1 m
    around them, closed with a disc of 2 m as on the terrain. Who is marked twice counts once. Metres are
    those of the picture's `gsd_m`, else of the people's boxes; ground seen at a low angle counts as if seen
    from above, which errs towards crowd.

    AnnotationError for people of unknown size in a picture of unknown scale, and for marks that are in other
    units than pixels of the picture.
    """
    if picture.width * picture.height > _MOST_PIXELS:
        raise AnnotationError(
            f"{picture.path.name}: {picture.width} x {picture.height} pixels are too many; allowed: "
            f"{_MOST_PIXELS:,}"
        )
    _require_pixels(picture)
    crowd = _drawn(picture.crowds, picture)
    people = distinct(picture.people)
    if len(people) >= DEFAULT_CROWD["min_people"]:
        gsd_m = _gsd_at(people, picture)
        members = in_crowds(people[:, :2], gsd_m)
        crowd |= _ground(people[members], gsd_m[members], picture)
    return PictureLabels(crowd, _drawn(picture.ignored, picture))


def _require_pixels(picture: AnnotatedPicture) -> None:
    """Marks in fractions, or made on a larger copy of the picture, would leave it empty in silence. A few
    beyond its edges are mistakes of a hand."""
    x, bottom, width, height = picture.people.T
    boxes = np.stack([x - width / 2.0, bottom - height, x + width / 2.0, bottom], axis=1)
    _refuse_corners(boxes[height > _POINT_PX], picture)
    outlines = (*picture.crowds, *picture.ignored)
    spans = np.array([[*one.min(axis=0), *one.max(axis=0)] for one in outlines]).reshape(-1, 4)
    left, top, right, bottom = np.concatenate([boxes, spans]).T
    if not len(left):
        return
    reach = np.stack([left, top, right, bottom]).ravel()
    farthest = float(reach[np.abs(reach).argmax()])
    if abs(farthest) > _FARTHEST_PX:
        raise AnnotationError(
            f"{picture.path.name}: a mark reaches to pixel {farthest:g}; allowed: up to {_FARTHEST_PX:,} "
            "from the corner"
        )
    of_size = f"its {picture.width} x {picture.height} pixels"
    if max(right.max(), bottom.max()) <= 1.0 and (np.stack([right, bottom]) % 1.0).any():
        raise AnnotationError(
            f"{picture.path.name}: all marks lie within one of {of_size}: they are fractions of its sides"
        )
    outside = (left > picture.width) | (top > picture.height) | (right < 0.0) | (bottom < 0.0)
    count = np.count_nonzero(outside)
    if 2 * count > len(outside):
        raise AnnotationError(
            f"{picture.path.name}: {count} of {len(outside)} marks lie outside {of_size}: they are of "
            "another size of it"
        )


def _refuse_corners(boxes: NDArray[np.float64], picture: AnnotatedPicture) -> None:
    """People's boxes [N, 4] (left, top, right, bottom) that were read from two corners as if the second were
    their size."""
    corner, size = boxes[:, :2], boxes[:, 2:] - boxes[:, :2]
    if are_two_corners(corner, size, (picture.width, picture.height)):
        raise AnnotationError(
            f"{picture.path.name}: all {len(boxes)} boxes of people are as wide and as high as they are away "
            "from the upper left corner: they are given by two corners; allowed: x, y, width, height"
        )


def in_crowds(feet: NDArray[np.float64], gsd_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which people [N] belong to a crowd (`truth.crowd_ground.crowds_of`), each with metres per pixel of its
    own; two are as far apart as the mean of their scales says."""
    from scipy.spatial import cKDTree

    radius_m = float(DEFAULT_CROWD["radius_m"])
    pairs = cKDTree(feet).query_pairs(radius_m / float(gsd_m.min()), output_type="ndarray")
    apart_px = np.linalg.norm(feet[pairs[:, 0]] - feet[pairs[:, 1]], axis=1)
    pairs = pairs[apart_px * gsd_m[pairs].mean(axis=1) <= radius_m]
    near = 1 + np.bincount(pairs.ravel(), minlength=len(feet))
    core = near >= DEFAULT_CROWD["min_people"]
    member = core.copy()
    for one, other in ((0, 1), (1, 0)):
        member[pairs[core[pairs[:, one]], other]] = True
    return member


def _gsd_at(people: NDArray[np.float64], picture: AnnotatedPicture) -> NDArray[np.float64]:
    """Metres per pixel [N] at each person."""
    if picture.gsd_m is not None:
        return np.full(len(people), picture.gsd_m)
    from scipy.spatial import cKDTree

    longest_px = people[:, 2:].max(axis=1)
    sized = longest_px > _POINT_PX
    if not sized.any():
        raise AnnotationError(
            f"{picture.path.name}: people are points and nothing tells the scale: give metres per pixel"
        )
    near = np.arange(1, min(_NEAREST, int(sized.sum())) + 1)
    _, who = cKDTree(people[sized, :2]).query(people[:, :2], k=near)
    return np.asarray(PERSON_HEIGHT_M / np.median(longest_px[sized][who], axis=1))


def _ground(
    people: NDArray[np.float64], gsd_m: NDArray[np.float64], picture: AnnotatedPicture
) -> NDArray[np.bool_]:
    """The ground [H, W] of people of crowds."""
    rows, columns = -(-picture.height // _GRID), -(-picture.width // _GRID)
    drawn, closing = np.zeros((rows, columns), np.bool_), np.zeros((rows, columns))
    for (x, y), metres in zip(people[:, :2] / _GRID - 0.5, gsd_m * _GRID, strict=True):
        reach = PERSON_RADIUS_M / metres
        left, right = max(0, int(np.ceil(x - reach))), min(columns, int(x + reach) + 1)
        top, bottom = max(0, int(np.ceil(y - reach))), min(rows, int(y + reach) + 1)
        if left >= right or top >= bottom:
            continue
        across, down = np.arange(left, right) - x, np.arange(top, bottom)[:, None] - y
        disc = across**2 + down**2 <= reach**2
        drawn[top:bottom, left:right] |= disc
        closing[top:bottom, left:right][disc] = float(DEFAULT_CROWD["radius_m"]) / metres
    closed = close_with_disc(drawn, closing) if drawn.any() else drawn
    return closed.repeat(_GRID, 0).repeat(_GRID, 1)[: picture.height, : picture.width]


def _drawn(polygons: tuple[Polygon, ...], picture: AnnotatedPicture) -> NDArray[np.bool_]:
    """Pixels [H, W] whose middle lies inside any of the polygons, whose corners are those of pixels."""
    from rasterio.features import rasterize

    shape = (picture.height, picture.width)
    if not polygons:
        return np.zeros(shape, np.bool_)
    rings = [[*polygon.tolist(), polygon[0].tolist()] for polygon in polygons]
    outlines = [{"type": "Polygon", "coordinates": [ring]} for ring in rings]
    return np.asarray(rasterize(outlines, out_shape=shape, dtype="uint8")).view(np.bool_)
