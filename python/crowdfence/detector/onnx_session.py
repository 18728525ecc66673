"""An ONNX model opened by ONNX Runtime, one thread per stream; failures are a DetectorError of one line."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock, Timer
from typing import TYPE_CHECKING, Any, Protocol

from numpy.typing import NDArray

from crowdfence.detector.contract.model_face import ModelFace, Tensor
from crowdfence.detector.execution_device import Device, check_runs_on, providers
from crowdfence.errors import DetectorError, quoted

if TYPE_CHECKING:
    import onnxruntime

TIME_LIMIT_S = 300.0
"""One run of a model takes tenths of a second, on a slow machine with a large picture some seconds."""
TIME_LIMIT_VARIABLE = "CROWDFENCE_MODEL_TIME_LIMIT_S"
"""Environment variable with another limit."""

_FATAL_ONLY = 4  # what is wrong is in the exception; the runtime would also write it to stderr
_SOURCE_LINE = re.compile(r"/\S+\.(?:h|cc):\d+ [^()]*\([^()]*\) ")
_GPU_FAILURE = re.compile(r"(?:CUDA|CUDNN|CUDNN_FE|CUBLAS) failure \d+: .*?(?= ; GPU=)")
_DTYPES = {"float": "float32", "double": "float64"}


_MOST_SHAPES = 8
"""Of pictures, whose sessions are kept: whole ones at five sizes, and the tiles of large ones."""


class Runs(Protocol):
    """What runs a model: an `onnxruntime.InferenceSession`, or several of them."""

    def run(
        self, outputs: Sequence[str], inputs: Mapping[str, NDArray[Any]], options: onnxruntime.RunOptions
    ) -> list[Any]: ...


@dataclass(frozen=True, slots=True)
class OnnxSession:
    session: Runs
    face: ModelFace


class SessionPerShape:
    """A session for each of the latest shapes of its input. For convolutions on a GPU ONNX Runtime plans
    anew whenever a shape is another one than the last: 1 ms for each of them, where the work itself takes a
    few hundredths of that."""

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
            if len(self._by_shape) > _MOST_SHAPES:
                del self._by_shape[next(iter(self._by_shape))]
            return session


def open_session(path: Path, threads: int = 1, device: Device = "cpu") -> OnnxSession:
    """Load a model. FileNotFoundError when there is none, DetectorError when it cannot be used, there or at
    all."""
    if threads < 1:
        raise ValueError(f"threads is {threads}; allowed: 1 and more")
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file: no model there")
    import onnxruntime

    computed_by = providers(device)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = _FATAL_ONLY

    def open_one() -> onnxruntime.InferenceSession:
        # The runtime's fallback retries with the provider that has just failed, and prints that on stdout.
        return onnxruntime.InferenceSession(str(path), options, providers=computed_by, enable_fallback=0)

    try:
        session = open_one()
        inputs, outputs = _tensors(session.get_inputs()), _tensors(session.get_outputs())
        face = ModelFace(path, inputs, outputs, session.get_modelmeta().custom_metadata_map)
    except Exception as error:  # the runtime's exceptions have no base class of their own
        what = reason(error).removeprefix(f"Load model from {path} failed:")
        other = "" if path.suffix == ".onnx" else "; models of other kinds are exported to ONNX first"
        raise DetectorError(f"{path} cannot be loaded by ONNX Runtime: {what}{other}") from None
    check_runs_on(device, session.get_providers())
    return OnnxSession(session if device == "cpu" else SessionPerShape(open_one), face)


@contextmanager
def time_limit() -> Iterator[onnxruntime.RunOptions]:
    """Options for one run of a session, which ends with a TimeoutError after `TIME_LIMIT_S`. A model may loop
    without end: ONNX has loops. The runtime looks at its terminate flag before every node, inside loops too;
    a timer in a thread of its own sets it. One node that never ends cannot be ended so."""
    import onnxruntime

    seconds = float(os.environ.get(TIME_LIMIT_VARIABLE, TIME_LIMIT_S))
    options = onnxruntime.RunOptions()
    timer = Timer(seconds, lambda: setattr(options, "terminate", True))
    timer.daemon = True
    timer.start()
    try:
        yield options
    except Exception:
        if options.terminate:
            raise TimeoutError(f"the model did not end within {seconds:g} s") from None
        raise
    finally:
        timer.cancel()


def reason(error: Exception) -> str:
    """What the runtime says, without its codes and its own source lines, on one line."""
    text = str(error)
    if of_a_gpu := _GPU_FAILURE.search(text):
        return quoted(of_a_gpu[0], 300).strip("'\"")
    while text.startswith("[ONNXRuntimeError]"):
        text = text.split(" : ", 3)[-1]
    return quoted(_SOURCE_LINE.sub("", text, count=1), 300).strip("'\"")


def _tensors(arguments: Any) -> tuple[Tensor, ...]:
    return tuple(
        Tensor(argument.name, _dtype(argument.type), tuple(argument.shape or ())) for argument in arguments
    )


def _dtype(written: str) -> str:
    """ "tensor(float)" -> "float32"."""
    inner = written.removeprefix("tensor(").removesuffix(")")
    return _DTYPES.get(inner, inner)
