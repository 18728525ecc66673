"""What an exporter notes beside a graph: where in whose source every node came from. It says nothing of the
network, and names folders of the machine that trained it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from onnx import ModelProto


def forget_exporter_notes(model: ModelProto) -> None:
    """Clear the notes at the graph, its nodes and its values. The model's own metadata stay: they are its
    contract."""
    graph = model.graph
    values = (*graph.input, *graph.output, *graph.value_info, *graph.initializer)
    for noted in (graph, *graph.node, *values):
        del noted.metadata_props[:]
        noted.doc_string = ""
