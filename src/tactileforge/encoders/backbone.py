"""Base class of touch encoders: input, sensor ids, tube masking and the views of a batch."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch, Features, MaskedFeatures
from tactileforge.encoders.preprocess import Preprocess
from tactileforge.encoders.transformer import size_preset
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.util.distributed import rand_rows


class Backbone(nn.Module):
    """Base class of touch encoders without a network: preprocessing, patches, views.

    A subclass sets ``prefix``, ``projected``, ``project`` and ``universal``, and implements
    `sensor_ids`, `encode` and `pool_tokens`.

    Args:
        size: A key of `transformer.SIZES`; or the width of a token, for other networks.
        depth: Number of blocks; None takes the size's.
        frames: Frames of a clip; a multiple of ``tube``.
        spacing: Seconds between the frames of a clip in training; 0 for one frame.
        image_size: Height and width of resized frames, pixels, or one number for both.
        patch: Rows and columns of a patch.
        tube: Frames of a patch.
        mask_ratio: Share of spatial positions hidden in the masked view, the same in every slot.
        pixels: Options of preprocessing, see `Preprocess`.

    Attributes:
        width: Size of a token.
        prefix: Number of tokens before the patches.
        grid: Numbers of temporal slots, rows and columns.
        universal: Row of the universal sensor; None for an encoder without one.
        pools_class_token: Whether `pool_tokens` reads only the class token and `encode` supports
            ``class_only``.
        static_graph: Whether every batch uses the same parameters (`PhasedDDP`).

    Raises:
        ConfigError: Tubes do not divide the sizes, or the mask hides everything.
    """

    modality = "touch"
    prefix: int
    projected: int
    project: nn.Module
    sensors: dict[str, int]
    universal: int | None = None
    pools_class_token = False
    #: Whether all steps of a phase use the same parameters, see `strategies.PhasedDDP`.
    static_graph = True

    def __init__(
        self,
        size: str | int,
        depth: int | None,
        frames: int,
        spacing: float,
        image_size: int | Sequence[int],
        patch: int,
        tube: int,
        mask_ratio: float,
        pixels: Mapping[str, Any],
    ) -> None:
        super().__init__()
        height, width = (image_size, image_size) if isinstance(image_size, int) else image_size
        if min(frames, tube, patch, height, width) < 1:
            raise ConfigError(
                f"encoder: frames={frames}, tube={tube}, patch={patch}, image_size={height} x "
                f"{width}; give 1 or more of each"
            )
        if frames % tube or height % patch or width % patch:
            raise ConfigError(
                f"encoder: tubes of {tube} frames and {patch} pixels do not divide "
                f"{frames} frames of {height} x {width}; change frames, image_size, tube or patch"
            )
        if not 0 <= mask_ratio < 1:
            raise ConfigError(f"encoder: mask_ratio is {mask_ratio}; it must be in [0, 1)")
        self.width, blocks, self.heads = (
            (size, 0, 0) if isinstance(size, int) else size_preset(size)
        )
        self.depth = blocks if depth is None else depth
        self.frames = frames
        self.spacing = spacing
        self.image_size = (height, width)
        self.patch = patch
        self.tube = tube
        self.mask_ratio = mask_ratio
        self.grid = (frames // tube, height // patch, width // patch)
        self.pixels = Preprocess.of(self.image_size, pixels)

    @abstractmethod
    def sensor_ids(self, sensor: Sequence[str]) -> Tensor:
        """Rows of the sensor table, int64 (B,)."""

    @abstractmethod
    def encode(
        self,
        patches: Tensor,
        sensor: Tensor,
        kept: Tensor | None = None,
        class_only: bool = False,
    ) -> Tensor:
        """The last hidden state.

        Args:
            patches: float (B, slots, N, P).
            sensor: int64 (B,), rows of the sensor table.
            kept: int64 (B, K), spatial positions to embed; None embeds all.
            class_only: Whether only the class token is needed; the last block then computes no
                other token.

        Returns:
            float (B, prefix + slots * (K or N), width), or (B, 1, width).
        """

    def encode_both(self, patches: Tensor, sensor: Tensor, kept: Tensor) -> tuple[Tensor, Tensor]:
        """Last hidden states of all patches and of the visible ones; arguments as of `encode`.

        A network whose layers work on single tokens computes both in one pass.
        """
        return self.encode(patches, sensor), self.encode(patches, sensor, kept)

    @abstractmethod
    def pool_tokens(self, tokens: Tensor) -> Tensor:
        """The projected class token or its substitute: (B, L, width) to (B, projected)."""

    def preprocess(
        self, frames: Tensor, background: Tensor, sensor: Tensor | None = None
    ) -> Tensor:
        """Normalises frames to float32 (B, T, 3, height, width); see `Preprocess`."""
        out: Tensor = self.pixels(frames, background, sensor)
        return out

    def patchify(self, x: Tensor) -> Tensor:
        """Cuts (B, T, 3, height, width) into (B, slots, N, 3 * tube * patch * patch)."""
        slots, rows, columns = self.grid
        x = x.reshape(len(x), slots, self.tube, 3, rows, self.patch, columns, self.patch)
        # colour before time within a patch, as the weights of a Conv3d are flattened
        x = x.permute(0, 1, 4, 6, 3, 2, 5, 7)
        return x.flatten(4).flatten(2, 3)

    def forward(self, frames: Tensor, background: Tensor, sensor: Tensor) -> tuple[Tensor, Tensor]:
        """Computes tokens (B, L, width), and projected class tokens (B, projected).

        Args:
            frames: uint8 (B, T, 3, H, W), RGB, oldest first.
            background: uint8 (B, 3, H, W).
            sensor: int64 (B,), rows of the sensor table, see `sensor_ids`.
        """
        tokens = self.encode(self.patchify(self.preprocess(frames, background, sensor)), sensor)
        return tokens, self.pool_tokens(tokens)

    def class_tokens(
        self, frames: Tensor, background: Tensor, sensor: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Computes the first token (B, width), and projected class tokens (B, projected).

        The values are those of `forward`, in less time if only the class token is projected. For
        inference: hooks on the encoder itself are not called.

        Args:
            frames: uint8 (B, T, 3, H, W), RGB, oldest first.
            background: uint8 (B, 3, H, W).
            sensor: int64 (B,), rows of the sensor table.
        """
        patches = self.patchify(self.preprocess(frames, background, sensor))
        if self.pools_class_token:
            tokens = self.encode(patches, sensor, class_only=True)
        else:
            tokens = self.encode(patches, sensor)
        return tokens[:, 0], self.pool_tokens(tokens)

    def views(self, batch: Batch, universal: float = 0.0) -> TactileViews:
        """Starts the views of a batch; see `contracts.Encoder.views`."""
        return TactileViews(self, batch, universal)


