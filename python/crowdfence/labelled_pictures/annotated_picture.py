"""One picture and what somebody marked in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence.legible import first_of

Polygon = NDArray[np.float64]
"""Corners [K, 2] in pixels, K >= 3."""
Role = Literal["person", "crowd", "ignore"]
_NAMED = 10
"""Classes named of those that mean nothing."""


class AnnotationError(ValueError):
    """A file of annotations that cannot be used; one line, with the place and the value."""


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedPicture:
    """Pixels to the right and downwards from the upper left corner."""

    path: Path
    width: int
    height: int
    people: NDArray[np.float64]
    """[N, 4]: x, y of the feet, width and height of the person; 0, 0 where only a point is known."""
    crowds: tuple[Polygon, ...] = ()
    """Crowds outlined as such."""
    ignored: tuple[Polygon, ...] = ()
    """Parts about which nothing is said."""
    gsd_m: float | None = None
    """Metres per pixel, where known for the whole picture."""
    left_out: tuple[str, ...] = ()
    """Classes of the marks in it that mean nothing, one for each mark."""
    painted_groups: int = 0
    """Those of `crowds` that are masks of people as a group (`iscrowd` of COCO)."""

    @property
    def is_bare(self) -> bool:
        """Whether nothing at all is marked in it: nobody is there, or nobody has labelled it."""
        return not (len(self.people) or self.crowds or self.ignored or self.left_out)


def people_in_boxes(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Boxes x, y, width, height [N, 4] -> people [N, 4] who stand on the middle of the lower edge."""
    x, y, width, height = boxes.reshape(-1, 4).T
    return np.stack([x + width / 2.0, y + height, width, height], axis=1)


def people_at_points(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points [N, 2] -> people [N, 4] of unknown size."""
    points = points.reshape(-1, 2)
    return np.concatenate([points, np.zeros_like(points)], axis=1)


def distinct(people: NDArray[np.float64]) -> NDArray[np.float64]:
    """People [N, 4] without those who are marked again with the same numbers, as in files that were put
    together: two of them are one, and would make a crowd of a couple. In their order."""
    _, first = np.unique(people, axis=0, return_index=True)
    return people[np.sort(first)]


def left_out_classes(pictures: Iterable[AnnotatedPicture]) -> tuple[dict[str, int], str]:
    """Marks by class of those that mean nothing, the most frequent first, and the same in words; nothing and
    an empty text where there are none."""
    counts = dict(Counter(name for picture in pictures for name in picture.left_out).most_common())
    if not counts:
        return counts, ""
    marks, names = sum(counts.values()), first_of([*counts], _NAMED)
    what = f"{marks} mark{'' if marks == 1 else 's'} of classes that mean nothing here: {names}"
    return counts, what


def painted_groups(pictures: Iterable[AnnotatedPicture]) -> str:
    """In words, how many masks of people count as crowds; an empty text where there are none. COCO has such
    of groups alone, an export of CVAT of everybody."""
    masks = sum(picture.painted_groups for picture in pictures)
    if not masks:
        return ""
    one = "1 mask of people is a group (iscrowd: 1) and counts as a crowd"
    several = f"{masks} masks of people are groups (iscrowd: 1) and count as a crowd each"
    return (
        f"{one if masks == 1 else several}; CVAT exports every mask so, also that of one person: where it is "
        "one, set its iscrowd to 0, or draw people as boxes or polygons"
    )


def rectangle(x: float, y: float, width: float, height: float) -> Polygon:
    return np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)])


def turned(polygon: Polygon, degrees: float) -> Polygon:
    """A polygon turned about the middle of its corners, clockwise as the picture is seen."""
    middle, turn = polygon.mean(axis=0), np.radians(degrees)
    to_right, down = (polygon - middle).T
    cos, sin = np.cos(turn), np.sin(turn)
    return np.asarray(middle + np.stack([cos * to_right - sin * down, sin * to_right + cos * down], axis=1))
