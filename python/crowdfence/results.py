"""A finished run -> one folder of files that other people's tools open."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from crowdfence._core import CrowdMass, __version__
from crowdfence.atomic_file import write_bytes
from crowdfence.atomic_folder import whole_folder
from crowdfence.exports.frames_csv import write_frames_csv
from crowdfence.exports.geojson import write_geojson
from crowdfence.exports.geotiff import write_geotiff
from crowdfence.exports.octomap import write_coloured_octomap, write_terrain_octomap
from crowdfence.exports.picture import DroneTrack, ground_footprint, write_picture
from crowdfence.exports.report import report_page
from crowdfence.iso_time import iso_utc
from crowdfence.pipeline import Run, shares
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.voxel_state import VoxelState

PICTURE_MARGIN_M = 60.0

FILES = {
    "zones.geojson": "no-fly polygons",
    "zone_history.jsonl": "zones, their evidence and what became of them, at every instant",
    "crowd_map.tif": "probability and state per ground cell",
    "crowd_map.png": "the map as a picture",
    "report.html": "all of it on one page to look at first, print or send by mail",
    "terrain.bt": "OctoMap: the terrain, occupied",
    "crowd_map.ot": "OctoMap: the terrain, coloured by state and probability",
    "frames.csv": "one row per instant",
    "crowd_map.crowdmap": "the state itself, to go on from (CrowdMap.load)",
    "summary.json": "what was run, on what, with which result",
}


ALWAYS = ("zones.geojson", "zone_history.jsonl", "summary.json")
"""What a run writes whatever files are chosen."""


def chosen_files(names: Collection[str] | None) -> frozenset[str]:
    """Names of `FILES`, those of `ALWAYS` among them; all for None. ValueError for a name that is none."""
    unknown = set(names or ()) - FILES.keys()
    if unknown:
        raise ValueError(f"{sorted(unknown)[0]!r} is no file of a run; there are {', '.join(FILES)}")
    return frozenset(FILES if names is None else (*ALWAYS, *names))


def write_results(
    run: Run, folder: str | PathLike[str], *, force: bool = False, files: Collection[str] | None = None
) -> dict[str, Any]:
    """Write the files of `FILES` as the folder `folder` and return the summary; `files` chooses among them.

    The folder is whole or absent: what fails, or is killed, leaves what was there. `force` replaces a folder
    that a run wrote. FileExistsError without it, OSError when a file cannot be written.
    """
    wanted = chosen_files(files)
    with whole_folder(folder, contents=FILES, force=force) as beside:
        return _write_files(run, beside, wanted)


def _write_files(run: Run, folder: Path, wanted: frozenset[str]) -> dict[str, Any]:
    config, crowd_map = run.config, run.crowd_map
    grid = SurfaceGrid.from_crowd_map(
        crowd_map,
        run.stamp_ns,
        threshold=run.threshold,
        stale_after_s=config.zones.stale_after_s,
        margin_m=PICTURE_MARGIN_M,
    )
    description, georeference = run.description, run.georeference

    write_geojson(folder / "zones.geojson", run.zones, description, georeference)
    run.history.write(folder / "zone_history.jsonl")
    if "crowd_map.tif" in wanted:
        write_geotiff(folder / "crowd_map.tif", grid, description, georeference)
    if wanted & {"crowd_map.png", "report.html"}:
        write_picture(
            folder / "crowd_map.png",
            grid,
            run.zones,
            description,
            tracks=drone_tracks(run),
            georeference=georeference,
        )
    if "terrain.bt" in wanted:
        write_terrain_octomap(folder / "terrain.bt", run.terrain)
    if "crowd_map.ot" in wanted:
        write_coloured_octomap(
            folder / "crowd_map.ot",
            run.terrain,
            crowd_map.probability(run.stamp_ns),
            crowd_map.state(run.stamp_ns, threshold=run.threshold, stale_after_s=config.zones.stale_after_s),
            description,
        )
    if "frames.csv" in wanted:
        write_frames_csv(folder / "frames.csv", run.rows)
    if "crowd_map.crowdmap" in wanted:
        crowd_map.save(folder / "crowd_map.crowdmap")
    summary = summarise(run, grid)
    if "report.html" in wanted:
        picture = (folder / "crowd_map.png").read_bytes()
        page = report_page(summary, run.zones, run.stamp_ns, picture, __version__)
        write_bytes(folder / "report.html", page.encode())
    if "crowd_map.png" not in wanted:
        (folder / "crowd_map.png").unlink(missing_ok=True)
    write_bytes(folder / "summary.json", (json.dumps(summary, indent=2) + "\n").encode())
    return summary


def summarise(run: Run, grid: SurfaceGrid) -> dict[str, Any]:
    """What was run, on what, with which result, ready for JSON."""
    first_ns, description = run.rows[0].stamp_ns, run.description
    integrated = Counter(drone for row in run.rows for drone in row.drones)
    return {
        "recording": run.recording.name,
        "first_instant": iso_utc(first_ns),
        "last_instant": iso_utc(run.stamp_ns),
        "duration_s": (run.stamp_ns - first_ns) / 1e9,
        "instants": len(run.rows),
        "frames": {drone: integrated[drone] for drone in run.recording.drones},
        "refused": [str(refused) for refused in run.refused],
        "warnings": run.warnings,
        "detector": heatmaps_of(run),
        "terrain": {
            "voxels": run.terrain.voxel_count,
            "voxel_size_m": run.terrain.voxel_size_m,
            "voxel_size_why": run.voxel_size_why,
            "seen_voxels": run.rows[-1].voxels_seen_so_far,
            "holes": None if run.holes is None else asdict(run.holes),
        },
        "method": description.method,
        "parameters": description.parameters,
        "threshold": run.threshold,
        "area_m2": {
            state.name.lower(): grid.area_m2(state) for state in VoxelState if state != VoxelState.NEVER_SEEN
        },
        "crowd_mass": _crowd_mass(run),
        "zones": [
            {
                "id": zone.id,
                "area_m2": zone.area_m2,
                "closed_m2": zone.polygon.area,
                "probability_max": zone.probability_max,
                "probability_interval": zone.interval,
                "valid_until": None if zone.valid_until_ns is None else iso_utc(zone.valid_until_ns),
                "valid_for_s": None
                if zone.valid_until_ns is None
                else (zone.valid_until_ns - run.stamp_ns) / 1e9,
                "forgotten_at": None if zone.forgotten_ns is None else iso_utc(zone.forgotten_ns),
                "reason": zone.reason,
            }
            for zone in run.zones
        ],
        "zones_of_the_mission": _zone_counts(run),
        "unseen_closed_m2": sum(zone.polygon.area for zone in run.zones.unseen),
        "static_zones": len(run.zones.static),
        "dropped_regions": run.zones.dropped_count,
        "min_area_m2": run.zones.min_area_m2,
        "dropped_area_m2": run.zones.dropped_area_m2,
    }


def _zone_counts(run: Run) -> dict[str, int]:
    """How often what became of a zone, over all instants."""
    kinds = Counter(event.kind for event in run.history.events)
    return {kind: kinds[kind] for kind in ("created", "split", "merged", "expired")}


def _crowd_mass(run: Run) -> dict[str, Any]:
    """Heatmap value of all pixels that show crowd, and which share of it met what: of all drones, of each."""

    def told(mass: CrowdMass) -> dict[str, Any]:
        return {"total": mass.total, "shares": shares(mass)}

    return {
        "b_threshold": run.crowd_map.method.b_threshold,
        **told(sum(run.crowd_mass.values(), CrowdMass())),
        "drones": {drone: told(mass) for drone, mass in run.crowd_mass.items()},
    }


def heatmaps_of(run: Run) -> dict[str, Any]:
    """Who made the heatmaps, and how the flight was beside what a model was tested for."""
    detector = run.heatmaps.to_json()
    if run.review is not None:
        detector["ranges"] = {check.quantity: check.to_json() for check in run.review.ranges}
    return detector


def drone_tracks(run: Run) -> list[DroneTrack]:
    """Where each drone's camera was at its frames, and what it saw last."""
    tracks = []
    for drone in run.recording.drones:
        frames = run.recording.frames_of(drone)
        if not frames:
            continue
        positions = np.array([frame.world_from_camera[:3, 3] for frame in frames])
        last = run.last_views.get(drone)
        footprint = (
            np.empty((0, 2))
            if last is None
            else ground_footprint(last, run.terrain, run.config.projection.max_range_m)
        )
        tracks.append(DroneTrack(drone, positions, footprint))
    return tracks
