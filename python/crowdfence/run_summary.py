"""What was run, on what, with which result, as `summary.json` says it."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from typing import Any

from crowdfence._core import CrowdMass
from crowdfence.iso_time import iso_utc
from crowdfence.pipeline import Run, shares
from crowdfence.sources.pose_noise import smoothed_by
from crowdfence.surface_grid import SurfaceGrid
from crowdfence.voxel_state import VoxelState


def run_facts(run: Run) -> dict[str, Any]:
    """What is said of a run of any layer, ready for JSON."""
    first_ns, description = run.rows[0].stamp_ns, run.description
    integrated = Counter(drone for row in run.rows for drone in row.drones)
    smoothed = smoothed_by(run.recording.manifest)
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
        "alignment": run.recording.manifest.get("alignment"),
        "pose_noise": {drone: asdict(noise) for drone, noise in smoothed.items()} or None,
        "left_out": run.recording.manifest.get("left_out", []),
        "hidden_by_camera_mask": run.recording.manifest.get("hidden_by_camera_mask", {}),
        "method": description.method,
        "parameters": description.parameters,
        "threshold": run.threshold,
    }


def summarise(run: Run, grid: SurfaceGrid) -> dict[str, Any]:
    """All of a run for crowds, ready for JSON."""
    return {
        **run_facts(run),
        "zone_rules": run.config.zone_parameters(run.crowd_map.default_threshold()),
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
