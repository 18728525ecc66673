"""Several detectors on one picture: their odds multiplied, what they all know beforehand counted once.

    logit P = logit prior + sum over the detectors that can see the place of (logit p - logit prior)

That is Bayes' rule for opinions that err independently of each other. Detectors do not know what they miss:
`lowest` is the smallest logit that the silence of one may count with. How much that may be has to be
measured. Of detectors that were not calibrated together, silence (p below the prior) adds nothing:

    logit P = logit prior + sum over those with p above the prior of (logit p - logit prior)
    P = the largest p where there are none

so each can add crowd, none can take away what another sees, and one that sees nothing leaves the others as
they are. A detector has no vote where a pixel covers more metres than it knows, enlarged where it enlarges
all such ground: its silence there says nothing. Where nobody has a vote the largest p stands, and the prior
at least: crowd that one of them sees there alone is not lost, and nobody calls that ground empty.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.contract.model_output import ModelOutput
from crowdfence.detector.ground_scale import Gsd, across, at_cells
from crowdfence.detector.inference.image_tensor import Image
from crowdfence.detector.inference.map_output import Map, sigmoid

COMBINATIONS = Path(__file__).parent / "models" / "combinations.json"
"""Rules that were calibrated, with the names of the detectors and their `fingerprint`."""
CALIBRATED_TOGETHER = "calibrated together"
"""Key of what a combination says about itself."""
_MOST_LOGIT = 16.0


@dataclass(frozen=True, slots=True)
class CombinationRule:
    """The numbers of the rule."""

    prior: float
    """Share of the cells that is crowd where the detectors were calibrated, in (0, 1)."""
    lowest: tuple[float, ...] | None
    """Smallest logit of each detector; None: nobody has measured what their silence is worth."""

    def combined(self, maps: Sequence[Map], votes: Sequence[np.ndarray | None]) -> Map:
        """P [h, w] of the heatmaps [h, w] of all detectors; `votes` [h, w] are False where one has none
        (None: it has them everywhere)."""
        prior = float(np.log(self.prior) - np.log1p(-self.prior))
        total = np.full(maps[0].shape, prior)
        surest = np.full(maps[0].shape, -_MOST_LOGIT)
        voted = np.zeros(maps[0].shape, bool)
        for values, lowest, vote in zip(maps, self.lowest or (prior,) * len(maps), votes, strict=True):
            with np.errstate(divide="ignore"):
                logit = np.log(values.astype(np.float64)) - np.log1p(-values.astype(np.float64))
            logit = np.clip(logit, -_MOST_LOGIT, _MOST_LOGIT)
            evidence = np.maximum(logit, lowest) - prior
            total += evidence if vote is None else np.where(vote, evidence, 0.0)
            surest = np.maximum(surest, logit)
            voted |= True if vote is None else vote
        if self.lowest is None:
            total = np.where(surest < prior, surest, np.maximum(total, surest))
        total = np.where(voted, total, np.maximum(surest, prior))
        return np.asarray(sigmoid(np.clip(total, -_MOST_LOGIT, _MOST_LOGIT)), np.float32)


def rule_for(contracts: Sequence[Contract]) -> tuple[CombinationRule, bool]:
    """The rule for these detectors, in whatever order, and whether it was calibrated for them. Others are
    taken as independent where they see crowd, with the prior of the calibrated ones: also one that bears the
    name of a calibrated one, such as a model trained or calibrated anew."""
    rules = json.loads(COMBINATIONS.read_text())
    names = [contract.name for contract in contracts]
    known = all(rules["detectors"].get(one.name) == fingerprint(one) for one in contracts)
    for calibrated in rules["calibrated"] if known else ():
        if sorted(calibrated["lowest"]) == sorted(names):
            lowest = tuple(calibrated["lowest"][name] for name in names)
            return CombinationRule(calibrated["prior"], lowest), True
    return CombinationRule(rules["prior"], None), False


def fingerprint(contract: Contract) -> str:
    """Of all that a contract says about what its probabilities are worth; the same for a model in eight
    bits."""
    document = contract.to_json()
    told = [document[name] for name in ("calibration", "sizes", "output")]
    told.append((contract.about or {}).get("sha256"))
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]


def combined_contract(contracts: Sequence[Contract], *, calibrated: bool) -> Contract:
    """What the combination says of itself: rates and tested range are those of the first, which decides alone
    where the others have no vote. What pictures look like that it was tested on says the first that states
    it."""
    first = contracts[0]
    stride = min(contract.output.stride for contract in contracts)
    return replace(
        first,
        name=" + ".join(contract.name for contract in contracts),
        version=None,
        output=ModelOutput("heatmap", "probability", "NHW", stride),
        pictures=next((one.pictures for one in contracts if one.pictures is not None), None),
        about={
            "combination of": [contract.name for contract in contracts],
            CALIBRATED_TOGETHER: calibrated,
        },
    )


def combination_warnings(contract: Contract) -> list[str]:
    """One sentence where a contract is that of detectors whose opinions nobody has measured together."""
    if (contract.about or {}).get(CALIBRATED_TOGETHER, True):
        return []
    return [
        f"the detectors {contract.name} were not calibrated together: where one sees crowd no other takes it "
        "away, so the false alarms of all add up"
    ]


class Opinion(Protocol):
    """What a combination asks: a `Detector`."""

    @property
    def contract(self) -> Contract: ...

    @property
    def coarsest_gsd_m(self) -> float | None: ...

    def __call__(self, image: Image, gsd_m: Gsd | None = None, *, as_it_is: bool = False) -> Map: ...


class CombinedModel:
    """Detectors that look at the same picture."""

    def __init__(self, detectors: Sequence[Opinion], rule: CombinationRule) -> None:
        self._detectors, self._rule = detectors, rule

    def heatmap(self, image: Image, gsd_m: Gsd | None, *, as_it_is: bool = False) -> Map:
        """P on the finest cells of theirs, all of which divide the picture evenly."""
        given = [detector(image, gsd_m, as_it_is=as_it_is) for detector in self._detectors]
        cells = max(values.shape[0] for values in given), max(values.shape[1] for values in given)
        maps = [_on(values, cells) for values in given]
        votes = [_votes(detector.coarsest_gsd_m, gsd_m, cells) for detector in self._detectors]
        return self._rule.combined(maps, votes)

    def heatmaps(
        self, images: Sequence[Image], gsd_m: Sequence[Gsd | None], *, as_it_is: bool = False
    ) -> list[Map]:
        return [self.heatmap(image, gsd, as_it_is=as_it_is) for image, gsd in zip(images, gsd_m, strict=True)]


def _votes(coarsest_m: float | None, gsd_m: Gsd | None, cells: tuple[int, int]) -> np.ndarray | None:
    """Cells [h, w] where a detector has a vote; ground that is not seen has no scale and hinders nobody."""
    if gsd_m is None or coarsest_m is None:
        return None
    return ~(at_cells(across(gsd_m), cells) > coarsest_m)


def _on(values: Map, cells: tuple[int, int]) -> Map:
    """A heatmap on a finer grid of the same picture. No value is interpolated: a crowd in one cell would fade
    beside its neighbours, and no detector takes away what another sees."""
    return values if values.shape == cells else at_cells(values, cells)
