"""The encoder ``pixels``: raw pixels as features, the least that an encoder has to beat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from tactileforge.encoders.backbone import Backbone, visible_patches
from tactileforge.encoders.positions import sincos_position_embedding
from tactileforge.encoders.preprocess import ANYTOUCH2


class PixelEncoder(Backbone):
    """Patches of the frames less their background, with fixed positions added; without weights.

    Args:
        frames: Frames of a clip; ``tube`` divides it.
        image_size: Height and width the frames are resized to, or one number for both.
        patch: Rows and columns of a patch.
        tube: Frames of a patch.
        spacing: Seconds between the frames of a clip.
        sensors: Sensors it is used with; all are treated alike.
        pixels: Preprocessing, see `preprocess.Preprocess`.

    Attributes:
        width: Size of a token: the numbers of a patch.
        prefix: 0.
        grid: Temporal slots, rows, columns.
    """

    prefix = 0
    #: It has no weights to train.
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
        """The patches themselves; see `Backbone.encode`."""
        seen, position = visible_patches(patches, self.position, kept)
        return (seen + position).flatten(1, 2)

    def pool_tokens(self, tokens: Tensor) -> Tensor:
        """Their mean: (B, L, width) to (B, width)."""
        return tokens.mean(1)
