"""The file that a calibration leaves behind: corrected graph, completed contract, checked against numpy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path
from crowdfence.calibration.choice import Calibration
from crowdfence.calibration.correction import LogitMap
from crowdfence.calibration.graph import bake, write_contract
from crowdfence.calibration.logit_counts import LIMIT, cell_logits
from crowdfence.detector.contract.contract import Contract, Validity
from crowdfence.detector.contract.picture_sizes import PictureSizes
from crowdfence.errors import DetectorError
from crowdfence.evaluation.voxels.rates import ProjectionSettings, VoxelRates

if TYPE_CHECKING:
    from onnx import ModelProto

    from crowdfence.detector.detector import Detector

TOLERATED_DIFFERENCE = 1e-3
"""Between the calibrated graph and the same in numpy; beyond it the graph does something else."""
TELLING_LOGIT = 13.0
"""Of larger ones a float32 probability says too little: a temperature of 10 makes .003 of one step of it."""
TOLERATED_DIFFERENCE_HALF, TELLING_LOGIT_HALF = 1e-2, 4.0
"""The same of a graph that computes in float16."""


def output_kind(contract: Contract) -> Literal["probability", "logits"]:
    """DetectorError for a model whose logits cannot be corrected inside its graph."""
    kind = contract.output.kind
    if kind not in ("probability", "logits"):
        raise DetectorError(
            f"{contract.name} puts out {kind}; inside a graph only a probability or logits can be calibrated"
        )
    return cast(Literal["probability", "logits"], kind)


def calibrated_contract(
    contract: Contract,
    calibration: Calibration,
    rates: VoxelRates | None,
    settings: ProjectionSettings | None,
    target_height_m: float,
) -> Contract:
    """The contract with what was measured. Without new rates there are none: the old ones were those of
    another heatmap."""
    document = calibration.to_json()
    # The detector divides the logits that leave a graph by this temperature; they are corrected already.
    by_graph = contract.output.kind == "logits" or not calibration.chosen.is_line
    document = {"temperature": 1.0 if by_graph else 1.0 / calibration.chosen.scale, **document}
    if contract.calibration is not None:
        document["earlier"] = contract.calibration  # with those before it, all of which moved the sizes
    completed = replace(
        with_measured_rates(contract, rates, settings),
        sizes=_sizes_after(contract.sizes, calibration.chosen),
        about=about_after(contract.about, calibration.chosen),
        calibration=document,
        target_height_m=target_height_m,
    )
    return Contract.from_json(completed.to_json())


def with_measured_rates(
    contract: Contract, rates: VoxelRates | None, settings: ProjectionSettings | None
) -> Contract:
    """The contract with these rates, or with none, and the range that they were measured in."""
    if rates is None or settings is None:
        return replace(contract, rates=None)
    spans = {name: span and tuple(span) for name, span in rates.validity.items()}
    validity = Validity(**cast(dict[str, Any], spans))
    return replace(contract, rates=rates.to_json(settings), validity=validity)


def _sizes_after(sizes: PictureSizes | None, chosen: LogitMap) -> PictureSizes | None:
    """What joins maps at several sizes, so that the outcome is corrected too. The graph corrects each map
    before they are joined: `scale` * z + `bias` of all gives scale * sum(weights * z) + bias * sum(weights),
    while scale * (own bias + sum(weights * z)) + bias was measured."""
    if sizes is None or sizes.weights is None or not chosen.is_line:
        return sizes
    bias = chosen.scale * sizes.bias + chosen.bias * (1.0 - sum(sizes.weights))
    return replace(sizes, bias=bias)


def sizes_before(contract: Contract) -> PictureSizes | None:
    """`_sizes_after` undone, for a network without the corrections that `contract` tells of. A curve left
    what joins the maps as it was."""
    sizes, correction = contract.sizes, contract.calibration
    while correction:
        by_graph = correction.get("in_graph") or {}
        correction = correction.get("earlier")
        if sizes is None or sizes.weights is None or "scale" not in by_graph:
            continue
        moved = by_graph["bias"] * (1.0 - sum(sizes.weights))
        sizes = replace(sizes, bias=(sizes.bias - moved) / by_graph["scale"])
    return sizes


def about_after(about: dict[str, Any] | None, chosen: LogitMap) -> dict[str, Any] | None:
    """Without what was counted on photographs at one half, where the correction moves that."""
    if about is None or (chosen.is_line and chosen.bias == 0.0):
        return about
    return {name: told for name, told in about.items() if name != "photographs"}


def write_calibrated(
    graph: ModelProto, chosen: LogitMap, contract: Contract, completed: Contract, output: Path
) -> None:
    """Write `graph`, which `contract` describes, corrected and with the `completed` contract; atomically."""
    import onnx

    # The correction was fitted after the division by the contract's temperature; now it comes before it.
    temperature = contract.temperature if contract.output.kind == "logits" else 1.0
    logit_map, limit = chosen.of_scaled(1.0 / temperature), LIMIT * temperature
    baked = bake(graph, logit_map, contract.output.name, output_kind(contract), limit)
    write_contract(baked, completed.to_json())
    with atomic_path(output) as temporary:
        onnx.save_model(baked, str(temporary))


def write_with_contract(model: Path, contract: Contract, output: Path) -> None:
    """Write the graph of a model as it is, with another contract; atomically."""
    import onnx

    graph = onnx.load(str(model))
    write_contract(graph, contract.to_json())
    with atomic_path(output) as temporary:
        onnx.save_model(graph, str(temporary))


def require_agreement(
    before: Detector, after: Detector, chosen: LogitMap, image: NDArray[np.uint8], *, half: bool = False
) -> None:
    """DetectorError unless the written model gives on an image what the correction gives in numpy. `half`:
    its output is float16."""
    tolerated = TOLERATED_DIFFERENCE_HALF if half else TOLERATED_DIFFERENCE
    image = _not_resampled(image, before.contract)
    raw = before(image, as_it_is=True)
    inside = np.abs(cell_logits(raw)) < (TELLING_LOGIT_HALF if half else TELLING_LOGIT)
    difference = np.abs(after(image, as_it_is=True) - chosen.probability(raw))[inside].max(initial=0.0)
    if difference > tolerated:
        raise DetectorError(
            f"the calibrated model differs from its calibration by {difference:.2g}; allowed: {tolerated:g}. "
            "Nothing is written. Please report this model"
        )


def _not_resampled(image: NDArray[np.uint8], contract: Contract) -> NDArray[np.uint8]:
    """The image at the size of a model that resizes. On any other size the heatmap is interpolated from the
    model's cells, and a correction of interpolated values differs from interpolated corrected ones."""
    size = contract.input.size
    if size is None or contract.input.resize not in ("stretch", "letterbox"):
        return image
    from PIL import Image

    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BILINEAR))
