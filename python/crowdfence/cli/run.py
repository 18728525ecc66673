"""`crowdfence run`: fuse a recording and write the results."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.atomic_file import writable_folder
from crowdfence.cli import console, options
from crowdfence.cli.options import DEFAULT, EVIDENCE, PAPER
from crowdfence.config import RunConfig

if TYPE_CHECKING:
    from crowdfence.detector.detector import Detector
    from crowdfence.maps import MapReading
    from crowdfence.pipeline import Run
    from crowdfence.sources.recording import Recording

MOST_ZONES_SHOWN = 12


def run(
    context: typer.Context,
    recording: options.RecordingPath,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")],
    terrain: options.TerrainPath = None,
    voxel_size_m: options.VoxelSizeM = None,
    terrain_option: options.TerrainOption = None,
    origin: options.Origin = None,
    assume_local: options.AssumeLocal = False,
    detector: options.DetectorChoice = "auto",
    contract: options.ContractPath = None,
    method: options.Method = options.MethodName.evidence,
    memory_s: options.MemoryS = EVIDENCE.memory_s,
    sharp_gsd_m: options.SharpGsdM = EVIDENCE.sharp_gsd_m,
    doubt: options.Doubt = EVIDENCE.doubt,
    agreement: options.Agreement = EVIDENCE.agreement,
    zone_log_odds: options.ZoneLogOdds = EVIDENCE.zone_log_odds,
    clear_log_odds: options.ClearLogOdds = EVIDENCE.clear_log_odds,
    prior: options.Prior = None,
    alpha: options.Alpha = PAPER.alpha,
    decay: options.Decay = PAPER.decay,
    decay_unit: options.DecayUnitOption = options.DecayUnit.second,
    unseen: options.UnseenOption = options.Unseen.fleet,
    normalise: options.Normalise = False,
    initial: options.InitialOption = options.Initial.zero,
    true_positive_rate: options.TruePositiveRate = None,
    false_positive_rate: options.FalsePositiveRate = None,
    b_threshold: options.BThreshold = PAPER.b_threshold,
    fleet_size: options.FleetSize = None,
    max_range_m: options.MaxRangeM = DEFAULT.projection.max_range_m,
    target_height_m: options.TargetHeightM = None,
    coverage: options.CoverageOption = options.Coverage.full,
    surface: options.SurfaceOption = options.Surface.planes,
    tolerance_ms: options.ToleranceMs = DEFAULT.grouping.tolerance_ms,
    threshold: options.Threshold = None,
    min_area_m2: options.MinAreaM2 = DEFAULT.zones.min_area_m2,
    stale_after_s: options.StaleAfterS = DEFAULT.zones.stale_after_s,
    as_json: options.Json = False,
) -> None:
    """Find the crowds in a recording's pictures, fuse them onto a map, write the map, the zones and a
    picture."""
    config = options.run_config(context.params, options.method_config(context.params, method))
    map_options = options.terrain_options(
        voxel_size_m, terrain_option, origin=origin, assume_local=assume_local
    )
    from crowdfence.pipeline import choose_detector, read_map
    from crowdfence.sources import open_recording

    with writable_folder(output, parents=True):
        source = open_recording(recording)
        chosen = choose_detector(source, detector, contract=contract)
        ground = read_map(source, terrain, **map_options)
        fuse_and_report(source, ground, config, output, detector=chosen, as_json=as_json)


def fuse_and_report(
    recording: Recording,
    ground: MapReading,
    config: RunConfig,
    output: Path,
    *,
    detector: Detector | None,
    as_json: bool,
) -> None:
    """The whole job with progress, then the summary."""
    from crowdfence import pipeline
    from crowdfence.results import write_results

    started = time.perf_counter()
    with console.progress("fusing", len(recording.frames), "frames") as advance:
        finished = pipeline.run(
            recording,
            ground.terrain,
            config,
            detector=detector,
            holes=ground.holes,
            on_step=lambda instant, _: advance(len(instant.frames)),
        )
    seconds = time.perf_counter() - started
    summary = write_results(finished, output)
    if as_json:
        console.print_json(summary)
    else:
        _report(summary, finished, seconds, output)


def _report(summary: dict[str, Any], run: Run, seconds: float, output: Path) -> None:
    out = console.stdout()
    frames = sum(summary["frames"].values())
    area = summary["area_m2"]
    out.print(
        console.facts(
            f"{summary['recording']}: {summary['instants']} instants of {len(summary['frames'])} drones",
            {
                "time": f"{summary['first_instant'][:19]}Z, {summary['duration_s']:.1f} s",
                "frames": f"{frames} integrated in {seconds:.1f} s ({frames / seconds:.1f} per second), "
                f"{len(summary['refused'])} refused",
                "terrain": f"{run.terrain.voxel_count:,} voxels of {run.terrain.voxel_size_m:g} m, "
                f"{summary['terrain']['seen_voxels']:,} of them seen",
                **({} if run.holes is None else {"holes of the map": str(run.holes)}),
                "heatmaps": _heatmaps(summary["detector"]),
                "method": _method(summary),
                "crowd": f"{area['crowd']:.0f} m2 at P >= {run.threshold:.3f}",
                "empty": f"{area['empty']:.0f} m2 seen recently, {area['stale']:.0f} m2 too long ago; "
                f"{area['not_cleared']:.0f} m2 looked at, not cleared",
            },
        )
    )
    out.print(_zone_table(summary))
    for reason in [*summary["warnings"], *summary["refused"]]:
        console.warn(reason)
    out.print(f"\nresults in [bold]{output}[/]: {', '.join(_written())}", soft_wrap=True)


def _heatmaps(detector: dict[str, Any]) -> str:
    if "name" not in detector:
        return "as recorded"
    version = f" {detector['version']}" if detector["version"] else ""
    checksum = f", sha256 {detector['sha256'][:12]}" if detector["sha256"] else ""
    return f"{detector['name']}{version} on the pictures{checksum}"


def _method(summary: dict[str, Any]) -> str:
    used = summary["parameters"]
    if summary["method"] == "or":
        return f"or, b > {used['b_threshold']:g}"
    if summary["method"] == "evidence":
        return (
            f"evidence, memory {used['memory_s']:g} s, prior {used['prior']:.4f}, "
            f"empty up to P = {used['cleared']:.2g}"
        )
    return (
        f"paper, alpha {used['alpha']:g}, lambda {used['decay']:g} per {used['decay_unit']}, prior "
        f"{used['prior']:.3f}, TPR {used['true_positive_rate']:g}, FPR {used['false_positive_rate']:g}, "
        f"N {used['fleet_size']}"
    )


def _zone_table(summary: dict[str, Any]) -> Any:
    from rich.table import Table

    zones = summary["zones"]
    more = f", the largest {MOST_ZONES_SHOWN}" if len(zones) > MOST_ZONES_SHOWN else ""
    table = Table(title=f"{len(zones)} zones{more}", title_justify="left", title_style="bold", box=None)
    table.add_column("zone")
    table.add_column("area m2", justify="right")
    table.add_column("largest P", justify="right")
    for zone in zones[:MOST_ZONES_SHOWN]:
        table.add_row(zone["id"], f"{zone['area_m2']:.0f}", f"{zone['probability_max']:.2f}")
    return table


def _written() -> list[str]:
    from crowdfence.results import FILES

    return list(FILES)
