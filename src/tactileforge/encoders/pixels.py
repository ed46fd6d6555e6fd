"""The encoder ``pixels``: raw pixels as features, the baseline for every encoder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from tactileforge.encoders.backbone import Backbone, visible_patches
from tactileforge.encoders.positions import sincos_position_embedding
from tactileforge.encoders.preprocess import ANYTOUCH2


class PixelEncoder(Backbone):
    """Patches of the frames minus their background, plus fixed positions; without weights.

    Args:
        frames: Frames of a clip; a multiple of ``tube``.
        image_size: Height and width of resized frames, pixels, or one number for both.
        patch: Rows and columns of a patch.
        tube: Frames of a patch.
        spacing: Seconds between the frames of a clip.
        sensors: Table of sensors, which has no effect on the features.
        pixels: Options of preprocessing, see `preprocess.Preprocess`.

    Attributes:
        width: Size of a token, 3 * tube * patch * patch.
        prefix: Number of tokens before the patches, 0.
        grid: Numbers of temporal slots, rows and columns.
    """

    prefix = 0
    #: Empty, as there are no weights to train.
    serves = ()

    def __init__(
        self,
        frames: int = 2,
        image_size: int | Sequence[int] = 64,
        patch: int = 8,
        tube: int = 2,
        spacing: float = 1 / 15,
        sensors: dict[str, int] | None = None,
        pixels: Mapping[str, Any] = ANYTOUCH2,
    ) -> None:
        super().__init__("tiny", None, frames, spacing, image_size, patch, tube, 0.0, pixels)
        self.width = self.projected = 3 * tube * patch * patch
        self.sensors = dict(sensors or {})
        self.project = torch.nn.Identity()
        place = sincos_position_embedding(self.grid, self.width)
        self.register_buffer("position", place, persistent=False)
        self.position: Tensor

    def sensor_ids(self, sensor: Sequence[str]) -> Tensor:
        """Zeros (B,): the sensor is not used."""
        return torch.zeros(len(sensor), dtype=torch.int64)

    def encode(
        self,
        patches: Tensor,
        sensor: Tensor,
        kept: Tensor | None = None,
        class_only: bool = False,
    ) -> Tensor:
        """Patches plus positions; see `Backbone.encode`."""
        seen, position = visible_patches(patches, self.position, kept)
        return (seen + position).flatten(1, 2)

    def pool_tokens(self, tokens: Tensor) -> Tensor:
        """Mean of the tokens: (B, L, width) to (B, width)."""
        return tokens.mean(1)