class TactileViews:
    """The views of one batch, each computed once, on first use.

    Random choices (the visible tubes, the samples with universal sensor tokens) are drawn in the
    constructor, so they do not depend on the order in which views are used.

    Args:
        encoder: Encoder of the views.
        batch: Batch of touch, see `tactileforge.contracts`.
        universal: Chance of the universal sensor tokens, 0 to 1, if the encoder has them.
        kept: int64 (B, K), spatial positions of the masked view; None draws them.
    """

    def __init__(
        self, encoder: Backbone, batch: Batch, universal: float, kept: Tensor | None = None
    ) -> None:
        self.encoder = encoder
        self.batch = batch
        self.chance = universal
        frames = batch["frames"]
        _, rows, columns = encoder.grid
        count = rows * columns
        self.keep = max(1, round(count * (1 - encoder.mask_ratio)))  # attention over none is NaN
        # one draw for masks and sensors, in the constructor: see above
        noise = rand_rows(len(frames), count + 1, device=frames.device)
        if kept is not None:
            noise[:, :count].scatter_(1, _places(kept, len(frames), count), -1.0)
            self.keep = kept.shape[1]
        self.order = noise[:, :count].argsort(dim=1)
        self.sensor = encoder.sensor_ids(batch["sensor"])
        if encoder.universal is not None:
            # some samples are shown without their sensor: these tokens learn to serve unknown ones
            self.sensor = torch.where(noise[:, count] < universal, encoder.universal, self.sensor)

    @cached_property
    def patches(self) -> Tensor:
        """Patches of the normalised frames, float (B, slots, N, P)."""
        batch = self.batch
        pixels = self.encoder.preprocess(batch["frames"], batch["background"], self.sensor)
        return self.encoder.patchify(pixels)

    @cached_property
    def kept(self) -> Tensor:
        """Spatial positions of the masked view, int64 (B, K)."""
        # in the order of their places, as tokens come without a mask
        return self.order[:, : self.keep].sort(dim=1).values

    @cached_property
    def full(self) -> Features:
        """Features with every patch visible."""
        return self._full(self.encoder.encode(self.patches, self.sensor))

    @cached_property
    def masked(self) -> MaskedFeatures:
        """Features of visible tubes: ``mask_ratio`` of the positions are hidden in every slot."""
        return self._masked(self.encoder.encode(self.patches, self.sensor, self.kept))

    def compute_both(self) -> None:
        """Computes both views, in one pass of the encoder if possible, with half the kernels."""
        full, masked = self.encoder.encode_both(self.patches, self.sensor, self.kept)
        self.full, self.masked = self._full(full), self._masked(masked)

    def _full(self, tokens: Tensor) -> Features:
        encoder = self.encoder
        return Features(tokens, encoder.pool_tokens(tokens), encoder.prefix, encoder.grid)

    def _masked(self, hidden: Tensor) -> MaskedFeatures:
        encoder = self.encoder
        masked = self.order[:, self.keep :].sort(dim=1).values
        tokens, cls = encoder.project(hidden), encoder.pool_tokens(hidden)
        return MaskedFeatures(tokens, cls, self.kept, masked, encoder.prefix, encoder.grid)

    def other(self, batch: Batch, kept: Tensor | None = None) -> TactileViews:
        """Views of another batch by the same encoder; see `contracts.Views.other`."""
        return TactileViews(self.encoder, batch, self.chance, kept)


