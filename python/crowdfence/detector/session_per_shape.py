"""A session for each of the latest shapes of a model's input, for GPUs.

ONNX Runtime plans each convolution on a GPU anew when its input has another shape than the last time: 1 ms
for each of 28, where the work itself takes a few hundredths of that (benchmarks/README.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from threading import Lock
from typing import TYPE_CHECKING, Any, Protocol

from numpy.typing import NDArray

if TYPE_CHECKING:
    import onnxruntime

MOST_SHAPES = 8
"""Pictures of one camera are shown at five sizes and less, and as tiles where they are large."""


class Runs(Protocol):
    """What runs a model: an `onnxruntime.InferenceSession`, or several of them."""

    def run(
        self, outputs: Sequence[str], inputs: Mapping[str, NDArray[Any]], options: onnxruntime.RunOptions
    ) -> list[Any]: ...


class SessionPerShape:
    """Safe to share between threads, as a session is."""

    def __init__(self, open_one: Callable[[], Runs]) -> None:
        self._open_one = open_one
        self._by_shape: dict[tuple[int, ...], Runs] = {}
        self._changes = Lock()

    def run(
        self, outputs: Sequence[str], inputs: Mapping[str, NDArray[Any]], options: onnxruntime.RunOptions
    ) -> list[Any]:
        return self._for(next(iter(inputs.values())).shape).run(outputs, inputs, options)

    def _for(self, shape: tuple[int, ...]) -> Runs:
        with self._changes:
            session = self._by_shape.pop(shape, None) or self._open_one()
            self._by_shape[shape] = session  # the latest comes last
            if len(self._by_shape) > MOST_SHAPES:
                del self._by_shape[next(iter(self._by_shape))]
            return session
