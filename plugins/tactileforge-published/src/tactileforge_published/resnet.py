"""ResNet-18 on single frames, for published weights; UniVTAC's encoder is a setting of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.encoders import AS_THEY_ARE, ConvBackbone

_WIDTH = 512
_STRIDE = 32  # pixels of a frame for one place of the last map
#: Channels of the four stages; all but the first halve the map.
_STAGES = (64, 128, 256, _WIDTH)
_BLOCKS = 2  # of a stage


class FixedNorm(nn.Module):
    """A batch norm with the statistics of its weights, in training too.

    Small batches of one sensor then do not shift what the weights know.

    Args:
        channels: Number of channels.
        eps: Added to the variance.
    """

    running_mean: Tensor
    running_var: Tensor

    def __init__(self, channels: int, eps: float = 1e-5) -> None:
        super().__init__()
        self.eps = eps
        self.weight = nn.Parameter(torch.ones(channels))
        self.bias = nn.Parameter(torch.zeros(channels))
        self.register_buffer("running_mean", torch.zeros(channels))
        self.register_buffer("running_var", torch.ones(channels))

    def forward(self, x: Tensor) -> Tensor:
        """Normalises (B, channels, h, w)."""
        scale = self.weight * torch.rsqrt(self.running_var + self.eps)
        shift = self.bias - self.running_mean * scale
        return x * scale[:, None, None] + shift[:, None, None]


class _Block(nn.Module):
    """Two convolutions beside a shortcut (He et al. 2016)."""

    def __init__(self, given: int, out: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(given, out, 3, stride, 1, bias=False)
        self.bn1 = FixedNorm(out)
        self.conv2 = nn.Conv2d(out, out, 3, 1, 1, bias=False)
        self.bn2 = FixedNorm(out)
        self.downsample: nn.Module = nn.Identity()
        if stride > 1:
            self.downsample = nn.Sequential(
                nn.Conv2d(given, out, 1, stride, bias=False), FixedNorm(out)
            )

    def forward(self, x: Tensor) -> Tensor:
        """(B, given, h, w) to (B, out, h / stride, w / stride)."""
        y = torch.relu(self.bn1(self.conv1(x)))
        out: Tensor = torch.relu(self.bn2(self.conv2(y)) + self.downsample(x))
        return out


class ResNet18(ConvBackbone):
    """Encodes each frame of a clip to the places of the last map of a ResNet-18.

    See `ConvBackbone` for tokens; the vector is a linear layer on their mean. Norms keep the
    statistics of their weights, so the network serves to use and to refine published weights rather
    than to train from random ones.
    Sources: He et al. 2016, and the layout of UniVTAC's weights.

    Args:
        frames: Frames of a clip.
        image_size: Height and width of resized frames, multiples of 32 pixels, or one number.
        projected: Width of the vector.
        sensors: Table of sensors, without effect on the features.
        mask_ratio: Share of spatial positions hidden in the masked view, the same in every slot.
        spacing: Seconds between the frames of a clip in training; 0 for one frame.
        pixels: Options of preprocessing, see `preprocess.Preprocess`.

    Attributes:
        width: Size of a token, 512.
        prefix: Number of tokens before the patches, 0.
        grid: Numbers of temporal slots, rows and columns.

    Raises:
        ConfigError: 32 does not divide the size.

    Example:
        >>> encoder = ResNet18(image_size=64).eval()
        >>> frames = torch.zeros(1, 1, 3, 48, 48, dtype=torch.uint8)
        >>> tokens, vector = encoder(frames, frames[:, 0], encoder.sensor_ids(["digit"]))
        >>> tokens.shape, vector.shape
        (torch.Size([1, 4, 512]), torch.Size([1, 512]))
    """

    def __init__(
        self,
        frames: int = 1,
        image_size: int | Sequence[int] = 256,
        projected: int = 512,
        sensors: dict[str, int] | None = None,
        mask_ratio: float = 0.75,
        spacing: float = 0.0,
        pixels: Mapping[str, Any] = AS_THEY_ARE,
    ) -> None:
        super().__init__(_WIDTH, frames, image_size, _STRIDE, sensors, mask_ratio, spacing, pixels)
        self.projected = projected
        self.conv1 = nn.Conv2d(3, _STAGES[0], 7, 2, 3, bias=False)
        self.bn1 = FixedNorm(_STAGES[0])
        self.pool = nn.MaxPool2d(3, 2, 1)
        given = _STAGES[0]
        stages = []
        for number, out in enumerate(_STAGES):
            first = _Block(given, out, 2 if number else 1)
            stages.append(nn.Sequential(first, *(_Block(out, out, 1) for _ in range(1, _BLOCKS))))
            given = out
        self.stages = nn.ModuleList(stages)
        self.project = nn.Linear(_WIDTH, projected)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                # as in torchvision's ResNet
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def map(self, pictures: Tensor) -> Tensor:
        """Last map of pictures (n, 3, height, width), (n, 512, height / 32, width / 32)."""
        x: Tensor = self.pool(torch.relu(self.bn1(self.conv1(pictures))))
        for stage in self.stages:
            x = stage(x)
        return x
