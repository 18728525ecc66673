"""The public names of crowdfence, with what their docstrings say, as a page of Markdown from the source:

python docs/api_reference.py > docs/api.md
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import crowdfence as cf

GROUPS = {
    "From a recording to zones": [
        *(
            "open_recording",
            "Recording",
            "open_terrain",
            "Terrain",
            "Georeference",
            "run",
            "Run",
            "RunConfig",
        ),
        *("EvidenceConfig", "PaperConfig", "OrConfig", "ProjectionConfig", "GroupingConfig", "ZoneConfig"),
        *("write_results", "write_geojson", "write_geotiff", "SurfaceGrid"),
    ],
    "Instant by instant": [
        *("Camera", "View", "FrameLoop", "Step", "CrowdMap", "Update", "CrowdColumns", "VoxelKnowledge"),
        *("VoxelState", "Evidence", "Paper", "Or", "Rates", "LikelihoodRatio"),
        *("LinearPool", "LogPool", "LogOdds", "MovingAverage"),
    ],
    "The steps by themselves": ["project", "Observation", "CrowdMass", "pool", "blend", "landing_prior"],
    "Zones and planners": [
        *("Zone", "ZoneSet", "ZoneEngine", "ZoneHistory", "find_zones", "open_static_zones"),
        *("safety_distance_m", "ClearAir", "safe_route"),
    ],
    "Detectors and figures": ["Detector", "Contract", "detector_rates", "mean_iou"],
    "The live service": ["Client"],
    "Errors": ["CrowdfenceError", "DetectorError", "FrameError", "MapFileError", "StampError", "ViewError"],
}
_HEAD = """# Python reference

Everything that `import crowdfence as cf` gives. Arrays are numpy's, [N, 3] is a shape; local metres are east,
north, up ([frames](frames.md)). What cannot be used raises a `ValueError` with the value and its
bound: a `cf.CrowdfenceError` where it is an array, a camera, a view, a map or a detector, a plain one in
recordings, zone files and configurations. This page is made from the code: `make api-reference`.
"""

Definition = ast.FunctionDef | ast.ClassDef


def reference() -> str:
    """The whole page."""
    parts = [_HEAD]
    for group, names in GROUPS.items():
        parts.append(f"## {group}\n")
        for name in names:
            parts += _section(name, _definition(name))
    return "\n".join(parts).rstrip() + "\n"


def _definition(name: str) -> Definition:
    value = getattr(cf, name)
    module = sys.modules[value.__module__]
    path = Path(inspect.getsourcefile(module) or "")
    if path.suffix != ".py" or module is cf:
        path = Path(cf.__file__).with_name("_core.pyi")
    for node in _source(path).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == value.__name__:
            return node
    raise LookupError(f"{name} is not in {path}")


@cache
def _source(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _section(name: str, node: Definition) -> Iterator[str]:
    yield f"### {name}\n"
    if isinstance(node, ast.FunctionDef):
        yield f"    {_signature(node, name)}\n"
        yield _text(node)
        return
    yield _text(node)
    fields = list(_fields(node))
    if fields:
        yield "\n".join(fields) + "\n"
    for member in node.body:
        if isinstance(member, ast.FunctionDef) and _is_shown(member):
            yield f"    {_signature(member, name)}\n"
            if ast.get_docstring(member):
                yield _text(member)


def _is_shown(member: ast.FunctionDef) -> bool:
    decorators = {ast.unparse(one) for one in member.decorator_list}
    if any(one.endswith(".setter") for one in decorators):
        return False
    return not member.name.startswith("_") or member.name in ("__init__", "__new__", "__call__")


def _signature(node: ast.FunctionDef, owner: str) -> str:
    """As one calls it."""
    decorators = {ast.unparse(one) for one in node.decorator_list}
    arguments = node.args
    bound = [*arguments.posonlyargs, *arguments.args]
    if owner != node.name and "staticmethod" not in decorators and bound[:1]:
        (arguments.posonlyargs or arguments.args).pop(0)
    given = ast.unparse(arguments)
    returned = f" -> {ast.unparse(node.returns)}" if node.returns is not None else ""
    if node.name in ("__init__", "__new__"):
        return f"{owner}({given})"
    if owner == node.name:
        return f"{node.name}({given}){returned}"
    if decorators & {"property", "cached_property", "functools.cached_property"}:
        return f"{owner}.{node.name}{returned}"
    name = owner if node.name == "__call__" else f"{owner}.{node.name}"
    return f"{name}({given}){returned}"


def _fields(node: ast.ClassDef) -> Iterator[str]:
    """Of dataclasses, enumerations and typed tuples, each with the string below it."""
    for field, below in zip(node.body, [*node.body[1:], None], strict=True):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            told = f"{field.target.id}: {ast.unparse(field.annotation)}"
            if field.value is not None and not ast.unparse(field.value).startswith("field("):
                told += f" = {ast.unparse(field.value)}"
        elif isinstance(field, ast.Assign) and isinstance(field.targets[0], ast.Name):
            told = f"{field.targets[0].id} = {ast.unparse(field.value)}"
        else:
            continue
        if told.startswith("_"):
            continue
        words = below.value.value if _is_text(below) else ""
        yield f"- `{told}`" + (f": {' '.join(words.split())}" if words else "")


def _is_text(node: ast.stmt | None) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _text(node: Definition) -> str:
    return (ast.get_docstring(node) or "").strip() + "\n"


if __name__ == "__main__":
    sys.stdout.write(reference())
