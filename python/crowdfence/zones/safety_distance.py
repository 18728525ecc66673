"""How far around a crowd the fence stands: one function per rule, each with its formula and source.

The distances of a list of rules are added (`safety_distance_m`): a rule for where an aircraft may come down,
and what makes the edge of the crowd itself uncertain. The functions compute what their formula says and no
more; whether a rule applies to a flight, and whether keeping it makes the flight lawful, they do not say.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence

GRAVITY_MPS2 = 9.81
LEAST_WIND_MPS = 3.0
"""Wind that a descent under a parachute is reckoned with at least (as for `parachute`)."""
SIGMAS_95 = math.sqrt(-2.0 * math.log(0.05))
"""95 % of errors that are normal and alike in both directions lie within 2.45 sigma (Rayleigh)."""
MOST_M = 100_000.0
"""Around a crowd; what is longer is a slip of the pen."""

_STS01_HEIGHTS_M = (30.0, 60.0, 90.0, 120.0)
_STS01_LIGHT_M = (10.0, 15.0, 20.0, 25.0)
_STS01_HEAVY_M = (20.0, 30.0, 45.0, 60.0)
_STS01_LIGHT_KG = 10.0
_STS01_MOST_KG = 25.0


def fixed(distance_m: float) -> float:
    """A distance of the operator's own."""
    return _not_negative("distance_m", distance_m)


def one_to_one(height_m: float, size_m: float = 0.0) -> float:
    """1:1 rule: H + CD / 2, as far away as the aircraft is high, and half its size.

    UK CAA GM1 to UAS.OPEN.040(1) (horizontal separation not less than the height); the size as in the ground
    risk buffer of the German LBA's guidance to SORA.
    """
    return _not_negative("height_m", height_m) + _not_negative("size_m", size_m) / 2


def ballistic(speed_mps: float, height_m: float, size_m: float = 0.0) -> float:
    """v sqrt(2 H / g) + CD / 2: motors off, no drag; height of the top of the contingency volume.

    Ground risk buffer of the German LBA's guidance to SORA; for rotorcraft only.
    """
    fall_s = math.sqrt(2.0 * _not_negative("height_m", height_m) / GRAVITY_MPS2)
    return _not_negative("speed_mps", speed_mps) * fall_s + _not_negative("size_m", size_m) / 2


def parachute(
    speed_mps: float, height_m: float, opening_s: float, descent_mps: float, wind_mps: float = LEAST_WIND_MPS
) -> float:
    """v t + w H / v_z: flight until the parachute is open, then drift with the wind, of at least 3 m/s.

    Ground risk buffer of the German LBA's guidance to SORA.
    """
    if not 0.0 < descent_mps < math.inf:
        raise ValueError(f"descent_mps is {descent_mps:g}; it must be finite and > 0")
    drift_mps = max(_not_negative("wind_mps", wind_mps), LEAST_WIND_MPS)
    before_m = _not_negative("speed_mps", speed_mps) * _not_negative("opening_s", opening_s)
    return before_m + drift_mps * _not_negative("height_m", height_m) / descent_mps


def glide(height_m: float, ratio: float) -> float:
    """H E: a fixed wing without a motor, with its glide ratio E.

    Ground risk buffer of the German LBA's guidance to SORA.
    """
    return _not_negative("height_m", height_m) * _not_negative("ratio", ratio)


def eu_a2(height_m: float, low_speed: bool = False) -> float:
    """max(H, 30), with the low-speed mode max(H, 5): distances to uninvolved persons in the EU's subcategory
    A2 (UAS.OPEN.030), joined with its 1:1 rule. Assemblies of people may not be overflown at all there."""
    return max(_not_negative("height_m", height_m), 5.0 if low_speed else 30.0)


def sts01(height_m: float, mass_kg: float) -> float:
    """Least ground risk buffer of the EU's standard scenario STS-01 (UAS.STS-01.020), a table: up to 30, 60,
    90, 120 m high 10, 15, 20, 25 m below 10 kg and 20, 30, 45, 60 m from there.

    Taken from secondary sources, not from the regulation's text. ValueError above 120 m, and above the 25 kg
    of class C5.
    """
    if mass_kg > _STS01_MOST_KG:
        raise ValueError(f"mass_kg is {mass_kg:g}; STS-01 ends at {_STS01_MOST_KG:g} kg")
    heavy = _not_negative("mass_kg", mass_kg) >= _STS01_LIGHT_KG
    distances_m = _STS01_HEAVY_M if heavy else _STS01_LIGHT_M
    for top_m, distance_m in zip(_STS01_HEIGHTS_M, distances_m, strict=True):
        if _not_negative("height_m", height_m) <= top_m:
            return distance_m
    raise ValueError(f"height_m is {height_m:g}; STS-01 ends at {_STS01_HEIGHTS_M[-1]:g} m")