def _places(kept: Tensor, batch: int, count: int) -> Tensor:
    """Checks positions to be shown: their type and shape, without waiting for the device.

    Raises:
        TactileForgeError: They do not fit the batch or the grid.
    """
    shape = tuple(kept.shape)
    if kept.dtype != torch.int64 or len(shape) != 2 or shape[0] != batch or not shape[1]:
        raise TactileForgeError(
            f"views.other: kept is {str(kept.dtype).removeprefix('torch.')} {shape}; give int64 "
            f"({batch}, K), K of the places 0 to {count - 1}"
        )
    return kept


def visible_patches(
    patches: Tensor, position: Tensor, kept: Tensor | None
) -> tuple[Tensor, Tensor]:
    """Selects visible patches and their positions.

    Args:
        patches: float (B, slots, N, P).
        position: float (slots * N, width).
        kept: int64 (B, K), visible spatial positions; None for all.

    Returns:
        float (B, slots, K or N, P), and (1 or B, slots, K or N, width).
    """
    batch, slots, count, _ = patches.shape
    position = position.view(1, slots, count, -1)
    if kept is None:
        return patches, position
    return patches_at(patches, kept), patches_at(position.expand(batch, -1, -1, -1), kept)


def patches_at(patches: Tensor, places: Tensor) -> Tensor:
    """Selects patches (B, slots, N, P) at spatial positions int64 (B, K): (B, slots, K, P).

    Example:
        >>> patches_at(torch.zeros(2, 2, 16, 48), torch.tensor([[0, 5], [3, 4]])).shape
        torch.Size([2, 2, 2, 48])
    """
    index = places[:, None, :, None].expand(-1, patches.shape[1], -1, patches.shape[-1])
    return patches.gather(2, index)


def rescale_norm(x: Tensor, length: float | None) -> Tensor:
    """Scales vectors (B, D) to a length; None leaves them unchanged."""
    return x if length is None else length * F.normalize(x, dim=-1)
