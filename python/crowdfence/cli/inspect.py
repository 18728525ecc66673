"""`crowdfence inspect`: what is in a map, a recording or a saved crowd map."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.atomic_file import replaceable_file
from crowdfence.cli import console, options, source_options
from crowdfence.cli.option_sets import FlightOptions, SourceOptions, takes
from crowdfence.cli.recording_tables import print_recording, unmeasured_ground
from crowdfence.cli.unused_options import refuse_unused
from crowdfence.cli.wording import in_options
from crowdfence.inspection import InspectionOptions

if TYPE_CHECKING:
    from rich.console import RenderableType

    from crowdfence.inspection.crowd_map import CrowdMapReport
    from crowdfence.inspection.recording import RecordingReport
    from crowdfence.inspection.terrain import MapReport, TerrainReport

DEFAULT = InspectionOptions()
_OF_VIEWS = ("tolerance_ms", "max_range_m", "samples", "check_pixels")
"""What maps and saved crowd maps have no use for."""


@takes(SourceOptions, FlightOptions, before="tolerance_ms")
def inspect(
    context: typer.Context,
    file: Annotated[
        Path, typer.Argument(help="Map, recording (.mcap or folder) or saved crowd map (.crowdmap).")
    ],
    terrain: Annotated[
        Path | None,
        typer.Option(
            "--terrain", "-t", help="Map below a recording (default: its own), or of a saved crowd map."
        ),
    ] = None,
    voxel_size_m: options.VoxelSizeM = None,
    terrain_option: options.TerrainOption = None,
    origin: options.Origin = None,
    assume_local: options.AssumeLocal = False,
    tolerance_ms: options.ToleranceMs = DEFAULT.tolerance_ms,
    max_range_m: options.MaxRangeM = DEFAULT.max_range_m,
    samples: Annotated[
        int, typer.Option("--samples", min=1, help="Instants whose views are compared on the terrain.")
    ] = DEFAULT.sampled_instants,
    quick: Annotated[
        bool, typer.Option("--quick", help="Leave out the landing prior and the overlap of views.")
    ] = False,
    check_pixels: Annotated[
        bool,
        typer.Option("--check-pixels", help="Read the pixels of every frame to find damaged and blank ones."),
    ] = False,
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture", help="Contact sheet of a recording (.png): frames, labels, footprints on the map."
        ),
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Say what is in a file: size, time span, gaps, cameras, flight, and how the views overlap."""
    from crowdfence.inspection import inspect_file
    from crowdfence.inspection.crowd_map import CrowdMapReport
    from crowdfence.inspection.recording import RecordingReport
    from crowdfence.inspection.terrain import MapReport

    if quick:
        refuse_unused(context, ["samples"], "with --quick, which compares no views")
    map_options = options.terrain_options(
        voxel_size_m, terrain_option, origin=origin, assume_local=assume_local
    )
    with ExitStack() as stack:
        if picture is not None:
            stack.enter_context(replaceable_file(picture, force=force, reads=[file, terrain]))
        tell = stack.enter_context(console.working())
        report = inspect_file(
            file,
            terrain=terrain,
            options=InspectionOptions(
                tolerance_ms=tolerance_ms,
                max_range_m=max_range_m,
                sampled_instants=samples,
                quick=quick,
                check_pixels=check_pixels,
                terrain_options=map_options,
                source_options=source_options.given(context.params),
            ),
            tell=tell,
        )
        if not isinstance(report, RecordingReport):
            refuse_unused(context, _OF_VIEWS, f"with {file}, which is no recording")
        if picture is not None:
            tell("drawing the contact sheet")
            _write_picture(picture, report, terrain, map_options, tolerance_ms, context.params)
    if as_json:
        console.print_json(asdict(report))
    elif isinstance(report, MapReport):
        out = console.stdout()
        header, terrain_facts = _map_facts(report)
        out.print(header)
        out.print()
        out.print(terrain_facts)
        for warning in report.warnings:
            console.warn(in_options(warning))
    elif isinstance(report, CrowdMapReport):
        console.stdout().print(_crowd_map_facts(report))
    else:
        print_recording(console.stdout(), report)


