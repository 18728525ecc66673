"""Values in the metadata of other tools: numbers, lists and class names written as text."""

from __future__ import annotations

import ast
import json
from collections.abc import Mapping
from typing import Any

from crowdfence.detector.contract.model_face import Dimension, ModelFace, Tensor
from crowdfence.errors import DetectorError, quoted

PEOPLE_NAMES = frozenset({"person", "persons", "people", "pedestrian", "pedestrians", "human", "humans"})
CROWD_NAMES = frozenset({"crowd", "crowds"})
_LONGEST = 1_000_000


def literal(metadata: Mapping[str, str], key: str) -> Any:
    """A value in JSON, or as Python prints it ({0: 'person'})."""
    text = metadata[key]
    if len(text) > _LONGEST:
        raise DetectorError(f"{key} has {len(text):,} characters; allowed: {_LONGEST:,}")
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        pass
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError):
        raise DetectorError(f"{key} is {quoted(text)}, which is no value of JSON or Python") from None


def class_names(metadata: Mapping[str, str], key: str) -> dict[int, str]:
    """Class number -> name, from a list or from a mapping with numbers as keys."""
    value = literal(metadata, key)
    value = dict(enumerate(value)) if isinstance(value, list) else value
    try:
        names = {int(number): name.strip().lower() for number, name in value.items()}
    except (TypeError, ValueError, AttributeError):
        names = {}
    if not names or min(names) < 0:
        raise DetectorError(f"{key} is {quoted(value)}; allowed: class numbers with their names")
    return names


def classes_named(names: Mapping[int, str], wanted: frozenset[str], key: str) -> list[int]:
    """The classes of one of the wanted names, at least one."""
    found = sorted(number for number, name in names.items() if name in wanted)
    if not found:
        listed = quoted(", ".join(names[number] for number in sorted(names)))
        raise DetectorError(f"{key} has no class named {', '.join(sorted(wanted))} but {listed}")
    return found


def only_image_input(face: ModelFace) -> Tensor:
    """The one float32 [N, 3, H, W] input that these tools write."""
    if len(face.inputs) != 1:
        raise DetectorError(f"the model has {len(face.inputs)} inputs; allowed: 1")
    tensor = face.inputs[0]
    if tensor.dtype != "float32" or len(tensor.shape) != 4 or tensor.shape[1] != 3:
        raise DetectorError(f"the input is {tensor}; allowed: float32 [N, 3, H, W]")
    return tensor


def fixed(dimension: Dimension) -> int | None:
    return dimension if isinstance(dimension, int) and dimension > 0 else None
