"""The report on a recording as text: a few facts, then one small table per question."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from crowdfence.cli import console
from crowdfence.cli.wording import in_options

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from crowdfence.inspection.camera import CameraReport
    from crowdfence.inspection.flight import Range
    from crowdfence.inspection.recording import DroneReport, RecordingReport, TerrainBelow, Trouble
    from crowdfence.inspection.terrain import TerrainReport
    from crowdfence.inspection.timing import PairOffset

_KINDS = {"mission": "mission file", "airsim": "AirSim recording", "folder": "plain folder"}

MOST_PAIRS_SHOWN = 15
"""Those of six drones."""


def print_recording(out: Console, report: RecordingReport) -> None:
    """Facts and tables to `out`; warnings and troubles to stderr."""
    out.print(_facts(report))
    for table in (_times(report), _cameras(report), _pixels(report), _flights(report), _overlap(report)):
        if table is not None:
            out.print()
            out.print(table)
    if report.terrain is not None and report.terrain.problem is not None:
        console.warn(in_options(report.terrain.problem))
    for warning in report.warnings:
        console.warn(in_options(warning))
    for trouble in report.refused:
        console.warn(in_options(f"refused {_trouble(trouble)}"))
    for trouble in report.damaged or ():
        console.warn(f"unusable {_trouble(trouble)}")


def _facts(report: RecordingReport) -> RenderableType:
    kind = _KINDS.get(report.kind, report.kind)
    sizes = [
        f"{count} with {_count(size, 'drone')}"
        for size, count in report.instants.with_drones.items()
        if count
    ]
    place = report.georeference
    rows = {
        "time": f"{report.first_frame or 'no usable frame'} + {report.duration_s:.3f} s",
        "instants": f"{report.instants.count} within {report.instants.tolerance_ms:g} ms"
        + (f": {', '.join(sizes)}" if sizes else ""),
        "offsets": _offsets(report.instants.offsets),
        "georeference": "none: local metres only"
        if place is None
        else f"{place.latitude_deg:.7f}, {place.longitude_deg:.7f} deg, {place.height_m:.1f} m (WGS84)",
        "terrain": _terrain(report.terrain),
        "refused": _total(report.refused),
        "unusable": "not looked for (--check-pixels)" if report.damaged is None else _total(report.damaged),
    }
    if not report.instants.offsets:
        del rows["offsets"]
    if report.layers:
        rows["layers"] = f"{', '.join(report.layers)} beside crowd (--layer)"
    drones = _count(len(report.drones), "drone")
    return console.facts(f"{report.path}: {kind}, {drones}, {_count(report.frames, 'frame')}", rows)


def _offsets(pairs: Iterable[PairOffset]) -> str:
    together = [(*pair.drones, pair.median_ms) for pair in pairs if pair.median_ms is not None]
    if not together:
        return "none: no instant holds frames of two drones"
    shown = together
    if len(shown) > MOST_PAIRS_SHOWN:
        shown = sorted(shown, key=lambda pair: -abs(pair[2]))[:MOST_PAIRS_SHOWN]
    told = ", ".join(f"{first} to {second} {median_ms:+.1f} ms" for first, second, median_ms in shown)
    left_out = len(together) - len(shown)
    return f"{told} (median within instants{f'; {left_out} pairs closer: --json' if left_out else ''})"


def _times(report: RecordingReport) -> RenderableType:
    columns = ("drone", "frames", "Hz", "max gap ms", "long gaps", "telemetry", "Hz", "max gap ms")
    return _table(
        "Frames and telemetry (a long gap is above 1.5 median periods)",
        columns,
        (
            (
                drone.drone,
                f"{drone.frames.count}",
                _number(drone.frames.rate_hz, ".2f"),
                _number(drone.frames.longest_gap_ms, ".1f"),
                f"{drone.frames.long_gaps}",
                f"{drone.telemetry.count}",
                _number(drone.telemetry.rate_hz, ".1f"),
                _number(drone.telemetry.longest_gap_ms, ".1f"),
            )
            for drone in report.drones
        ),
    )


def _cameras(report: RecordingReport) -> RenderableType:
    columns = ("drone", "image", "model", "fx px", "HFOV deg", "blind px", "distortion")
    return _table(
        "Cameras",
        columns,
        (_camera_row(drone, camera) for drone in report.drones for camera in drone.cameras),
        text_columns=("model", "distortion"),
    )


def _camera_row(drone: DroneReport, camera: CameraReport) -> tuple[str, ...]:
    return (
        drone.drone,
        f"{camera.width} x {camera.height}",
        camera.model,
        f"{camera.fx:.1f}",
        _number(camera.hfov_deg, ".1f"),
        f"{camera.blind_pixels}",
        " ".join(f"{value:.4g}" for value in camera.distortion) or "none",
    )


def _pixels(report: RecordingReport) -> RenderableType:
    columns = ("drone", "heatmaps", "size", "stride", "images", "crowd regions", "silhouettes", "depth")
    return _table(
        "Frames that hold",
        columns,
        (
            (
                drone.drone,
                f"{drone.pixels.heatmaps}",
                f"{drone.heatmap.width} x {drone.heatmap.height}" if drone.heatmap else "-",
                f"{drone.heatmap.stride:g}" if drone.heatmap else "-",
                f"{drone.pixels.images}",
                f"{drone.pixels.regions}",
                f"{drone.pixels.silhouettes}",
                f"{drone.pixels.depth}",
            )
            for drone in report.drones
        ),
    )


def _flights(report: RecordingReport) -> RenderableType:
    columns = ("drone", "tilt deg", "speed m/s", "height m", "beside", "under", "depth m")
    return _table(
        "Flight (tilt below the horizon, height above the map, frames beside and under the map, recorded "
        "depth against the map's)",
        columns,
        (
            (
                drone.drone,
                _range(drone.flight.tilt_below_horizon_deg),
                _range(drone.flight.speed_m_per_s),
                _range(drone.flight.height_above_terrain_m),
                _number(drone.flight.frames_beside_terrain, "d"),
                _number(drone.flight.frames_under_terrain, "d"),
                _number(drone.depth.median_absolute_m if drone.depth else None, ".2f"),
            )
            for drone in report.drones
        ),
    )


def _overlap(report: RecordingReport) -> RenderableType | None:
    overlap = report.overlap
    if overlap is None or not overlap.pairs:
        return None
    shown = list(overlap.pairs)
    if len(shown) > MOST_PAIRS_SHOWN:  # twelve drones are 66 pairs
        shown = sorted(shown, key=lambda pair: -(pair.mean_share or 0.0))[:MOST_PAIRS_SHOWN]
    left_out = len(overlap.pairs) - len(shown)
    rest = f"; {left_out} pairs that share less: --json" if left_out else ""
    return _table(
        f"Overlap of views within {overlap.max_range_m:g} m ({overlap.instants} instants sampled, "
        f"{overlap.overlapping_instants} with overlap{rest})",
        ("drones", "instants", "share of the smaller view"),
        ((" and ".join(pair.drones), f"{pair.instants}", _number(pair.mean_share, ".1%")) for pair in shown),
    )


def _table(
    title: str,
    columns: tuple[str, ...],
    rows: Iterable[tuple[str, ...]],
    text_columns: tuple[str, ...] = (),
) -> RenderableType:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, header_style="dim")
    for number, column in enumerate(columns):
        left = number == 0 or column in text_columns
        table.add_column(column, justify="left" if left else "right")
    for row in rows:
        table.add_row(*map(console.escaped, row))
    return Group(Text(title, style="bold"), table)  # a table's own title wraps at the table's width


def _terrain(below: TerrainBelow | None) -> str:
    if below is None:
        return "none named; give one with --terrain for heights and overlap"
    whose = "given" if below.given else "named by the recording"
    if below.report is None:
        return f"{below.path} ({whose}), cannot be used"
    report = below.report
    holes = "" if below.holes is None else f", holes: {below.holes}"
    size = f"{report.voxels:,} voxels of {report.voxel_size_m:g} m"
    said = "".join(f", read with {name}={value}" for name, value in below.read_with.items())
    return f"{below.path} ({whose}){said}, {size}{holes}{unmeasured_ground(report)}"


def unmeasured_ground(report: TerrainReport) -> str:
    """How much of a map's ground nobody measured, after a comma; nothing where its file says of none."""
    if not report.unmeasured_m2:
        return ""
    return f", {report.unmeasured_m2:,.0f} m2 ({report.unmeasured_share:.2%}) that nobody measured"


def _trouble(trouble: Trouble) -> str:
    return f"{_count(trouble.count, 'frame')} ({', '.join(trouble.drones)}), the first: {trouble.first}"


def _total(troubles: Iterable[Trouble]) -> str:
    total = sum(trouble.count for trouble in troubles)
    return _count(total, "frame") if total else "none"


def _range(values: Range | None) -> str:
    return "-" if values is None else f"{values.low:.1f} to {values.high:.1f}"


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
