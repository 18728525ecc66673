"""Python 3.10 is the oldest that is promised. Tests run on the Python that is there, mostly a newer one: what
3.10 refuses as soon as a module is imported is looked for in its source. What the standard library had not
yet is known to mypy, which is told of 3.10 (pyproject.toml); `make test-oldest` runs the tests on it."""

import ast
from pathlib import Path

import pytest

import crowdfence

OLDEST = (3, 10)
SOURCES = sorted(Path(crowdfence.__file__).parent.rglob("*.py"))


def generic_named_tuples(tree: ast.AST) -> list[str]:
    """Names of classes that are both, which Python allows since 3.11."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            bases = {ast.unparse(base).split("[")[0].split(".")[-1] for base in node.bases}
            if "NamedTuple" in bases and len(bases) > 1:
                found.append(node.name)
    return found


def test_what_is_looked_for_is_found() -> None:
    tree = ast.parse(
        "class A(NamedTuple, Generic[T]): ...\nclass B(typing.NamedTuple): ...\nclass C(Generic[T]): ..."
    )
    assert generic_named_tuples(tree) == ["A"]
    with pytest.raises(SyntaxError):
        ast.parse("try: ...\nexcept* ValueError: ...", feature_version=OLDEST)


def test_the_oldest_python_takes_every_module() -> None:
    """For most of this project's life it took none: one named tuple was generic."""
    assert len(SOURCES) > 100
    trees = {
        str(path): ast.parse(path.read_text(encoding="utf-8"), feature_version=OLDEST) for path in SOURCES
    }
    assert len(trees) == len(SOURCES)
    assert not {name: found for name, tree in trees.items() if (found := generic_named_tuples(tree))}
