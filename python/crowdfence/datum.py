"""How the datum of a coordinate reference system (CRS) lies to WGS84, also where PROJ does not know.

Latitude and longitude mean a place only together with a datum. Where PROJ has no transformation between two
datums, it takes the one's degrees for the other's ("ballpark") without a word: on the ellipsoids of the old
national systems that is 100 m to a kilometre off. Such systems are refused here. Those on the ellipsoid of
satellite positioning (GRS80, WGS84), as many tools write them without their datum, are realisations of the
same frame within a metre or two; they are taken as WGS84, and `datum_doubt` says so. It also says where the
transformation that PROJ has is a coarse one, as of NAD27 without its grids.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import PurePath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pyproj import CRS, Transformer

# GRS80, WGS84 and CGCS2000 differ by 0.1 mm at the poles.
_SEMI_MAJOR_M = 6_378_137.0
_INVERSE_FLATTENING = 298.2572
_CLOSE_M = 4.0
"""What the register says of NAD83 and of others that are nearer in truth."""


@lru_cache(maxsize=64)
def wgs84_from(crs: CRS) -> Transformer:
    """CRS -> (longitude_deg, latitude_deg, ellipsoidal height).

    ValueError for a CRS whose datum PROJ cannot bring to WGS84, and for heights above a geoid whose grid is
    not installed.
    """
    transformer = _known(crs)
    if transformer is not None:
        return transformer
    horizontal = crs.sub_crs_list[0] if crs.is_compound else crs
    known = _known(horizontal) is not None
    if not known and not _lies_like_wgs84(horizontal):
        raise ValueError(
            f"PROJ does not know how the datum of {horizontal.name!r} ({_datum(horizontal)}) lies to WGS84, "
            f"and without that places may lie hundreds of metres off{_missing_grid(horizontal)}; pass "
            "crs='EPSG:...', the reference system with its datum"
        )
    if crs.is_compound:
        why, cure = "PROJ's geoid grid for them is not installed", f"Get it ({_sync(_missing_grids(crs))})"
        if not known:
            why, cure = "PROJ does not know how its datum lies to WGS84", "Name one with a datum"
        raise ValueError(
            f"heights of {crs.name!r} cannot be converted to the WGS84 ellipsoid: {why}. {cure}, or use the "
            "horizontal part of the CRS and add the geoid's height (for maps: height_offset_m)"
        )
    from pyproj.exceptions import ProjError

    try:
        return _transformer(crs, allow_ballpark=True)
    except ProjError as error:  # of a projection that it does not know, or without some of its numbers
        raise ValueError(
            f"PROJ cannot tell where places in {crs.name!r} are ({error}); pass crs='EPSG:...', the "
            "reference system as a register has it"
        ) from error


@lru_cache(maxsize=64)
def datum_doubt(crs: CRS, place: tuple[float, float] | None = None) -> str | None:
    """What is doubtful about places in a CRS that `wgs84_from` accepts, as a sentence; None if nothing is.

    `place`: latitude and longitude near them, to be told too where PROJ knows the datum to some metres only.
    """
    known = _known(crs)
    if known is not None:
        return None if place is None else _coarse(crs, known, place)
    if crs.is_compound:
        return None
    return (
        f"PROJ does not know how the datum of {crs.name!r} ({_datum(crs)}) lies to WGS84; by its ellipsoid "
        "it is taken as WGS84, and places may be a metre or two off (crs='EPSG:...' names one with a datum)"
    )


def _coarse(crs: CRS, transformer: Transformer, place: tuple[float, float]) -> str | None:
    from pyproj.exceptions import ProjError

    latitude, longitude = place
    try:
        transformer.transform(longitude, latitude, 0.0, direction="INVERSE", errcheck=True)
        accuracy_m = transformer.get_last_used_operation().accuracy
    except (ProjError, NotImplementedError):  # before PROJ 9.1 it does not say which it took
        return None
    if accuracy_m is None or not accuracy_m > _CLOSE_M:
        return None
    return (
        f"PROJ knows how the datum of {crs.name!r} ({_datum(crs)}) lies to WGS84 only within "
        f"{accuracy_m:g} m: so far off its places may be{_missing_grid(crs, place)}"
    )


def _known(crs: CRS) -> Transformer | None:
    """By a transformation that PROJ has, or None."""
    from pyproj.exceptions import ProjError

    try:
        return _transformer(crs, allow_ballpark=False)
    except ProjError:
        return None


def _transformer(crs: CRS, *, allow_ballpark: bool) -> Transformer:
    from pyproj import Transformer

    target = "EPSG:4326" if len(crs.axis_info) < 3 else "EPSG:4979"
    return Transformer.from_crs(crs, target, always_xy=True, allow_ballpark=allow_ballpark)


def _lies_like_wgs84(crs: CRS) -> bool:
    ellipsoid = crs.ellipsoid
    if ellipsoid is None or "intermediate" in _datum(crs).lower():
        return False  # an intermediate datum is a step on the way to a national grid and may lie anywhere
    return (
        abs(ellipsoid.semi_major_metre - _SEMI_MAJOR_M) < 0.5
        and abs(ellipsoid.inverse_flattening - _INVERSE_FLATTENING) < 1e-3
    )


def _datum(crs: CRS) -> str:
    return "none" if crs.datum is None else str(crs.datum.name)


def uncovered_heights(crs: CRS, transformer: Transformer, place: tuple[float, float]) -> str:
    """Why heights of a compound CRS cannot be converted at a latitude and longitude that lie in its
    horizontal part, and what to do."""
    used = [grid.short_name for operation in transformer.operations or () for grid in operation.grids]
    name = f" ({PurePath(used[0]).name})" if used else ""
    grids = _missing_grids(crs, place)
    cure = f"get {grids[0]} ({_sync(grids)}), or " if grids else ""
    return (
        f"PROJ's vertical grid for heights of {crs.name!r}{name} does not cover latitude {place[0]:.6g}, "
        f"longitude {place[1]:.6g}: {cure}use the horizontal part of the CRS and add the geoid's height "
        "(for maps: height_offset_m)"
    )


def _sync(grids: list[str]) -> str:
    return f"pyproj sync --file {grids[0]}" if grids else "pyproj sync, proj-data"


def _missing_grid(crs: CRS, place: tuple[float, float] | None = None) -> str:
    """The grid that would help, there or anywhere, for the middle of a sentence."""
    grids = _missing_grids(crs, place)
    return f". Its grid {grids[0]} is not installed ({_sync(grids)})" if grids else ""


def _missing_grids(crs: CRS, place: tuple[float, float] | None = None) -> list[str]:
    """Grids of which one would help, there or anywhere: those first that `pyproj sync` can get, and of them
    those that need no second one."""
    import warnings

    from pyproj.exceptions import ProjError
    from pyproj.transformer import AreaOfInterest, TransformerGroup

    target = "EPSG:4326" if len(crs.axis_info) < 3 else "EPSG:4979"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # it warns of the very grid that is asked for
            area = None if place is None else AreaOfInterest(place[1], place[0], place[1], place[0])
            group = TransformerGroup(crs, target, always_xy=True, area_of_interest=area, allow_ballpark=False)
    except ProjError:
        return []
    needed = [list(operation.grids) for operation in group.unavailable_operations]
    missing = [(not grids[0].url, len(grids), grids[0].short_name) for grids in needed if grids]
    return [name for *_, name in sorted(missing, key=lambda grid: grid[:2])]
