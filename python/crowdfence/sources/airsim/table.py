"""airsim_rec.txt: one line per recorded moment of one vehicle, and the names of the images it lists.

Formats from the sources of AirSim and Cosys-AirSim: PawnSimApi.cpp getRecordFileLine, RecordingFile.cpp.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from crowdfence.sources.csv_rows import integer, numbers, read_rows

TABLE_NAME = "airsim_rec.txt"

_POSITION = ("POS_X", "POS_Y", "POS_Z")
_ATTITUDE = ("Q_W", "Q_X", "Q_Y", "Q_Z")
_IMAGE_NAME = re.compile(
    r"(?P<camera>.+?)_(?:(?P<type>[0-9])|10_(?P<annotation>.+?))_(?P<stamp>[0-9]{1,20})\.(?P<suffix>png|pfm|ppm|jpe?g)",
    re.ASCII,
)
_ANNOTATION = 10


@dataclass(frozen=True, slots=True)
class ImageName:
    """What the name of an image file says."""

    file: str
    camera: str
    image_type: int
    stamp_ns: int
    """Nanoseconds of the machine's clock when the picture was written, not of the simulation."""


@dataclass(frozen=True, slots=True)
class TableRow:
    """One line of the table: the body's pose in NED metres from the vehicle's own start."""

    line: int
    vehicle: str
    stamp_ms: int
    """Milliseconds of the simulation's clock, cut."""
    position: list[float]
    quaternion: list[float]
    images: tuple[ImageName, ...]


def read_table(
    path: Path, only_vehicle: str, camera_names: Sequence[str]
) -> tuple[list[TableRow], list[tuple[str, str]]]:
    """The rows, and (vehicle, reason) for every line that cannot be used.

    Columns are found by name: car recordings have more of them, and AirSim before 1.3 has no VehicleName;
    `only_vehicle` then stands in. `camera_names` settles names that can be read in two ways.
    """
    rows: list[TableRow] = []
    faulty: list[tuple[str, str]] = []
    for line, cells in read_rows(path, ["TimeStamp", *_POSITION, *_ATTITUDE, "ImageFile"], delimiter="\t"):
        if isinstance(cells, str):
            faulty.append(("", f"{path.name} {cells}"))
            continue
        vehicle = cells.get("VehicleName") or only_vehicle
        try:
            rows.append(
                TableRow(
                    line,
                    vehicle,
                    integer(cells, "TimeStamp"),
                    numbers(cells, _POSITION),
                    numbers(cells, _ATTITUDE),
                    tuple(_image_names(cells["ImageFile"], vehicle, camera_names)),
                )
            )
        except ValueError as error:
            faulty.append((vehicle, f"{path.name} line {line}: {error}"))
    return rows, faulty


def _image_names(cell: str, vehicle: str, camera_names: Sequence[str]) -> Iterable[ImageName]:
    for file in filter(None, (part.strip() for part in cell.split(";"))):
        name = parse_image_name(file, vehicle, camera_names)
        if name is None:
            raise ValueError(
                f"image name {file[:80]!r} is not img_[<vehicle>_]<camera>_<type>_<nanoseconds>.<ext>"
            )
        yield name


def parse_image_name(file: str, vehicle: str, camera_names: Sequence[str] = ()) -> ImageName | None:
    """Read `img_<vehicle>_<camera>_<type>[_<annotation>]_<ns>.<ext>` or, without vehicle,
    `img_<camera>_<type>_<ns>.<ext>`; None for anything else, also for a path.

    Vehicle and camera names may hold underscores themselves. The vehicle is known from the table's row; where
    its name is also the beginning of a camera's, the reading whose camera is in `camera_names` wins.
    """
    readings = [f"img_{vehicle}_"] if vehicle else ["img__"]
    parsed = []
    for prefix in [*readings, "img_"]:
        match = _IMAGE_NAME.fullmatch(file.removeprefix(prefix)) if file.startswith(prefix) else None
        if match is not None and not set(match["camera"]) & set("/\\"):
            image_type = _ANNOTATION if match["type"] is None else int(match["type"])
            parsed.append(ImageName(file, match["camera"], image_type, int(match["stamp"])))
    return next((name for name in parsed if name.camera in camera_names), parsed[0] if parsed else None)
