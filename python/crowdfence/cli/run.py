"""`crowdfence run`: fuse a recording and write the results."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.atomic_folder import replaceable_folder
from crowdfence.cli import console, options, source_options
from crowdfence.cli.detector_choice import chosen_detector
from crowdfence.cli.layer_report import report_layer, untold_warnings
from crowdfence.cli.made_by import heatmaps_line, method_line
from crowdfence.cli.option_sets import FUSION, LayerOptions, MapOptions, map_options, takes
from crowdfence.cli.refusals import refusal_lines
from crowdfence.cli.unused_options import refuse_options_of_other_methods, refuse_zone_options
from crowdfence.cli.wording import counted, in_options
from crowdfence.config import RunConfig
from crowdfence.zones.square_metres import square_metres

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector
    from crowdfence.maps import MapReading
    from crowdfence.pipeline import Run
    from crowdfence.sources.recording import Recording

MOST_ZONES_SHOWN = 12
LOOK_FIRST = ("report.html", "crowd_map.png", "layer_map.png")
OpenReport = Annotated[bool, typer.Option("--open", help="Open the report when it is done.")]
WHY = {
    "seen": "crowd seen just now",
    "not_cleared": "looked at, not cleared",
    "not_looked_at": "nobody has looked since",
    "held": "below the threshold, held",
}


@takes(MapOptions, LayerOptions, *FUSION, before="files")
def run(
    context: typer.Context,
    recording: options.RecordingPaths,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")],
    files: options.Files = None,
    show: OpenReport = False,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """From a flight to no-fly zones: finds the crowds in the pictures, puts them on the map, and writes the
    zones, the map and a report to look at."""
    chosen = context.params
    config = options.run_config(
        options.zone_parameters(chosen), options.method_config(chosen, chosen["method"])
    )
    refuse_options_of_other_methods(context, [config.method])
    map_told = map_options(chosen)
    from crowdfence.layer_results import chosen_layer_files
    from crowdfence.pipeline import read_map
    from crowdfence.results import chosen_files
    from crowdfence.sources.layers import CROWD, LANDING_SITE, checked_layer
    from crowdfence.zones.sites import require_takes_back

    named = ",".join(files).split(",") if files else None
    layer = checked_layer(chosen["layer"])
    if layer != CROWD:
        refuse_zone_options(context, layer)
    if layer == LANDING_SITE:
        require_takes_back(config.method.name)
    wanted = chosen_files(named) if layer == CROWD else chosen_layer_files(named, layer)
    with result_folder(output, force=force, layer=layer):
        source = source_options.open_source(recording, chosen).of_layer(layer)
        detector = chosen_detector(source, chosen)
        ground = read_map(source, chosen["terrain"], **map_told)
        fuse_and_report(
            source,
            ground,
            config,
            output,
            detector=detector,
            static_zones=chosen["static_zones"] or (),
            files=wanted,
            force=force,
            as_json=as_json,
            show=show,
        )


def result_folder(output: Path, *, force: bool, layer: str = "crowd") -> AbstractContextManager[None]:
    """Checked before the first frame: that a result folder can be written, and replaces nothing unasked."""
    from crowdfence.layer_results import LAYER_FILES
    from crowdfence.results import FILES
    from crowdfence.sources.layers import CROWD

    return replaceable_folder(output, contents=FILES if layer == CROWD else LAYER_FILES, force=force)


def fuse_and_report(
    recording: Recording,
    ground: MapReading,
    config: RunConfig,
    output: Path,
    *,
    detector: Detector | None,
    force: bool,
    as_json: bool,
    static_zones: Sequence[Path] = (),
    files: frozenset[str] | None = None,
    show: bool = False,
) -> None:
    """The whole job with progress, then the summary."""
    from crowdfence import pipeline
    from crowdfence.layer_results import LAYER_FILES, write_layer_results
    from crowdfence.results import write_results
    from crowdfence.sources.layers import CROWD
    from crowdfence.static_zones import read_static_zones

    georeference = recording.georeference or ground.terrain.georeference
    others, left_out = read_static_zones(list(static_zones), georeference)
    for reason in left_out:
        console.warn(reason)
    started = time.perf_counter()
    with console.progress("fusing", len(recording.frames), "frames") as advance:
        finished = pipeline.run(
            recording,
            ground.terrain,
            config,
            detector=detector,
            holes=ground.holes,
            voxel_size_why=ground.voxel_size_why,
            map_doubts=ground.doubts,
            static_zones=others,
            static_left_out=left_out,
            on_step=lambda instant, _: advance(len(instant.frames)),
        )
    seconds = time.perf_counter() - started
    if recording.layer != CROWD:
        summary = write_layer_results(finished, output, force=force, files=files)
        written, report = sorted(files or LAYER_FILES), report_layer
    else:
        summary = write_results(finished, output, force=force, files=files)
        written, report = _written(files), _report
    if as_json:
        console.print_json(summary)
    else:
        report(summary, finished, seconds, output, written)
    _look_first(output, written, show=show, quiet=as_json)


def _look_first(output: Path, written: list[str], *, show: bool, quiet: bool) -> None:
    """Open what is best looked at first, or say where it is."""
    first = next((output / name for name in LOOK_FIRST if name in written), None)
    if first is None:
        return
    if not quiet:
        hint = "" if show else " (--open shows it)"
        console.stdout().print(f"look first at [bold]{console.escaped(first)}[/]{hint}", soft_wrap=True)
    if show and typer.launch(str(first.resolve())) != 0:
        console.warn(f"nothing here opens {first}; copy it to where a browser is")


def _report(summary: dict[str, Any], run: Run, seconds: float, output: Path, written: list[str]) -> None:
    out = console.stdout()
    frames = sum(summary["frames"].values())
    area = summary["area_m2"]
    out.print(
        console.facts(
            f"{summary['recording']}: {counted(summary['instants'], 'instant')} of "
            f"{counted(len(summary['frames']), 'drone')}",
            {
                "time": f"{summary['first_instant'][:19]}Z, {summary['duration_s']:.1f} s",
                "frames": f"{frames} integrated in {seconds:.1f} s ({frames / seconds:.1f} per second), "
                f"{len(summary['refused'])} refused",
                "terrain": f"{run.terrain.voxel_count:,} voxels of {run.terrain.voxel_size_m:g} m, "
                f"{summary['terrain']['seen_voxels']:,} of them seen; the size: {run.voxel_size_why}",
                **({} if run.holes is None else {"holes of the map": str(run.holes)}),
                "heatmaps": heatmaps_line(summary["detector"]),
                "method": method_line(summary),
                "crowd": f"{square_metres(area['crowd'])} at P >= {run.threshold:.3f}{_left_out(summary)}",
                **_also_closed(summary),
                "empty": f"{area['empty']:.0f} m2 seen recently, {area['stale']:.0f} m2 too long ago; "
                f"{area['not_cleared']:.0f} m2 looked at, not cleared",
            },
        )
    )
    out.print(_zone_table(summary))
    for reason in [*map(in_options, untold_warnings(run)), *refusal_lines(run.refused)]:
        console.warn(reason)
    out.print(f"\nresults in [bold]{console.escaped(output)}[/]: {', '.join(written)}", soft_wrap=True)


def _left_out(summary: dict[str, Any]) -> str:
    """Crowd that no zone covers is never left out in silence."""
    regions = summary["dropped_regions"]
    if not regions:
        return ""
    covered = (
        "closed as ground that is not known to be empty" if summary["unseen_closed_m2"] else "in no zone"
    )
    return (
        f", of it {square_metres(summary['dropped_area_m2'])} in {counted(regions, 'region')} below "
        f"{summary['min_area_m2']:g} m2: {covered}"
    )


def _also_closed(summary: dict[str, Any]) -> dict[str, str]:
    closed = {}
    if summary["unseen_closed_m2"]:
        closed["unseen"] = (
            f"{square_metres(summary['unseen_closed_m2'])} closed because they are not known to be empty"
        )
    if summary["static_zones"]:
        closed["zones of others"] = str(summary["static_zones"])
    return closed


def _zone_table(summary: dict[str, Any]) -> Any:
    from rich.table import Table

    zones, counts = summary["zones"], summary["zones_of_the_mission"]
    more = f", the largest {MOST_ZONES_SHOWN}" if len(zones) > MOST_ZONES_SHOWN else ""
    ever = counts["created"] + counts["split"]
    if ever > len(zones):
        more += f"; {ever} during the mission"
    table = Table(
        title=f"{counted(len(zones), 'zone')}{more}", title_justify="left", title_style="bold", box=None
    )
    table.add_column("zone")
    table.add_column("crowd m2", justify="right")
    table.add_column("closed m2", justify="right")
    table.add_column("largest P", justify="right")
    table.add_column("ends unseen", justify="right")
    table.add_column("why")
    for zone in zones[:MOST_ZONES_SHOWN]:
        table.add_row(
            zone["id"],
            square_metres(zone["area_m2"]).removesuffix(" m2"),
            square_metres(zone["closed_m2"]).removesuffix(" m2"),
            f"{zone['probability_max']:.2f}",
            "never" if zone["valid_for_s"] is None else f"in {zone['valid_for_s']:.0f} s",
            WHY[zone["reason"]],
        )
    return table


def _written(files: frozenset[str] | None) -> list[str]:
    from crowdfence.results import FILES

    return [name for name in FILES if files is None or name in files]
