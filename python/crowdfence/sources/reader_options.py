"""Options of `open_recording`, sorted to the readers that know them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from crowdfence.sources.camera_mount import CameraMount

OptionsT = TypeVar("OptionsT")


def reader_options(kind: type[OptionsT], path: Path, given: Mapping[str, Any]) -> OptionsT:
    """The options of one reader, a dataclass. `mount` may be text, `calibration` a file, `topics` one text.

    Errors as for `refuse_options`, of those that this reader has not.
    """
    known = {field.name for field in fields(kind)}  # type: ignore[arg-type]
    refuse_options(path, {name: value for name, value in given.items() if name not in known})
    return kind(**{name: _meant(name, value) for name, value in given.items()})


def refuse_options(path: Path, given: Mapping[str, Any]) -> None:
    """ValueError for options that only other kinds of recordings have, TypeError for one that none has."""
    for name in given:
        kinds = [kind for kind, names in _options_by_kind().items() if name in names]
        if not kinds:
            raise TypeError(f"open_recording() got an unexpected keyword argument {name!r}")
        raise ValueError(f"{path} is no {' or '.join(kinds)}: {name} does not apply")


def _options_by_kind() -> dict[str, set[str]]:
    from crowdfence.sources.airsim.vehicle import AirSimOptions
    from crowdfence.sources.film.reader import FilmOptions
    from crowdfence.sources.multi_camera.reader import MultiCameraOptions
    from crowdfence.sources.photographs.reader import PhotographOptions
    from crowdfence.sources.ros_bag.reader import BagOptions

    kinds = {
        "AirSim recording": AirSimOptions,
        "ROS bag": BagOptions,
        "film": FilmOptions,
        "folder of photographs": PhotographOptions,
        "data set of fixed cameras": MultiCameraOptions,
    }
    return {what: {field.name for field in fields(kind)} for what, kind in kinds.items()}


def _meant(name: str, value: Any) -> Any:
    if name == "mount" and isinstance(value, str):
        return CameraMount.parse(value)
    if name == "topics" and isinstance(value, str):
        return [value]
    if name == "telemetry":
        return Path(value)
    if name == "calibration" and isinstance(value, (str, PathLike)):
        from crowdfence.sources.lens.calibration_file import read_calibration

        return read_calibration(Path(value))
    return value
