"""Imports never climb: every module against the list of layers in ARCHITECTURE.md, and no circles."""

import ast
import re
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import crowdfence

PACKAGE = Path(crowdfence.__file__).parent
ARCHITECTURE = Path(__file__).parents[1] / "ARCHITECTURE.md"

Imports = Mapping[str, set[str]]
"""Module -> modules of the package that it imports, wherever in it."""


def declared_layers() -> list[set[str]]:
    """Places of the package, the highest layer first."""
    block = re.search(r"^```layers\n(.*?)^```", ARCHITECTURE.read_text(encoding="utf-8"), re.M | re.S)
    assert block is not None
    return [set(line.split()) for line in block[1].splitlines()]


def modules() -> dict[str, Path]:
    """Dotted name -> file. The root is left out: its public names are imported when they are first used."""
    found = {}
    for path in PACKAGE.rglob("*.py"):
        name = ".".join(("crowdfence", *path.relative_to(PACKAGE).with_suffix("").parts))
        found[name.removesuffix(".__init__")] = path
    del found["crowdfence"]
    return found


def imported(source: str, known: set[str]) -> set[str]:
    """Modules of the package that a source imports: anywhere, also in functions and for types only."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are written in full"
            whole = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {name if name in known else str(node.module) for name in whole}
    return {name for name in names if name.partition(".")[0] == "crowdfence"}


def imports_of_the_package() -> Imports:
    files = modules()
    known = {*files, "crowdfence._core"}
    return {name: imported(path.read_text(encoding="utf-8"), known) for name, path in files.items()}


def place(module: str) -> str:
    """ "crowdfence.sources.mission.reader" -> "sources"; the root itself is ""."""
    return module.partition(".")[2].partition(".")[0]


def climbing(imports: Imports, layers: list[set[str]]) -> list[str]:
    """Imports that leave their place for one that is not below it; what has no layer is below nothing."""
    height = {name: -depth for depth, layer in enumerate(layers) for name in layer}
    return [
        f"{module} imports {other}"
        for module, others in imports.items()
        for other in sorted(others)
        if place(module) != place(other)
        and not height.get(place(other), 0) < height.get(place(module), -len(layers))
    ]


def circle(imports: Imports) -> list[str]:
    """Modules of which each imports the one before it, the first one also last; empty when there is none."""
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_every_place_has_one_layer() -> None:
    declared = [name for layer in declared_layers() for name in layer]
    assert sorted(declared) == sorted({place(module) for module in modules()} | {"_core"})


def test_imports_never_climb() -> None:
    assert climbing(imports_of_the_package(), declared_layers()) == []


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert circle(imports_of_the_package()) == []


@pytest.mark.parametrize(
    ("module", "other", "climbs"),
    [
        ("cli.run", "sources", False),
        ("sources.folder", "sources.recording", False),
        ("sources.folder", "_core", False),
        ("sources.folder", "cli.run", True),
        ("zones", "zones_of_tomorrow", True),
        ("zones_of_tomorrow", "sources", True),
        ("zones", "sources", True),
        ("sources.folder", "", True),
    ],
)
def test_what_climbing_is(module: str, other: str, climbs: bool) -> None:
    layers = [{"cli"}, {"zones", "sources"}, {"_core"}]
    edge = {f"crowdfence.{module}": {f"crowdfence.{other}".removesuffix(".")}}
    assert bool(climbing(edge, layers)) is climbs


def test_a_circle_is_found() -> None:
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) in (["b", "c", "b"], ["c", "b", "c"])
    assert circle({"a": {"b", "c"}, "b": {"c"}}) == []


def test_every_form_of_import_is_seen() -> None:
    source = """
import numpy
import crowdfence.zones
from crowdfence import pipeline
from crowdfence.sources import open_recording, stamps
if TYPE_CHECKING:
    from crowdfence.config import RunConfig
def later():
    from crowdfence._core import Terrain
"""
    known = {"crowdfence.pipeline", "crowdfence.sources.stamps"}
    found = {"zones", "pipeline", "sources", "sources.stamps", "config", "_core"}
    assert imported(source, known) == {f"crowdfence.{name}" for name in found}
