"""A small convolutional encoder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.encoders import ANYTOUCH2, Backbone, patches_at


class SmallCnn(Backbone):
    """Patches, then residual 3 x 3 convolutions over their grid, slot by slot.

    `Backbone` subtracts the background, resizes, cuts patches, masks and makes the views.

    Args:
        width: Channels, and the size of a token.
        layers: Number of residual convolutions.
        frames: Frames of a clip, a multiple of ``tube``.
        image_size: Height and width of the resized frames, or one number for both.
        patch: Rows and columns of a patch.
        tube: Frames of a patch.
        mask_ratio: Share of the positions hidden in the masked view.
        spacing: Time between the frames of a clip, s.
        sensors: Row of each sensor; a run fills it in. All sensors are encoded alike.
        pixels: Preprocessing, see `tactileforge.encoders.preprocess.Preprocess`.

    Attributes:
        serves: Names of its objectives; the conformance suite takes a training step with each.
    """

    serves = ("pixel", "diff", "align", "match", "force")
    prefix = 0

    def __init__(
        self,
        width: int = 96,
        layers: int = 4,
        frames: int = 4,
        image_size: int | Sequence[int] = 64,
        patch: int = 8,
        tube: int = 2,
        mask_ratio: float = 0.6,
        spacing: float = 1 / 15,
        sensors: dict[str, int] | None = None,
        pixels: Mapping[str, Any] = ANYTOUCH2,
    ) -> None:
        super().__init__(width, None, frames, spacing, image_size, patch, tube, mask_ratio, pixels)
        self.projected = width
        self.sensors = dict(sensors or {})
        self.embed = nn.Linear(3 * tube * patch * patch, width)
        self.hidden = nn.Parameter(torch.zeros(width))
        self.layers = nn.ModuleList(
            nn.Sequential(nn.GroupNorm(1, width), nn.Conv2d(width, width, 3, padding=1), nn.GELU())
            for _ in range(layers)
        )
        self.project = nn.Linear(width, width)

    def sensor_ids(self, sensor: Sequence[str]) -> Tensor:
        """Zeros, int64 (B,): all sensors are encoded alike."""
        return torch.zeros(len(sensor), dtype=torch.int64, device=self.hidden.device)

    def encode(
        self,
        patches: Tensor,
        sensor: Tensor,
        kept: Tensor | None = None,
        class_only: bool = False,
    ) -> Tensor:
        """Encodes the patches as tokens, one for each visible patch.

        Args:
            patches: float (B, slots, N, 3 * tube * patch * patch).
            sensor: int64 (B,), not used.
            kept: int64 (B, K), visible positions; None for all.
            class_only: Not used, as there is no class token.

        Returns:
            float (B, slots * (K or N), width).
        """
        slots, rows, columns = self.grid
        x = self.embed(patches)
        if kept is not None:  # convolutions see all positions: no hidden content may leak
            seen = torch.zeros(len(x), x.shape[2], dtype=torch.bool, device=x.device)
            seen = seen.scatter(1, kept, True)[:, None, :, None]
            x = torch.where(seen, x, self.hidden.to(x.dtype))
        maps = x.flatten(0, 1).transpose(1, 2).unflatten(2, (rows, columns))
        for layer in self.layers:
            maps = maps + layer(maps)
        x = maps.flatten(2).transpose(1, 2).unflatten(0, (-1, slots))
        return (x if kept is None else patches_at(x, kept)).flatten(1, 2)

    def pool_tokens(self, tokens: Tensor) -> Tensor:
        """The mean of the tokens, projected: (B, L, width) to (B, width)."""
        pooled: Tensor = self.project(tokens.mean(1))
        return pooled
