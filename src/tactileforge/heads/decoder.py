"""The decoder of masked tubes, used by pixel, diff and jepa, each with its own weights."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from tactileforge.contracts import Encoder, MaskedFeatures
from tactileforge.encoders.backbone import patches_at
from tactileforge.encoders.positions import sincos_grid
from tactileforge.encoders.relative import Relative, RelativeBias
from tactileforge.encoders.transformer import Transformer, init_weights
from tactileforge.errors import ConfigError


@dataclass(frozen=True)
class Reconstruction:
    """Predicted and true masked tubes, frame by frame.

    Attributes:
        predicted: float (B, M, n, 3 * patch * patch), prediction of n frames.
        target: True values, of the same shape.
        masked: int64 (B, M), spatial positions of the tubes.
        unit: float (B, M, n, 1), divisor of errors; None for 1.
    """

    predicted: Tensor
    target: Tensor
    masked: Tensor
    unit: Tensor | None = None

    @property
    def loss(self) -> Tensor:
        """Squared error, averaged over frames, masked tubes and pixels."""
        error = self.predicted - self.target
        return (error if self.unit is None else error / self.unit).square().mean()


def check_moving(encoder: Encoder, head: str) -> None:
    """Refuses an encoder of one frame, for heads on frames 2..T.

    Raises:
        ConfigError: The encoder has less than two frames.
    """
    if encoder.frames < 2:
        raise ConfigError(f"head.{head} reads frames 2 and later: give encoder.frames of 2 or more")


class MaskedDecoder(nn.Module):
    """Decodes visible tokens and mask tokens to the pixels, or features, of the masked tubes.

    A token's position is given by fixed sines and cosines of its slot, row and column. (Positions
    of row and column alone would make the two slots of a masked tube the same.) Only masked tokens
    are predicted. Attention without a bias does not depend on the order of tokens, so visible ones
    come first and the last block computes only the mask tokens behind them; a bias by offset needs
    tokens in the order of their positions.

    Args:
        encoder: Encoder of the masked view.
        width: Width of the decoder.
        depth: Number of blocks.
        heads: Number of attention heads.
        out: Number of predicted values per masked patch; None for its pixels.
        relative: Bias of attention by offset, see `RelativeBias`; with ``neighbours`` and four
            heads or more, filling in from the neighbours is learned much sooner.
        norm: Whether there is a norm before the last linear layer; without one, a patch twice as
            bright is predicted twice as bright, even before training.

    Raises:
        ConfigError: ``encoder.mask_ratio`` masks nothing.
    """

    def __init__(
        self,
        encoder: Encoder,
        width: int,
        depth: int,
        heads: int,
        out: int | None = None,
        relative: Relative = "none",
        norm: bool = True,
    ) -> None:
        super().__init__()
        # an encoder of a plugin may have another mask: half is what most have
        places, ratio = encoder.grid[1] * encoder.grid[2], getattr(encoder, "mask_ratio", 0.5)
        if round(places * (1 - ratio)) >= places:
            raise ConfigError(
                f"encoder.mask_ratio={ratio} hides none of {places} places, and pixel, diff and "
                "jepa predict what is hidden; give more"
            )
        self.tube = encoder.tube
        self.relative = RelativeBias.of(relative, heads, encoder.grid, encoder.prefix)
        self.embed = nn.Linear(encoder.projected, width)
        self.mask_token = nn.Parameter(torch.empty(width))
        self.transformer = Transformer(width, depth, heads)
        self.norm = nn.LayerNorm(width) if norm else nn.Identity()
        self.predict = nn.Linear(width, out or 3 * encoder.tube * encoder.patch**2)
        # not in checkpoints: it is computed from the sizes
        self.register_buffer("position", sincos_grid(encoder.grid, width), persistent=False)
        self.position: Tensor
        self.apply(init_weights)
        # after apply(), which sets its own; a small last layer starts near the mean of the pixels
        nn.init.normal_(self.mask_token, std=0.02)
        nn.init.normal_(self.predict.weight, std=0.02)

    def forward(self, features: MaskedFeatures) -> Tensor:
        """Decodes the masked view to float (B, slots, M, out)."""
        x = self.embed(features.tokens)
        prefix, visible = x.split([features.prefix, x.shape[1] - features.prefix], dim=1)
        visible = visible.unflatten(1, (features.grid[0], -1))
        decode = self._by_visibility if self.relative is None else self._by_place
        out: Tensor = self.predict(self.norm(decode(prefix, visible, features)))
        return out

    def _by_visibility(self, prefix: Tensor, visible: Tensor, features: MaskedFeatures) -> Tensor:
        """Masked tokens (B, slots, M, width), from visible tokens followed by mask tokens."""
        place = self.position.flatten(1, 2)
        seen = visible + place[:, features.kept].transpose(0, 1)
        blank = self.mask_token.to(visible.dtype) + place[:, features.masked].transpose(0, 1)
        x = torch.cat([prefix, seen.flatten(1, 2), blank.flatten(1, 2)], dim=1)
        count = blank.shape[1] * blank.shape[2]
        # mask tokens are last, and only they are predicted from: the last block computes no others
        hidden: Tensor = self.transformer(x, only=slice(x.shape[1] - count, None))
        return hidden.reshape(len(x), len(place), -1, x.shape[-1])

    def _by_place(self, prefix: Tensor, visible: Tensor, features: MaskedFeatures) -> Tensor:
        """Masked tokens (B, slots, M, width), from all tokens in the order of their positions."""
        assert self.relative is not None
        tokens = self._placed(visible, features) + self.position.flatten(1, 2)
        x = torch.cat([prefix, tokens.flatten(1, 2)], dim=1)
        x = self.transformer(x, self.relative())[:, features.prefix :]
        return masked_patches(x.unflatten(1, (visible.shape[1], -1)), features)

    def _placed(self, visible: Tensor, features: MaskedFeatures) -> Tensor:
        """Puts visible tokens (B, slots, K, width) and mask tokens in order: (..., N, ...)."""
        batch, slots, _, width = visible.shape
        count = features.kept.shape[1] + features.masked.shape[1]
        # mask tokens everywhere, then the visible tokens at their places
        blank = self.mask_token.to(visible.dtype).expand(batch, slots, count, width)
        index = features.kept[:, None, :, None].expand(-1, slots, -1, width)
        return blank.scatter(2, index, visible)

    def frames(self, patches: Tensor) -> Tensor:
        """Splits tubes into frames: (B, slots, M, 3 * tube * P) to (B, M, slots * tube, 3 * P)."""
        batch, slots, count, size = patches.shape
        x = patches.reshape(batch, slots, count, 3, self.tube, size // (3 * self.tube))
        return x.permute(0, 2, 1, 4, 3, 5).flatten(4).flatten(2, 3)


def masked_patches(patches: Tensor, features: MaskedFeatures) -> Tensor:
    """Selects patches or tokens (B, slots, N, P) at the masked positions: (B, slots, M, P)."""
    return patches_at(patches, features.masked)
