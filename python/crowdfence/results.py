"""A finished run -> one folder of files that other people's tools open."""

from __future__ import annotations

import json
from collections.abc import Collection
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from crowdfence._core import __version__
from crowdfence.atomic_file import write_bytes
from crowdfence.atomic_folder import whole_folder
from crowdfence.exports.frames_csv import write_frames_csv
from crowdfence.exports.geojson import write_geojson
from crowdfence.exports.geotiff import write_geotiff
from crowdfence.exports.octomap import write_coloured_octomap, write_terrain_octomap
from crowdfence.exports.picture import DroneTrack, ground_footprint, write_picture
from crowdfence.exports.report import report_page
from crowdfence.pipeline import Run
from crowdfence.run_summary import summarise
from crowdfence.surface_grid import SurfaceGrid

PICTURE_MARGIN_M = 60.0

FILES = {
    "zones.geojson": "no-fly polygons",
    "zone_history.jsonl": "zones, their evidence and what became of them, at every instant",
    "crowd_map.tif": "probability, state and what zones close per ground cell",
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
        write_geotiff(folder / "crowd_map.tif", grid, description, georeference, run.zones.closed)
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
