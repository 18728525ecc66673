"""`crowdfence convert`: any recording -> a mission file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.atomic_file import NO_ROOM, replaceable_file
from crowdfence.cli import console, options, source_options
from crowdfence.cli.option_sets import FlightOptions, SourceOptions, takes
from crowdfence.cli.refusals import refusal_lines
from crowdfence.cli.wording import in_options

if TYPE_CHECKING:
    from collections.abc import Iterator

    from crowdfence.sources.mission.topic_writer import TopicMessage
    from crowdfence.sources.recording import Recording


@takes(SourceOptions, FlightOptions, before="force")
def convert(
    context: typer.Context,
    recording: options.RecordingPaths,
    output: Annotated[Path, typer.Option("--output", "-o", help="Mission file to write (.mcap).")],
    results: Annotated[
        Path | None,
        typer.Option(
            "--results", help="Folder of a run of this recording: its zones and map go into the file too."
        ),
    ] = None,
    depth_images: Annotated[
        bool,
        typer.Option(
            "--depth-images",
            help="Depth as 32FC1 images, which Foxglove draws; --results does so too. Default: PNG in "
            "centimetres where that loses nothing, a third of the bytes.",
        ),
    ] = False,
    terrain: Annotated[
        Path | None,
        typer.Option("--terrain", "-t", help="Map to put into the file. Default: the recording's own."),
    ] = None,
    terrain_option: options.TerrainOption = None,
    with_map: Annotated[
        bool,
        typer.Option(
            "--with-map/--without-map", help="Whether the map goes into the file, which then opens anywhere."
        ),
    ] = True,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Write a recording as a mission file (MCAP, ROS 2 messages) that gives the same views bit for bit."""
    from crowdfence.maps import stated_place
    from crowdfence.sources.convert import convert as write_mission

    if output.suffix.lower() != ".mcap":
        raise ValueError(f"{output}: convert writes mission files, whose name ends in .mcap")
    if terrain is not None:
        stated_place(terrain)  # a map, before anything is read
    map_options = options.terrain_options(pairs=terrain_option)
    with replaceable_file(output, force=force, reads=[*recording, terrain]):
        source = source_options.open_source(recording, context.params)
        beside = () if results is None else _results(results, source)
        lacking = None if results is None else _heatmaps_told(results, source)
        doubts: tuple[str, ...] = ()
        if map_options:
            _check_options(terrain or source.terrain, map_options)
        if terrain is not None:
            source, doubts = _on_map(source, terrain, map_options)
        with console.progress("converting", len(source.frames), "frames") as advance:
            try:
                conversion = write_mission(
                    source,
                    output,
                    beside=beside,
                    depth_images=depth_images or results is not None,
                    terrain=terrain,
                    terrain_options=map_options,
                    map_inside=with_map,
                    progress=lambda done, total: advance(),
                )
            except OSError as error:
                if error.errno not in NO_ROOM:
                    raise
                # A write does not say which file it was.
                what = f"cannot write {output}: {error.strerror}; nothing of it is left"
                raise OSError(error.errno, what) from error
    if lacking is not None:
        console.warn(lacking)
    warnings = [*source.warnings, *doubts]
    if as_json:
        console.print_json(
            {
                "file": str(conversion.path),
                "bytes": conversion.size_bytes,
                "frames": conversion.frames,
                "poses": conversion.poses,
                "refused": [str(refused) for refused in conversion.refused],
                "omitted": conversion.omitted,
                "map": conversion.map_inside,
                "warnings": warnings,
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
                "map": _map_told(conversion.map_inside, with_map),
                **({"read with": ", ".join(terrain_option)} if terrain_option else {}),
            },
        )
    )
    for reason in [
        *map(in_options, warnings),
        *refusal_lines(conversion.refused),
        *map(in_options, conversion.omitted),
    ]:
        console.warn(reason)


def _heatmaps_told(run: Path, recording: Recording) -> str | None:
    """What the file lacks of a run whose heatmaps a detector made."""
    summary = run / "summary.json"
    try:
        told = json.loads(summary.read_bytes()) if summary.is_file() else None
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{summary} is no summary of a run: {error}") from error
    detector = told.get("detector") if isinstance(told, dict) else None
    if not isinstance(detector, dict) or detector.get("heatmaps") != "model":
        return None
    recorded = any(frame.pixels.heatmap is not None for frame in recording.frames)
    there = "the recorded heatmaps are" if recorded else "no heatmaps are"
    made = f"those that {detector.get('name')} made for {run}, which a run does not keep"
    return f"{there} in the file, not {made}"


def _results(run: Path, recording: Recording) -> Iterator[TopicMessage]:
    """What the run found; ValueError when it is none of this recording."""
    from crowdfence.exports.ros2 import result_messages
    from crowdfence.result_folder import open_grid, open_history, read_as_one

    with read_as_one(run):
        history = open_history(run)
        # An instant has the stamp of its newest frame. Simulated flights all begin at one time and place.
        if {frame.stamp_ns for frame in recording.frames}.isdisjoint(history.stamps_ns):
            raise ValueError(
                f"{run} is no run of {recording.name}: no frame of it has the stamp of an instant"
            )
        if recording.georeference not in (None, history.georeference):
            raise ValueError(f"{run} is no run of {recording.name}: its local frame lies elsewhere")
        grid = open_grid(run, history)
    return result_messages(history, grid)


def _map_told(inside: str | None, wanted: bool) -> str:
    if inside is not None:
        return f"{inside}, in the file"
    return "none: give one with --terrain when you run" if wanted else "not in the file"


def _check_options(path: Path | None, map_options: dict[str, Any]) -> None:
    """ValueError for options that no later reader could use; before heights are settled, or nothing is."""
    from crowdfence.maps import check_options

    if path is None:
        raise ValueError(
            "--terrain-option says how to read a map, and there is none; give one with --terrain"
        )
    if not_of_a_map := {"assume_local", "georeference"} & map_options.keys():
        raise ValueError(f"{path}: {min(not_of_a_map)} is no option of a map that goes with a recording")
    try:
        check_options(path, **map_options)
    except TypeError as error:
        raise ValueError(str(error)) from error


def _on_map(
    source: Recording, terrain: Path, map_options: dict[str, Any]
) -> tuple[Recording, tuple[str, ...]]:
    """With heights that waited for the map, and what is doubtful about that. What nobody said of where the
    map lies goes with the file, in which it will have come with the recording."""
    from crowdfence.pipeline import read_map
    from crowdfence.pipeline.terrain import relation_doubts
    from crowdfence.sources.ground_contact import on_ground

    unsaid = relation_doubts(terrain, source, source.georeference, map_options)
    known = replace(source, warnings=(*source.warnings, *unsaid))
    if not source.ground_contacts:
        return known, ()
    ground = read_map(source, terrain, **map_options)
    doubts = tuple(doubt for doubt in ground.doubts if doubt not in known.warnings)
    return on_ground(known, ground.terrain), doubts
