"""`crowdfence export`: the zones of a run in the formats of others."""

from __future__ import annotations

import json
import time
from contextlib import ExitStack
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.atomic_file import replaceable_file, write_bytes
from crowdfence.cli import console, options
from crowdfence.cli.asked_stamp import asked_stamp
from crowdfence.cli.unused_options import refuse_of, refuse_unused
from crowdfence.cli.wording import counted
from crowdfence.legible import first_of
from crowdfence.zones.square_metres import square_metres

if TYPE_CHECKING:
    from crowdfence.exports.zone_formats import ZoneExport
    from crowdfence.surface_grid import SurfaceGrid
    from crowdfence.zones import Zone
    from crowdfence.zones.history import ZoneHistory


class ExportFormat(str, Enum):
    """Formats of zones."""

    geojson = "geojson"
    ed318 = "ed318"
    ed269 = "ed269"
    ed269_list = "ed269-list"
    f3548 = "f3548"
    kml = "kml"
    multidrone = "multidrone"
    qgc = "qgc"
    csv = "csv"
    state = "state"
    costmap = "costmap"
    mcap = "mcap"


_RASTERS = (ExportFormat.state, ExportFormat.costmap)

_TOLD_M2 = 0.5
"""Less is rounding."""
_MOST_NAMED = 12
"""A national file has thousands; all of them are in --json."""


class DatumName(str, Enum):
    """What heights are above."""

    agl = "AGL"
    amsl = "AMSL"
    wgs84 = "WGS84"


RunFolder = Annotated[Path, typer.Argument(help="Folder that `crowdfence run` wrote, or its zone history.")]
At = Annotated[
    str,
    typer.Option(
        "--at",
        metavar="STAMP",
        help="last, first, +SECONDS after the first instant, nanoseconds, or 2026-01-01T12:00:00Z.",
    ),
]


_AUTHORITIES = ("ed318", "ed269", "ed269-list")
_WITH_TIMES = (*_AUTHORITIES, "f3548", "kml", "csv")
"""Formats that say from when on a zone holds."""
_USES = {
    "country": _AUTHORITIES,
    "authority": (*_AUTHORITIES, "f3548"),
    "contact": _AUTHORITIES,
    "datum": (*_AUTHORITIES, "csv"),
    "max_items": ("qgc",),
    "plan": ("qgc",),
}
"""Which formats read which options."""


