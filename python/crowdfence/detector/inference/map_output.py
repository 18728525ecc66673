"""Output of a map model -> one value a cell: a probability, or people."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.contract.check import chosen_channel
from crowdfence.detector.contract.contract import Contract
from crowdfence.errors import DetectorError

ROUNDING = 1e-4
"""A probability may miss [0, 1] by this much, as float16 and interpolation do; it is then cut to it."""
_ADDED_UP = 1e-3
"""By which probabilities of some hundred classes in float16 may miss 1."""
_UNSURE = 0.1
"""Logits this near to each other are those of a network that says nothing."""

Map = NDArray[np.float32]


def map_values(raw: NDArray[np.generic], contract: Contract, model_shape: tuple[int, int]) -> Map:
    """Raw output -> [N, h, w] float32: P in [0, 1], or people per cell for kind "density".

    model_shape is height and width of the input. DetectorError for another shape than the contract's layout
    and stride give, for NaN and infinity, and for probabilities outside [0, 1].
    """
    output = contract.output
    channels = _channels_last(raw, contract, model_shape)
    if output.kind == "class_logits":
        _refuse_probabilities(_finite(channels, contract), contract)
        values = _softmax(channels, contract)
    else:
        values = channels[..., chosen_channel(contract, channels.shape[-1])]
        if output.kind == "logits":
            values = sigmoid(_finite(values, contract) / np.float32(contract.temperature))
        elif output.kind == "density":
            # Regressors miss zero by a little on both sides; fewer than nobody has no meaning.
            values = np.maximum(_finite(values, contract), 0.0) * np.float32(output.count_scale or 1.0)
        else:
            values = in_unit_range(values, f"output {output.name}")
    return np.asarray(values, np.float32)


def in_unit_range(values: NDArray[np.floating], what: str) -> NDArray[np.floating]:
    """The values, which must be finite and in [0, 1]; DetectorError names the first that is not."""
    low, high = values.min(), values.max()
    if low >= 0.0 and high <= 1.0:  # False for NaN
        return values
    if low >= -ROUNDING and high <= 1.0 + ROUNDING:
        return values.clip(0.0, 1.0)
    finite = np.isfinite(values)
    at = np.argwhere(~finite if not finite.all() else (values < 0.0) | (values > 1.0))[0]
    raise DetectorError(
        f"{what} holds {values[tuple(at)]} at {at.tolist()} (of {list(values.shape)}); allowed: "
        "probabilities in [0, 1]" + ("; are these kind 'logits'?" if finite.all() and low < 0.0 else "")
    )


def sigmoid(z: NDArray[np.floating]) -> NDArray[np.floating]:
    with np.errstate(over="ignore"):  # exp overflows to infinity, and 1 / infinity is the right 0
        return np.asarray(1.0 / (1.0 + np.exp(-z)))


def _refuse_probabilities(logits: NDArray[np.floating], contract: Contract) -> None:
    """A softmax of probabilities hardly leaves the middle: of 20 classes the surest crowd is 1/8. Those
    of a softmax add up to 1, those of a sigmoid for each class do not. No network is unsure of all classes
    all over a picture; one that gives one value everywhere sees nothing, which `SameAnswer` tells."""
    if logits.min() < 0.0 or logits.max() > 1.0 + ROUNDING:
        return
    add_up = np.abs(logits.sum(axis=-1) - 1.0).max() <= _ADDED_UP
    if add_up or np.ptp(logits) > _UNSURE:
        which = "those of a cell add up to 1" if add_up else "no logits do all over a picture"
        raise DetectorError(
            f"output {contract.output.name}: all values lie in [0, 1], and {which}: they are probabilities, "
            "no logits; is output.kind 'probability'?"
        )


def _softmax(logits: NDArray[np.floating], contract: Contract) -> NDArray[np.floating]:
    """P of the chosen class; temperature divides the logits."""
    chosen = chosen_channel(contract, logits.shape[-1])
    scaled = logits / np.float32(contract.temperature)
    weights = np.exp(scaled - scaled.max(axis=-1, keepdims=True))
    return np.asarray(weights[..., chosen] / weights.sum(axis=-1))


def _channels_last(
    raw: NDArray[np.generic], contract: Contract, model_shape: tuple[int, int]
) -> NDArray[np.floating]:
    """[N, h, w, C] as float32 or float64, a view where possible."""
    output = contract.output
    layout, stride = output.layout, output.stride
    if raw.ndim != len(layout):
        raise DetectorError(f"output {output.name} has shape {list(raw.shape)}; the contract says {layout}")
    side = {letter: raw.shape[index] for index, letter in enumerate(layout)}
    expected = tuple(-(-pixels // stride) for pixels in model_shape)
    if (side["H"], side["W"]) != expected or raw.size == 0:
        raise DetectorError(
            f"output {output.name} has {side['H']} x {side['W']} cells for an input of {model_shape[0]} x "
            f"{model_shape[1]} pixels; stride {stride} gives {expected[0]} x {expected[1]}"
        )
    values: NDArray[np.floating] = raw.astype(
        np.float64 if raw.dtype == np.float64 else np.float32, copy=False
    )
    if layout == "NCHW":
        return np.moveaxis(values, 1, -1)
    return np.asarray(values[..., None] if layout == "NHW" else values)


def _finite(values: NDArray[np.floating], contract: Contract) -> NDArray[np.floating]:
    if np.isfinite(values).all():
        return values
    at = np.argwhere(~np.isfinite(values))[0]
    raise DetectorError(
        f"output {contract.output.name} holds {values[tuple(at)]} at {at.tolist()} "
        f"(of {list(values.shape)}); allowed: finite numbers"
    )
