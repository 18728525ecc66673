"""Zones drawn by a test, and a ground station that talks to emulated vehicles on a clock of its own."""

import json
from pathlib import Path

import numpy as np
import shapely

from crowdfence import Georeference, Zone
from crowdfence.fence_sync import FenceKeeper, GroundStation, Patience
from crowdfence.fence_sync.autopilot_capacity import Capacity
from support.vehicle_emulator import Channel, EmulatedLink, EmulatedVehicle, closes

HERE = Georeference(47.3977, 8.5456, 500.0)
"""Where the emulated vehicle stands."""


def zone(polygon: shapely.Geometry, name: str = "Z1", ground_m: tuple[float, float] = (0.0, 0.0)) -> Zone:
    return Zone(
        id=name,
        polygon=polygon,
        cell_count=1,
        area_m2=polygon.area,
        probability_max=0.9,
        probability_mean=0.9,
        lower_m=ground_m[0],
        upper_m=ground_m[1],
        last_seen_ns=0,
        oldest_look_ns=0,
        seen_by=("uav1",),
    )


def box(west: float, south: float, side_m: float = 20.0, name: str = "Z1") -> Zone:
    return zone(shapely.box(west, south, west + side_m, south + side_m), name)


def written_zones(path: Path, *boxes: tuple[float, float, float, float], **properties: object) -> Path:
    """A GeoJSON file of boxes: west, south, east, north in degrees."""
    features = [
        {
            "type": "Feature",
            "id": f"Z{number}",
            "geometry": json.loads(shapely.to_geojson(shapely.box(*corners))),
            "properties": properties,
        }
        for number, corners in enumerate(boxes, start=1)
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def station(link: EmulatedLink, patience: Patience | None = None, system: int | None = None) -> GroundStation:
    ground = GroundStation(link, clock=link.clock, patience=patience)
    ground.find_vehicle(10.0, system)
    return ground


def keeper(
    vehicle: EmulatedVehicle,
    folder: Path,
    channel: Channel | None = None,
    capacity: Capacity | None = None,
) -> FenceKeeper:
    return FenceKeeper(station(EmulatedLink(vehicle, channel=channel)), folder, capacity)


def covers(vehicle: EmulatedVehicle, zones: list[Zone], georeference: Georeference = HERE) -> bool:
    """Whether the edges of the zones lie in what the vehicle holds, as the vehicle itself works it out."""
    share = np.linspace(0.0, 1.0, 8)[:, None, None]
    for one in zones:
        ring = shapely.get_coordinates(one.polygon)
        corners = (ring[:-1] + share * np.diff(ring, axis=0)).reshape(-1, 2)
        heights = [[x, y, z] for z in (one.lower_m, one.upper_m) for x, y in corners]
        latitude, longitude, _ = georeference.geodetic_from_local(heights)
        if not all(closes(vehicle.items, *place) for place in zip(latitude, longitude, strict=True)):
            return False
    return True
