"""Weights between two trainings of one network: `python between_weights.py FIRST SECOND OUT [--share 0.5]`.

A network that was trained further on other pictures forgets some of what it knew. Halfway between its weights
before and after it keeps most of both (Wortsman et al., "Robust fine-tuning of zero-shot models", 2022): the
second training began where the first one ended.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import onnx
from onnx import numpy_helper

from crowdfence.detector.contract.lookup import METADATA_KEY

PREFIX = "network."


def between(first: onnx.ModelProto, second: onnx.ModelProto, share: float) -> onnx.ModelProto:
    """`second`, of whose weights `share` is its own and the rest those of `first`. ValueError for models of
    two networks, and for a `second` that was calibrated: what was measured of it is not true of the mixture.
    """
    stated = {entry.key: entry.value for entry in second.metadata_props}.get(METADATA_KEY, "{}")
    if {"rates", "calibration"} & {key for key, value in json.loads(stated).items() if value is not None}:
        raise ValueError(
            "the second model is calibrated: give it as it was trained, and calibrate the mixture"
        )
    before = {one.name: numpy_helper.to_array(one) for one in first.graph.initializer}
    for one in second.graph.initializer:
        if not one.name.startswith(PREFIX):
            continue
        after = numpy_helper.to_array(one)
        if one.name not in before or before[one.name].shape != after.shape:
            raise ValueError(f"{one.name} {list(after.shape)} is not in the first model")
        mixed = (1.0 - share) * before[one.name] + share * after
        one.CopyFrom(numpy_helper.from_array(mixed.astype(after.dtype), one.name))
    return second


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=Path)
    parser.add_argument("second", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--share", type=float, default=0.5, help="of the second model")
    given = parser.parse_args()
    mixed = between(onnx.load(str(given.first)), onnx.load(str(given.second)), given.share)
    onnx.save_model(mixed, str(given.out))


if __name__ == "__main__":
    sys.exit(main())
