"""Where ONNX Runtime computes a model: on the processor, or on a GPU by CUDA.

Never on the processor instead of a GPU that was asked for: ONNX Runtime would do that by itself, with a line
on stderr, and a fleet's pictures would then be late.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from contextlib import redirect_stdout
from io import StringIO
from typing import Any, Literal, get_args

from crowdfence.errors import DetectorError, quoted

Device = Literal["cpu", "cuda"]
DEVICES: tuple[Device, ...] = get_args(Device)

_PROVIDERS: dict[Device, list[tuple[str, dict[str, Any]]]] = {
    "cpu": [("CPUExecutionProvider", {})],
    "cuda": [
        (
            "CUDAExecutionProvider",
            {
                # As fast as what trying all of them finds, which is the default and takes a second for each
                # new shape of a picture.
                "cudnn_conv_algo_search": "HEURISTIC",
                # Products of 10 bits of mantissa would give other heatmaps than those that were calibrated.
                "use_tf32": 0,
            },
        ),
        ("CPUExecutionProvider", {}),  # for what CUDA has no kernel of, such as arithmetic of shapes
    ],
}
_INSTALL = "pip uninstall onnxruntime, then pip install 'onnxruntime-gpu[cuda,cudnn]'"
_ERRORS_ONLY = 3
_DRIVER = "libcuda.so.1"


def providers(device: Device) -> list[tuple[str, dict[str, Any]]]:
    """What a session is opened with. ValueError for a device of another name, DetectorError for a GPU that
    this machine or the installed ONNX Runtime does not have."""
    if device not in _PROVIDERS:
        raise ValueError(f"device is {quoted(device)}; allowed: {', '.join(DEVICES)}")
    if device == "cuda":
        _require_cuda()
    return _PROVIDERS[device]


def check_runs_on(device: Device, used: Sequence[str]) -> None:
    """DetectorError where a session uses other providers than it was opened for."""
    wanted = _PROVIDERS[device][0][0]
    if wanted not in used:
        raise DetectorError(
            f"device cuda: ONNX Runtime could not start it and would use {used[0]}; {_INSTALL}"
        )


def _require_cuda() -> None:
    """What goes wrong first on a machine that was not set up for it, in words that say what to do."""
    import onnxruntime

    name = f"ONNX Runtime {onnxruntime.__version__}"
    if "CUDAExecutionProvider" not in onnxruntime.get_available_providers():
        raise DetectorError(f"device cuda: the installed {name} is for processors alone; {_INSTALL}")
    try:
        ctypes.CDLL(_DRIVER)
    except OSError as error:
        raise DetectorError(f"device cuda: no driver of an NVIDIA GPU on this machine: {error}") from None
    # Convolutions that it plans in a roundabout way are told on stderr, one by one, for each picture.
    onnxruntime.set_default_logger_severity(_ERRORS_ONLY)
    with redirect_stdout(StringIO()) as printed:
        onnxruntime.preload_dlls()  # from the packages of CUDA, which no search path leads to
    missing = next((line for line in printed.getvalue().splitlines() if line.startswith("Failed")), None)
    if missing is not None:
        raise DetectorError(f"device cuda: {name} lacks a library of CUDA: {missing}; {_INSTALL}")
