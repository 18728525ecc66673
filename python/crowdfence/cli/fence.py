"""`crowdfence fence`: zones sent to an autopilot over MAVLink, and kept there."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.atomic_file import replaceable_file, write_bytes
from crowdfence.cli import console, options
from crowdfence.cli.asked_stamp import asked_stamp
from crowdfence.cli.exit_codes import GATE_NOT_MET
from crowdfence.cli.export import At
from crowdfence.cli.unused_options import refuse_unused

if TYPE_CHECKING:
    from crowdfence.fence_sync import FenceEvent, FenceKeeper, FenceReport, ZonePlace, ZoneSource


_ONE_INSTANT = "with zones of one instant, as those of GeoJSON or a service"

app = typer.Typer(
    help="An autopilot's fence over MAVLink: send zones, read it, keep it equal to zones, clear it.",
    epilog="Exit codes: 0 ok, 1 nothing was changed, or not known to be, 2 usage, 3 done, with an alarm.",
    no_args_is_help=True,
)

Zones = Annotated[
    str,
    typer.Argument(
        help="Folder that `crowdfence run` wrote, its zone history, zones as GeoJSON, or the address of a "
        "live service (http://HOST:PORT)."
    ),
]
Token = Annotated[
    str | None,
    typer.Option(
        "--token",
        envvar="CROWDFENCE_TOKEN",
        show_envvar=False,
        help="That of a viewer of the service; better in CROWDFENCE_TOKEN, because others of this machine "
        "can read a command line.",
    ),
]
Ca = Annotated[
    Path | None,
    typer.Option("--ca", help="PEM file of the service's certificate, where no authority vouches for it."),
]
Link = Annotated[
    str,
    typer.Option(
        "--link",
        metavar="udpin|udpout|tcp:HOST:PORT",
        help="Where the vehicle is, such as udpin:0.0.0.0:14550.",
    ),
]
System = Annotated[
    int | None,
    typer.Option("--system", min=1, max=254, help="System id of the vehicle. Default: the only one heard."),
]
CapacityItems = Annotated[
    int | None,
    typer.Option(
        "--capacity",
        min=1,
        help="Items that the fence holds, those of others with them. Default: 63 for PX4, 560 bytes for "
        "ArduPilot, less where the vehicle refuses.",
    ),
]
Margin = Annotated[
    list[str] | None,
    typer.Option(
        "--buffer",
        metavar="RULE:NAME=VALUE,...",
        help="Close so much more around all zones, as the rules of crowdfence run: most autopilots act once "
        "they are in the fence. contingency:speed_mps=10 is until a multirotor stands. May be repeated: the "
        "distances are added.",
    ),
]
State = Annotated[
    Path | None,
    typer.Option(
        "--state",
        help="Folder that remembers what was written last, by which our shapes are told from those of "
        "others. Default: crowdfence/fences in ~/.local/state.",
    ),
]
TimeoutS = Annotated[
    float,
    typer.Option(
        "--timeout-s", min=0.1, max=3600.0, help="How long to wait for a vehicle that says nothing."
    ),
]


@app.callback()
def _group() -> None:
    pass


@app.command("push")
def push(
    context: typer.Context,
    zones: Zones,
    link: Link,
    at: At = "last",
    static_zones: options.StaticZones = None,
    buffer: Margin = None,
    token: Token = None,
    ca: Ca = None,
    system: System = None,
    capacity: CapacityItems = None,
    state: State = None,
    timeout_s: TimeoutS = 5.0,
    as_json: options.Json = False,
) -> None:
    """Make the fence of a vehicle cover the zones, as they were at an instant.

    The whole list is replaced, read back and compared; shapes of others stay in it. The vehicle keeps the
    fence that it had on any failure.
    """
    source = _source(_place(context, zones, at, token, ca), static_zones, buffer)
    wanted = source.read()
    for reason in source.left_out:
        console.warn(reason)
    with _keeper(link, system, capacity, state, timeout_s) as keeper:
        report = keeper.put(wanted.zones, wanted.georeference)
    _tell_report(report, keeper, as_json)


@app.command("pull")
def pull(
    link: Link,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="GeoJSON file to write. Default: print it.")
    ] = None,
    system: System = None,
    state: State = None,
    timeout_s: TimeoutS = 5.0,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Read the fence of a vehicle: what closes which ground, and which of it is ours."""
    from contextlib import nullcontext

    from crowdfence.fence_sync import fence_geojson

    with nullcontext() if output is None else replaceable_file(output, force=force):
        with _keeper(link, system, None, state, timeout_s) as keeper:
            shapes, ours = keeper.read()
        text = fence_geojson(shapes, ours, keeper.station.vehicle.name)
        if output is None:
            print(text, end="")
            return
        write_bytes(output, text.encode())
    items = sum(map(len, shapes))
    if as_json:
        told = {"file": str(output), "shapes": len(shapes), "items": items, "our_shapes": len(ours)}
        console.print_json(told)
        return
    console.stdout().print(
        f"{len(shapes)} shapes in {items} items, {len(ours)} of them ours, in {console.escaped(output)}",
        soft_wrap=True,
    )


@app.command("clear")
def clear(
    link: Link,
    everything: Annotated[bool, typer.Option("--all", help="Shapes of others, too.")] = False,
    system: System = None,
    state: State = None,
    timeout_s: TimeoutS = 5.0,
    as_json: options.Json = False,
) -> None:
    """Remove what we wrote from the fence of a vehicle; what others drew stays unless --all."""
    with _keeper(link, system, None, state, timeout_s) as keeper:
        report = keeper.clear(everything=everything)
    _tell_report(report, keeper, as_json)


