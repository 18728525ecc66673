"""What `crowdfence run --layer` prints of a finished run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowdfence.cli import console
from crowdfence.cli.made_by import heatmaps_line, method_line
from crowdfence.cli.refusals import refusal_lines
from crowdfence.cli.wording import counted

if TYPE_CHECKING:
    from crowdfence.pipeline import Run

MOST_SITES_SHOWN = 12


def report_layer(summary: dict[str, Any], run: Run, seconds: float, output: Path, written: list[str]) -> None:
    out = console.stdout()
    frames, area, layer = sum(summary["frames"].values()), summary["area_m2"], summary["layer"]
    out.print(
        console.facts(
            f"{summary['recording']}, layer {layer}: {counted(summary['instants'], 'instant')} of "
            f"{counted(len(summary['frames']), 'drone')}",
            {
                "frames": f"{frames} integrated in {seconds:.1f} s, {len(summary['refused'])} refused",
                "terrain": f"{run.terrain.voxel_count:,} voxels of {run.terrain.voxel_size_m:g} m, "
                f"{summary['terrain']['seen_voxels']:,} of them seen",
                "heatmaps": heatmaps_line(summary["detector"]),
                "method": method_line(summary),
                layer: f"{area['found']:.0f} m2 at P >= {run.threshold:.3f}",
                f"no {layer}": f"{area['not_found']:.0f} m2 seen recently; {area['not_cleared']:.0f} m2 "
                "looked at, undecided",
                **_closed(summary),
            },
        )
    )
    if "sites.geojson" in written:
        out.print(_site_table(summary))
    for reason in [*untold_warnings(run), *refusal_lines(run.refused)]:
        console.warn(reason)
    out.print(f"\nresults in [bold]{console.escaped(output)}[/]: {', '.join(written)}", soft_wrap=True)


def untold_warnings(run: Run) -> list[str]:
    """Those of a run but what zones of others hold besides, which is told before the first frame."""
    told = set(run.static_left_out)
    return [reason for reason in run.warnings if reason not in told]


def _closed(summary: dict[str, Any]) -> dict[str, str]:
    """That nothing kept sites out of no-fly zones is never left unsaid."""
    if summary["closed_zones"]:
        return {"no-fly zones": f"{summary['closed_zones']}, kept free of sites"}
    return {"no-fly zones": "none given (--static-zones): sites may lie inside one"}


def _site_table(summary: dict[str, Any]) -> Any:
    from rich.table import Table

    sites = summary["sites"]
    more = f", the {MOST_SITES_SHOWN} with the most room" if len(sites) > MOST_SITES_SHOWN else ""
    table = Table(title=f"\n{counted(len(sites), 'site')}{more}", title_justify="left", box=None)
    table.add_column("site")
    for column in ("area", "free disc", "steepest"):
        table.add_column(column, justify="right")
    for site in sites[:MOST_SITES_SHOWN]:
        table.add_row(
            site["id"],
            f"{site['area_m2']:.0f} m2",
            f"{site['radius_m']:.1f} m",
            f"{site['slope_deg']:.1f} deg",
        )
    return table