def contingency(
    speed_mps: float,
    reaction_s: float = 1.0,
    pitch_deg: float = 45.0,
    gps_m: float = 3.0,
    holding_m: float = 3.0,
    map_m: float = 1.0,
) -> float:
    """S_GPS + S_POS + S_K + v t + v^2 / (2 g tan(pitch)): until a multirotor stands still.

    Contingency volume of the German LBA's guidance to SORA, with its usual values.
    """
    if not 0.0 < pitch_deg < 90.0:
        raise ValueError(f"pitch_deg is {pitch_deg:g}; it must be between 0 and 90")
    errors_m = sum(
        _not_negative(name, value)
        for name, value in (("gps_m", gps_m), ("holding_m", holding_m), ("map_m", map_m))
    )
    speed = _not_negative("speed_mps", speed_mps)
    stop_m = speed**2 / (2.0 * GRAVITY_MPS2 * math.tan(math.radians(pitch_deg)))
    return errors_m + speed * _not_negative("reaction_s", reaction_s) + stop_m


def map_resolution(voxel_size_m: float) -> float:
    """sqrt(2) / 2 of a voxel: from the middle of a cell, where crowd is told to be, to its corner. Ours."""
    return _not_negative("voxel_size_m", voxel_size_m) * math.sqrt(0.5)


def pose_error(sigma_m: float, sigmas: float = SIGMAS_95) -> float:
    """k sigma: how far off the ground is on which a camera sees the crowd; 95 % by default. Ours."""
    return _not_negative("sigma_m", sigma_m) * _not_negative("sigmas", sigmas)


def crowd_motion(speed_mps: float, latency_s: float) -> float:
    """v t: how far people walk between the picture and the fence that is kept. Ours."""
    return _not_negative("speed_mps", speed_mps) * _not_negative("latency_s", latency_s)


RULES: dict[str, Callable[..., float]] = {
    "fixed": fixed,
    "one-to-one": one_to_one,
    "ballistic": ballistic,
    "parachute": parachute,
    "glide": glide,
    "eu-a2": eu_a2,
    "sts-01": sts01,
    "contingency": contingency,
    "map": map_resolution,
    "pose": pose_error,
    "motion": crowd_motion,
}


def safety_distance_m(rules: Sequence[str]) -> float:
    """Sum of rules as text: ["ballistic:speed_mps=10,height_m=60", "motion:speed_mps=1.5,latency_s=2"].

    ValueError for a rule that does not exist, a value that is missing, unknown, given twice or out of bounds,
    and for more than `MOST_M`.
    """
    try:
        distance_m = math.fsum(_distance_m(rule) for rule in rules)
    except (OverflowError, ZeroDivisionError):
        distance_m = math.inf
    if not distance_m <= MOST_M:
        raise ValueError(f"buffer {', '.join(rules)} is {distance_m:g} m; it must be at most {MOST_M:g} m")
    return distance_m


def _distance_m(rule: str) -> float:
    name, _, text = rule.partition(":")
    if name not in RULES:
        raise ValueError(f"buffer {name!r} is none of {', '.join(RULES)}")
    formula = RULES[name]
    values: dict[str, float | bool] = {}
    for pair in filter(None, text.split(",")):
        key, equals, value = pair.partition("=")
        if not equals or key not in inspect.signature(formula).parameters:
            raise ValueError(f"buffer {rule!r}: {pair!r} is none of {_parameters(formula)}")
        if key in values:
            raise ValueError(f"buffer {rule!r} says {key}= twice")
        is_switch = isinstance(inspect.signature(formula).parameters[key].default, bool)
        values[key] = _switch(rule, key, value) if is_switch else _number(rule, value)
    missing = [
        key
        for key, parameter in inspect.signature(formula).parameters.items()
        if parameter.default is inspect.Parameter.empty and key not in values
    ]
    if missing:
        raise ValueError(f"buffer {rule!r} needs {', '.join(f'{key}=' for key in missing)}")
    return formula(**values)


def _parameters(formula: Callable[..., float]) -> str:
    return ", ".join(f"{key}=" for key in inspect.signature(formula).parameters)


def _switch(rule: str, key: str, text: str) -> bool:
    if text not in ("true", "false"):
        raise ValueError(f"buffer {rule!r}: {key} is {text!r}; it must be true or false")
    return text == "true"


def _number(rule: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"buffer {rule!r}: {text!r} is not a number") from None


def _not_negative(name: str, value: float) -> float:
    if not 0.0 <= value < math.inf:
        raise ValueError(f"{name} is {value:g}; it must be finite and >= 0")
    return float(value)
