"""Docstrings of the compiled core -> `_core.pyi`: `make stub` writes them, `--check` names what differs.

The reference is written once, in the doc comments of the binding. Names, signatures and types of the stub are
written by hand and held against the core by `mypy.stubtest`.
"""

import ast
import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from crowdfence import _core

STUB = Path(__file__).parents[2] / "python" / "crowdfence" / "_core.pyi"

Node = ast.Module | ast.ClassDef | ast.FunctionDef


class Entry(NamedTuple):
    """What the stub declares, and the docstring that the core has for it."""

    name: str
    node: Node
    documentation: str | None


def main(arguments: list[str]) -> int:
    stub = STUB.read_text(encoding="utf-8")
    if arguments == ["--check"]:
        differing = differences(stub)
        print("\n".join(f"{STUB.name}: docstring of {name} differs" for name in differing), file=sys.stderr)
        return int(bool(differing))
    STUB.write_text(with_docstrings(stub), encoding="utf-8")
    return 0


def differences(stub: str) -> list[str]:
    """Names whose docstring in the stub is not the core's."""
    return [entry.name for entry in entries(stub) if ast.get_docstring(entry.node) != entry.documentation]


def with_docstrings(stub: str) -> str:
    """The stub with the core's docstrings."""
    text = stub.encode()  # ast counts columns in bytes
    for entry in sorted(entries(stub), key=lambda entry: _begin(text, entry.node.body[0]), reverse=True):
        text = _with_docstring(text, entry.node, entry.documentation)
    return text.decode()


def entries(stub: str) -> Iterator[Entry]:
    """Module, classes, methods, properties and functions of the stub. What is private needs no docstring, and
    the arguments of `__new__` are those of the class."""
    module = ast.parse(stub)
    yield Entry(_core.__name__, module, _documentation(_core))
    for declared in module.body:
        if isinstance(declared, ast.ClassDef | ast.FunctionDef):
            value = getattr(_core, declared.name, None)
            yield Entry(declared.name, declared, _documentation(value))
            for member in declared.body if isinstance(declared, ast.ClassDef) else []:
                if isinstance(member, ast.FunctionDef) and not _is_setter(member):
                    name, private = f"{declared.name}.{member.name}", member.name.startswith("_")
                    documentation = _documentation(getattr(value, member.name, None))
                    yield Entry(name, member, None if private else documentation)


def _documentation(value: object) -> str | None:
    return inspect.cleandoc(value.__doc__) if value is not None and value.__doc__ else None


def _is_setter(member: ast.FunctionDef) -> bool:
    return any(isinstance(decorator, ast.Attribute) for decorator in member.decorator_list)


def _with_docstring(text: bytes, node: Node, documentation: str | None) -> bytes:
    first = node.body[0]
    begin = _begin(text, first)
    head, body = text[:begin].rstrip(), text[begin:]
    if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):  # a docstring, or ...
        body = text[_offset(text, first.end_lineno, first.end_col_offset) :]
    else:
        body = b"\n" + b" " * first.col_offset + body
    if documentation is None:
        return head + (b" ..." if len(node.body) == 1 else b"") + body
    indent = "" if isinstance(node, ast.Module) else " " * (node.col_offset + 4)
    return head + (f"\n{indent}" if head else "").encode() + _literal(documentation, indent).encode() + body


def _literal(documentation: str, indent: str) -> str:
    lines = documentation.replace("\\", "\\\\").split("\n")
    text = "\n".join([lines[0], *(f"{indent}{line}".rstrip() for line in lines[1:])])
    end = f"\n{indent}" if len(lines) > 1 or text.endswith('"') else ""
    return f'"""{text}{end}"""'


def _begin(text: bytes, statement: ast.stmt) -> int:
    decorators = getattr(statement, "decorator_list", [])
    line = min([statement.lineno, *(decorator.lineno for decorator in decorators)])
    return _offset(text, line, statement.col_offset)


def _offset(text: bytes, line: int | None, column: int | None) -> int:
    assert line is not None and column is not None  # ast.parse gives every node its place
    return sum(map(len, text.splitlines(keepends=True)[: line - 1])) + column


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
