"""`preprocessor_config.json` of Hugging Face Transformers beside a model -> the input half of a contract.

The file describes how images become tensors (resize, rescale, normalise) and nothing about the output: the
caller states that, or the model is refused. Switches that are absent have had different defaults in different
releases, so they must be written out.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from crowdfence.detector.contract.json_section import JsonSection
from crowdfence.detector.contract.metadata_values import fixed, only_image_input
from crowdfence.detector.contract.model_face import ModelFace
from crowdfence.errors import DetectorError, quoted

NAME = "Hugging Face"
_LARGEST_BYTES = 1_000_000


def config_path(face: ModelFace) -> Path:
    return face.path.with_name("preprocessor_config.json")


def document(face: ModelFace, output: Mapping[str, Any] | None) -> dict[str, Any]:
    """The contract as JSON. DetectorError when the file is ambiguous or the output is not stated."""
    if output is None:
        raise DetectorError(
            "it describes the input only, and what the output means is not stated: give output={...}"
        )
    config = JsonSection(_read(config_path(face)))
    image = only_image_input(face)
    rescaled, normalised = _switch(config, "do_rescale"), _switch(config, "do_normalize")
    if config.raw("do_center_crop"):
        raise config.refuse("do_center_crop", "false, because crowds at the border would be cut off")
    if config.raw("rescale_offset"):
        raise config.refuse("rescale_offset", "false: say it as image_mean and image_std")
    return {
        "schema": 1,
        "name": face.path.stem,
        "input": {
            "name": image.name,
            "layout": "NCHW",
            "dtype": "float32",
            "color": _color(config, normalised=normalised),
            "scale": config.number("rescale_factor", 0.0, above=True) if rescaled else 1.0,
            "mean": _channels(config, "image_mean") if normalised else None,
            "std": _channels(config, "image_std") if normalised else None,
            **_geometry(config, face, output),
        },
        "output": _named(output, face),
    }


def _read(path: Path) -> Any:
    with open(path, "rb") as file:
        text = file.read(_LARGEST_BYTES + 1)
    if len(text) > _LARGEST_BYTES:
        raise DetectorError(f"it is larger than {_LARGEST_BYTES:,} bytes")
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DetectorError(f"it is not JSON: {error}") from None


def _switch(config: JsonSection, name: str) -> bool:
    value = config.raw(name)
    if not isinstance(value, bool):
        raise config.refuse(name, "true or false, written out")
    return value


def _color(config: JsonSection, *, normalised: bool) -> str:
    """MobileViT and what is built on it take the channels the other way round."""
    if not config.raw("do_flip_channel_order"):
        return "RGB"
    if normalised:
        raise config.refuse(
            "do_flip_channel_order", "false where do_normalize is true: of which order is image_mean?"
        )
    return "BGR"


def _channels(config: JsonSection, name: str) -> list[float]:
    if config.raw(name) is None:
        raise config.refuse(name, "a list of 3 numbers, because do_normalize is true")
    return list(config.numbers(name, 3, ()))


def _geometry(config: JsonSection, face: ModelFace, output: Mapping[str, Any]) -> dict[str, Any]:
    """Stretched to a fixed size, or left alone and padded to whole cells."""
    if _switch(config, "do_resize"):
        size = config.raw("size")
        if not isinstance(size, Mapping) or set(size) != {"height", "width"}:
            raise config.refuse("size", '{"height": ..., "width": ...}')
        return {"resize": "stretch", "size": [size["width"], size["height"]]}
    height, width = (fixed(side) for side in face.inputs[0].shape[2:])
    if height is not None and width is not None:
        return {"resize": "tile", "size": [width, height]}
    multiple_of = config.raw("size_divisor") or output.get("stride")
    return {"resize": "none", "multiple_of": multiple_of}


def _named(output: Mapping[str, Any], face: ModelFace) -> dict[str, Any]:
    if output.get("name") is None and len(face.outputs) != 1:
        raise DetectorError(
            f"the model has {len(face.outputs)} outputs "
            f"({quoted(', '.join(tensor.name for tensor in face.outputs))}): output.name must say which"
        )
    return {"name": face.outputs[0].name, **output}
