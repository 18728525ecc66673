"""What an AirSim recording knows of the world: where everybody stood, and the cameras as they were.

    truth/world.csv     stamp_ns, person, x, y, z, crowd: everybody over time, feet in local ENU metres,
                        crowd 0 = in none
    truth/people.npz    the same as arrays: stamp_ns [T], position_enu [T, P, 3], crowd_id [P]
    truth/cameras.csv   drone, stamp_ns, exposure_ns, x, y, z, qw, qx, qy, qz: the camera of each picture,
                        camera axes (OpenCV) -> ENU, and when it was taken on the clock of the world

Without cameras.csv, or a row of it, pictures count as taken at their stamp: AirSim has one clock.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.csv_rows import integer, numbers, read_rows
from crowdfence.sources.interrupted_simulation import interrupted_line
from crowdfence.sources.recorded_truth import CameraPose, FrameTruth, PeopleLog, RecordedPeople

_WORLD = ("stamp_ns", "person", "x", "y", "z", "crowd")
_CAMERA = ("x", "y", "z", "qw", "qx", "qy", "qz")


class TrueCameras(NamedTuple):
    """The cameras of the pictures, by drone and stamp."""

    truth: Mapping[tuple[str, int], FrameTruth]
    warnings: tuple[str, ...]

    def of(self, drone: str, stamp_ns: int, *, has_world: bool) -> FrameTruth:
        """Of one picture. Where none is recorded and the world is, it was taken at its stamp."""
        if found := self.truth.get((drone, stamp_ns)):
            return found
        return FrameTruth(exposure_ns=partial(_as_it_is, stamp_ns)) if has_world else FrameTruth()


def read_people(folder: Path) -> tuple[PeopleLog, tuple[str, ...]]:
    """Everybody over time, and what is doubtful about it; an empty log where nothing is recorded or the file
    cannot be read."""
    table, arrays = folder / "truth" / "world.csv", folder / "truth" / "people.npz"
    try:
        if table.is_file():
            return _read_table(table)
        if arrays.is_file():
            return _read_arrays(arrays), ()
    except (OSError, ValueError, KeyError) as error:
        return PeopleLog(), (f"where people stood cannot be read: {error}",)
    return PeopleLog(), ()


def read_cameras(folder: Path) -> TrueCameras:
    """The cameras as they were; rows that cannot be read are left out and counted."""
    path = folder / "truth" / "cameras.csv"
    if not path.is_file():
        return TrueCameras({}, ())
    truth: dict[tuple[str, int], FrameTruth] = {}
    faulty: list[str] = []
    try:
        for line, row in read_rows(path, ["drone", "stamp_ns", "exposure_ns", *_CAMERA]):
            if isinstance(row, str):
                faulty.append(row)
                continue
            try:
                stamp_ns, exposure_ns = integer(row, "stamp_ns"), integer(row, "exposure_ns")
                pose = _pose(numbers(row, _CAMERA))
            except ValueError as error:
                faulty.append(f"line {line}: {error}")
                continue
            truth[row["drone"], stamp_ns] = FrameTruth(
                pose=partial(_as_it_is, pose), exposure_ns=partial(_as_it_is, exposure_ns)
            )
    except (OSError, ValueError) as error:
        return TrueCameras({}, (f"the cameras as they were cannot be read: {error}",))
    said = f"{path.name}: {len(faulty)} rows cannot be read, first: {faulty[0]}" if faulty else ""
    return TrueCameras(truth, (said,) if said else ())


def read_simulation(folder: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """What the simulator says of itself in simulation.json, with the definition of a crowd; else nothing. One
    sentence beside it where the mission did not come to its end."""
    path = folder / "simulation.json"
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        simulation = told["simulation"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return {}, ()
    if not isinstance(simulation, dict):
        return {}, ()
    # The simulator writes them at the end: a run that was killed left none.
    killed = "made_with" in simulation and "statistics" not in told
    interrupted = interrupted_line({"complete": False} if killed else told.get("statistics"))
    return {"simulation": simulation}, () if interrupted is None else (interrupted,)


def _read_table(path: Path) -> tuple[PeopleLog, tuple[str, ...]]:
    rows: dict[int, list[list[float]]] = {}
    faulty: list[str] = []
    for line, row in read_rows(path, _WORLD):
        if isinstance(row, str):
            faulty.append(row)
            continue
        try:
            person, crowd = integer(row, "person"), integer(row, "crowd")
            place = numbers(row, ("x", "y", "z"))
            rows.setdefault(integer(row, "stamp_ns"), []).append([person, crowd, *place])
        except ValueError as error:
            faulty.append(f"line {line}: {error}")
    warnings = (f"{path.name}: {len(faulty)} rows cannot be read, first: {faulty[0]}",) if faulty else ()
    arrays = {stamp_ns: np.array(some) for stamp_ns, some in rows.items()}
    return PeopleLog(sorted(arrays), lambda stamp_ns: _people(stamp_ns, arrays[stamp_ns])), warnings


def _people(stamp_ns: int, rows: NDArray[np.float64]) -> RecordedPeople:
    """`rows` [P, 5]: person, crowd, x, y, z."""
    person, crowd = rows[:, 0].astype(np.uint32), rows[:, 1].astype(np.uint32)
    return RecordedPeople(stamp_ns, rows[:, 2:].astype(np.float32), person, crowd)


def _read_arrays(path: Path) -> PeopleLog:
    with np.load(path, allow_pickle=False) as arrays:
        stamps_ns, position, crowd = (arrays[name] for name in ("stamp_ns", "position_enu", "crowd_id"))
    stamps_ns, crowd = stamps_ns.astype(np.int64), crowd.astype(np.uint32)
    if position.shape != (len(stamps_ns), len(crowd), 3):
        raise ValueError(
            f"{path.name} has position_enu {list(position.shape)} for {len(stamps_ns)} stamps and "
            f"{len(crowd)} people"
        )
    first = {int(stamp_ns): row for row, stamp_ns in reversed(list(enumerate(stamps_ns)))}
    person = np.arange(1, len(crowd) + 1, dtype=np.uint32)

    def people(stamp_ns: int) -> RecordedPeople:
        return RecordedPeople(stamp_ns, position[first[stamp_ns]].astype(np.float32), person, crowd)

    return PeopleLog(sorted(first), people)


def _pose(values: list[float]) -> CameraPose:
    quaternion = np.array(values[3:])
    length = float(np.linalg.norm(quaternion))
    if not (np.isfinite(values).all() and length > 0.5):
        raise ValueError(f"a camera pose that is none: {values}")
    return CameraPose(np.array(values[:3]), quaternion / length)


def _as_it_is(value: Any) -> Any:
    return value
