"""Base class of convolutional encoders: places of a map are their tokens."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from tactileforge.encoders.backbone import Backbone, patches_at
from tactileforge.encoders.tactile_vit import PUBLISHED_SENSORS


class ConvBackbone(Backbone):
    """Encodes each frame of a clip by a convolutional network, without regard to the sensor.

    A token is one place of its map, with all channels. Hidden patches are replaced by zeros, so
    that nothing of them reaches their neighbours. A subclass has parameters, and sets ``projected``
    and ``project``.

    Args:
        width: Channels of the map.
        frames: Frames of a clip.
        image_size: Height and width of resized frames, pixels, or one number for both.
        stride: Pixels of a frame for one place of the map.
        sensors: Table of sensors, without effect on the features.
        mask_ratio: Share of spatial positions hidden in the masked view, the same in every slot.
        spacing: Seconds between the frames of a clip in training; 0 for one frame.
        pixels: Options of preprocessing, see `preprocess.Preprocess`.

    Raises:
        ConfigError: ``stride`` does not divide the size.
    """

    prefix = 0

    def __init__(
        self,
        width: int,
        frames: int,
        image_size: int | Sequence[int],
        stride: int,
        sensors: dict[str, int] | None,
        mask_ratio: float,
        spacing: float,
        pixels: Mapping[str, Any],
    ) -> None:
        super().__init__(width, None, frames, spacing, image_size, stride, 1, mask_ratio, pixels)
        self.sensors = dict(dict.fromkeys(PUBLISHED_SENSORS, 0) if sensors is None else sensors)

    @abstractmethod
    def map(self, pictures: Tensor) -> Tensor:
        """Map of preprocessed pictures: (n, 3, height, width) to (n, width, rows, columns)."""

    def sensor_ids(self, sensor: Sequence[str]) -> Tensor:
        """Zeros (B,): the sensor is not used."""
        zeros = torch.zeros(len(sensor), dtype=torch.int64)
        return zeros.to(next(self.parameters()).device, non_blocking=True)

    def encode(
        self,
        patches: Tensor,
        sensor: Tensor,
        kept: Tensor | None = None,
        class_only: bool = False,
    ) -> Tensor:
        """Places of the map, (B, slots * (K or N), width); see `Backbone.encode`."""
        _, rows, columns = self.grid
        if kept is not None:
            shown = patches.new_zeros(len(patches), rows * columns).scatter(1, kept, 1.0)
            patches = patches * shown[:, None, :, None]
        # put together again: a convolution sees pictures, not patches
        x = patches.reshape(-1, rows, columns, 3, self.patch, self.patch)
        pictures = x.permute(0, 3, 1, 4, 2, 5).reshape(-1, 3, *self.image_size)
        places = self.map(pictures.to(next(self.parameters()).dtype)).flatten(2).mT
        places = places.view(-1, self.grid[0], *places.shape[1:])
        if kept is not None:
            places = patches_at(places, kept)
        return places.flatten(1, 2)

    def pool_tokens(self, tokens: Tensor) -> Tensor:
        """The mean of the tokens, projected: (B, L, width) to (B, projected)."""
        out: Tensor = self.project(tokens.mean(1))
        return out
