"""crowdnet-s: plain 3x3 convolutions with a U-shaped head, 0.70 M parameters, output at stride 4.

    3 -> 16 s2, residual x 2 | 24 s2, residual = p4 | 48 s2, residual x 2 = p8
    96 s2, residual x 3 with dilation 1, 2, 4 | + global mean
    48, up, + p8 | 24, up, + p4 | one logit per target

Plain convolutions run on every CPU, GPU and NPU runtime at full speed, where depthwise ones often do not. The
largest stride is 16, so 320x240, 640x480 and 1280x720 need no padding. People are a few pixels tall, so the
residuals at strides 2, 4 and 8 earn their time (`training/README.md`).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

MULTIPLE_OF = 16
"""Sides of the input must be multiples of this."""

RARE_LOGIT = -3.0
"""Where the output starts: most cells are empty."""


class ConvUnit(nn.Sequential):
    """3x3 convolution, batch normalisation, ReLU."""

    def __init__(self, inputs: int, outputs: int, *, stride: int = 1, dilation: int = 1) -> None:
        super().__init__(
            nn.Conv2d(inputs, outputs, 3, stride, dilation, dilation, bias=False),
            nn.BatchNorm2d(outputs),
            nn.ReLU(inplace=True),
        )


class Residual(nn.Module):
    """Two 3x3 convolutions beside an identity."""

    def __init__(self, channels: int, *, dilation: int = 1) -> None:
        super().__init__()
        self.first = ConvUnit(channels, channels, dilation=dilation)
        self.second = nn.Sequential(
            nn.Conv2d(channels, channels, 3, 1, dilation, dilation, bias=False), nn.BatchNorm2d(channels)
        )

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.second(self.first(x)))


class SceneProjection(nn.Module):
    """1x1 convolution [B, C, h, w] -> [B, out, h, w] of every cell plus what the mean of all cells says."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.scene, self.down = nn.Conv2d(inputs, inputs, 1), nn.Conv2d(inputs, outputs, 1)

    def forward(self, x: Tensor) -> Tensor:
        return self.down(x + self.scene(_mean(x)))


class FoldedScene(nn.Module):
    """The function of a `SceneProjection`, with the mean's two matrices multiplied into one."""

    def __init__(self, trained: SceneProjection) -> None:
        super().__init__()
        down, scene = trained.down, trained.scene
        assert down.bias is not None and scene.bias is not None, "both of a SceneProjection have a bias"
        matrix = down.weight.detach().flatten(1)
        self.down = nn.Conv2d(down.in_channels, down.out_channels, 1)
        self.scene = nn.Conv2d(down.in_channels, down.out_channels, 1, bias=False)
        with torch.no_grad():
            self.down.weight.copy_(down.weight)
            self.down.bias = nn.Parameter(down.bias + matrix @ scene.bias)
            self.scene.weight.copy_((matrix @ scene.weight.flatten(1))[:, :, None, None])

    def forward(self, x: Tensor) -> Tensor:
        return self.down(x) + self.scene(_mean(x))


class CrowdNet(nn.Module):
    """Images [B, 3, H, W] in [0, 1] -> logits [B, targets, H / 4, W / 4]; H and W are multiples of 16.

    `width` scales all channel counts: 1 is crowdnet-s, 0.5 crowdnet-xs.
    """

    def __init__(self, targets: int = 1, *, width: float = 1.0) -> None:
        super().__init__()
        self.width = width
        c2, c4, c8, c16 = (round(channels * width) for channels in (16, 24, 48, 96))
        self.to_p4 = nn.Sequential(
            ConvUnit(3, c2, stride=2), Residual(c2), Residual(c2), ConvUnit(c2, c4, stride=2), Residual(c4)
        )
        self.to_p8 = nn.Sequential(ConvUnit(c4, c8, stride=2), Residual(c8), Residual(c8))
        self.to_p16 = nn.Sequential(
            ConvUnit(c8, c16, stride=2), Residual(c16), Residual(c16, dilation=2), Residual(c16, dilation=4)
        )
        self.down_p16: SceneProjection | FoldedScene = SceneProjection(c16, c8)
        self.down_p8 = nn.Conv2d(c8, c4, 1)
        self.side_p8, self.side_p4 = nn.Conv2d(c8, c8, 1), nn.Conv2d(c4, c4, 1)
        self.merge_p8, self.merge_p4 = ConvUnit(c8, c8), ConvUnit(c4, c4)
        self.logit = nn.Conv2d(c4, targets, 1)
        nn.init.constant_(self.logit.bias, RARE_LOGIT)  # type: ignore[arg-type]

    def forward(self, image: Tensor) -> Tensor:
        p4 = self.to_p4(image * 2.0 - 1.0)
        p8 = self.to_p8(p4)
        p16 = self.down_p16(self.to_p16(p8))
        p8 = self.merge_p8(functional.relu(_doubled(p16) + self.side_p8(p8)))
        p4 = self.merge_p4(functional.relu(_doubled(self.down_p8(p8)) + self.side_p4(p4)))
        return self.logit(p4)

    def deployed(self, target: int) -> CrowdNet:
        """A copy on the CPU for use, not for training: one target, the scene folded, fewer parameters."""
        copy = CrowdNet(1, width=self.width)
        state = {name: value.detach().cpu() for name, value in self.state_dict().items()}
        for name in ("logit.weight", "logit.bias"):
            state[name] = state[name][target : target + 1]
        copy.load_state_dict(state)
        assert isinstance(copy.down_p16, SceneProjection), "only what is trained is deployed"
        copy.down_p16 = FoldedScene(copy.down_p16)
        return copy.eval()


def padded(image: Tensor) -> Tensor:
    """Images [B, 3, H, W] with the border repeated up to whole network cells, as a `Detector` shows them."""
    height, width = image.shape[2:]
    return functional.pad(image, (0, -width % MULTIPLE_OF, 0, -height % MULTIPLE_OF), mode="replicate")


def _mean(x: Tensor) -> Tensor:
    return x.mean(dim=(2, 3), keepdim=True)


def _doubled(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)
