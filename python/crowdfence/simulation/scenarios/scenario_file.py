"""TOML files -> `Scenario`: every key known, every value of the declared type."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from crowdfence.errors import quoted
from crowdfence.simulation.scenarios.plan_checks import ScenarioError
from crowdfence.simulation.scenarios.scenario import Scenario

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

BUILT_IN = ("race", "festival", "street", "beach", "empty")
MAX_SCENARIO_BYTES = 1_000_000


def load_scenario(name_or_path: str | Path, **overrides: Any) -> Scenario:
    """A built-in scenario ("race", "festival", "street", "beach", "empty") or a TOML file of the same form.

    `overrides` replace values of the file: `frames=90`, `camera={"width": 320, "height": 240}` (a mapping
    changes only the keys that it names), `trouble=TroublePlan()`; None leaves a value as it is.

    Raises ScenarioError for an unknown name, key or value, naming it, and the file where that holds it;
    OSError when the file cannot be read.
    """
    path = _path_of(name_or_path)
    tables = read_toml(path)
    given: Mapping[str, Any] = {key: value for key, value in overrides.items() if value is not None}
    try:
        scenario = scenario_from_tables(merged(tables, given), default_name=path.stem, source=None)
    except ScenarioError:
        scenario_from_tables(
            tables, default_name=path.stem, source=str(path)
        )  # where the file is wrong itself
        raise
    if "drones" not in given:  # of a smaller fleet some of what the file says is of nobody
        _require_drones(scenario, path)
    return scenario


def _require_drones(scenario: Scenario, path: Path) -> None:
    """ScenarioError where the trouble is that of a drone that the file does not have."""
    trouble = scenario.trouble
    for kind, pairs in (("joins_s", trouble.joins_s), ("leaves_s", trouble.leaves_s)):
        for drone, _ in pairs:
            if drone >= scenario.drones:
                raise ScenarioError(
                    f"{path}: trouble.{kind} names drone {drone} of {scenario.drones}; drones count from 0: "
                    f"the last one, uav{scenario.drones}, is {scenario.drones - 1}"
                )


def read_toml(path: Path) -> dict[str, Any]:
    """Tables of a TOML file of at most 1 MB. ScenarioError names the file and the line of a mistake."""
    if path.stat().st_size > MAX_SCENARIO_BYTES:
        raise ScenarioError(
            f"{path}: {path.stat().st_size} bytes, a scenario has at most {MAX_SCENARIO_BYTES}"
        )
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as mistake:
        raise ScenarioError(f"{path}: not a TOML file: {mistake}") from mistake


def merged(tables: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """`tables` with the values of `overrides`; a mapping changes only the keys that it names."""
    result = dict(tables)
    for key, value in overrides.items():
        before = result.get(key, {})
        if isinstance(value, Mapping) and isinstance(before, Mapping):
            result[key] = merged(before, value)
        else:
            result[key] = value
    return result


def scenario_from_tables(tables: Mapping[str, Any], *, default_name: str, source: str | None) -> Scenario:
    """The scenario that `tables` describe; ScenarioError starts with `source`, where there is one."""
    try:
        scenario = _record(Scenario, {"name": default_name, "description": "", **tables}, "")
    except ValueError as mistake:
        said = str(mistake) if source is None else f"{source}: {mistake}"
        raise ScenarioError(said) from mistake
    assert isinstance(scenario, Scenario)
    return scenario


def _path_of(name_or_path: str | Path) -> Path:
    if str(name_or_path) in BUILT_IN:
        return Path(__file__).parent / f"{name_or_path}.toml"
    path = Path(name_or_path)
    if path.suffix != ".toml" and not path.exists():
        raise ScenarioError(
            f"unknown scenario {str(name_or_path)!r}: choose one of {', '.join(BUILT_IN)} or a .toml file"
        )
    return path


def _record(kind: Any, table: Any, where: str) -> Any:
    if isinstance(table, kind):
        return table
    if not isinstance(table, Mapping):
        raise ScenarioError(f"{where} must be a table, got {table!r}")
    types = get_type_hints(kind)
    prefix = f"{where}." if where else ""
    for key in table:
        if key not in types:
            raise ScenarioError(f"unknown key {prefix}{key}; known are {', '.join(sorted(types))}")
    for field in fields(kind):
        required = field.default is field.default_factory  # both are dataclasses.MISSING
        if required and field.name not in table:
            raise ScenarioError(f"{prefix}{field.name} is missing")
    return kind(**{key: _value(types[key], value, prefix + key) for key, value in table.items()})


def _value(kind: Any, value: Any, where: str) -> Any:
    if is_dataclass(kind):
        return _record(kind, value, where)
    if get_origin(kind) is tuple:
        return _tuple(get_args(kind), value, where)
    if isinstance(value, int) and abs(value) > sys.float_info.max:  # those of TOML have no end
        raise ScenarioError(f"{where} must be a finite number, got {quoted(value)}")
    if kind is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, bool) != (kind is bool) or not isinstance(value, kind):
        raise ScenarioError(f"{where} must be {kind.__name__}, got {value!r}")
    return value


def _tuple(kinds: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise ScenarioError(f"{where} must be a list, got {value!r}")
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        return tuple(_value(kinds[0], item, f"{where}[{number}]") for number, item in enumerate(value))
    if len(value) != len(kinds):
        raise ScenarioError(f"{where} must have {len(kinds)} values, got {len(value)}")
    return tuple(_value(kind, item, where) for kind, item in zip(kinds, value, strict=True))
