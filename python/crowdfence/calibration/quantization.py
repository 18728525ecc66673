"""A model whose convolutions compute with whole numbers of eight bits: twice as fast and more on a CPU, and a
quarter of the size.

Between the layers a value becomes one of 256 steps over the range that pictures of flights show. Weights
become one of 127 steps a channel, half of what eight bits hold, so that CPUs whose products saturate give
the same sums. The layer that sees the picture stays in floating point, and so does what follows the last
convolution.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path
from crowdfence.calibration.graph import write_contract
from crowdfence.calibration.rates_in_eight_bits import ARITHMETIC, in_eight_bits, with_own_rates
from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.contract.lookup import sidecar_path
from crowdfence.detector.inference.image_tensor import Image, InputTensor, patch_pixels
from crowdfence.detector.inference.patches import patches
from crowdfence.detector.model_check import ASSUMED_GSD_M
from crowdfence.errors import DetectorError, FrameError
from crowdfence.evaluation.labelled_missions import MeasurementPlan, mission_names, open_labelled
from crowdfence.sources.recording import Frame, RefusedFrame

if TYPE_CHECKING:
    from onnx import ModelProto

    from crowdfence.detector.detector import Detector

QUANTIZED = ("Conv", "Add", "Relu")
"""Operators that compute in eight bits; others pass such values on or turn them back."""
MIN_OPSET = 13
"""From here on DequantizeLinear has steps for each channel."""
PICTURES = 64
CALLED = 0.5
ALIKE = 0.8
"""Of the cells that either model calls crowd; where they agree on less the one in eight bits is another."""


@dataclass(frozen=True, slots=True)
class Quantization:
    """What became of the model; its heatmaps on pictures between those that the ranges were taken from."""

    pictures: int
    """From which the ranges were taken."""
    agreement: float
    """IoU of the cells that both call crowd at one half; nan where neither calls any."""
    mean_difference: float
    """Of the heatmaps' values."""
    cpu_ms: tuple[float, float]
    """CPU time of the first picture before and after, the least of several."""
    size_bytes: tuple[int, int]
    rates: dict[str, Any] | None
    """What its contract states of them: true_positive, false_positive, missions, arithmetic."""
    rates_not_measured: str | None
    """Why they are those in floating point, or none."""
    warnings: tuple[str, ...]
    """That it finds other crowds than before, and what is doubtful about rates that were measured anew, as of
    `calibrate_model`."""
    refused: tuple[str, ...]
    """Pictures that could not be used, and why."""


def quantize_model(
    detector: Detector,
    model: Path,
    data: Sequence[Path],
    output: Path,
    *,
    pictures: int = PICTURES,
    plan: MeasurementPlan | None = None,
    on_picture: Callable[[], None] = lambda: None,
) -> Quantization:
    """Write `model`, which `detector` has loaded, in eight bits to `output`, with its contract; atomically.

    The ranges come from `pictures` frames spread evenly over the recordings; as many others judge the result.
    Where the recordings are labelled missions with maps, the frames that `plan` looks at tell its rates.
    `on_picture` is called for each of all these.

    ModuleNotFoundError without the package onnx; DetectorError for a model in which no convolution can
    compute in eight bits, one that does so already, or of an operator set below 13; ValueError for recordings
    without a picture, or with a contract beside `output` that would hide the model's own.
    """
    from crowdfence.detector.detector import Detector

    if sidecar_path(output).exists():
        raise ValueError(f"{sidecar_path(output)} would hide the contract inside {output}: remove it first")
    unread: dict[str, None] = {}
    frames = _spread(data, 2 * pictures)
    ranges, judges = frames[::2], frames[1::2] or frames[:1]
    readable = [(frame, image.shape) for frame, image in _pictures(ranges, on_picture, unread)]
    used = len(readable)
    quantized = _quantized(model, _Reader(readable, detector.contract), in_eight_bits(detector.contract))
    why_not, warnings, refused = None, tuple[str, ...](), tuple[str, ...]()
    with atomic_path(output) as temporary:
        temporary.write_bytes(quantized.SerializeToString())
        after = Detector(temporary)
        agreement, mean_difference, cpu_ms = _judged(detector, after, judges, on_picture, unread)
        contract = after.contract
        try:
            measured = with_own_rates(after, data, plan or MeasurementPlan(), on_picture)
            contract, warnings, refused = measured
        except DetectorError:
            raise
        except ValueError as reason:
            why_not = str(reason)
        write_contract(quantized, contract.to_json())
        temporary.write_bytes(quantized.SerializeToString())
    told = ("true_positive", "false_positive", "missions", ARITHMETIC)
    return Quantization(
        used,
        agreement,
        mean_difference,
        cpu_ms,
        (model.stat().st_size, output.stat().st_size),
        contract.rates and {name: contract.rates[name] for name in told if name in contract.rates},
        why_not,
        (*_of_another_model(agreement), *warnings),
        tuple(dict.fromkeys([*unread, *refused])),
    )


