"""Where and when a planner asks. What is no place and no stamp is refused before it could be called clear."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.unmasked import require_unmasked
from crowdfence.zones.area import require_area

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

MOST_PLACE_M = 2e7
"""In local coordinates nothing on Earth is further: it is 12,757 km across."""
MOST_STAMP_NS = 2**62
"""The year 2116, and as long before 1970: the difference of two stamps fits a machine word."""


def as_area(within: Polygon | MultiPolygon | None) -> Polygon | MultiPolygon | None:
    """The area, checked."""
    if within is not None:
        require_area(within, "within")
    return within


def as_places(points: ArrayLike) -> NDArray[np.float64]:
    """Points [N, 3], or one [3], as [N, 3]. ValueError for another shape, masked, or off the Earth."""
    require_unmasked(points, "points")
    array = np.atleast_2d(np.asarray(points, dtype=np.float64))
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"points must be [N, 3], got shape {list(np.shape(points))}")
    is_place = (np.abs(array) <= MOST_PLACE_M).all(axis=1)
    if not is_place.all():
        first = int(np.argmin(is_place))
        raise ValueError(f"point {first} is {told(array[first])}; places lie within {MOST_PLACE_M:g} m")
    return array


def as_stamps(stamps_ns: ArrayLike, count: int) -> NDArray[np.int64]:
    """Stamps in ns, [count] or one for all, as int64; `datetime64` counts in its own unit. ValueError for
    what is no whole number (a clock in seconds), lies beyond `MOST_STAMP_NS`, is masked, of another shape, or
    of single precision, in which stamps of today are two minutes apart."""
    require_unmasked(stamps_ns, "stamps")
    given = np.asarray(stamps_ns)
    if given.dtype.kind == "M":
        # Beyond the year 2262 numpy begins anew, and from 2.5 on raises.
        try:
            in_ns = given.astype("datetime64[ns]")
        except OverflowError as error:
            raise ValueError(f"{_IS_STAMP}, got {given.max()}") from error
        is_same = in_ns.astype(given.dtype) == given
        if not is_same.all():
            raise ValueError(f"{_IS_STAMP}, got {given[~is_same].flat[0]}")
        given = in_ns.astype(np.int64)
    is_single = given.dtype.kind == "f" and given.dtype.itemsize < np.dtype(np.float64).itemsize
    if given.dtype.kind not in "iuf" or is_single:
        # Python's whole numbers too large for a machine word are objects.
        large = given.dtype.kind == "O" and all(isinstance(one, int) for one in given.flat)
        raise ValueError(f"{_IS_STAMP}, got {max(given.flat, key=abs) if large else given.dtype}")
    is_stamp = (given >= -MOST_STAMP_NS) & (given <= MOST_STAMP_NS) & (given == np.trunc(given))
    if not is_stamp.all():
        raise ValueError(f"{_IS_STAMP}, got {given[~is_stamp].flat[0]}")
    if given.shape not in ((), (1,), (count,)):
        raise ValueError(f"{count} points have {count} stamps or one, got shape {list(given.shape)}")
    return np.broadcast_to(given.astype(np.int64), count)


def told(place: ArrayLike) -> str:
    return "(" + ", ".join(f"{value:g}" for value in np.ravel(place)) + ")"


_IS_STAMP = f"stamps are whole nanoseconds between -{MOST_STAMP_NS} and {MOST_STAMP_NS}"