def export(
    context: typer.Context,
    run: RunFolder,
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")],
    kind: Annotated[
        ExportFormat,
        typer.Option(
            "--format",
            "-f",
            help="What to write; state: GeoTIFF with colours, costmap: YAML and PGM, mcap: ROS 2 messages of "
            "the whole run for Foxglove.",
        ),
    ],
    at: At = "last",
    country: Annotated[
        str | None, typer.Option("--country", help="For ED-318 and ED-269: ISO 3166, three letters.")
    ] = None,
    authority: Annotated[
        str, typer.Option("--authority", help="Who is responsible for the zones.")
    ] = "fleet operator",
    contact: Annotated[str | None, typer.Option("--contact", help="E-mail address of the authority.")] = None,
    datum: Annotated[
        DatumName, typer.Option("--datum", help="What heights are above: ground, sea (EGM96), ellipsoid.")
    ] = DatumName.agl,
    max_items: Annotated[
        int, typer.Option("--max-items", help="Capacity of the fence for --format qgc: corners and circles.")
    ] = 63,
    plan: Annotated[
        Path | None, typer.Option("--plan", help="For qgc: a plan that exists, to which the fence is added.")
    ] = None,
    static_zones: options.StaticZones = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Write the no-fly zones of a run, as they were at an instant, for authorities, UTM, autopilots and
    viewers."""
    from crowdfence.result_folder import (
        files_read_of,
        open_grid,
        open_history,
        read_as_one,
    )
    from crowdfence.static_zones import read_static_zones
    from crowdfence.zones.history import with_static

    refuse_of(context, _USES, kind.value, f"with --format {kind.value}")
    if kind is ExportFormat.mcap:
        refuse_unused(context, ["at"], "with --format mcap, which holds every instant")
    written = [output]
    if kind is ExportFormat.costmap:
        written.append(output.with_suffix(".pgm"))
        if output.suffix == ".pgm":
            raise ValueError(f"{output}: a costmap is a YAML file, with a picture of the same name beside it")
    with ExitStack() as stack:
        for path in written:
            reads = [*files_read_of(run), plan, *(static_zones or [])]
            stack.enter_context(replaceable_file(path, force=force, reads=reads))
        with read_as_one(run):
            history = open_history(run)
            taken = {zone.id for zones in history.sets for zone in zones.closed}
            others, left_out = read_static_zones(static_zones or [], history.georeference, taken)
            history = with_static(history, _on_ground_of(run, others))
            # Zones hold from the instant that found them, not from when somebody asks.
            stamp_ns = history.stamps_ns[history.index_at(asked_stamp(at, history))]
            report: dict[str, Any] = {"file": str(output), "format": kind.value}
            grid = open_grid(run, history) if kind is ExportFormat.mcap else None
        if kind is ExportFormat.mcap:
            _write_mcap(output, run, history, grid, report)
        elif kind in _RASTERS:
            report["beyond_raster"] = _write_raster(kind, output, run, history, stamp_ns)
        elif kind is ExportFormat.geojson:
            write_bytes(output, _geojson(history, stamp_ns).encode())
        else:
            zones = _zone_export(
                history,
                stamp_ns,
                country=country,
                authority=authority,
                contact=contact,
                datum=datum.value,
                max_items=max_items,
            )
            write_bytes(output, _text(kind, zones, plan, report).encode())
    zones_at = history.at(stamp_ns)
    report |= {
        "stamp_ns": stamp_ns,
        "zones": len(zones_at.closed),
        "crowd_zones": len(zones_at),
        "dropped_area_m2": zones_at.dropped_area_m2,
        "dropped_is_closed": bool(zones_at.unseen),
        "left_out": left_out,
    }
    _report(report, as_json)


def _on_ground_of(run: Path, others: tuple[Zone, ...]) -> tuple[Zone, ...]:
    """With the heights of their ground, where the run wrote its terrain."""
    from crowdfence.maps import open_terrain
    from crowdfence.zones.given_ground import on_ground

    terrain = run / "terrain.bt"
    return on_ground(others, open_terrain(terrain)) if others and terrain.exists() else others


def _write_raster(
    kind: ExportFormat, output: Path, run: Path, history: ZoneHistory, stamp_ns: int
) -> list[str]:
    """From the map of the last instant, which is the one that a run keeps. Ids of zones that reach beyond."""
    from crowdfence.exports.state_rasters import write_costmap, write_state_geotiff

    crowd_map = run / "crowd_map.tif"
    if not crowd_map.exists():
        raise FileNotFoundError(f"{run} holds no crowd_map.tif, which --format {kind.value} is made from")
    if stamp_ns != history.stamps_ns[-1]:
        raise ValueError(
            f"--format {kind.value} is of the last instant only, because a run keeps no other map"
        )
    write = write_state_geotiff if kind is ExportFormat.state else write_costmap
    return write(output, crowd_map, history.at(stamp_ns).closed)


def _write_mcap(
    output: Path, run: Path, history: ZoneHistory, grid: SurfaceGrid | None, report: dict[str, Any]
) -> None:
    """Of all instants."""
    from crowdfence.exports.closed_cells import reach_beyond
    from crowdfence.exports.raster_placement import RasterPlacement
    from crowdfence.exports.ros2 import write_results_mcap

    report["messages"] = write_results_mcap(output, history, grid)
    if grid is None:
        console.warn(f"{run} holds no terrain.bt and crowd_map.crowdmap: the file shows zones alone")
        return
    placed = RasterPlacement.of(grid, None).transform
    beyond = [reach_beyond(zones.closed, grid.shape[::-1], placed) for zones in history.sets]
    report["beyond_raster"] = list(dict.fromkeys(name for names in beyond for name in names))


def _geojson(history: ZoneHistory, stamp_ns: int) -> str:
    from crowdfence.exports.geojson import zones_geojson
    from crowdfence.result_folder import description_at

    return zones_geojson(history.at(stamp_ns), description_at(history, stamp_ns), history.georeference)


def _zone_export(history: ZoneHistory, stamp_ns: int, **how: Any) -> ZoneExport:
    from crowdfence.exports.zone_formats import ZoneExport

    if history.georeference is None:
        raise ValueError("the run has no place on Earth; only --format geojson writes local metres")
    zones = history.at(stamp_ns)
    return ZoneExport(
        zones=zones.closed,
        stamp_ns=stamp_ns,
        georeference=history.georeference,
        mission=history.description.get("mission", ""),
        method=history.description.get("method", ""),
        threshold=zones.threshold,
        **how,
    )


def _text(kind: ExportFormat, zones: ZoneExport, plan: Path | None, report: dict[str, Any]) -> str:
    from crowdfence.exports.zone_formats import ZONE_FORMATS, qgc_plan
    from crowdfence.exports.zone_formats.f3548 import cut_short_ns
    from crowdfence.exports.zone_formats.over_coverage import WITHOUT_HOLES, over_coverage_m2
    from crowdfence.exports.zone_formats.qgc_plan import fence_of

    if kind.value in WITHOUT_HOLES:
        report["over_coverage_m2"] = over_coverage_m2(kind.value, zones)
    if kind.value in _WITH_TIMES:
        now_ns = time.time_ns()
        report["begins_in_s"] = max(0.0, (zones.stamp_ns - now_ns) / 1e9)
        ends_ns = [zone.valid_until_ns for zone in zones.zones if zone.valid_until_ns is not None]
        report["over_by_forecast"] = sum(end_ns <= now_ns for end_ns in ends_ns)
    if kind is ExportFormat.f3548:
        cut_ns = cut_short_ns(zones)
        report |= {"cut_short": len(cut_ns), "cut_short_ns": min(cut_ns, default=None)}
    if kind is not ExportFormat.qgc:
        return ZONE_FORMATS[kind.value](zones)
    existing = None if plan is None else _read_plan(plan)
    fence = fence_of(zones, existing)
    report |= {"fence_items": fence.items, "over_coverage_m2": fence.over_coverage_m2}
    return qgc_plan(zones, existing)


def _read_plan(path: Path) -> dict[str, Any]:
    try:
        plan = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is no plan: {error}") from error
    if not isinstance(plan, dict):
        raise ValueError(f"{path} is no plan: it holds no object")
    return plan


def _report(report: dict[str, Any], as_json: bool) -> None:
    from crowdfence.iso_time import iso_utc

    if as_json:
        console.print_json(report)
        return
    out = console.stdout()
    if "messages" in report:
        count, topics = sum(report["messages"].values()), len(report["messages"])
        out.print(f"{count} messages on {topics} topics in {console.escaped(report['file'])}", soft_wrap=True)
    else:
        out.print(
            f"{counted(report['zones'], 'zone')} of {iso_utc(report['stamp_ns'])} in "
            f"{console.escaped(report['file'])}",
            soft_wrap=True,
        )
    if "fence_items" in report:
        over_m2 = report["over_coverage_m2"]
        out.print(
            f"a fence of {counted(report['fence_items'], 'item')} closes {over_m2:.0f} m2 more than the zones"
        )
    elif report.get("over_coverage_m2", 0.0) >= _TOLD_M2:
        from crowdfence.exports.zone_formats.over_coverage import WITHOUT_HOLES

        over = square_metres(report["over_coverage_m2"])
        console.warn(
            f"{over} more than the zones are closed: in {report['format']}, {WITHOUT_HOLES[report['format']]}"
        )
    if report.get("begins_in_s") and report["zones"]:
        begin = f"{report['begins_in_s']:,.0f} s from now, at {iso_utc(report['stamp_ns'])}"
        console.warn(
            f"the zones begin {begin}: readers of {report['format']} take their ground for open until then. "
            "The recording's clock is ahead, as one that shows local time may be"
        )
    if ended := report.get("over_by_forecast"):
        console.warn(
            f"{counted(ended, 'zone')} ended before now by the forecast that {report['format']} carries: its "
            "readers take that ground for open, though no look has opened it"
        )
    if report.get("cut_short"):
        console.warn(_cut_short(report))
    if report["dropped_area_m2"] and not report["dropped_is_closed"]:
        dropped = square_metres(report["dropped_area_m2"])
        console.warn(f"{dropped} of crowd are in no zone: below min_area_m2 of the run")
    if report.get("beyond_raster"):
        names = first_of(report["beyond_raster"], _MOST_NAMED)
        console.warn(f"the raster ends near what was seen; not all of {names} lies within it")
    for reason in report["left_out"]:
        console.warn(reason)


def _cut_short(report: dict[str, Any]) -> str:
    """Nobody has opened a zone that only its file ends."""
    from crowdfence.iso_time import iso_utc

    count, end_ns = report["cut_short"], report["cut_short_ns"]
    zones = f"{counted(count, 'zone')} that stand{'s' if count == 1 else ''} longer"
    told = f"f3548 closes for a day at most: {zones}"
    if end_ns > time.time_ns():
        return f"{told} will be open from {iso_utc(end_ns)} on; publish anew before"
    return f"{told} ended in this file at {iso_utc(end_ns)}: who reads it now takes that ground for open"