def _write_picture(
    picture: Path,
    report: MapReport | RecordingReport | CrowdMapReport,
    terrain_path: Path | None,
    terrain_options: dict[str, Any],
    tolerance_ms: float,
    parameters: Mapping[str, Any],
) -> None:
    from crowdfence.exports.contact_sheet import write_contact_sheet
    from crowdfence.inspection.recording import RecordingReport
    from crowdfence.pipeline import read_map
    from crowdfence.sources.ground_contact import on_ground

    if not isinstance(report, RecordingReport):
        raise ValueError(f"--picture goes with recordings; {report.path} is not one")
    recording = source_options.open_source(Path(report.path), parameters)
    terrain = None
    if terrain_path is not None or recording.terrain is not None:
        terrain = read_map(recording, terrain_path, **terrain_options).terrain  # its doubts are in the report
        recording = on_ground(recording, terrain)
    write_contact_sheet(picture, recording, terrain, tolerance_ms=tolerance_ms)


def _terrain_facts(report: TerrainReport) -> dict[str, str]:
    """Size and place of a terrain, one fact a row."""
    spans = zip("xyz", report.low_m, report.high_m, strict=True)
    place = report.georeference
    return {
        "voxels": f"{report.voxels:,} of {report.voxel_size_m:g} m",
        "extent": " x ".join(f"{length:,.1f}" for length in report.extent_m) + " m (east, north, up)",
        "bounds": ", ".join(f"{axis} {low:,.1f} to {high:,.1f}" for axis, low, high in spans) + " m",
        "georeference": "none: local metres only"
        if place is None
        else f"(0, 0, 0) is {place.latitude_deg:.7f}, {place.longitude_deg:.7f} deg, {place.height_m:.1f} m "
        "above the ellipsoid (WGS84)",
    }


def _map_facts(report: MapReport) -> tuple[RenderableType, RenderableType]:
    """What the file says, what becomes of it."""
    header = {name.replace("_", " "): f"{value}" for name, value in report.file.items()}
    rows = _terrain_facts(report.terrain)
    rows["voxels"] += f", {report.voxel_size_why}"
    rows["memory"] = f"{_megabytes(report.tree_bytes)} ({report.tree_bytes_per_voxel:.2f} bytes a voxel)"
    columns = report.columns
    unmeasured = unmeasured_ground(report.terrain)
    rows["columns"] = f"{columns.columns:,}, {columns.overhang_share:.1%} with overhangs{unmeasured}"
    if report.landing_prior is None:
        rows["landing prior"] = f"none: {report.no_landing_prior}"
    else:
        rows["landing prior"] = f"{report.landing_prior:.3f} (share of the columns suitable for landing)"
    if report.holes is not None:
        rows["holes"] = str(report.holes)
    rows["fingerprint"] = report.terrain.fingerprint
    title = f"{report.path}: {report.kind}, {_megabytes(report.bytes)}"
    return console.facts(title, header), console.facts("As a terrain", rows)


def _crowd_map_facts(report: CrowdMapReport) -> RenderableType:
    rows = {
        "format version": f"{report.version}",
        "terrain": f"{report.terrain_voxels:,} voxels, fingerprint {report.terrain_fingerprint}",
    }
    content = report.content
    if content is None:
        rows["content"] = "needs the map that it was made on: give it with --terrain"
    else:
        rows |= {
            "method": content.method,
            "drones": ", ".join(content.drones) or "none",
            "instants": f"{content.instants}, {content.first_instant or '-'} + {content.duration_s:.1f} s",
            "voxels": ", ".join(
                f"{count:,} {state.replace('_', ' ')}" for state, count in content.states.items()
            ),
            "threshold": f"{content.threshold:.4f}",
            "highest P": "-" if content.highest_probability is None else f"{content.highest_probability:.4f}",
        }
    return console.facts(f"{report.path}: crowd map, {_megabytes(report.bytes)}", rows)


def _megabytes(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 100_000 else f"{count / 1e3:.1f} kB"
