"""Does a contract fit the graph that it is about? Everything that can be known before the first image."""

from __future__ import annotations

from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.contract.metadata_values import fixed
from crowdfence.detector.contract.model_face import ModelFace, Tensor
from crowdfence.detector.contract.model_output import PEOPLE_KINDS
from crowdfence.errors import DetectorError, quoted

_FLOATS = ("float32", "float16", "float64")


def check_contract(contract: Contract, face: ModelFace) -> None:
    """DetectorError names the model, the tensor as it is and as the contract has it."""
    try:
        _check_input(contract, face)
        _check_output(contract, face)
    except DetectorError as error:
        raise DetectorError(f"{face.path}: {error}") from None


def _check_input(contract: Contract, face: ModelFace) -> None:
    if len(face.inputs) != 1:
        names = quoted(", ".join(tensor.name for tensor in face.inputs))
        raise DetectorError(f"the model has {len(face.inputs)} inputs ({names}); allowed: 1, the image")
    tensor, wanted = face.inputs[0], contract.input
    _check_name("input", wanted.name, (tensor,))
    if tensor.dtype != wanted.dtype:
        raise DetectorError(f"the input is {tensor}; the contract says {wanted.dtype}")
    if len(tensor.shape) != 4:
        raise DetectorError(f"the input is {tensor}; allowed: 4 dimensions, {wanted.layout}")
    at = {letter: tensor.shape[index] for index, letter in enumerate(wanted.layout)}
    if fixed(at["C"]) not in (None, 3):
        raise DetectorError(
            f"the input is {tensor}: {at['C']} channels in {wanted.layout}; allowed: 3 ({wanted.color})"
        )
    if fixed(at["N"]) not in (None, 1):
        raise DetectorError(f"the input is {tensor}: {at['N']} images at once; allowed: 1 or any number")
    for letter, index, what in (("W", 0, "wide"), ("H", 1, "high")):
        pixels = fixed(at[letter])
        if pixels is not None and (wanted.size is None or wanted.size[index] != pixels):
            said = "null" if wanted.size is None else list(wanted.size)
            raise DetectorError(
                f"the input is {tensor}, {pixels} pixels {what}; the contract's input.size is {said}"
            )


def _check_output(contract: Contract, face: ModelFace) -> None:
    wanted = contract.output
    tensor = _check_name("output", wanted.name, face.outputs)
    if tensor.dtype not in _FLOATS:
        raise DetectorError(f"the output is {tensor}; allowed: {', '.join(_FLOATS)}")
    if tensor.shape and len(tensor.shape) != len(wanted.layout):
        raise DetectorError(f"the output is {tensor}; the contract says {wanted.layout}")
    if tensor.shape and wanted.kind not in PEOPLE_KINDS and "C" in wanted.layout:
        channels = fixed(tensor.shape[wanted.layout.index("C")])
        if channels is not None:
            chosen_channel(contract, channels)


def chosen_channel(contract: Contract, channels: int) -> int:
    """The channel of a map that is crowd; DetectorError where the contract says none, or one too high."""
    output = contract.output
    if output.kind == "class_logits" and channels == 1:
        raise DetectorError(
            f"output {output.name} has 1 channel: class_logits need 2 and more; one channel is kind 'logits'"
        )
    index = output.classes[0] if output.classes else None
    if index is None and channels == 1:
        return 0
    if index is None and output.kind == "class_logits" and channels == 2:
        return 1  # background, crowd: the one order in use
    if index is None or index >= channels:
        raise DetectorError(
            f"output.class_index is {'missing' if index is None else index} and output {output.name} has "
            f"{channels} channels; allowed: 0 to {channels - 1}"
        )
    return index


def _check_name(role: str, name: str, tensors: tuple[Tensor, ...]) -> Tensor:
    for tensor in tensors:
        if tensor.name == name:
            return tensor
    names = quoted(", ".join(tensor.name for tensor in tensors))
    raise DetectorError(f"the contract's {role}.name is {quoted(name)}; the model has {names}")
