"""A finished run of a layer other than crowds -> one folder of files that other people's tools open.

The files have other names than those of crowds, so that no tool takes the one for the other.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from os import PathLike
from pathlib import Path
from typing import Any

from crowdfence.atomic_file import write_bytes
from crowdfence.atomic_folder import whole_folder
from crowdfence.exports.geotiff import write_geotiff
from crowdfence.exports.octomap import write_coloured_octomap, write_terrain_octomap
from crowdfence.exports.site_picture import write_site_picture
from crowdfence.exports.sites_geojson import write_sites
from crowdfence.pipeline import Run
from crowdfence.results import PICTURE_MARGIN_M, drone_tracks
from crowdfence.run_summary import run_facts
from crowdfence.sources.layers import LANDING_SITE
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.voxel_state import VoxelState
from crowdfence.zones.sites import LandingSite, find_sites

LAYER_FILES = {
    "sites.geojson": "landing sites (layer landing-site)",
    "layer_map.tif": "probability of the class and state per ground cell",
    "layer_map.png": "the map as a picture, with the sites",
    "layer_map.ot": "OctoMap: the terrain, coloured by state and probability",
    "terrain.bt": "OctoMap: the terrain, occupied",
    "layer_map.crowdmap": "the state itself, to go on from (CrowdMap.load)",
    "summary.json": "what was run, on what, with which result",
}

ALWAYS = ("summary.json",)
"""What is written whatever files are chosen; sites too, where the layer has any."""


def chosen_layer_files(names: Collection[str] | None, layer: str) -> frozenset[str]:
    """Names of `LAYER_FILES`; all for None. ValueError for a name that is none."""
    unknown = set(names or ()) - LAYER_FILES.keys()
    if unknown:
        raise ValueError(
            f"{sorted(unknown)[0]!r} is no file of a layer's run; there are {', '.join(LAYER_FILES)}"
        )
    sites = ("sites.geojson",) if layer == LANDING_SITE else ()
    wanted = set(LAYER_FILES if names is None else (*ALWAYS, *sites, *names))
    return frozenset(wanted if sites else wanted - {"sites.geojson"})


def write_layer_results(
    run: Run, folder: str | PathLike[str], *, force: bool = False, files: Collection[str] | None = None
) -> dict[str, Any]:
    """Write the files of `LAYER_FILES` as the folder `folder` and return the summary, as `write_results` does
    for crowds; arguments and errors are the same."""
    wanted = chosen_layer_files(files, run.recording.layer)
    with whole_folder(folder, contents=LAYER_FILES, force=force) as beside:
        return _write_files(run, beside, wanted)


def sites_of(run: Run) -> tuple[LandingSite, ...]:
    """The landing sites at the end of a run, free of its zones; none for a layer of another class."""
    if run.recording.layer != LANDING_SITE:
        return ()
    return find_sites(
        run.crowd_map,
        run.stamp_ns,
        threshold=run.threshold,
        min_area_m2=run.config.zones.least_area_m2(run.config.projection.coverage),
        closed=run.zones.closed,
        stale_after_s=run.config.zones.stale_after_s,
    )


def _write_files(run: Run, folder: Path, wanted: frozenset[str]) -> dict[str, Any]:
    crowd_map, description, georeference = run.crowd_map, run.description, run.georeference
    threshold, stale_after_s = run.threshold, run.config.zones.stale_after_s
    grid = SurfaceGrid.from_crowd_map(
        crowd_map,
        run.stamp_ns,
        threshold=threshold,
        stale_after_s=stale_after_s,
        margin_m=PICTURE_MARGIN_M,
    )
    sites = sites_of(run)
    closed_ids = [zone.id for zone in run.zones.closed]
    if "sites.geojson" in wanted:
        write_sites(folder / "sites.geojson", sites, description, georeference, closed_ids)
    if "layer_map.tif" in wanted:
        write_geotiff(folder / "layer_map.tif", grid, description, georeference, run.zones)
    if "layer_map.png" in wanted:
        write_site_picture(
            folder / "layer_map.png", grid, sites, run.zones.closed, description, tracks=drone_tracks(run)
        )
    if "layer_map.ot" in wanted:
        probability = crowd_map.probability(run.stamp_ns)
        state = crowd_map.state(run.stamp_ns, threshold=threshold, stale_after_s=stale_after_s)
        write_coloured_octomap(folder / "layer_map.ot", run.terrain, probability, state, description)
    if "terrain.bt" in wanted:
        write_terrain_octomap(folder / "terrain.bt", run.terrain)
    if "layer_map.crowdmap" in wanted:
        crowd_map.save(folder / "layer_map.crowdmap")
    summary = _summary(run, grid, sites)
    write_bytes(folder / "summary.json", (json.dumps(summary, indent=2) + "\n").encode())
    return summary


def _summary(run: Run, grid: SurfaceGrid, sites: tuple[LandingSite, ...]) -> dict[str, Any]:
    """What was run, on what, with which result, ready for JSON."""
    return {
        "layer": run.recording.layer,
        **run_facts(run),
        "area_m2": _areas(grid),
        "closed_zones": len(run.zones.closed),
        "min_area_m2": run.config.zones.least_area_m2(run.config.projection.coverage),
        "sites": [
            {"id": site.id, "area_m2": site.area_m2, "radius_m": site.radius_m, "slope_deg": site.slope_deg}
            for site in sites
        ],
    }


def _areas(grid: SurfaceGrid) -> dict[str, float]:
    """Ground by what is known of it, in the words of a layer."""
    names = {VoxelState.CROWD: "found", VoxelState.EMPTY: "not_found"}
    return {
        names.get(state, state.name.lower()): grid.area_m2(state)
        for state in VoxelState
        if state != VoxelState.NEVER_SEEN
    }
