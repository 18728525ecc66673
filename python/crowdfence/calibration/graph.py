"""A correction of the logits written into an ONNX graph, and a contract into its metadata."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from crowdfence.calibration.correction import LogitMap
from crowdfence.calibration.logit_counts import LIMIT
from crowdfence.detector.contract.lookup import METADATA_KEY
from crowdfence.errors import DetectorError, quoted

if TYPE_CHECKING:
    from onnx import GraphProto, ModelProto, NodeProto

PREFIX = "crowdfence_calibration"
MIN_OPSET = 8
"""From here on Mul, Add, Min and Max stretch one number over a tensor."""


def bake(
    model: ModelProto,
    logit_map: LogitMap,
    output_name: str,
    kind: Literal["probability", "logits"],
    limit: float = LIMIT,
) -> ModelProto:
    """A copy of `model` whose output `output_name` is corrected; everything else is as it was.

    A `probability` must come out of a Sigmoid: the correction goes in front of it, in full precision.
    `logits` are corrected as they leave the graph. Before that they are cut at `limit`, as they were where
    the correction was fitted: what was counted there says nothing of how sure larger ones may be. A line then
    takes one Mul and one Add, a curve a few standard operators for each knot.

    Raises DetectorError for a graph without that output, one where it is made otherwise or lies inside a
    control-flow operator, an output that is not floating point, an operator set below 8, and a graph that
    is not valid ONNX though a runtime may take it.
    """
    import onnx

    corrected = onnx.ModelProto()
    corrected.CopyFrom(model)
    graph = corrected.graph
    _require_opset(corrected)
    dtype = float_type(graph, output_name)
    writer = _Writer(graph, dtype)
    index = _producer(graph, output_name)
    if kind == "probability":
        sigmoid = _sigmoid_before(graph, index, output_name)
        node = graph.node[sigmoid]
        node.input[0] = writer.map(node.input[0], logit_map, limit)
        at = sigmoid
    else:
        raw = f"{PREFIX}_{writer.number}_before"
        _rename(graph, output_name, raw)
        writer.map(writer.without_infinity(raw), logit_map, limit)
        writer.nodes[-1].output[0] = output_name
        at = index + 1
    nodes = [*graph.node[:at], *writer.nodes, *graph.node[at:]]
    del graph.node[:]
    graph.node.extend(nodes)
    try:
        onnx.checker.check_model(corrected)
    except onnx.checker.ValidationError as error:
        raise DetectorError(
            "the model is no valid ONNX, though ONNX Runtime takes it, and no correction fits into it: "
            f"{quoted(str(error), 200)}; export it again"
        ) from None
    return corrected


def write_contract(model: ModelProto, document: dict[str, Any]) -> None:
    """Put a contract into the metadata of a model in place of an older one; other entries stay."""
    kept = [entry for entry in model.metadata_props if entry.key != METADATA_KEY]
    entries = [(entry.key, entry.value) for entry in kept]
    del model.metadata_props[:]
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for key, value in [*entries, (METADATA_KEY, text)]:
        model.metadata_props.add(key=key, value=value)


class _Writer:
    """Collects new nodes; constants go straight into the graph's initializers."""

    def __init__(self, graph: GraphProto, dtype: type[np.floating[Any]]) -> None:
        self._graph, self._dtype = graph, dtype
        # A model that was calibrated before holds our names already; numbers stay where an earlier
        # correction was cut off.
        names = [name for node in graph.node for name in node.output]
        names += [constant.name for constant in graph.initializer]
        taken = {name for name in names if name.startswith(PREFIX)}
        self.number = next(n for n in range(len(taken) + 1) if not _any_starts(taken, f"{PREFIX}_{n}_"))
        self.nodes: list[NodeProto] = []

    def without_infinity(self, logits: str) -> str:
        """The logits, NaN for infinity: both are refused when they leave a graph, and cut at a limit infinity
        would be a number like any other."""
        return self._apply("Add", logits, self._apply("Sub", logits, logits))

    def map(self, logits: str, logit_map: LogitMap, limit: float) -> str:
        """Name of the tensor that holds the corrected logits."""
        logits = self._apply("Min", self._apply("Max", logits, -limit), limit)
        if logit_map.is_line:
            scaled = self._apply("Mul", logits, logit_map.scale)
            return self._apply("Add", scaled, logit_map.bias)
        # Sum over the pieces of slope * (logits cut to the piece), which is continuous by construction.
        before, after = np.array(logit_map.knots).T
        slopes = [logit_map.slope_below, *np.diff(after) / np.diff(before), logit_map.slope_above]
        below = self._apply("Min", logits, before[0])
        total = self._apply("Mul", below, slopes[0])
        start = after[0] - slopes[0] * before[0]
        for low, high, slope in zip(before[:-1], before[1:], slopes[1:-1], strict=True):
            piece = self._apply("Min", self._apply("Max", logits, low), high)
            total = self._apply("Add", total, self._apply("Mul", piece, slope))
            start -= slope * low
        above = self._apply("Max", logits, before[-1])
        total = self._apply("Add", total, self._apply("Mul", above, slopes[-1]))
        return self._apply("Add", total, start - slopes[-1] * before[-1])

    def _apply(self, operator: str, left: str, right: str | float) -> str:
        from onnx import helper, numpy_helper

        name = f"{PREFIX}_{self.number}_{len(self.nodes)}"
        if not isinstance(right, str):
            constant = numpy_helper.from_array(np.array(right, self._dtype), f"{name}_constant")
            self._graph.initializer.append(constant)
            right = constant.name
        self.nodes.append(helper.make_node(operator, [left, right], [name], name=name))
        return name


