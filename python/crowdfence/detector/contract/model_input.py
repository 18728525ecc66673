"""The image tensor of a model: layout, colours, normalisation, size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from crowdfence.detector.contract.json_section import JsonSection
from crowdfence.detector.contract.model_output import MAP_KINDS, ModelOutput
from crowdfence.errors import DetectorError

_LARGEST_SIDE = 16384
_MOST_VIBRANCE = 8.0
_CONTRAST = (0.1, 300.0)
"""How far apart black and white may lie in a tensor. Pixels as they are make 255, those from 0 to 1 over the
standard deviations of ImageNet 4.5; taken for each other they make 0.017 and 1133."""


@dataclass(frozen=True, slots=True)
class ModelInput:
    """The image tensor. Its values: (pixel * scale - mean) / std, per channel in the order of `color`."""

    name: str
    layout: Literal["NHWC", "NCHW"]
    dtype: Literal["uint8", "float32"]
    color: Literal["RGB", "BGR"] = "RGB"
    scale: float = 1.0
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    std: tuple[float, ...] = (1.0, 1.0, 1.0)
    size: tuple[int, int] | None = None
    """Width and height in pixels; None: any multiple of `multiple_of`."""
    multiple_of: int = 1
    resize: Literal["none", "stretch", "letterbox", "tile"] = "none"
    vibrance: float = 1.0
    """Factor on the palest colours before anything else; falls to 1 for strong ones (`_core.vibrant`)."""

    @property
    def is_raw(self) -> bool:
        """The tensor holds the pixels themselves."""
        return self.scale == 1.0 and not any(self.mean) and all(value == 1.0 for value in self.std)


def input_from_json(section: JsonSection, output: ModelOutput) -> ModelInput:
    multiple_of = section.integer("multiple_of", 1, 4096, 1)
    resize = section.choice("resize", ("none", "stretch", "letterbox", "tile"), "none")
    value = ModelInput(
        name=section.text("name"),
        layout=section.choice("layout", ("NHWC", "NCHW")),
        dtype=section.choice("dtype", ("uint8", "float32")),
        color=section.choice("color", ("RGB", "BGR")),
        scale=section.number("scale", 0.0, 1.0, above=True),
        mean=section.numbers("mean", 3, (0.0, 0.0, 0.0)),
        std=section.numbers("std", 3, (1.0, 1.0, 1.0)),
        size=_size(section, multiple_of),
        multiple_of=multiple_of,
        resize=resize,
        vibrance=_vibrance(section),
    )
    section.done()
    if any(number <= 0.0 for number in value.std):
        raise section.refuse("std", "3 numbers above 0")
    if value.dtype == "uint8" and not value.is_raw:
        raise DetectorError(
            f"{section.key('dtype')} is 'uint8', the pixels as they are: scale, mean and std must be 1, 0, 1"
        )
    _refuse_other_pixels(section, value)
    if value.size is None and resize in ("stretch", "letterbox"):
        raise DetectorError(f"{section.key('resize')} is {resize!r}, which needs {section.key('size')}")
    side = value.size or (multiple_of, multiple_of)
    cut_exactly = resize in ("none", "tile") and output.kind in MAP_KINDS
    if cut_exactly and any(pixels % output.stride for pixels in side):
        raise DetectorError(
            f"{section.key('size' if value.size else 'multiple_of')} is "
            f"{list(value.size) if value.size else multiple_of}; allowed: multiples of "
            f"output.stride ({output.stride}), or resize 'stretch' or 'letterbox'"
        )
    return value


def _refuse_other_pixels(section: JsonSection, model: ModelInput) -> None:
    """Mean and std of pixels from 0 to 255 beside a scale that makes them 0 to 1, or the other way round: the
    model then sees next to nothing of a picture, and finds nobody."""
    white = 255.0 * model.scale
    contrasts = [white / std for std in model.std]
    if all(_CONTRAST[0] <= contrast <= _CONTRAST[1] for contrast in contrasts) and all(
        -white <= mean <= 2.0 * white for mean in model.mean
    ):
        return
    raise DetectorError(
        f"{section.key('mean')} {list(model.mean)} and {section.key('std')} {list(model.std)} do not go "
        f"with {section.key('scale')} {model.scale:.6g}, which makes pixels 0 to {white:.6g}: black and "
        f"white would be {min(contrasts):.3g} apart; allowed: {_CONTRAST[0]:g} to {_CONTRAST[1]:g}, and a "
        f"mean from {-white:.6g} to {2.0 * white:.6g}. Those of pixels from 0 to 255 go with scale 1, those "
        "of pixels from 0 to 1 with scale 0.00392157 (1/255)"
    )


def _vibrance(section: JsonSection) -> float:
    value: float = section.number("vibrance", 1.0, 1.0)
    if value > _MOST_VIBRANCE:
        raise section.refuse("vibrance", f"a number from 1 to {_MOST_VIBRANCE:g}")
    return value


def _size(section: JsonSection, multiple_of: int) -> tuple[int, int] | None:
    value = section.raw("size")
    if value is None:
        return None
    whole = isinstance(value, (list, tuple)) and len(value) == 2 and all(type(side) is int for side in value)
    if not whole or not all(1 <= side <= _LARGEST_SIDE and side % multiple_of == 0 for side in value):
        raise section.refuse(
            "size", f"null or [width, height], multiples of {multiple_of} from 1 to {_LARGEST_SIDE}"
        )
    return value[0], value[1]
