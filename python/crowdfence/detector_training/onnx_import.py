"""An exported model -> the network that it came from, to train it further where no checkpoint was kept."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from crowdfence.detector_training.network import ConvUnit, CrowdNet, Residual

_PREFIX = "network."


def import_onnx(path: Path, targets: int, width: float) -> dict[str, Tensor]:
    """State of a `CrowdNet` of `targets` outputs, each of which says what the model at `path` says before
    its calibration.

    Batch normalisation, which the file holds folded into the convolutions, only adds a bias in evaluation;
    train on with `frozen_statistics` or after `measure_statistics`, or it would normalise what is normal
    already. ValueError for a file that `export_onnx` did not write, or of another width.
    """
    import onnx
    from onnx.numpy_helper import to_array

    try:
        graph = onnx.load(str(path)).graph
    except OSError:
        raise
    except Exception:  # of protobuf, which has several
        raise ValueError(f"{path} is no ONNX file") from None
    stored = {
        one.name.removeprefix(_PREFIX): torch.from_numpy(to_array(one).copy())
        for one in graph.initializer
        if one.name.startswith(_PREFIX)
    }
    network = CrowdNet(targets, width=width).eval()
    state = {name: value.clone() for name, value in network.state_dict().items()}
    try:
        for name in _normalised(network):
            convolution, norm = f"{name}.0", f"{name}.1"
            state[f"{convolution}.weight"] = stored.pop(f"{convolution}.weight")
            state[f"{norm}.bias"] = stored.pop(f"{convolution}.weight_bias")
            epsilon = network.get_submodule(norm).eps
            state[f"{norm}.running_var"].fill_(1.0 - float(epsilon))  # type: ignore[arg-type]
        for part in ("weight", "bias"):
            logit = stored.pop(f"logit.{part}")
            state[f"logit.{part}"] = logit.repeat(targets, *[1] * (logit.dim() - 1))
        down = stored.pop("down_p16.down.weight")
        # The exported mean's matrix is down @ scene; down has full rank, so one scene gives it back.
        folded = stored.pop("down_p16.scene.weight").flatten(1).double()
        scene = torch.linalg.pinv(down.flatten(1).double()) @ folded
        state["down_p16.down.weight"] = down
        state["down_p16.down.bias"] = stored.pop("down_p16.down.bias")
        state["down_p16.scene.weight"] = scene.float()[:, :, None, None]
        state["down_p16.scene.bias"].zero_()
        state.update(stored)
        network.load_state_dict(state)
    except (KeyError, RuntimeError) as error:
        raise ValueError(
            f"{path} is no model of `crowdfence train` of width {width:g} in floating point "
            f"({error}); give its own --width, and of a model in eight bits the one that it was made from"
        ) from None
    return state


def freeze_statistics(network: nn.Module) -> None:
    """Let batch normalisation use its stored statistics in training too."""
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()


def measure_statistics(network: nn.Module, images: Tensor) -> None:
    """Give batch normalisation the statistics of `images` [B, 3, H, W], and the scale and bias with which the
    network still says what it said: from there it can be trained on with statistics that follow its weights.
    """

    def measure(norm: nn.BatchNorm2d, inputs: tuple[Tensor, ...]) -> None:
        assert norm.running_mean is not None and norm.running_var is not None
        variance, mean = torch.var_mean(inputs[0].double(), dim=(0, 2, 3), correction=0)
        before = (norm.running_var.double() + norm.eps).sqrt()
        norm.bias.add_((norm.weight * (mean - norm.running_mean) / before).float())
        norm.weight.mul_(((variance + norm.eps).sqrt() / before).float())
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)

    hooks = [
        module.register_forward_pre_hook(measure)
        for module in network.modules()
        if isinstance(module, nn.BatchNorm2d)
    ]
    was_training = network.training
    try:
        with torch.no_grad():
            network.eval()(images)
    finally:
        network.train(was_training)
        for hook in hooks:
            hook.remove()


def _normalised(network: CrowdNet) -> list[str]:
    """Names of the pairs of a convolution and its batch normalisation."""
    names = [name for name, module in network.named_modules() if isinstance(module, ConvUnit)]
    residuals = [name for name, module in network.named_modules() if isinstance(module, Residual)]
    return names + [f"{name}.second" for name in residuals]
