"""`help()` shows the reference of the compiled core, and the stub says the same."""

import ast
import runpy
from operator import attrgetter
from pathlib import Path
from typing import Any

import pytest

from crowdfence import _core

STUB_DOCS = runpy.run_path(str(Path(__file__).parent.parent / "crates/crowdfence-python/stub_docs.py"))
STUB = STUB_DOCS["STUB"].read_text(encoding="utf-8")
CLASSES = [name for name in _core.__all__ if isinstance(getattr(_core, name), type)]
MEMBERS = [
    f"{name}.{member}"
    for name in CLASSES
    if getattr(_core, name).__base__ is object
    for member in vars(getattr(_core, name))
    if not member.startswith("_")
]
NAMES = sorted([*_core.__all__, *MEMBERS])  # always in one order, whichever process collects them

# What can be refused, and the exceptions that its docstring has to name.
REFUSALS = {
    "Camera.pinhole": ["ViewError"],
    "Camera.fisheye": ["ViewError"],
    "Camera.project": ["CrowdfenceError"],
    "Camera.unproject": ["ViewError", "CrowdfenceError"],
    "View": ["ViewError", "StampError", "CrowdfenceError"],
    "Terrain": ["CrowdfenceError"],
    "Terrain.from_occupancy": ["CrowdfenceError"],
    "Terrain.from_height_map": ["CrowdfenceError"],
    "Terrain.from_points": ["CrowdfenceError"],
    "Terrain.from_triangles": ["CrowdfenceError"],
    "Terrain.from_indices": ["CrowdfenceError"],
    "Terrain.from_octomap": ["MapFileError"],
    "Terrain.open": ["MapFileError", "TypeError"],
    "Terrain.raycast": ["CrowdfenceError"],
    "Terrain.voxel_centers": ["CrowdfenceError"],
    "Terrain.voxel_indices": ["CrowdfenceError"],
    "Terrain.voxel_ids": ["CrowdfenceError"],
    "Terrain.with_origin": ["CrowdfenceError"],
    "CrowdMass": ["CrowdfenceError"],
    "Observation": ["CrowdfenceError", "ViewError", "StampError"],
    "Observation.from_bytes": ["MapFileError", "CrowdfenceError"],
    "project": ["CrowdfenceError"],
    "Rates": ["CrowdfenceError"],
    "Paper": ["CrowdfenceError"],
    "Or": ["CrowdfenceError"],
    "LinearPool": ["CrowdfenceError"],
    "LogPool": ["CrowdfenceError"],
    "LogOdds": ["CrowdfenceError"],
    "MovingAverage": ["CrowdfenceError"],
    "CrowdMap": ["CrowdfenceError"],
    "CrowdMap.integrate": ["StampError", "ViewError"],
    "CrowdMap.integrate_observations": ["MapFileError"],
    "CrowdMap.probability": ["StampError", "CrowdfenceError"],
    "CrowdMap.state": ["StampError", "CrowdfenceError"],
    "CrowdMap.seen_probability": ["StampError"],
    "CrowdMap.crowd_columns": ["StampError", "CrowdfenceError"],
    "CrowdMap.crowd_ids": ["StampError", "CrowdfenceError"],
    "CrowdMap.crowd_ids_at_last_looks": ["CrowdfenceError"],
    "CrowdMap.columns_of": ["StampError", "CrowdfenceError"],
    "CrowdMap.shown_ids": ["CrowdfenceError", "StampError"],
    "CrowdMap.spoke_for_crowd": ["CrowdfenceError"],
    "CrowdMap.last_seen_ns": ["CrowdfenceError"],
    "CrowdMap.seen_by": ["CrowdfenceError"],
    "CrowdMap.from_bytes": ["MapFileError"],
    "CrowdMap.save": ["OSError"],
    "CrowdMap.load": ["MapFileError", "OSError"],
    "pool": ["CrowdfenceError"],
    "blend": ["CrowdfenceError"],
    "write_octomap_binary": ["CrowdfenceError", "MapFileError"],
    "write_octomap_color": ["CrowdfenceError", "MapFileError"],
}


def _core_value(name: str) -> Any:
    return attrgetter(name)(_core)


def _documentation(name: str) -> str:
    return _core_value(name).__doc__ or ""


@pytest.mark.parametrize("name", [name for name in NAMES if name != "__version__"])
def test_every_public_name_has_a_docstring(name: str) -> None:
    assert _documentation(name).strip(), f"help(crowdfence.{name}) shows nothing"


def test_the_stub_says_what_the_core_says() -> None:
    assert STUB_DOCS["differences"](STUB) == [], "run make stub"


def test_a_stub_without_docstrings_gets_them_all() -> None:
    tree = ast.parse(STUB)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
            node.body = node.body[1:] or [ast.Expr(ast.Constant(...))]
    bare = ast.unparse(tree)
    assert '"""' not in bare
    assert STUB_DOCS["differences"](bare)
    assert STUB_DOCS["differences"](STUB_DOCS["with_docstrings"](bare)) == []


def test_a_docstring_that_the_core_does_not_have_goes() -> None:
    stub = 'class Rates:\n    def __new__(cls) -> Rates:\n        """Old."""\n    def __eq__(self): ...\n'
    cleared = STUB_DOCS["with_docstrings"](stub)
    assert "def __new__(cls) -> Rates: ...\n    def __eq__" in cleared


@pytest.mark.parametrize("name", REFUSALS)
def test_docstrings_name_what_is_raised(name: str) -> None:
    for exception in REFUSALS[name]:
        assert exception in _documentation(name)


def test_signatures_show_the_defaults_as_python_writes_them() -> None:
    signatures = {
        "View": "(drone, stamp_ns, camera, world_from_camera, heatmap)",
        "Rates": "(true_positive, false_positive)",
        "pool": '(m, visible, rates, prior, *, b_threshold=0.5, unseen="fleet", normalise=False)',
        "Terrain.from_points": "(points, voxel_size_m, origin=(0.0, 0.0, 0.0))",
        "Terrain.open": "(path, *, voxel_size_m=None, georeference=None, **options)",
    }
    assert {name: _core_value(name).__text_signature__ for name in signatures} == signatures
