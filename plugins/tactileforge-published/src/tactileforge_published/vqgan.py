"""The encoder of a VQGAN, up to its code book; UniT is a setting of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.encoders import AS_THEY_ARE, ConvBackbone

#: Groups and epsilon of a norm, as in the published VQGAN (Esser et al. 2021).
_GROUPS, _EPS = 32, 1e-6


class _Residual(nn.Module):
    """Two convolutions after norms and SiLU, beside a shortcut."""

    def __init__(self, given: int, out: int) -> None:
        super().__init__()
        self.norm1 = nn.GroupNorm(_GROUPS, given, _EPS)
        self.conv1 = nn.Conv2d(given, out, 3, padding=1)
        self.norm2 = nn.GroupNorm(_GROUPS, out, _EPS)
        self.conv2 = nn.Conv2d(out, out, 3, padding=1)
        self.nin_shortcut = nn.Conv2d(given, out, 1) if given != out else nn.Identity()

    def forward(self, x: Tensor) -> Tensor:
        """(n, given, h, w) to (n, out, h, w)."""
        y = self.conv1(F.silu(self.norm1(x)))
        y = self.conv2(F.silu(self.norm2(y)))
        out: Tensor = self.nin_shortcut(x) + y
        return out


class _Attention(nn.Module):
    """Attention of every place to all, with one head, beside a shortcut."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.GroupNorm(_GROUPS, width, _EPS)
        self.q, self.k, self.v, self.proj_out = (nn.Conv2d(width, width, 1) for _ in range(4))

    def forward(self, x: Tensor) -> Tensor:
        """(n, width, h, w) to the same."""
        y = self.norm(x)
        # with an axis for the one head, which ONNX needs
        query, key, value = (layer(y).flatten(2).mT[:, None] for layer in (self.q, self.k, self.v))
        seen = F.scaled_dot_product_attention(query, key, value)[:, 0].mT
        out: Tensor = x + self.proj_out(seen.reshape(x.shape))
        return out


class _Halved(nn.Module):
    """A convolution to half the size, padded at the right and at the bottom."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(width, width, 3, stride=2)

    def forward(self, x: Tensor) -> Tensor:
        """(n, width, h, w) to (n, width, h / 2, w / 2)."""
        # as in the published weights; padding=1 of the convolution would shift the map
        out: Tensor = self.conv(F.pad(x, (0, 1, 0, 1)))
        return out


class _Level(nn.Module):
    """Residual blocks of one size, each with attention or none, and a step to half the size."""

    def __init__(self, given: int, out: int, blocks: int, attends: bool, halved: bool) -> None:
        super().__init__()
        self.block = nn.ModuleList(_Residual(out if i else given, out) for i in range(blocks))
        self.attn = nn.ModuleList(_Attention(out) for _ in range(blocks * attends))
        self.downsample = _Halved(out) if halved else nn.Identity()

    def forward(self, x: Tensor) -> Tensor:
        """(n, given, h, w) to (n, out, h or h / 2, w or w / 2)."""
        for number, block in enumerate(self.block):
            x = block(x)
            x = self.attn[number](x) if self.attn else x
        out: Tensor = self.downsample(x)
        return out


class _Middle(nn.Module):
    """A block, attention and a block."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.block_1, self.attn_1 = _Residual(width, width), _Attention(width)
        self.block_2 = _Residual(width, width)

    def forward(self, x: Tensor) -> Tensor:
        """(n, width, h, w) to the same."""
        out: Tensor = self.block_2(self.attn_1(self.block_1(x)))
        return out


class VqganEncoder(ConvBackbone):
    """Encodes each frame of a clip to the map before the code book of a VQGAN.

    See `ConvBackbone` for tokens; the vector is their mean, and has as few numbers as a token. What
    was trained is the map: give a probe or a head all tokens.
    Sources: Esser et al. 2021 (VQGAN), and the layout of UniT's weights.

    Args:
        channels: Channels of each level, multiples of 32; each but the last halves the size.
        blocks: Number of blocks of a level.
        attention: Levels with attention, counted from 0.
        latent: Channels of the map.
        frames: Frames of a clip.
        image_size: Height and width of resized frames, pixels, or one number for both.
        sensors: Table of sensors, without effect on the features.
        mask_ratio: Share of spatial positions hidden in the masked view, the same in every slot.
        spacing: Seconds between the frames of a clip in training; 0 for one frame.
        pixels: Options of preprocessing, see `preprocess.Preprocess`.

    Attributes:
        width: Size of a token, ``latent``.
        prefix: Number of tokens before the patches, 0.
        grid: Numbers of temporal slots, rows and columns.

    Raises:
        ConfigError: The levels do not halve the size evenly.

    Example:
        >>> import torch
        >>> encoder = VqganEncoder([32, 32, 64], image_size=(32, 48)).eval()
        >>> frames = torch.zeros(1, 1, 3, 48, 48, dtype=torch.uint8)
        >>> tokens, vector = encoder(frames, frames[:, 0], encoder.sensor_ids(["digit"]))
        >>> tokens.shape, vector.shape
        (torch.Size([1, 96, 3]), torch.Size([1, 3]))
    """

    def __init__(
        self,
        channels: Sequence[int] = (128, 128, 256, 512),
        blocks: int = 2,
        attention: Sequence[int] = (3,),
        latent: int = 3,
        frames: int = 1,
        image_size: int | Sequence[int] = (128, 160),
        sensors: dict[str, int] | None = None,
        mask_ratio: float = 0.75,
        spacing: float = 0.0,
        pixels: Mapping[str, Any] = AS_THEY_ARE,
    ) -> None:
        last = len(channels) - 1
        super().__init__(latent, frames, image_size, 2**last, sensors, mask_ratio, spacing, pixels)
        self.projected = latent
        self.project = nn.Identity()
        self.conv_in = nn.Conv2d(3, channels[0], 3, padding=1)
        given = [channels[0], *channels]
        self.down = nn.ModuleList(
            _Level(given[i], out, blocks, i in attention, i < last)
            for i, out in enumerate(channels)
        )
        self.mid = _Middle(channels[-1])
        self.norm_out = nn.GroupNorm(_GROUPS, channels[-1], _EPS)
        self.conv_out = nn.Conv2d(channels[-1], latent, 3, padding=1)
        self.quant_conv = nn.Conv2d(latent, latent, 1)

    def map(self, pictures: Tensor) -> Tensor:
        """Map of pictures before it is looked up, (n, latent, rows, columns)."""
        x = self.conv_in(pictures)
        for level in self.down:
            x = level(x)
        out: Tensor = self.quant_conv(self.conv_out(F.silu(self.norm_out(self.mid(x)))))
        return out