def _any_starts(names: set[str], prefix: str) -> bool:
    return any(name.startswith(prefix) for name in names)


def _require_opset(model: ModelProto) -> None:
    versions = [entry.version for entry in model.opset_import if entry.domain in ("", "ai.onnx")]
    if not versions or max(versions) < MIN_OPSET:
        found = max(versions) if versions else "none"
        raise DetectorError(
            f"the model's operator set is {found}; a calibration needs {MIN_OPSET} or newer: export it again"
        )


def float_type(graph: GraphProto, output_name: str) -> type[np.floating[Any]]:
    """In which precision an output is computed; DetectorError for one that is no floating point."""
    from onnx import TensorProto

    outputs = {output.name: output for output in graph.output}
    if output_name not in outputs:
        raise DetectorError(f"the graph has no output {output_name!r}; it has {', '.join(outputs) or 'none'}")
    element = outputs[output_name].type.tensor_type.elem_type
    types: dict[int, type[np.floating[Any]]] = {
        TensorProto.FLOAT: np.float32,
        TensorProto.DOUBLE: np.float64,
        TensorProto.FLOAT16: np.float16,
    }
    if element not in types:
        raise DetectorError(
            f"output {output_name!r} is {TensorProto.DataType.Name(element)}; only floating point can be "
            "calibrated inside the graph"
        )
    return types[element]


def _producer(graph: GraphProto, name: str) -> int:
    for index, node in enumerate(graph.node):
        if name in node.output:
            return index
    raise DetectorError(f"no operator of the main graph makes {name!r}")


def _sigmoid_before(graph: GraphProto, index: int, output_name: str) -> int:
    """Index of the Sigmoid that the output comes from, through Identity at most."""
    while graph.node[index].op_type == "Identity":
        index = _producer(graph, graph.node[index].input[0])
    operator = graph.node[index].op_type
    if operator != "Sigmoid":
        raise DetectorError(
            f"output {output_name!r} is a probability made by {operator}, not Sigmoid: its logits cannot be "
            'reached. Export the model with logits as output (kind "logits")'
        )
    return index


def _rename(graph: GraphProto, old: str, new: str) -> None:
    """Give a tensor another name where it is made and where it is used, but not among the graph's outputs."""
    for node in graph.node:
        for names in (node.input, node.output):
            for position, name in enumerate(names):
                if name == old:
                    names[position] = new
