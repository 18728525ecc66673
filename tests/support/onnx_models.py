"""Small ONNX models whose output follows from the image by hand arithmetic.

Maps: the mean of a colour over each cell of 4 x 4 pixels (channel 0 = red of RGB). People: the pixels of one
colour, or a fixed list.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import ArrayLike
from onnx import TensorProto, helper, numpy_helper

OPSET = 17
STRIDE = 4


def contract(kind: str = "probability", **changes: Any) -> dict[str, Any]:
    """A contract of the uint8 NHWC models below; changes are written "input__size"=[64, 64]."""
    people = kind in ("points", "boxes")
    document: dict[str, Any] = {
        "schema": 1,
        "name": "test model",
        "version": "1.0",
        "licence": "Apache-2.0",
        "input": {
            "name": "image",
            "layout": "NHWC",
            "dtype": "uint8",
            "color": "RGB",
            "multiple_of": 8,
            "resize": "none",
        },
        "output": {
            "name": "heatmap",
            "kind": kind,
            "layout": "NDC" if people else "NCHW",
            "stride": STRIDE,
        },
    }
    if people:
        document["output"]["row"] = "score"
    if kind == "boxes":
        document["output"]["box_format"] = "xyxy"
    if kind == "density":
        document["output"]["count_scale"] = 1.0
    for path, value in changes.items():
        *sections, key = path.split("__")
        place = document
        for section in sections:
            place = place[section]
        place[key] = value
    return document


def write_map_model(
    path: Path,
    document: Mapping[str, Any] | None = None,
    *,
    scale: float = 1.0 / 255.0,
    offset: float = 0.0,
    channels: Sequence[int] = (0,),
    blur_cells: int = 0,
    layout: str = "NHWC",
    dtype: int = TensorProto.UINT8,
    image_shape: Sequence[int | str] | None = None,
    output_layout: str = "NCHW",
    metadata: Mapping[str, str] | None = None,
    batch: int | str = "N",
) -> Path:
    """Mean colour of each cell * scale + offset, one output channel per entry of `channels`.

    blur_cells > 0 averages over that many cells on every side, zeros beyond the border.
    """
    nodes = [helper.make_node("Cast", ["image"], ["float"], to=TensorProto.FLOAT)]
    if layout == "NHWC":
        nodes.append(helper.make_node("Transpose", ["float"], ["nchw"], perm=[0, 3, 1, 2]))
    else:
        nodes.append(helper.make_node("Identity", ["float"], ["nchw"]))
    nodes += [
        helper.make_node("AveragePool", ["nchw"], ["mean"], kernel_shape=[STRIDE] * 2, strides=[STRIDE] * 2),
        helper.make_node("Gather", ["mean", "channels"], ["chosen"], axis=1),
        helper.make_node("Mul", ["chosen", "scale"], ["scaled"]),
        helper.make_node("Add", ["scaled", "offset"], ["sharp"]),
    ]
    side = 2 * blur_cells + 1
    blur = helper.make_node(
        "AveragePool",
        ["sharp"],
        ["answer"],
        kernel_shape=[side, side],
        pads=[blur_cells] * 4,
        strides=[1, 1],
        count_include_pad=1,
    )
    nodes.append(blur)
    if output_layout == "NHWC":
        nodes.append(helper.make_node("Transpose", ["answer"], ["heatmap"], perm=[0, 2, 3, 1]))
    elif output_layout == "NHW":
        nodes.append(helper.make_node("Squeeze", ["answer", "one"], ["heatmap"]))
    else:
        nodes.append(helper.make_node("Identity", ["answer"], ["heatmap"]))
    constants = {
        "channels": np.array(channels, np.int64),
        "scale": np.float32(scale),
        "offset": np.float32(offset),
        "one": np.array([1], np.int64),
    }
    default = [batch, "H", "W", 3] if layout == "NHWC" else [batch, 3, "H", "W"]
    shapes = {"NCHW": ["N", len(channels), "h", "w"], "NHWC": ["N", "h", "w", len(channels)]}
    return _write(
        path,
        nodes,
        constants,
        helper.make_tensor_value_info("image", dtype, image_shape or default),
        helper.make_tensor_value_info(
            "heatmap", TensorProto.FLOAT, shapes.get(output_layout, ["N", "h", "w"])
        ),
        document,
        metadata,
    )


def write_fixed_output_model(
    path: Path,
    output: ArrayLike,
    document: Mapping[str, Any] | None = None,
    *,
    dtype: int = TensorProto.UINT8,
    image_shape: Sequence[int | str] = (1, "H", "W", 3),
    output_shape: Sequence[int | str] | None = None,
    metadata: Mapping[str, str] | None = None,
    output_name: str = "heatmap",
) -> Path:
    """The same output for every image."""
    answer = np.asarray(output, np.float32)
    nodes = [
        helper.make_node("Cast", ["image"], ["float"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMax", ["float"], ["brightest"], keepdims=0),
        helper.make_node("Mul", ["brightest", "zero"], ["nothing"]),
        helper.make_node("Add", ["answer", "nothing"], [output_name]),
    ]
    return _write(
        path,
        nodes,
        {"zero": np.float32(0.0), "answer": answer},
        helper.make_tensor_value_info("image", dtype, list(image_shape)),
        helper.make_tensor_value_info(output_name, TensorProto.FLOAT, list(output_shape or answer.shape)),
        document,
        metadata,
    )


def write_pixel_people_model(path: Path, document: Mapping[str, Any]) -> Path:
    """One person (x, y, 1) at the centre of every pixel with red above 200: [1, D, 3]."""
    nodes = [
        helper.make_node("Gather", ["image", "red"], ["reds"], axis=3),
        helper.make_node("Greater", ["reds", "limit"], ["people"]),
        helper.make_node("NonZero", ["people"], ["at"]),  # [3, D]: image, row, column
        helper.make_node("Gather", ["at", "order"], ["column_row"], axis=0),
        helper.make_node("Cast", ["column_row"], ["corner"], to=TensorProto.FLOAT),
        helper.make_node("Add", ["corner", "half"], ["centre"]),
        helper.make_node("Mul", ["corner", "zero"], ["nothing"]),
        helper.make_node("ReduceSum", ["nothing", "first"], ["nothing_row"], keepdims=1),
        helper.make_node("Add", ["nothing_row", "one"], ["score"]),
        helper.make_node("Concat", ["centre", "score"], ["rows"], axis=0),
        helper.make_node("Transpose", ["rows"], ["detections"], perm=[1, 0]),
        helper.make_node("Unsqueeze", ["detections", "first"], ["heatmap"]),
    ]
    constants = {
        "red": np.int64(0),
        "limit": np.uint8(200),
        "order": np.array([2, 1], np.int64),
        "half": np.float32(0.5),
        "zero": np.float32(0.0),
        "first": np.array([0], np.int64),
        "one": np.float32(1.0),
    }
    return _write(
        path,
        nodes,
        constants,
        helper.make_tensor_value_info("image", TensorProto.UINT8, [1, "H", "W", 3]),
        helper.make_tensor_value_info("heatmap", TensorProto.FLOAT, [1, "D", 3]),
        document,
        None,
    )


def write_two_input_model(path: Path) -> Path:
    nodes = [helper.make_node("Add", ["image", "other"], ["heatmap"])]
    inputs = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 3, 8, 8]) for name in ("image", "other")
    ]
    output = helper.make_tensor_value_info("heatmap", TensorProto.FLOAT, [1, 3, 8, 8])
    return _save(path, helper.make_graph(nodes, "two", inputs, [output]), contract(), None)


def _write(
    path: Path,
    nodes: list[onnx.NodeProto],
    constants: Mapping[str, Any],
    image: onnx.ValueInfoProto,
    output: onnx.ValueInfoProto,
    document: Mapping[str, Any] | None,
    metadata: Mapping[str, str] | None,
) -> Path:
    initializers = [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()]
    return _save(path, helper.make_graph(nodes, "test", [image], [output], initializers), document, metadata)


def _save(
    path: Path,
    graph: onnx.GraphProto,
    document: Mapping[str, Any] | None,
    metadata: Mapping[str, str] | None,
    opset: int = OPSET,
) -> Path:
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    entries = dict(metadata or {})
    if document is not None:
        entries["crowdfence"] = json.dumps(document)
    helper.set_model_props(model, entries)
    path.write_bytes(model.SerializeToString())
    return path


def write_endless_model(path: Path) -> Path:
    """A model whose Loop has no trip limit and a condition that stays true."""
    types = TensorProto
    body = helper.make_graph(
        [
            helper.make_node("Identity", ["go_on"], ["still"]),
            helper.make_node("Identity", ["carried"], ["passed"]),
        ],
        "body",
        [
            helper.make_tensor_value_info("step", types.INT64, []),
            helper.make_tensor_value_info("go_on", types.BOOL, []),
            helper.make_tensor_value_info("carried", types.FLOAT, None),
        ],
        [
            helper.make_tensor_value_info("still", types.BOOL, []),
            helper.make_tensor_value_info("passed", types.FLOAT, None),
        ],
    )
    nodes = [
        helper.make_node("Cast", ["image"], ["float"], to=types.FLOAT),
        helper.make_node("Transpose", ["float"], ["nchw"], perm=[0, 3, 1, 2]),
        helper.make_node("AveragePool", ["nchw"], ["mean"], kernel_shape=[STRIDE] * 2, strides=[STRIDE] * 2),
        helper.make_node("Gather", ["mean", "channel"], ["red"], axis=1),
        helper.make_node("Loop", ["", "true", "red"], ["heatmap"], body=body),
    ]
    graph = helper.make_graph(
        nodes,
        "endless",
        [helper.make_tensor_value_info("image", types.UINT8, ["N", "H", "W", 3])],
        [helper.make_tensor_value_info("heatmap", types.FLOAT, ["N", 1, "h", "w"])],
        [
            numpy_helper.from_array(np.array(True), "true"),
            numpy_helper.from_array(np.array([0], np.int64), "channel"),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)])
    model.ir_version = 8
    helper.set_model_props(model, {"crowdfence": json.dumps(contract())})
    onnx.save(model, path)
    return path
