"""`crowdfence convert`: any recording -> a mission file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from crowdfence.atomic_file import writable_file
from crowdfence.cli import console, options, source_options

if TYPE_CHECKING:
    from crowdfence.sources.recording import Recording


def convert(
    context: typer.Context,
    recording: options.RecordingPaths,
    output: Annotated[Path, typer.Option("--output", "-o", help="Mission file to write (.mcap).")],
    topics: source_options.Topics = None,
    mount: source_options.Mount = None,
    calibration: source_options.Calibration = None,
    telemetry: source_options.Telemetry = None,
    clock_offset_s: source_options.ClockOffset = None,
    heights: source_options.Heights = None,
    geoid_m: source_options.GeoidM = None,
    take_off: source_options.TakeOff = None,
    ground_start: source_options.GroundStart = False,
    frames_per_s: source_options.FramesPerS = None,
    terrain: options.TerrainPath = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Write a recording as a mission file (MCAP, ROS 2 messages) that gives the same views bit for bit."""
    from crowdfence.sources.convert import convert as write_mission

    with writable_file(output):
        _require_place(output, recording, force)
        source = source_options.open_source(recording, context.params)
        if terrain is not None:
            source = _on_map(source, terrain)
        with console.progress("converting", len(source.frames), "frames") as advance:
            conversion = write_mission(source, output, progress=lambda done, total: advance())
    if as_json:
        console.print_json(
            {
                "file": str(conversion.path),
                "bytes": conversion.size_bytes,
                "frames": conversion.frames,
                "poses": conversion.poses,
                "refused": [str(refused) for refused in conversion.refused],
                "omitted": conversion.omitted,
            }
        )
        return
    frames = ", ".join(f"{drone} {count}" for drone, count in conversion.frames.items())
    console.stdout().print(
        console.facts(
            f"{conversion.path}",
            {
                "size": f"{conversion.size_bytes / 1e6:.1f} MB",
                "frames": frames,
                "poses": str(conversion.poses),
            },
        )
    )
    for reason in [*map(str, conversion.refused), *conversion.omitted]:
        console.warn(reason)


def _on_map(source: Recording, terrain: Path) -> Recording:
    """Heights that wait for the map are settled on it, and the mission file names it."""
    from crowdfence.pipeline import open_terrain
    from crowdfence.sources.ground_contact import on_ground

    if source.ground_contacts:
        source = on_ground(source, open_terrain(source, terrain))
    return replace(source, terrain=terrain)


def _require_place(output: Path, recordings: list[Path], force: bool) -> None:
    if not output.exists():
        return
    if any(recording.exists() and output.samefile(recording) for recording in recordings):
        raise FileExistsError(f"{output} is the recording itself; choose another file")
    if not force:
        raise FileExistsError(f"{output} exists; --force replaces it")
