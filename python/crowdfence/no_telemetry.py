"""Nothing is sent that nobody asked for.

ONNX Runtime, which runs the models, reports its use over the network since 1.29, on Linux too: names and
hashes of models, and a number that it keeps for the machine. A computer of a fleet may have no network at
all, and what it looks at is nobody's business.
"""

from __future__ import annotations

import os

ONNX_RUNTIME_VARIABLE = "ORT_DISABLE_TELEMETRY"
"""Read once, when ONNX Runtime is loaded. Its function `disable_telemetry_events` comes too late: by then the
number is on disk and a first message in the queue."""


def refuse_telemetry() -> None:
    """For this process and those that it starts. A variable that is set stays as it is: somebody decided."""
    os.environ.setdefault(ONNX_RUNTIME_VARIABLE, "1")
