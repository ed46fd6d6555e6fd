"""Preprocessing of uint8 frames for an encoder: background, size and normalisation, as data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import NEUTRAL_BACKGROUND
from tactileforge.errors import ConfigError, check_names, unknown

# means and deviations of red, green and blue, 0..1, in the training of CLIP (its repository,
# clip.py) and of ImageNet models (torchvision's weights)
CLIP_MEAN = (0.48145466, 0.4578275, 0.40821073)
CLIP_STD = (0.26862954, 0.26130258, 0.27577711)
IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)

#: AnyTouch 2: difference to the background, squashed to size, CLIP's mean and deviation.
ANYTOUCH2: dict[str, Any] = {
    "offset": 130,
    "fit": "squash",
    "filter": "bilinear",
    "mean": CLIP_MEAN,
    "std": CLIP_STD,
}
#: Sparsh: difference to the background in whole grey levels, upright, 4:3, no normalisation.
SPARSH: dict[str, Any] = {
    "offset": 127,
    "fit": "portrait",
    "filter": "bilinear",
    "mean": (0.0, 0.0, 0.0),
    "std": (1.0, 1.0, 1.0),
}
#: Frames as they are, squashed to size, grey levels / 255.
AS_THEY_ARE: dict[str, Any] = {
    "offset": None,
    "fit": "squash",
    "filter": "bilinear",
    "mean": (0.0, 0.0, 0.0),
    "std": (1.0, 1.0, 1.0),
}

#: Amplification of differences for a model of photographs.
DIFFERENCE_GAIN = 1.5

FITS = ("squash", "cover", "portrait", "pad", "letterbox")
FILTERS = ("bilinear", "bicubic")


class Preprocess(nn.Module):
    """Preprocessing of an encoder: uint8 frames of any size to normalised frames of its size.

    Ways to fit a frame to a size, all anti-aliased:

    - ``squash``: resized without keeping the aspect ratio;
    - ``cover``: shorter side resized to ``edge``, then cropped to the centre;
    - ``portrait``: a wide frame turned a quarter clockwise, cropped to the centre of the right
      aspect ratio, then resized (Sparsh);
    - ``pad``: padded to a square by black bars, turned a quarter anticlockwise, then resized (TVL);
    - ``letterbox``: padded to a square by black bars, then resized (FeelAnyForce).

    Args:
        size: Height and width of the result, pixels.
        offset: Grey level of a pixel without change from the background; None subtracts no
            background.
        fit: Way to fit a frame to ``size``: ``squash``, ``cover``, ``portrait``, ``pad`` or
            ``letterbox``.
        filter: Interpolation: ``bilinear`` or ``bicubic``.
        mean: Mean per channel, of values in [0, 1]; or one such row for each row of the sensor
            table.
        std: Standard deviation, in the form of ``mean``.
        edge: Length of the shorter side for ``cover``, pixels; None takes the longer side of
            ``size``.

    Raises:
        ConfigError: ``fit`` or ``filter`` is unknown, ``mean`` or ``std`` are not three finite
            numbers (per row), or ``edge`` is too small.
    """

    def __init__(
        self,
        size: tuple[int, int],
        offset: int | None,
        fit: str,
        filter: str,
        mean: Sequence[float] | Sequence[Sequence[float]],
        std: Sequence[float] | Sequence[Sequence[float]],
        edge: int | None = None,
    ) -> None:
        super().__init__()
        for what, name, known in (("fit", fit, FITS), ("filter", filter, FILTERS)):
            if name not in known:
                raise ConfigError(unknown(f"encoder.pixels.{what}", name, known))
        self.size = size
        self.offset = offset
        self.fit = fit
        self.filter = filter
        self.edge = max(size) if edge is None else edge
        if self.edge < max(size):
            raise ConfigError(f"encoder.pixels.edge is {edge}: it must be at least {max(size)}")
        for name, value in (("mean", mean), ("std", std)):
            rows = [list(x) if isinstance(x, Sequence) else x for x in value]
            if not np.isfinite(rows).all() or (name == "std" and np.min(rows) <= 0):
                raise ConfigError(f"encoder.pixels.{name}={rows}: give finite numbers, std above 0")
            numbers = torch.tensor(rows)
            if numbers.shape[-1:] != (3,) or numbers.ndim > 2:
                raise ConfigError(
                    f"encoder.pixels.{name} has shape {tuple(numbers.shape)}: give three numbers, "
                    "or three for each row of the sensor table"
                )
            # not in state dicts: they are options, which every file of weights has in its header
            self.register_buffer(name, numbers.float()[..., None, None], persistent=False)
        self.mean: Tensor
        self.std: Tensor

    @classmethod
    def of(cls, size: tuple[int, int], options: Mapping[str, Any]) -> Preprocess:
        """Builds it from a configuration node.

        Raises:
            ConfigError: An option is unknown or missing.
        """
        needed = set(ANYTOUCH2)
        check_names("option of encoder.pixels", options, needed | {"edge"})
        if missing := sorted(needed - set(options)):
            raise ConfigError(f"encoder.pixels lacks {', '.join(missing)}")
        return cls(size, **options)

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Preprocess:
        """Moves to a device but stays float32, as bfloat16 would round pixels too coarsely."""
        exact = self.mean, self.std
        super()._apply(fn, recurse)  # type: ignore[no-untyped-call]
        self.mean, self.std = (x.to(self.mean.device) for x in exact)
        return self

    def forward(self, frames: Tensor, background: Tensor, sensor: Tensor | None = None) -> Tensor:
        """Preprocesses frames to float32 (B, T, 3, height, width).

        Args:
            frames: uint8 (B, T, 3, H, W), any H and W.
            background: uint8 (B, 3, H, W).
            sensor: int64 (B,), rows of the sensor table; used if each row has its own mean.
        """
        x = self.resize(self.difference(frames, background))
        mean, std = self.mean, self.std
        if mean.ndim == 4 and sensor is not None:
            mean, std = mean[sensor][:, None], std[sensor][:, None]
        return x.sub_(mean).div_(std)  # in place: `difference` has made a tensor of its own

    def difference(self, frames: Tensor, background: Tensor) -> Tensor:
        """Subtracts the background, to values in [0, 1]; a neutral one changes nothing."""
        if self.offset is None:
            return _own(frames).div_(255)
        still = background[:, None].float()
        offset: int | Tensor = self.offset
        if offset != NEUTRAL_BACKGROUND:
            # a neutral background stands for none: with another offset frames would become darker
            neutral = (still == NEUTRAL_BACKGROUND).flatten(1).all(1).view(-1, 1, 1, 1, 1)
            offset = torch.where(neutral, NEUTRAL_BACKGROUND, offset)
        # one new tensor, and then in place: each further one would cost as much as the sum itself
        return _own(frames).sub_(still).add_(offset).clamp_(0, 255).div_(255)

    def resize(self, x: Tensor) -> Tensor:
        """Fits frames to the size: (B, T, 3, H, W) to (B, T, 3, height, width)."""
        size = self.size
        if self.fit in ("pad", "letterbox"):
            height, width = x.shape[-2:]
            side = max(height, width)
            bars = (side - width) // 2, (side - height) // 2
            x = F.pad(x, (bars[0], bars[0], bars[1], bars[1]))
            x = x.rot90(1, (-2, -1)) if self.fit == "pad" else x
        elif self.fit == "portrait":
            x = x.rot90(-1, (-2, -1)) if x.shape[-2] < x.shape[-1] else x
            height, width = x.shape[-2:]
            x = _centre(
                x, min(height, width * size[0] // size[1]), min(width, height * size[1] // size[0])
            )
        elif self.fit == "cover":
            height, width = x.shape[-2:]
            short = min(height, width)
            # the long side rounded down, as torchvision's Resize does
            size = (self.edge * height // short, self.edge * width // short)
        if x.shape[-2:] != size:
            flat = F.interpolate(x.flatten(0, 1), size, mode=self.filter, antialias=True)
            x = flat.view(*x.shape[:3], *size)
            x = x.clamp(0, 1) if self.filter == "bicubic" else x
        return _centre(x, *self.size) if self.fit == "cover" else x


def _own(frames: Tensor) -> Tensor:
    """A copy in float32, laid out alike whatever the layout given, as sums are then alike."""
    return frames.to(torch.float32, copy=True, memory_format=torch.contiguous_format)


def _centre(x: Tensor, height: int, width: int) -> Tensor:
    """Crops (..., H, W) to its centre."""
    # rounded as torchvision's CenterCrop does
    top, left = round((x.shape[-2] - height) / 2), round((x.shape[-1] - width) / 2)
    return x[..., top : top + height, left : left + width]


def difference_picture(
    frame: Tensor, background: Tensor, gain: float | Tensor = DIFFERENCE_GAIN
) -> Tensor:
    """Change from the background, as a picture for a model of photographs.

    Args:
        frame: Frame, uint8 (..., 3, H, W).
        background: Frame without contact, of the same shape.
        gain: Amplification of the difference.

    Returns:
        float (..., 3, H, W), about 127.5; not cut off at 0 and 255.
    """
    return 127.5 + gain * (frame.float() - background.float())
