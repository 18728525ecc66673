"""`crowdfence route`: a way round the zones of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from crowdfence.atomic_file import replaceable_file, write_bytes
from crowdfence.cli import console, options
from crowdfence.cli.asked_stamp import asked_stamp
from crowdfence.cli.exit_codes import GATE_NOT_MET
from crowdfence.cli.export import At, RunFolder
from crowdfence.iso_time import iso_utc

if TYPE_CHECKING:
    from crowdfence.exports.state_raster import StateRaster
    from crowdfence.georeference import Georeference
    from crowdfence.planner import Route
    from crowdfence.result_folder import StatesOfGround

_UNKNOWN = {
    "never_seen": "never seen or beyond the map",
    "occluded": "hidden",
    "stale": "seen empty too long ago",
    "not_cleared": "looked at and not cleared",
    "crowd": "crowd that no zone closes",
}
"""States of ground that is not known to be empty."""
_CROWD_OF_ENDED_ZONES = "crowd in zones that have ended by then, or in none"
"""What `crowd` is below a way that may pass zones after their end."""
_TOLD_M = 0.05
"""Less is rounding."""
_FAR_M = 100_000.0
"""No flight with its ground goes so far: latitude and longitude were changed round."""
_NO_STATES = (
    "{run} holds no map of that instant (a run keeps that of its last one, crowd_map.tif; a later one is "
    "made from terrain.bt and crowd_map.crowdmap): it is not known how much of the way lies over ground "
    "that nobody has seen empty"
)


def route(
    run: RunFolder,
    start: Annotated[str, typer.Option("--from", metavar="LAT,LON", help="Where the way begins.")],
    goal: Annotated[str, typer.Option("--to", metavar="LAT,LON", help="Where it ends.")],
    local: Annotated[
        bool, typer.Option("--local", help="--from and --to are local metres, EAST,NORTH.")
    ] = False,
    clearance_m: Annotated[
        float, typer.Option("--clearance-m", help="Distance that is kept from every zone.")
    ] = 0.0,
    speed_m_s: Annotated[
        float | None,
        typer.Option(
            "--speed-m-s", help="Says when the way is where, if it is begun at the instant of --at."
        ),
    ] = None,
    expires: Annotated[
        bool,
        typer.Option(
            "--expires",
            help="Zones that have an end may be flown through after it; with --speed-m-s. Ends are forecasts "
            "of method paper, not looks: nobody has seen that the ground is empty then.",
        ),
    ] = False,
    beyond_map: Annotated[
        bool,
        typer.Option(
            "--beyond-map",
            help="The way may leave the ground of the map. No camera of the run could look there, so that no "
            "zone says where people are.",
        ),
    ] = False,
    known_empty: Annotated[
        bool,
        typer.Option(
            "--known-empty",
            help="Only over ground that was seen empty, lately: all other ground is closed like a zone, as "
            "run --close-unseen closes it. Without it, ground that nobody has looked at counts as clear.",
        ),
    ] = False,
    at: At = "last",
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="GeoJSON file for the way; with --speed-m-s it says when the way is where. Default: none.",
        ),
    ] = None,
    picture: Annotated[Path | None, typer.Option("--picture", help="PNG of the way and the zones.")] = None,
    static_zones: options.StaticZones = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """The shortest way round the no-fly zones of a run as they were at an instant, over ground that its map
    knows; exit code 3 where there is none.

    Clear means in no zone, not seen empty: how much of the way lies over ground that is not known to be empty
    is told. --known-empty keeps off such ground, as does a run that was made with --close-unseen.
    """
    from contextlib import ExitStack

    if expires and speed_m_s is None:
        raise ValueError("--expires needs --speed-m-s: a zone that ends is flown through after its end")
    if output is not None and picture is not None and output.resolve() == picture.resolve():
        raise ValueError(f"--output and --picture are both {output}: one would take the other's place")
    from crowdfence.planner import NoRoute, safe_route
    from crowdfence.planner.seen_ground import not_known_empty
    from crowdfence.planner.told_in_degrees import at_one_height
    from crowdfence.result_folder import (
        StatesOfGround,
        files_read_of,
        ground_height_of,
        known_ground_of,
        open_history,
        read_as_one,
    )
    from crowdfence.static_zones import read_static_zones

    with ExitStack() as stack:
        for path in filter(None, (output, picture)):
            reads = [*files_read_of(run), *(static_zones or [])]
            stack.enter_context(replaceable_file(path, force=force, reads=reads))
        with read_as_one(run):
            history = open_history(run)
            others, left_out = read_static_zones(static_zones or [], history.georeference)
            for reason in left_out:
                console.warn(reason)
            departure_ns = asked_stamp(at, history)
            zones = (*history.at(departure_ns).closed, *others)
            frame = None if local else history.georeference
            if frame is None and not local:
                raise ValueError("the run has no place on Earth; give local metres with --local")
            height_m, passed = 0.0, zones
            if history.georeference is not None:
                # Where no zone does, the map says how high the ground lies.
                says = any(zone.lower_m < zone.upper_m for zone in zones)
                height_m, passed = at_one_height(zones, 0.0 if says else ground_height_of(run))
            begin, end = _place(start, frame, height_m), _place(goal, frame, height_m)
            ground = known_ground_of(run, history)
            if ground is None and not beyond_map:
                raise ValueError(
                    f"{run} does not say how far its map reaches; --beyond-map plans a way over any ground"
                )
            of_ground = StatesOfGround(run, history)
            states = of_ground.at(departure_ns)
            if known_empty:
                if beyond_map or ground is None:
                    raise ValueError(
                        "--known-empty and --beyond-map contradict each other: nobody looked there"
                    )
                if states is None:
                    raise ValueError(f"--known-empty: {_NO_STATES.format(run=run)}")
                unknown = not_known_empty(states, ground)
                zones, passed = (*zones, unknown), (*passed, unknown)
            try:
                found = safe_route(
                    begin,
                    end,
                    passed,
                    clearance_m=clearance_m,
                    within=None if beyond_map else ground,
                    departure_ns=None if speed_m_s is None else departure_ns,
                    speed_m_s=speed_m_s,
                    expires=expires,
                )
            except NoRoute as reason:
                console.fail(_worded(str(reason)))
                raise typer.Exit(GATE_NOT_MET) from None
            report = {
                "zones_at": iso_utc(history.stamps_ns[history.index_at(departure_ns)]),
                "clearance_m": clearance_m,
                "expires": expires,
                **_told(found, history.georeference, ground, height_m, states),
                "not_known_empty_on_arrival_m": _aged_m(found, states, of_ground),
            }
        if output is not None:
            from crowdfence.exports.route_geojson import route_geojson

            about = {name: value for name, value in report.items() if name != "waypoints"}
            feature = route_geojson(found.waypoints, found.stamps_ns, history.georeference, height_m, about)
            write_bytes(output, feature.encode())
        if picture is not None:
            from crowdfence.exports.route_picture import write_route_picture

            write_route_picture(picture, found, zones, clearance_m, states)
    if report["beyond_map_m"] is None:
        console.warn(f"{run} does not say how far its map reaches: nothing is known of ground beyond it")
    elif report["beyond_map_m"] > 0.0:
        console.warn(
            f"{report['beyond_map_m']:.1f} m of the way lie beyond the map: nobody knows who stands there"
        )
    if report["over_m"] is None:
        console.warn(_NO_STATES.format(run=run))
    elif report["not_known_empty_m"] >= _TOLD_M:
        console.warn(_over_unknown(report))
    aged_m = report["not_known_empty_on_arrival_m"]
    if aged_m is not None and aged_m - report["not_known_empty_m"] >= _TOLD_M:
        console.warn(
            f"by the arrival {aged_m:.1f} of {report['length_m']:.1f} m lie over ground that is not known to "
            "be empty: looks at it have grown old by then, unless a drone looks again"
        )
    if as_json:
        console.print_json(report)
        return
    console.stdout().print(
        f"{found.length_m:.1f} m over {len(found.waypoints) - 2} turns, "
        f"{found.direct_m:.1f} m as the crow flies, by the zones of {report['zones_at']}",
        soft_wrap=True,
    )
    for place in report["waypoints"]:
        told = ", ".join(f"{name} {value}" for name, value in place.items())
        console.stdout().print(f"  {told}", soft_wrap=True)


def _place(text: str, georeference: Georeference | None, height_m: float) -> Any:
    """Local metres [2]; of degrees at a local height."""
    from crowdfence.georeference import on_earth
    from crowdfence.planner.told_in_degrees import local_place

    try:
        first, second = map(float, text.split(","))
    except ValueError:
        raise ValueError(f"{text!r} must be two numbers with a comma between them") from None
    if georeference is None:
        return np.array([first, second])
    if not on_earth(first, second):
        raise ValueError(f"{text!r} is no latitude and longitude in degrees; local metres need --local")
    place = local_place(georeference, first, second, height_m)
    if np.hypot(*place) > _FAR_M:
        raise ValueError(
            f"{text!r} lies more than {_FAR_M / 1000:.0f} km from the flight; the latitude comes first, then "
            "the longitude"
        )
    return place


def _worded(reason: str) -> str:
    """Why there is no way, in the options of this command."""
    from crowdfence.zones.engine import UNSEEN_ID

    return (
        reason.replace("the area", "the ground of the map (--beyond-map may leave it)")
        .replace(f"in zone {UNSEEN_ID}", "over ground that is not known to be empty")
        .replace(f"zone {UNSEEN_ID}", "ground that is not known to be empty")
    )


def _over_unknown(report: dict[str, Any]) -> str:
    length_m, unknown_m = report["length_m"], report["not_known_empty_m"]
    words = _UNKNOWN | {"crowd": _CROWD_OF_ENDED_ZONES} if report["expires"] else _UNKNOWN
    parts = [
        f"{report['over_m'][state]:.1f} m {said}"
        for state, said in words.items()
        if report["over_m"][state] >= _TOLD_M
    ]
    return (
        f"{unknown_m:.1f} of {length_m:.1f} m of the way lie over ground that is not known to be empty: "
        f"{', '.join(parts)}; no zone only means that no crowd was seen. --known-empty keeps off such ground"
    )


def _aged_m(found: Route, at_departure: StateRaster | None, of_ground: StatesOfGround) -> float | None:
    """How much of a way lies over ground that is not known to be empty by what is known now when it arrives;
    None for a way without times, and where nothing is known."""
    if found.stamps_ns is None or at_departure is None:
        return None
    over_m = _over_m(found, at_departure)
    if over_m is not None and over_m["empty"] == 0.0:
        return _unknown_m(over_m)  # nothing can age, and reading the map takes longer than finding the way
    return _unknown_m(_over_m(found, of_ground.at(int(found.stamps_ns[-1]))))


def _over_m(found: Route, states: StateRaster | None) -> dict[str, float] | None:
    """Metres of a way by the state of the ground below; None where nothing is known of it."""
    from crowdfence.planner.seen_ground import metres_by_state

    if states is None:
        return None
    return {state.name.lower(): m for state, m in metres_by_state(found.waypoints, states).items()}


def _unknown_m(over_m: dict[str, float] | None) -> float | None:
    return None if over_m is None else sum(over_m[name] for name in _UNKNOWN)


def _told(
    found: Route,
    georeference: Georeference | None,
    ground: Any,
    height_m: float,
    states: StateRaster | None,
) -> dict[str, Any]:
    waypoints: list[dict[str, float | str]] = [
        {"east_m": round(x, 3), "north_m": round(y, 3)} for x, y in found.waypoints.tolist()
    ]
    if georeference is not None:
        from crowdfence.georeference import longitude_latitude

        degrees = longitude_latitude(found.waypoints, height_m, georeference).tolist()
        for waypoint, (east, north) in zip(waypoints, degrees, strict=True):
            waypoint |= {"latitude": round(north, 8), "longitude": round(east, 8)}
    if found.stamps_ns is not None:
        for waypoint, stamp_ns in zip(waypoints, found.stamps_ns.tolist(), strict=True):
            waypoint |= {"at": iso_utc(stamp_ns)}
    over_m = _over_m(found, states)
    return {
        "length_m": found.length_m,
        "direct_m": found.direct_m,
        "beyond_map_m": None if ground is None else _beyond_m(found, ground),
        "not_known_empty_m": _unknown_m(over_m),
        "over_m": over_m,
        "waypoints": waypoints,
    }


def _beyond_m(found: Route, ground: Any) -> float:
    """How much of the way lies beyond the ground of the map."""
    import shapely

    way = shapely.LineString(found.waypoints)
    return 0.0 if ground.covers(way) else float(shapely.difference(way, ground).length)
