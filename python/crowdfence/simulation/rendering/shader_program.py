"""GLSL sources of the package: files in shaders/, with #include "file" lines expanded."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import moderngl

_INCLUDE = re.compile(r'^#include "([a-z_.]+)"$', re.MULTILINE)


def shader_source(name: str) -> str:
    """Text of one shader file with its includes."""
    folder = resources.files("crowdfence.simulation.rendering") / "shaders"
    text = (folder / name).read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda match: shader_source(match.group(1)), text)


def build_program(context: moderngl.Context, vertex: str, fragment: str) -> moderngl.Program:
    """Program from two shader files."""
    return context.program(vertex_shader=shader_source(vertex), fragment_shader=shader_source(fragment))


def set_uniforms(program: moderngl.Program, values: Mapping[str, Any]) -> None:
    """Set those uniforms that the program uses; matrices and arrays are numpy, as written on paper."""
    for name, value in values.items():
        if name not in program:
            continue
        uniform: Any = program[name]
        if isinstance(value, np.ndarray):
            columns_first = np.swapaxes(value, -1, -2) if value.shape[-2:] == (4, 4) else value
            uniform.write(np.ascontiguousarray(columns_first, np.float32).tobytes())
        else:
            uniform.value = value