@app.command("watch")
def watch(
    context: typer.Context,
    zones: Zones,
    link: Link,
    opening_s: Annotated[
        float, typer.Option("--opening-s", min=0.0, help="Ground opens when it has been open for so long.")
    ] = 5.0,
    interval_s: Annotated[
        float, typer.Option("--interval-s", min=0.0, max=3600.0, help="Least time between two fences.")
    ] = 2.0,
    check_s: Annotated[
        float, typer.Option("--check-s", min=1.0, max=3600.0, help="Read the fence back so often.")
    ] = 20.0,
    stale_after_s: Annotated[
        float | None,
        typer.Option("--stale-after-s", min=0.1, help="Alarm when the zones are not written for so long."),
    ] = None,
    expires: Annotated[
        bool,
        typer.Option("--expires", help="Zones end at their valid_until, even if nobody looked there again."),
    ] = False,
    duration_s: Annotated[
        float | None,
        typer.Option("--duration-s", min=0.0, help="Stop after so long. Default: with Ctrl-C."),
    ] = None,
    static_zones: options.StaticZones = None,
    buffer: Margin = None,
    token: Token = None,
    ca: Ca = None,
    system: System = None,
    capacity: CapacityItems = None,
    state: State = None,
    timeout_s: TimeoutS = 5.0,
    as_json: options.Json = False,
) -> None:
    """Keep the fence of a vehicle equal to zones as they are written, until Ctrl-C, which leaves it there.

    New ground is closed at once, ground opens after a while. --json prints an event a line.
    """
    from crowdfence.fence_sync import FenceWatch, WatchPlan
    from crowdfence.stop_request import StopRequest

    source = _source(_place(context, zones, "last", token, ca), static_zones, buffer)
    source.read()  # what is wrong from the beginning is refused, what becomes wrong later is an alarm
    for reason in source.left_out:
        console.warn(reason)
    plan = WatchPlan(opening_s, interval_s, check_s, stale_after_s, expires)
    with _keeper(link, system, capacity, state, timeout_s) as keeper:
        watching = FenceWatch(keeper, source, plan, lambda event: _tell([event], as_json))
        clock = keeper.station.clock
        # No exception: raised while a message is decoded, it could be taken for a damaged one and be lost.
        with StopRequest() as stop:
            until_s = float("inf") if duration_s is None else clock() + duration_s
            watching.run(until_s, lambda: stop.wanted)
        if stop.wanted:
            console.stderr().print("stopped; the vehicle keeps its fence")
    if watching.alarms:
        raise typer.Exit(GATE_NOT_MET)


def _place(context: typer.Context, zones: str, at: str, token: str | None, ca: Path | None) -> ZonePlace:
    """Where zones are read; options that it has no use for are refused."""
    from crowdfence.fence_sync import ServiceZones, ZoneFile, is_address
    from crowdfence.result_folder import open_history

    if is_address(zones):
        refuse_unused(context, ["at"], _ONE_INSTANT)
        return ServiceZones(zones, token=token, ca=ca)
    refuse_unused(context, ["token", "ca"], "with zones that are no address of a service")
    place = ZoneFile(zones, at)
    if place.is_of_one_instant:
        refuse_unused(context, ["at"], _ONE_INSTANT)
    elif at != "last":
        asked_stamp(at, open_history(zones))
    return place


def _source(place: ZonePlace, static_zones: list[Path] | None, buffer: list[str] | None) -> ZoneSource:
    from crowdfence.fence_sync import ZoneSource
    from crowdfence.zones import safety_distance_m

    return ZoneSource(place, static_zones or (), safety_distance_m(buffer or []))


@contextmanager
def _keeper(
    link: str, system: int | None, capacity: int | None, state: Path | None, timeout_s: float
) -> Iterator[FenceKeeper]:
    from crowdfence.fence_sync import (
        FenceKeeper,
        GroundStation,
        ItemCapacity,
        Patience,
        open_transport,
    )
    from crowdfence.fence_sync.vehicle_memory import default_folder

    patience = Patience(tries=max(1, round(timeout_s / Patience().retry_s)))
    station = GroundStation(open_transport(link), clock=time.monotonic, patience=patience)
    try:
        with console.working() as step:
            step("waiting for a vehicle")
            station.find_vehicle(timeout_s, system)
        yield FenceKeeper(
            station, state or default_folder(), None if capacity is None else ItemCapacity(capacity)
        )
    finally:
        station.close()


def _tell_report(report: FenceReport, keeper: FenceKeeper, as_json: bool) -> None:
    if as_json:
        told: dict[str, Any] = {"vehicle": keeper.station.vehicle.name, **report.to_json()}
        console.print_json(told)
    else:
        console.stdout().print(console.escaped(keeper.station.vehicle.name))
        _tell(report.events, as_json=False)
    if report.alarms:
        raise typer.Exit(GATE_NOT_MET)


def _tell(events: Iterable[FenceEvent], as_json: bool) -> None:
    import json

    for event in events:
        if as_json:
            print(json.dumps(event.to_json()), flush=True)
        elif event.alarm:
            console.stdout().print(f"[bold red]alarm[/]: {console.escaped(event.text)}", soft_wrap=True)
        else:
            console.stdout().print(console.escaped(event.text), soft_wrap=True)
    sys.stdout.flush()  # who follows a log sees an alarm when it happens
