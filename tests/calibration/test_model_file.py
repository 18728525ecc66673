"""The check that a written model does what its calibration says, for every way in which an image is cut up.

The models put out the red of their 4 x 4 cells as logits, so a correction is known by hand: a temperature
of 2 halves the logits, and a graph with half the scale performs it.
"""

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest

from crowdfence import Contract, Detector
from crowdfence.calibration.correction import UNCHANGED, line
from crowdfence.calibration.model_file import require_agreement, write_calibrated
from crowdfence.errors import DetectorError
from support.onnx_models import contract, write_map_model

IMAGE = np.random.default_rng(7).integers(0, 256, (150, 170, 3), dtype=np.uint8)
TILES = {"input__size": [64, 64], "input__resize": "tile"}
"""Of an image of 170 x 150 pixels: 4 x 3 tiles, which overlap by 16 pixels or more."""
STRETCHED = {"input__size": [128, 96], "input__resize": "stretch"}
LETTERBOXED = {"input__size": [128, 128], "input__resize": "letterbox"}
HALVED = line("temperature", 0.5)


def detector(path: Path, *, sharpness: float, bias: float = 0.0, **changes: Any) -> Detector:
    """Logits from -3 to 3, times `sharpness`, plus `bias`; every cell is the mean of 3 x 3 cells."""
    return Detector(
        write_map_model(
            path,
            contract("logits", **changes),
            scale=sharpness * 6.0 / 255.0,
            offset=bias - 3.0 * sharpness,
            blur_cells=1,
        )
    )


every_way = pytest.mark.parametrize(
    "changes", [{}, TILES, STRETCHED, LETTERBOXED], ids=["whole", "tiles", "stretched", "letterboxed"]
)


@every_way
@pytest.mark.parametrize("sharpness", [1.0, 6.0])
def test_a_graph_that_performs_the_correction_passes(
    tmp_path: Path, changes: dict[str, Any], sharpness: float
) -> None:
    """Also where the heatmap is interpolated from the model's cells: there the correction of an interpolated
    probability is not the interpolated corrected one, by up to .01 with sharp logits."""
    before = detector(tmp_path / "before.onnx", sharpness=sharpness, **changes)
    after = detector(tmp_path / "after.onnx", sharpness=0.5 * sharpness, **changes)
    require_agreement(before, after, HALVED, IMAGE)


@every_way
@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param({"sharpness": 1.0}, id="not corrected"),
        pytest.param({"sharpness": 0.25}, id="corrected twice"),
        pytest.param({"sharpness": 0.5, "bias": 0.1}, id="with a bias that was not fitted"),
    ],
)
def test_a_graph_that_does_something_else_is_found(
    tmp_path: Path, changes: dict[str, Any], wrong: dict[str, float]
) -> None:
    before = detector(tmp_path / "before.onnx", sharpness=1.0, **changes)
    after = detector(tmp_path / "after.onnx", **wrong, **changes)
    with pytest.raises(DetectorError, match="the calibrated model differs from its calibration by"):
        require_agreement(before, after, HALVED, IMAGE)


def test_a_tiled_model_as_it_is_written_passes(tmp_path: Path) -> None:
    """The graph corrected by `write_calibrated` itself, with its own contract back in the file."""
    before = detector(tmp_path / "before.onnx", sharpness=1.0, **TILES)
    described = contract("logits", **TILES)
    completed = Contract.from_json({**described, "calibration": {"temperature": 1.0}})
    output = tmp_path / "after.onnx"
    graph = onnx.load(str(tmp_path / "before.onnx"))
    write_calibrated(graph, HALVED, Contract.from_json(described), completed, output)
    require_agreement(before, Detector(output), HALVED, IMAGE)


@pytest.mark.parametrize("scale", [0.05, 0.1, 0.2, 0.5, 2.0])
@pytest.mark.parametrize("half", [False, True], ids=["float32", "float16"])
def test_a_model_that_was_far_too_sure_of_itself_passes(tmp_path: Path, scale: float, half: bool) -> None:
    """Its probabilities near 1 have lost their logits, so numpy cannot tell what the graph makes of them."""
    before_path = sure_model(tmp_path / "before.onnx", half=half)
    described, output = contract("probability"), tmp_path / "after.onnx"
    chosen, before = line("temperature", scale), Detector(before_path, contract=described)
    graph = onnx.load(str(before_path))
    write_calibrated(graph, chosen, Contract.from_json(described), Contract.from_json(described), output)
    after = Detector(output)
    require_agreement(before, after, chosen, IMAGE, half=half)
    for wrong in (UNCHANGED, line("scale and bias", scale, 0.2)):
        with pytest.raises(DetectorError, match="differs from its calibration"):
            require_agreement(before, after, wrong, IMAGE, half=half)


def sure_model(path: Path, *, half: bool) -> Path:
    """P = sigmoid of the red of a cell, from -16 to 16."""
    write_map_model(path, scale=32.0 / 255.0, offset=-16.0)
    model = onnx.load(str(path))
    (last,) = (node for node in model.graph.node if "heatmap" in node.output)
    last.output[0] = "logits"
    kind = onnx.TensorProto.FLOAT16 if half else onnx.TensorProto.FLOAT
    model.graph.node.append(onnx.helper.make_node("Cast", ["logits"], ["cast"], to=kind))
    model.graph.node.append(onnx.helper.make_node("Sigmoid", ["cast"], ["heatmap"]))
    model.graph.output[0].type.tensor_type.elem_type = kind
    onnx.save_model(model, str(path))
    return path
