"""Trained network -> ONNX file that takes pictures as they are and describes itself."""

from __future__ import annotations

import warnings
from pathlib import Path

import torch
from torch import Tensor, nn

from crowdfence.atomic_file import atomic_path
from crowdfence.detector.contract.contract import Contract
from crowdfence.detector_training.exporter_notes import forget_exporter_notes
from crowdfence.detector_training.network import MULTIPLE_OF, CrowdNet

METADATA_KEY = "crowdfence"
OPSET = 18


class PictureNet(nn.Module):
    """uint8 pictures [N, H, W, 3] RGB -> probability of crowd [N, 1, H / 4, W / 4] for one target."""

    def __init__(self, network: CrowdNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> Tensor:
        return torch.sigmoid(self.network(image.permute(0, 3, 1, 2).float() / 255.0))


def export_onnx(network: CrowdNet, target: int, contract: Contract, path: Path) -> None:
    """Write plane `target` of the network's output with `contract` as metadata; batch normalisation
    and scene are folded, and batch, height and width stay free. OSError when the file cannot be written."""
    import json

    model = PictureNet(network.deployed(target)).eval()
    batch = torch.export.Dim("batch", min=1, max=1024)
    rows, columns = (torch.export.Dim(name, min=1, max=4096) for name in ("rows", "columns"))
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            model,
            (torch.zeros((2, 6 * MULTIPLE_OF, 8 * MULTIPLE_OF, 3), dtype=torch.uint8),),
            input_names=["image"],
            output_names=["heatmap"],
            dynamic_shapes={"image": {0: batch, 1: MULTIPLE_OF * rows, 2: MULTIPLE_OF * columns}},
            opset_version=OPSET,
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    program.model.metadata_props[METADATA_KEY] = json.dumps(contract.to_json())
    proto = program.model_proto
    forget_exporter_notes(proto)
    with atomic_path(path) as part:
        part.write_bytes(proto.SerializeToString())
