"""From the coordinates written in a map file to local metres and back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence.datum import datum_doubt
from crowdfence.georeference import Georeference

if TYPE_CHECKING:
    from pyproj import CRS

HeightUnit = Literal["auto", "m", "ft", "us-ft"]

METRES_PER_UNIT = {"m": 1.0, "ft": 0.3048, "us-ft": 1200 / 3937}

# The plumb line this far from the anchor leans 1.8 degrees; a map beyond it belongs to another flight.
MAX_DISTANCE_M = 200_000.0
_MOST_LONGITUDE_DEG = 540.0
"""Maps that go on beyond the antimeridian write 181; what is farther round is no longitude."""


@dataclass(frozen=True, slots=True)
class HeightRules:
    """What the caller says about the heights in a file.

    `unit`: "m", "ft" (international foot), "us-ft" (survey foot), or "auto": the unit of the vertical
    reference system, else of the file's own label, else of the horizontal axes where those are lengths, else
    metres. Files whose label contradicts the vertical system are refused, and height models where the
    horizontal axes would decide and are not metres: they hold metres as often. Points of a laser scanner have
    one unit for all three. `offset_m` is added to every height, for instance the height of the geoid above
    the ellipsoid; when given, it replaces the vertical datum, and a vertical axis in the file gives only the
    unit.
    """

    unit: HeightUnit = "auto"
    offset_m: float | None = None

    def __post_init__(self) -> None:
        if self.unit != "auto" and self.unit not in METRES_PER_UNIT:
            raise ValueError(f"height_unit is {self.unit!r}, must be 'auto', 'm', 'ft' or 'us-ft'")
        if self.offset_m is not None and not math.isfinite(self.offset_m):
            raise ValueError(f"height_offset_m is {self.offset_m}, must be finite")

    def unsaid_unit(self, crs: CRS | None, label: str | None) -> str | None:
        """The unit of the horizontal axes where that is not the metre, and nothing else says what heights are
        in; `label` is how the file itself calls it."""
        if self.unit != "auto" or label or crs is None or len(crs.axis_info) > 2 or not crs.is_projected:
            return None
        horizontal = crs.axis_info[0]
        return None if horizontal.unit_conversion_factor == 1.0 else str(horizontal.unit_name)

    def metres_per_height(self, crs: CRS | None, label: str | None = None) -> float:
        """Metres per unit of the file's heights; `label` is how the file itself calls the unit. ValueError
        where that contradicts the vertical reference system."""
        if self.unit != "auto":
            return METRES_PER_UNIT[self.unit]
        if crs is not None and len(crs.axis_info) > 2:
            axis = crs.axis_info[2]
            _require_one_unit(label, str(axis.unit_name), float(axis.unit_conversion_factor))
            return float(axis.unit_conversion_factor)
        if label:
            return _labelled_unit_m(label)
        if crs is not None and crs.is_projected:
            return float(crs.axis_info[0].unit_conversion_factor)
        return 1.0


@dataclass(frozen=True, slots=True)
class SourceFrame:
    """The frame of one map file.

    `crs` None: x and y are local metres already. `metres_per_height` holds for the heights in the file,
    `metres_per_axis` for the vertical axis of `crs` (1 where it has none).
    """

    crs: CRS | None
    georeference: Georeference | None
    metres_per_height: float
    metres_per_axis: float
    height_offset_m: float

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is doubtful about the places of its points, one sentence each."""
        if self.crs is None:
            return ()
        at = self.georeference
        doubt = datum_doubt(self.crs, None if at is None else (at.latitude_deg, at.longitude_deg))
        return () if doubt is None else (doubt,)

    def local_from_source(
        self, x: NDArray[np.float64], y: NDArray[np.float64], height: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Coordinates as written in the file, each [N] -> local metres [N, 3]."""
        z = (height * self.metres_per_height + self.height_offset_m) / self.metres_per_axis
        if self.crs is None or self.georeference is None:
            return np.stack(np.broadcast_arrays(x, y, z), axis=-1)
        return self.georeference.local_from_projected(self.crs, x, y, z)

    def source_from_local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Local metres [N, 3] -> coordinates as written in the file (x, y, height) [N, 3]."""
        if self.crs is None or self.georeference is None:
            source = points.copy()
        else:
            source = self.georeference.projected_from_local(self.crs, points)
        height_m = source[:, 2] * self.metres_per_axis - self.height_offset_m
        source[:, 2] = height_m / self.metres_per_height
        return source


def source_frame(
    crs: CRS | None,
    georeference: Georeference | None,
    rules: HeightRules,
    metres_per_height: float,
    *,
    centre: tuple[float, float],
    lowest: float,
) -> SourceFrame:
    """Frame of a file whose middle is `centre` (x, y) and whose lowest height is `lowest`, as written in it.

    Without `georeference` the anchor becomes that middle at the lowest height, rounded down to whole metres.
    ValueError for depths, for a vertical datum that PROJ cannot convert and for a file too far away from the
    anchor.
    """
    offset_m = rules.offset_m or 0.0
    if crs is None:
        return SourceFrame(None, georeference, metres_per_height, 1.0, offset_m)
    if len(crs.axis_info) > 2 and crs.axis_info[2].direction == "down":
        raise ValueError(
            f"its reference system {crs.name!r} counts depths, downward: taken for heights, hills would be "
            "valleys; write it with heights, of the other sign (rio calc '(* -1 (read 1))'), and in a system "
            "that counts them upward"
        )
    if rules.offset_m is not None:
        crs = horizontal_part(crs)
    metres_per_axis = float(crs.axis_info[2].unit_conversion_factor) if len(crs.axis_info) > 2 else 1.0
    z = (lowest * metres_per_height + offset_m) / metres_per_axis
    _check_degrees(crs, centre)
    if georeference is None:
        middle = Georeference.from_projected(crs, *_on_earth(crs, *centre), z)
        georeference = replace(middle, height_m=math.floor(middle.height_m), of_map=True)
    distance_m = float(np.linalg.norm(georeference.local_from_projected(crs, *centre, z)))
    if distance_m > MAX_DISTANCE_M:
        raise ValueError(
            f"the middle of the map is {distance_m / 1000:.0f} km away from the anchor {georeference}; the "
            f"bound is {MAX_DISTANCE_M / 1000:.0f} km. Another map, or latitude and longitude exchanged?"
        )
    return SourceFrame(crs, georeference, metres_per_height, metres_per_axis, offset_m)


def _check_degrees(crs: CRS, centre: tuple[float, float]) -> None:
    """Metres that are declared as degrees lead anywhere on Earth, or to no latitude."""
    if not crs.is_geographic:
        return
    x, y = (value * float(crs.axis_info[0].unit_conversion_factor) / math.pi * 180.0 for value in centre)
    if abs(x) > _MOST_LONGITUDE_DEG or abs(y) > 90.0:
        raise ValueError(
            f"its middle is at {centre[0]:.10g}, {centre[1]:.10g}, which is no longitude and latitude of its "
            f"reference system {crs.name!r}; pass crs='EPSG:...' of the one that they are in"
        )


def _on_earth(crs: CRS, x: float, y: float) -> tuple[float, float]:
    """The same place with a longitude that goes on beyond the antimeridian brought back."""
    if not crs.is_geographic:
        return x, y
    turn = 2.0 * math.pi / float(crs.axis_info[0].unit_conversion_factor)
    return (math.remainder(x, turn) if abs(x) > turn / 2.0 else x), y


def chosen_crs(in_file: CRS | None, stated: str | int | CRS | None, *, assume_local: bool) -> CRS | None:
    """The reference system to use, None for local metres; ValueError when there is none or one too many.

    `stated` comes from the caller and takes precedence over the file's; `assume_local` is for files without
    any.
    """
    found = in_file if stated is None else stated_crs(stated)
    if assume_local and found is not None:
        raise ValueError(
            f"assume_local contradicts the reference system {found.name!r}; leave one of them out"
        )
    if not assume_local and found is None:
        raise ValueError(
            "the file has no coordinate reference system; pass crs='EPSG:...' if you know it, or "
            "assume_local=True if its coordinates are local metres (east, north)"
        )
    return found


def stated_crs(stated: str | int | CRS) -> CRS:
    """The reference system that the caller names. ValueError for one that PROJ does not know."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return CRS.from_user_input(stated)
    except CRSError as error:
        raise ValueError(
            f"crs is {stated!r}, which is no coordinate reference system that PROJ knows; give one such as "
            "EPSG:32632"
        ) from error


def horizontal_part(crs: CRS) -> CRS:
    """The CRS without its vertical axis."""
    return crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()


def _labelled_unit_m(label: str) -> float:
    known_m = _known_unit_m(label)
    if known_m is None:
        raise ValueError(f"the file gives heights in {label!r}; pass height_unit='m', 'ft' or 'us-ft'")
    return known_m


def _known_unit_m(label: str) -> float | None:
    words = label.lower().replace("_", " ").replace("-", " ").strip()
    if words in ("m", "metre", "metres", "meter", "meters"):
        return METRES_PER_UNIT["m"]
    if words in ("ft", "foot", "feet", "international foot", "international feet"):
        return METRES_PER_UNIT["ft"]
    if words in ("us ft", "ftus", "usft", "us survey foot", "us survey feet", "foot us", "survey foot"):
        return METRES_PER_UNIT["us-ft"]
    return None


def _require_one_unit(label: str | None, axis_unit: str, axis_m: float) -> None:
    """Of the two kinds of feet, which differ by 2 mm in a kilometre, many programs write the one for the
    other."""
    labelled_m = _known_unit_m(label) if label else None
    if labelled_m is not None and not math.isclose(labelled_m, axis_m, rel_tol=1e-5):
        raise ValueError(
            f"the file gives heights in {label}, and its vertical reference system counts in {axis_unit}; "
            "pass height_unit='m', 'ft' or 'us-ft'"
        )