class _Chosen(NamedTuple):
    """A frame with a picture, and the name of its mission."""

    mission: str
    frame: Frame


def _spread(data: Sequence[Path], count: int) -> list[_Chosen]:
    """Frames with pictures, evenly over each recording and as many of each."""
    each = -(-count // max(1, len(data)))
    chosen: list[_Chosen] = []
    for path, name in zip(data, mission_names(data), strict=True):
        frames = [frame for frame in open_labelled(path).frames if frame.pixels.image is not None]
        at = np.unique(np.linspace(0, len(frames) - 1, min(each, len(frames))).round().astype(np.intp))
        chosen += [_Chosen(name, frames[index]) for index in at]
    if not chosen:
        raise ValueError("the recordings hold no pictures to take the ranges of a model's layers from")
    return chosen


def _pictures(
    chosen: Sequence[_Chosen], on_picture: Callable[[], None], unread: dict[str, None]
) -> Iterator[tuple[Frame, Image]]:
    """Those that can be read; into `unread` why others cannot. ValueError where none can."""
    read, reason = 0, ""
    for mission, frame in chosen:
        try:
            yield frame, frame.image()
            read += 1
        except FrameError as error:
            reason = f"{mission}: {RefusedFrame(frame.drone, frame.stamp_ns, error.reason)}"
            unread[reason] = None
        finally:
            on_picture()
    if not read:
        raise ValueError(f"none of {len(chosen)} pictures can be read, the last: {reason}")


def _quantized(model: Path, pictures: _Reader, contract: Contract) -> ModelProto:
    import onnx
    from onnxruntime.quantization import CalibrationMethod, QuantFormat, QuantType, quantize_static
    from onnxruntime.quantization.shape_inference import quant_pre_process

    original = onnx.load(str(model))
    _require_floating_point(original)
    with TemporaryDirectory() as folder:
        prepared, written = Path(folder) / "prepared.onnx", Path(folder) / "quantized.onnx"
        # The tools of the runtime tell what they do on standard output.
        with redirect_stdout(io.StringIO()):
            quant_pre_process(str(model), str(prepared), skip_symbolic_shape=True)
            _name_nodes(prepared)
            quantize_static(
                str(prepared),
                str(written),
                pictures,
                quant_format=QuantFormat.QDQ,
                op_types_to_quantize=list(QUANTIZED),
                nodes_to_exclude=_kept_in_floating_point(onnx.load(str(prepared))),
                per_channel=True,
                reduce_range=True,
                activation_type=QuantType.QUInt8,
                weight_type=QuantType.QInt8,
                calibrate_method=CalibrationMethod.Percentile,
                extra_options={"CalibStridedMinMax": 1},  # inputs at a time, of any method
            )
        quantized = onnx.load(str(written))
    if not any(node.op_type == "QuantizeLinear" for node in quantized.graph.node):
        raise DetectorError(
            "between its first and its last convolution, which stay in floating point, the model has nothing "
            "that could compute in eight bits: convolutions of float32 with constant weights"
        )
    del quantized.metadata_props[:]
    quantized.metadata_props.extend(original.metadata_props)
    write_contract(quantized, contract.to_json())
    return quantized


class _Reader:
    """What the model is shown of each picture, in the form that the runtime asks for. It asks for one after
    the other: what it looks at together must have one size, and all that layers make of it is in memory. So
    are pictures, decoded when they are asked for."""

    def __init__(self, pictures: Sequence[tuple[Frame, tuple[int, ...]]], contract: Contract) -> None:
        """`pictures` with their shapes."""
        self._name, self._tensor = contract.input.name, InputTensor(contract.input)
        self._shown = [
            (frame, patch)
            for frame, (height, width, *_) in pictures
            for patch in patches(height, width, contract.input, contract.output.stride)
        ]
        self._decoded: tuple[Frame, Image] | None = None
        self.set_range(0, len(self))

    def __len__(self) -> int:
        return len(self._shown)

    def set_range(self, start_index: int, end_index: int) -> None:
        self._left = iter(self._shown[start_index:end_index])

    def get_next(self) -> dict[str, NDArray[np.generic]] | None:
        for frame, patch in self._left:
            if self._decoded is None or self._decoded[0] is not frame:
                self._decoded = frame, frame.image()
            return {self._name: self._tensor(patch_pixels(self._decoded[1], patch)[None])}
        return None


def _require_floating_point(model: ModelProto) -> None:
    """DetectorError for a model in eight bits, and for one of too old an operator set."""
    if any(node.op_type == "QuantizeLinear" for node in model.graph.node):
        raise DetectorError("the model computes in eight bits already: take the one in floating point")
    found = max((entry.version for entry in model.opset_import if entry.domain in ("", "ai.onnx")), default=0)
    if found < MIN_OPSET:
        raise DetectorError(
            f"the model's operator set is {found}; eight bits need {MIN_OPSET} or newer: export it again, or "
            f"turn it into that with onnx.version_converter.convert_version(model, {MIN_OPSET})"
        )


def _name_nodes(path: Path) -> None:
    """What stays in floating point is told to the runtime by name, and names are optional in ONNX."""
    import onnx

    model = onnx.load(str(path))
    for index, node in enumerate(model.graph.node):
        node.name = node.name or f"crowdfence_{node.op_type}_{index}"
    onnx.save_model(model, str(path))


def _kept_in_floating_point(model: ModelProto) -> list[str]:
    """Names of the first convolution, the last one and all that follows it."""
    nodes = list(model.graph.node)
    convolutions = [index for index, node in enumerate(nodes) if node.op_type == "Conv"]
    if not convolutions:
        raise DetectorError("the model has no convolutions that could compute in eight bits")
    return [nodes[convolutions[0]].name, *(node.name for node in nodes[convolutions[-1] :])]


def _judged(
    before: Detector,
    after: Detector,
    judges: Sequence[_Chosen],
    on_picture: Callable[[], None],
    unread: dict[str, None],
) -> tuple[float, float, tuple[float, float]]:
    """Agreement, mean difference and CPU times, as in `Quantization`."""
    both = either = cells = 0
    difference = 0.0
    cpu_ms = (np.inf, np.inf)
    gsd_m = ASSUMED_GSD_M if before.needs_gsd else None
    for _, image in _pictures(judges, on_picture, unread):
        maps = before(image, gsd_m, as_it_is=True), after(image, gsd_m, as_it_is=True)
        cpu_ms = (
            cpu_ms
            if np.isfinite(cpu_ms[0])
            else (_cpu_ms(before, image, gsd_m), _cpu_ms(after, image, gsd_m))
        )
        called = [values >= CALLED for values in maps]
        both += int((called[0] & called[1]).sum())
        either += int((called[0] | called[1]).sum())
        difference += float(np.abs(maps[0] - maps[1]).sum())
        cells += maps[0].size
    return both / either if either else np.nan, difference / max(cells, 1), cpu_ms


def _of_another_model(agreement: float) -> Iterator[str]:
    if agreement < ALIKE:  # False for NaN
        yield (
            "in eight bits it is another model: of the cells that either calls crowd both call "
            f"{agreement:.0%}. What was measured in floating point, such as its calibration, is not true of "
            "it; judge it (model evaluate) before it flies"
        )


def _cpu_ms(detector: Detector, image: Image, gsd_m: float | None, runs: int = 5) -> float:
    def once() -> float:
        start = process_time()
        detector(image, gsd_m, as_it_is=True)
        return 1e3 * (process_time() - start)

    return min(once() for _ in range(runs))
