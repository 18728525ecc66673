"""What recording.json says of a plain folder (`folder`): its cameras, its place on Earth, its map.

A key of a camera that is not known is refused, and one that is there twice: where `distortion` is misspelt,
or a second camera still has the name of the first, rays are others than was meant, and nothing would tell.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from crowdfence._core import Camera
from crowdfence.errors import quoted
from crowdfence.georeference import Georeference

_KEYS = ("cameras", "georeference", "terrain")
_INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
_CAMERA = (*_INTRINSICS, "model", "distortion")
_PLACE = ("latitude_deg", "longitude_deg", "height_m")
_MODELS = ("pinhole", "brown_conrady", "kannala_brandt")


class _TwiceError(ValueError):
    """A key that is there twice."""


def read_description(path: Path, warnings: list[str]) -> dict[str, Any]:
    """The file; keys that mean nothing here are told. ValueError."""
    try:
        description = json.loads(path.read_text(encoding="utf-8-sig"), object_pairs_hook=_each_once)
    except FileNotFoundError:
        raise ValueError(f"{path} is missing: it must hold the cameras of the drones") from None
    except _TwiceError as error:
        raise ValueError(f"{path} has two keys {quoted(error.args[0])} side by side; keep one") from None
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not JSON: {error}") from error
    if not isinstance(description, dict) or not isinstance(description.get("cameras"), dict):
        raise ValueError(f'{path} must be an object with "cameras", an object by drone name')
    if unknown := [key for key in description if key not in _KEYS]:
        # Notes of its owner, or a name that is misspelt.
        known = ", ".join(f'"{key}"' for key in _KEYS)
        warnings.append(f"{path.name}: {', '.join(unknown)} not used; known are {known}")
    return description


def camera_of(description: Mapping[str, Any], drone: str, path: Path) -> Camera:
    """The camera of a drone. ValueError where there is none, or one that cannot be used."""
    cameras = description["cameras"]
    entry = cameras.get(drone, cameras.get("*"))
    if entry is None:
        raise ValueError(f'{path} has no camera for drone {drone!r}: add cameras.{drone} or cameras."*"')
    whose = f"{path}: the camera of {drone!r}"
    if not isinstance(entry, dict):
        raise ValueError(f"{whose} is {quoted(entry)}; it must be an object with {', '.join(_CAMERA)}")
    _check_keys(whose, entry, _CAMERA)
    try:
        width, height = (_pixels(entry, name) for name in ("width", "height"))
        fx, fy, cx, cy = (_number(entry, name) for name in ("fx", "fy", "cx", "cy"))
        model, distortion = entry.get("model", "pinhole"), _distortion(entry)
        if model not in _MODELS:
            raise ValueError(f"unknown model {model!r} ({', '.join(_MODELS)})")
        if model == "pinhole" and any(distortion or ()):
            raise ValueError("a pinhole camera has no distortion: is it brown_conrady or kannala_brandt?")
        if model == "kannala_brandt":
            return Camera.fisheye(width, height, fx, fy, cx, cy, distortion or (0.0, 0.0, 0.0, 0.0))
        return Camera.pinhole(width, height, fx, fy, cx, cy, distortion)
    except KeyError as error:
        raise ValueError(f"{whose} has no {error}") from error
    except (OverflowError, ValueError) as error:
        raise ValueError(f"{whose} cannot be used: {error}") from error


def cameras_of_nobody(description: Mapping[str, Any], drones: Collection[str], name: str) -> list[str]:
    """What to tell of cameras of drones that are not there, where a drone has none of its own: under a
    misspelt name it takes that of all others."""
    cameras = description["cameras"]
    unused = [drone for drone in cameras if drone != "*" and drone not in drones]
    others = [drone for drone in sorted(drones) if drone not in cameras]
    if not (unused and others):
        return []
    return [
        f"{name}: there is a camera of {', '.join(map(quoted, unused))} and no such drone, and "
        f'{", ".join(map(quoted, others))} is given that of "*": if a name is misspelt, it is the lens of '
        "another, and what was seen is put elsewhere"
    ]


def georeference_of(description: Mapping[str, Any], path: Path) -> Georeference | None:
    """Where on Earth the origin of the poses lies, as far as it is told. ValueError for no such place."""
    entry = description.get("georeference")
    if entry is None:
        return None
    whose = f'{path}: "georeference"'
    if not isinstance(entry, dict):
        raise ValueError(f"{whose} is {quoted(entry)}; it must be an object with {', '.join(_PLACE)}")
    _check_keys(whose, entry, _PLACE)
    try:
        return Georeference(*(_number(entry, name) for name in _PLACE))
    except KeyError as error:
        raise ValueError(f"{whose} has no {error}; it needs {', '.join(_PLACE)}") from error
    except (OverflowError, ValueError) as error:
        raise ValueError(f"{whose}: {str(error).removeprefix('georeference: ')}") from error


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """What an object holds. JSON takes the last of two keys of one name."""
    held: dict[str, Any] = {}
    for key, value in pairs:
        if key in held:
            raise _TwiceError(key)
        held[key] = value
    return held


def _check_keys(whose: str, entry: Iterable[str], known: tuple[str, ...]) -> None:
    unknown = [key for key in entry if key not in known]
    if unknown:
        raise ValueError(f"{whose} has an unknown key {quoted(unknown[0])}; known are {', '.join(known)}")


def _pixels(entry: Mapping[str, Any], name: str) -> int:
    value = entry[name]
    if not (isinstance(value, int) and value >= 1):
        raise ValueError(f"{name} is {quoted(value)}; it must be a whole number of at least 1")
    return value


def _number(entry: Mapping[str, Any], name: str) -> float:
    return _as_number(name, entry[name])


def _as_number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(f"{name} is {quoted(value)}; it must be a number, without quotes")
    return float(value)


def _distortion(entry: Mapping[str, Any]) -> list[float] | None:
    values = entry.get("distortion")
    if values is None:
        return None
    if not isinstance(values, list):
        raise ValueError(f"distortion is {quoted(values)}; it must be a list of numbers")
    return [_as_number(f"distortion[{place}]", value) for place, value in enumerate(values)]
