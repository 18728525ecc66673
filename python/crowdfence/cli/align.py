"""`crowdfence align`: what the poses of a flight are constantly off."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from crowdfence.atomic_file import replaceable_file
from crowdfence.cli import console, options, source_options
from crowdfence.cli.exit_codes import GATE_NOT_MET
from crowdfence.cli.option_sets import MapOptions, SourceOptions, map_options, takes
from crowdfence.cli.wording import counted, in_options

if TYPE_CHECKING:
    from crowdfence.alignment import Alignment, DroneAlignment, Estimate


@takes(MapOptions, SourceOptions, before="frames")
def align(
    context: typer.Context,
    recording: options.RecordingPaths,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Alignment to write (.json), for --alignment.")
    ],
    frames: Annotated[
        int, typer.Option("--frames", min=6, help="Pictures of each drone to compare at most.")
    ] = 24,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Find out what a flight's poses and clock are constantly off, from its pictures and the map.

    Nothing is guessed: what the pictures cannot tell is said and left alone. Where they tell nothing, no file
    is written and the exit code is 3.
    """
    from crowdfence.alignment.estimate import align as estimate
    from crowdfence.alignment.estimate import step_count, told_in_json
    from crowdfence.pipeline import read_map
    from crowdfence.sources.alignment_file import write_alignment

    with replaceable_file(output, force=force, reads=[*recording, context.params["terrain"]]):
        source = source_options.open_source(recording, context.params)
        ground = read_map(source, context.params["terrain"], **map_options(context.params))
        with console.progress("reading", step_count(source, frames), "pictures") as advance:
            found = estimate(source, ground.terrain, most_frames=frames, progress=advance)
        if found.told:
            write_alignment(output, found.offsets(), told_in_json(found), source)
    warnings = [*source.warnings, *ground.doubts]
    if as_json:
        file = str(output) if found.told else None
        console.print_json({"file": file, **told_in_json(found), "warnings": warnings})
    else:
        _report(found, output)
        for reason in warnings:
            console.warn(in_options(reason))
    if not found.told:
        console.fail("the pictures cannot tell what the poses are off; nothing was written")
        raise typer.Exit(GATE_NOT_MET)


def _report(found: Alignment, output: Path) -> None:
    from rich.table import Table

    out = console.stdout()
    for drone in found.drones:
        name = f"[bold]{console.escaped(drone.drone)}[/]"
        if drone.why_not:
            out.print(f"{name}: cannot tell: {drone.why_not}", soft_wrap=True)
            continue
        out.print(f"{name}: {_agreement(drone)}", soft_wrap=True)
        table = Table("", "off by", "+-", "", box=None)
        for one in drone.estimates:
            verdict = _verdict(one)
            digits = 3 if one.unit == "s" else 2
            table.add_row(
                one.quantity, f"{one.value:+.{digits}f} {one.unit}", f"{one.error:.{digits}f}", verdict
            )
        out.print(table)
    if found.told:
        file = console.escaped(output)
        out.print(f"\nalignment in [bold]{file}[/]; use it with --alignment {file}", soft_wrap=True)


def _verdict(one: Estimate) -> str:
    if not one.told:
        return f"left alone: {one.why_not}"
    return "put right" + (" against the other drones" if one.quantity in ("east", "north") else "")


def _agreement(drone: DroneAlignment) -> str:
    unknown = drone.pictures - drone.pictures_matched
    rest = f"; nothing is known of the other {unknown}: their poses may be far off" if unknown else ""
    return (
        f"{counted(drone.matches, 'place')} in {drone.pictures_matched} of {drone.pictures} pictures, apart "
        f"by {drone.before_px:.2f} px before, {drone.after_px:.2f} px after{rest}"
    )
