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
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import one_line
from crowdfence.sources.csv_rows import integer, numbers, read_rows
from crowdfence.sources.interrupted_simulation import interrupted_line
from crowdfence.sources.recorded_truth import CameraPose, FrameTruth, PeopleLog, RecordedPeople
from crowdfence.sources.stamps import LAST_STAMP_NS

_WORLD = ("stamp_ns", "person", "x", "y", "z", "crowd")
_CAMERAS = "cameras.csv"
_CAMERA = ("x", "y", "z", "qw", "qx", "qy", "qz")

_BACK_WITHIN_S = 2.0
_MOST_MISSING = 0.1


class TrueCameras(NamedTuple):
    """The cameras of the pictures, by drone and stamp."""

    truth: Mapping[tuple[str, int], FrameTruth]
    warnings: tuple[str, ...]

    def of(self, drone: str, stamp_ns: int, *, has_world: bool) -> FrameTruth:
        """Of one picture. Where none is recorded and the world is, it was taken at its stamp."""
        if found := self.truth.get((drone, stamp_ns)):
            return found
        return FrameTruth(exposure_ns=partial(_as_it_is, stamp_ns)) if has_world else FrameTruth()

    def without_row(self, frames: Iterable[tuple[str, int]]) -> list[str]:
        """One sentence at most where the table is there, and lacks pictures (drone and stamp)."""
        told = list(frames)
        missing = [frame for frame in told if frame not in self.truth]
        if not self.truth or not missing:
            return []
        drone, stamp_ns = missing[0]
        return [
            f"{len(missing)} of {len(told)} pictures have no row in {_CAMERAS}, the first: {drone} at "
            f"{stamp_ns}; they count as taken at their stamp, from where telemetry puts them"
        ]


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
        said = f"where people stood cannot be read: {error}"
        return PeopleLog(unreadable=said), (said,)
    return PeopleLog(), ()


def read_cameras(folder: Path) -> TrueCameras:
    """The cameras as they were; rows that cannot be read are left out and counted."""
    path = folder / "truth" / _CAMERAS
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
    sentence beside it where the mission did not come to its end, or the file cannot be read."""
    path = folder / "simulation.json"
    if not path.is_file():
        return {}, ()
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        simulation = told["simulation"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        return {}, (f"{path.name} cannot be read, nor what a crowd is there: {one_line(error)}",)
    if not isinstance(simulation, dict):
        return {}, (f"{path.name} cannot be read, nor what a crowd is there: it holds no simulation",)
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
            stamp_ns, person, crowd = (integer(row, name) for name in ("stamp_ns", "person", "crowd"))
            place = numbers(row, ("x", "y", "z"))
            if stamp_ns > LAST_STAMP_NS or not np.isfinite(place).all():
                raise ValueError(f"no moment or no place: {stamp_ns} ns, {', '.join(map(str, place))} m")
        except ValueError as error:
            faulty.append(f"line {line}: {error}")
            continue
        rows.setdefault(stamp_ns, []).append([person, crowd, *place])
    warnings = [f"{path.name}: {len(faulty)} rows cannot be read, first: {faulty[0]}"] if faulty else []
    # Who is listed twice at one place, as in tables that were put together, would make a crowd of a couple.
    arrays = {stamp_ns: np.unique(np.array(rows[stamp_ns]), axis=0) for stamp_ns in sorted(rows)}
    if again := sum(map(len, rows.values())) - sum(map(len, arrays.values())):
        warnings.append(f"{path.name}: {again} rows say again who stands where, and count once")
    if told := _missing_people(path.name, arrays):
        warnings.append(told)
    return PeopleLog([*arrays], lambda stamp_ns: _people(stamp_ns, arrays[stamp_ns])), tuple(warnings)


def _missing_people(name: str, arrays: Mapping[int, NDArray[np.float64]]) -> str | None:
    """One sentence where people are missing at stamps around which they are there: a moment is known by all
    of its people, and of some there is no crowd. ValueError where that is so of many, as in a table that
    gives everybody stamps of their own."""
    if not arrays:
        return None
    stamps_ns = np.array([*arrays], np.int64)
    person = np.concatenate([people[:, 0] for people in arrays.values()])
    number = np.repeat(np.arange(len(arrays)), [len(people) for people in arrays.values()])
    order = np.lexsort((number, person))
    person, number = person[order], number[order]
    is_back = np.diff(person) == 0
    is_back &= np.diff(stamps_ns[number]) <= _BACK_WITHIN_S * 1e9
    missing = int(np.maximum(np.diff(number)[is_back] - 1, 0).sum())
    if not missing:
        return None
    share = missing / (missing + len(person))
    told = (
        f"{name}: {share:.1%} of the people who are there within {_BACK_WITHIN_S:g} s are missing at stamps "
        "in between; every stamp must list everybody"
    )
    if share > _MOST_MISSING:
        raise ValueError(told)
    return told


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
