"""Recordings of AirSim and Cosys-AirSim, with heatmaps and telemetry beside them.

    airsim_rec.txt                                  the simulator's table: body pose and images per moment
    images/                                         its pictures
    settings.json                                   start positions, camera mounts, fields of view, origin
    heatmaps/heatmap_<vehicle>_<stamp_ns>.png|npy   what the detector said
    layers/<layer>/heatmap_<vehicle>_<stamp_ns>.png|npy   optional: heatmaps of other classes
    telemetry/<vehicle>.csv                         optional: camera or gimbal at telemetry rate
    truth/regions/region_<vehicle>_<stamp_ns>.png   optional: crowd numbers
    truth/layers/<layer>/label_<vehicle>_<stamp_ns>.png   optional: 0 = the pixel does not show the class
    truth/world.csv, people.npz, cameras.csv        optional: who stood where, and the cameras as they were
    terrain/terrain.bt, terrain/dem.tif             optional: a map

The table holds neither the gimbal nor the camera's pose, and its stamps are milliseconds, perhaps of
another clock than the file names. Where telemetry is missing, the camera is the table's body pose with the
mount of the settings; a gimbal that moved is then unknown, and the recording's warnings say so.

The camera's pose is composed at every telemetry row and then interpolated, so that a mission file, which
holds exactly these poses, gives the same views bit for bit.
"""

from functools import partial
from pathlib import Path

from crowdfence.sources.airsim.settings import AirSimSettings
from crowdfence.sources.airsim.table import TABLE_NAME, TableRow, read_table
from crowdfence.sources.airsim.vehicle import AirSimOptions, Vehicle, VehicleReader, first_file
from crowdfence.sources.airsim.world_truth import read_cameras, read_people, read_simulation
from crowdfence.sources.place_camera import Limits, place_cameras
from crowdfence.sources.recording import Recording, RefusedFrame
from crowdfence.sources.terrain_hint import find_terrain

__all__ = ["AirSimOptions", "find_airsim_folder", "read_airsim"]


def read_airsim(folder: Path, limits: Limits, options: AirSimOptions) -> Recording:
    """Open the folder that holds airsim_rec.txt. ValueError when table or settings cannot be used."""
    settings = AirSimSettings.read(options.settings or _find_settings(folder))
    only_vehicle = next(iter(settings.vehicles)) if len(settings.vehicles) == 1 else "drone"
    camera_names = sorted({name for vehicle in settings.vehicles for name in settings.cameras(vehicle)})
    rows, faulty = read_table(folder / TABLE_NAME, only_vehicle, camera_names)
    by_vehicle: dict[str, list[TableRow]] = {}
    for row in rows:
        by_vehicle.setdefault(row.vehicle, []).append(row)
    if not by_vehicle:
        raise ValueError(
            f"{folder / TABLE_NAME} has no usable line: {faulty[0][1] if faulty else 'only a header'}"
        )
    people, doubts = read_people(folder)
    cameras = read_cameras(folder)
    simulation, unfinished = read_simulation(folder)
    truth_of = partial(cameras.of, has_world=bool(len(people.stamps_ns)))
    reader = VehicleReader(folder, settings, options, len(by_vehicle), truth_of)
    found = {vehicle: reader.read(vehicle, rows) for vehicle, rows in sorted(by_vehicle.items())}
    _check_one_clock(found)
    frames, refused = place_cameras(
        {vehicle: item.unplaced for vehicle, item in found.items()},
        {vehicle: item.track for vehicle, item in found.items()},
        limits,
    )
    unknown = cameras.without_row((frame.drone, frame.stamp_ns) for frame in frames)
    return Recording(
        name=folder.resolve().name,
        drones=tuple(found),
        frames=frames,
        georeference=settings.georeference(),
        terrain=find_terrain(folder),
        refused=(*(RefusedFrame(vehicle, None, reason) for vehicle, reason in faulty), *refused),
        warnings=(
            *reader.warnings,
            *reader.labels_without_frame(),
            *doubts,
            *cameras.warnings,
            *unknown,
            *unfinished,
        ),
        manifest={
            "kind": "airsim",
            "path": str(folder),
            "settings": str(settings.path) if settings.path else None,
            "cameras": {vehicle: item.camera for vehicle, item in found.items()},
            "clock": {vehicle: item.clock for vehicle, item in found.items()},
            **simulation,
        },
        pose_tracks={vehicle: item.track for vehicle, item in found.items()},
        people=people,
    )


def _check_one_clock(found: dict[str, Vehicle]) -> None:
    """Frames of different vehicles are only simultaneous if one clock stamped them."""
    by_clock = {item.clock: vehicle for vehicle, item in found.items() if item.unplaced}
    if len(by_clock) > 1:
        (clock, vehicle), (other_clock, other_vehicle) = sorted(by_clock.items())
        raise ValueError(
            f"stamps of {vehicle!r} come from the {clock}, those of {other_vehicle!r} from the {other_clock}"
            "; the two run apart: record telemetry for all vehicles or for none"
        )


def find_airsim_folder(path: Path) -> Path | None:
    """The folder with airsim_rec.txt: `path` itself or its only subfolder with one, None if there is none.

    ValueError when several subfolders are recordings.
    """
    if (path / TABLE_NAME).is_file():
        return path
    inside = sorted(table.parent for table in path.glob(f"*/{TABLE_NAME}"))
    if len(inside) > 1:
        names = ", ".join(folder.name for folder in inside)
        raise ValueError(f"{path} holds {len(inside)} AirSim recordings ({names}): open one of them")
    return inside[0] if inside else None


def _find_settings(folder: Path) -> Path | None:
    return first_file(folder, ["settings.json"]) or first_file(folder.parent, ["settings.json"])
