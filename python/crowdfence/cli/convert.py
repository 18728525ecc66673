"""`crowdfence convert`: any recording -> a mission file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from crowdfence.atomic_file import writable_file
from crowdfence.cli import console, options, source_options


def convert(
    context: typer.Context,
    recording: options.RecordingPath,
    output: Annotated[Path, typer.Option("--output", "-o", help="Mission file to write (.mcap).")],
    topics: source_options.Topics = None,
    mount: source_options.Mount = None,
    calibration: source_options.Calibration = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Write a recording as a mission file (MCAP, ROS 2 messages) that gives the same views bit for bit."""
    from crowdfence.sources.convert import convert as write_mission

    with writable_file(output):
        _require_place(output, recording, force)
        source = source_options.open_source(recording, context.params)
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


def _require_place(output: Path, recording: Path, force: bool) -> None:
    if not output.exists():
        return
    if recording.exists() and output.samefile(recording):
        raise FileExistsError(f"{output} is the recording itself; choose another file")
    if not force:
        raise FileExistsError(f"{output} exists; --force replaces it")
