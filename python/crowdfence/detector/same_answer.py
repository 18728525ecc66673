"""Whether a model gives the same answer wherever it looks: then it does not see its pictures, and what it
says of the ground below them is worth nothing.

A network whose weights were lost, whose input is scaled away or whose contract names a dead output is sure of
nobody everywhere, and its flights look like flights over empty ground. One that sees says different things of
different ground: of the dullest ninths of 12 pictures of the demo, bare asphalt among them, the two shipped
ones answer with logits that lie 4.9 and 3.6 apart.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.inference.map_output import ROUNDING, sigmoid

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract

SAME_LOGITS = 0.5
"""No answers lie farther apart where nothing is seen."""
LEAST_MASKS = 10
"""Masks of 0 everywhere, of which fewer may well be right."""
_SURE = float(np.finfo(np.float32).tiny), 1.0 - float(np.finfo(np.float32).epsneg)
"""Probabilities whose logits are still finite."""


class SameAnswer:
    """Looks at heatmaps as they pass."""

    def __init__(self, contract: Contract | None) -> None:
        self._name = "" if contract is None else contract.name
        self._kind = None if contract is None else contract.output.kind
        self._temperature = 1.0 if contract is None else contract.temperature
        self.looked_at, self._lowest, self._highest = 0, np.inf, -np.inf

    def add(self, heatmap: NDArray[np.float32]) -> None:
        """Of the next picture [h, w]."""
        self.looked_at += 1
        self._lowest = min(self._lowest, float(heatmap.min()))
        self._highest = max(self._highest, float(heatmap.max()))

    @property
    def warning(self) -> str | None:
        """One sentence where all of them hold next to one value, or what probabilities become where they are
        taken for logits; None for models that find people, which are as often right to find none, and for a
        few masks of nobody."""
        if self.looked_at == 0 or self._kind not in ("probability", "logits", "class_logits"):
            return None
        if self._kind == "probability" and self._highest == 0.0:
            return self._of_masks() if self.looked_at >= LEAST_MASKS else None
        low, high = np.clip([self._lowest, self._highest], *_SURE)
        pictures = "the picture" if self.looked_at == 1 else f"all {self.looked_at} pictures"
        if np.log(high / low) - np.log((1.0 - high) / (1.0 - low)) > SAME_LOGITS:
            return self._of_probabilities(pictures)
        return (
            f"{self._name} gives P = {self._highest:.2g} everywhere in {pictures}, whatever is there: it "
            "does not see them; check scale, mean, std and color of its contract, and the model itself"
        )

    def _of_probabilities(self, pictures: str) -> str | None:
        """One sentence where the logits all lie in [0, 1]. No network is unsure everywhere."""
        least, most = sigmoid(np.array([0.0, 1.0 / self._temperature]))
        if self._kind != "logits" or self._lowest < least - ROUNDING or self._highest > most + ROUNDING:
            return None
        return (
            f"{self._name} gives P = {self._lowest:.2g} to {self._highest:.2g} in {pictures}, so all is "
            "crowd: its output lies between 0 and 1, as probabilities do, and its contract says output.kind "
            "'logits'; is it 'probability'?"
        )

    def _of_masks(self) -> str:
        return (
            f"{self._name} gives 0 everywhere in all {self.looked_at} pictures: nobody is in any of them, or "
            "it does not see them, and the ground below them is called empty for nothing; show it a picture "
            "of a crowd"
        )
