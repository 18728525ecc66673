"""At which size a model is shown a picture, or a part of one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from crowdfence.detector.contract.json_section import JsonSection
from crowdfence.detector.contract.model_output import PEOPLE_KINDS, ModelOutput
from crowdfence.errors import DetectorError

_MOST_SIZES = 8
_SMALLEST, _LARGEST = 1.0 / 64.0, 8.0


@dataclass(frozen=True, slots=True)
class PictureSizes:
    """A model knows people of some sizes only. Without this section it is shown pictures as they are."""

    gsd_m: tuple[float, float] | None = None
    """Metres per pixel that the model knows. Parts of a picture that are known to be finer are shrunk by
    powers of two until they lie above the lower end; coarser ones are enlarged once, twofold."""
    without_gsd: tuple[float, ...] = (1.0,)
    """Sizes at which a picture is shown when nothing is known about its scale."""
    weights: tuple[float, ...] | None = None
    """Maps at several sizes, their logits z sorted downwards: P = sigmoid(bias + sum(weights * z)). As many
    as there are sizes; people found at several sizes are joined instead."""
    bias: float = 0.0

    @staticmethod
    def from_json(section: JsonSection | None, output: ModelOutput) -> PictureSizes | None:
        if section is None:
            return None
        sizes = _list(section, "without_gsd", 1, _MOST_SIZES) or (1.0,)
        if not all(_SMALLEST <= size <= _LARGEST for size in sizes):
            raise section.refuse("without_gsd", f"sizes from {_SMALLEST:g} to {_LARGEST:g}")
        weights = _list(section, "weights", len(sizes), len(sizes))
        value = PictureSizes(_span(section), sizes, weights, section.number("bias", default=0.0))
        section.done()
        maps = output.kind not in (*PEOPLE_KINDS, "density")
        if weights is not None and not maps:
            raise DetectorError(f"{section.key('weights')} go with maps of probabilities, not {output.kind}")
        if len(sizes) > 1 and maps and weights is None:
            raise DetectorError(f"{section.key('weights')} are missing: {len(sizes)} maps become one by them")
        if len(sizes) > 1 and output.kind in ("density", "points"):
            raise DetectorError(f"{section.key('without_gsd')}: {output.kind} are looked for at one size")
        return value

    def to_json(self) -> dict[str, Any]:
        return {
            "gsd_m": None if self.gsd_m is None else list(self.gsd_m),
            "without_gsd": list(self.without_gsd),
            "weights": None if self.weights is None else list(self.weights),
            "bias": self.bias,
        }


def _span(section: JsonSection) -> tuple[float, float] | None:
    span = section.span("gsd_m")
    if span is not None and not 0.0 < 2.0 * span[0] <= span[1]:
        raise section.refuse("gsd_m", "[low, high] in metres, 0 < 2 * low <= high: parts are halved")
    return span


def _list(section: JsonSection, name: str, fewest: int, most: int) -> tuple[float, ...] | None:
    given = section.raw(name)
    if given is None:
        return None
    if not isinstance(given, (list, tuple)) or not fewest <= len(given) <= most:
        count = str(most) if fewest == most else f"{fewest} to {most}"
        raise section.refuse(name, f"a list of {count} numbers")
    return section.numbers(name, len(given), ())
