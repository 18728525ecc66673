"""An ONNX model opened by ONNX Runtime, one thread per stream; failures are a DetectorError of one line."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING, Any

from crowdfence.detector.contract.model_face import ModelFace, Tensor
from crowdfence.detector.execution_device import Device, check_runs_on, providers
from crowdfence.detector.session_per_shape import Runs, SessionPerShape
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
_WEIGHTS_BESIDE_IT = "session.model_external_initializers_file_folder_path"
_DTYPES = {"float": "float32", "double": "float64"}


@dataclass(frozen=True, slots=True)
class OnnxSession:
    session: Runs
    face: ModelFace


def open_session(path: Path, threads: int = 1, device: Device = "cpu") -> OnnxSession:
    """Load a model. FileNotFoundError when there is none, OSError when it cannot be read, DetectorError when
    it cannot be used, there or at all."""
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
    model: str | bytes = str(path)
    if device != "cpu":  # further sessions are of the same model, whatever stands in its place by then
        model = path.read_bytes()
        options.add_session_config_entry(_WEIGHTS_BESIDE_IT, str(path.parent))

    def open_one() -> onnxruntime.InferenceSession:
        # The runtime's fallback retries with the provider that has just failed, and prints that on stdout.
        return onnxruntime.InferenceSession(model, options, providers=computed_by, enable_fallback=0)

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
