"""The touch encoder of AnyTouch 2: a CLIP-style vision transformer on spatio-temporal tubes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch, Features, MaskedFeatures
from tactileforge.distributed import rand_rows
from tactileforge.encoders.transformer import Transformer, init_weights, size_of
from tactileforge.errors import ConfigError, unknown

#: Rows of the published sensor table (AnyTouch 2). The last row of the table is the universal
# sensor.
PUBLISHED_SENSORS = {
    "gelsight": 0,
    "digit": 1,
    "gelslim": 2,
    "gelsight_mini": 3,
    "duragel": 4,
    "dm": 5,
}
CLIP_MEAN = (0.48145466, 0.4578275, 0.40821073)
CLIP_STD = (0.26862954, 0.26130258, 0.27577711)


class TactileViT(nn.Module):
    """Touch clips to tokens; preprocessing included, so frames go in as uint8.

    The sequence is one class token, ``sensor_tokens`` tokens of the sensor, and the patches of
    every temporal slot in (slot, row, column) order. Patches are tubes of ``tube`` frames, embedded
    linearly, with one learned position each. Blocks are pre-norm with a norm before the first
    (CLIP's).
    Source: AnyTouch 2, sections Method and Implementation Details, and its published weights.

    Args:
        size: ``tiny`` (192 wide, 6 deep, 3 heads), ``small`` (384/12/6) or ``base`` (768/12/12).
        frames: Frames of a clip; ``tube`` divides it.
        image_size: Height and width the frames are resized to, or one number for both.
        patch: Rows and columns of a patch.
        tube: Frames of a patch.
        projected: Width of the space in which decoding and alignment take place.
        mask_ratio: Share of spatial positions that the masked view hides, the same in every slot.
        sensor_tokens: Tokens a sensor has.
        sensor_rows: Rows of the sensor table, the universal one included.
        sensors: Row of each sensor; None takes the published table.
        unknown_sensor: What to do with a sensor that has no row: ``error``, or take ``universal``.

    Attributes:
        width: Size of a token.
        prefix: Tokens before the patches.
        grid: Temporal slots, rows, columns.

    Raises:
        ConfigError: Sizes that the tubes do not divide, or a row outside the sensor table.

    Example:
        >>> import torch
        >>> encoder = TactileViT("tiny", frames=4, image_size=32).eval()
        >>> frames = torch.zeros(2, 4, 3, 240, 320, dtype=torch.uint8)
        >>> tokens, cls = encoder(frames, frames[:, 0], encoder.rows(["digit", "gelsight"]))
        >>> tokens.shape, cls.shape
        (torch.Size([2, 14, 192]), torch.Size([2, 512]))
    """

    modality = "touch"

    def __init__(
        self,
        size: Literal["tiny", "small", "base"] = "base",
        frames: int = 4,
        image_size: int | Sequence[int] = 224,
        patch: int = 16,
        tube: int = 2,
        projected: int = 512,
        mask_ratio: float = 0.75,
        sensor_tokens: int = 5,
        sensor_rows: int = 20,
        sensors: dict[str, int] | None = None,
        unknown_sensor: Literal["error", "universal"] = "error",
    ) -> None:
        super().__init__()
        height, width = (image_size, image_size) if isinstance(image_size, int) else image_size
        if frames % tube or height % patch or width % patch:
            raise ConfigError(
                f"encoder: tubes of {tube} frames and {patch} pixels do not divide "
                f"{frames} frames of {height} x {width}; change frames, image_size, tube or patch"
            )
        if not 0 <= mask_ratio < 1:
            raise ConfigError(f"encoder: mask_ratio is {mask_ratio}; it must be in [0, 1)")
        self.sensors = dict(PUBLISHED_SENSORS if sensors is None else sensors)
        for name, row in self.sensors.items():
            if not 0 <= row < sensor_rows - 1:
                raise ConfigError(
                    f"encoder: sensor {name!r} has row {row} of {sensor_rows}, of which the last "
                    "is universal; raise sensor_rows"
                )
        self.width, depth, heads = size_of(size)
        self.projected = projected
        self.frames = frames
        self.image_size = (height, width)
        self.patch = patch
        self.tube = tube
        self.mask_ratio = mask_ratio
        self.unknown_sensor = unknown_sensor
        self.prefix = 1 + sensor_tokens
        self.grid = (frames // tube, height // patch, width // patch)
        slots, rows, columns = self.grid

        self.class_token = nn.Parameter(torch.empty(self.width))
        self.sensor_table = nn.Parameter(torch.empty(sensor_rows, sensor_tokens, self.width))
        self.position = nn.Parameter(torch.empty(1 + slots * rows * columns, self.width))
        self.embed = nn.Linear(3 * tube * patch * patch, self.width, bias=False)
        self.norm_in = nn.LayerNorm(self.width)
        self.transformer = Transformer(self.width, depth, heads)
        self.norm_out = nn.LayerNorm(self.width)
        self.project = nn.Linear(self.width, projected, bias=False)
        self.register_buffer("mean", torch.tensor(CLIP_MEAN).view(3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(CLIP_STD).view(3, 1, 1), persistent=False)
        self.mean: Tensor
        self.std: Tensor
        self.apply(init_weights)
        for parameter in (self.class_token, self.sensor_table, self.position):
            nn.init.normal_(parameter, std=0.02)

    def rows(self, sensor: Sequence[str]) -> Tensor:
        """Rows of the sensor table, int64 (B,).

        Raises:
            ConfigError: A sensor has no row, and ``unknown_sensor`` is ``error``.
        """
        universal = len(self.sensor_table) - 1
        if self.unknown_sensor == "error":
            for name in sensor:
                if name not in self.sensors:
                    fix = "Add it to encoder.sensors, or set encoder.unknown_sensor=universal."
                    raise ConfigError(unknown("sensor of the encoder", name, self.sensors, fix))
        rows = torch.tensor([self.sensors.get(name, universal) for name in sensor])
        return rows.to(self.sensor_table.device, non_blocking=True)

    def preprocess(self, frames: Tensor, background: Tensor) -> Tensor:
        """Background difference, resize and normalisation, as published.

        ``clamp(frame - background + 130/255, 0, 1)``, bilinear with anti-aliasing to ``image_size``
        (the aspect is not kept), CLIP's mean and standard deviation.

        Args:
            frames: uint8 (B, T, 3, H, W).
            background: uint8 (B, 3, H, W).

        Returns:
            float32 (B, T, 3, height, width).
        """
        x = (frames.float() - background[:, None].float() + 130).clamp(0, 255) / 255
        if x.shape[-2:] != self.image_size:
            flat = F.interpolate(x.flatten(0, 1), self.image_size, mode="bilinear", antialias=True)
            x = flat.view(*x.shape[:3], *self.image_size)
        return (x - self.mean) / self.std

    def patchify(self, x: Tensor) -> Tensor:
        """(B, T, 3, height, width) to (B, slots, N, 3 * tube * patch * patch)."""
        slots, rows, columns = self.grid
        x = x.reshape(len(x), slots, self.tube, 3, rows, self.patch, columns, self.patch)
        x = x.permute(0, 1, 4, 6, 3, 2, 5, 7)
        return x.flatten(4).flatten(2, 3)

    def forward(self, frames: Tensor, background: Tensor, sensor: Tensor) -> tuple[Tensor, Tensor]:
        """Tokens before the last norm (B, L, width), and projected class tokens (B, projected).

        Args:
            frames: uint8 (B, T, 3, H, W), RGB, oldest first.
            background: uint8 (B, 3, H, W).
            sensor: int64 (B,), see `rows`.
        """
        tokens = self.encode(self.patchify(self.preprocess(frames, background)), sensor)
        return tokens, self.project(self.norm_out(tokens[:, 0]))

    def encode(self, patches: Tensor, sensor: Tensor, kept: Tensor | None = None) -> Tensor:
        """Last hidden state, before the last norm.

        Args:
            patches: float (B, slots, N, P).
            sensor: int64 (B,), rows of the sensor table.
            kept: int64 (B, K), spatial positions to embed; None embeds all.

        Returns:
            float (B, prefix + slots * (K or N), width).
        """
        batch, slots, count, _ = patches.shape
        position = self.position[1:].view(1, slots, count, -1)
        if kept is not None:
            index = kept[:, None, :, None]
            patches = patches.gather(2, index.expand(-1, slots, -1, patches.shape[-1]))
            position = position.expand(batch, -1, -1, -1)
            position = position.gather(2, index.expand(-1, slots, -1, self.width))
        x = (self.embed(patches) + position).flatten(1, 2)
        head = (self.class_token + self.position[0]).expand(batch, 1, -1)
        x = torch.cat([head, self.sensor_table[sensor], x], dim=1)
        hidden: Tensor = self.transformer(self.norm_in(x))
        return hidden

    def views(self, batch: Batch, universal: float = 0.0) -> TactileViews:
        """Starts the views of a batch; see `contracts.Encoder.views`."""
        return TactileViews(self, batch, universal)


class TactileViews:
    """The views of one batch, each computed once, when first asked for.

    Random choices (which tubes are kept, which samples take the universal sensor tokens) are drawn
    at once, so they do not depend on which view is asked for first.

    Args:
        encoder: Whose views.
        batch: See `tactileforge.contracts`.
        universal: Chance of the universal sensor tokens.
    """

    def __init__(self, encoder: TactileViT, batch: Batch, universal: float) -> None:
        self.encoder = encoder
        self.batch = batch
        frames = batch["frames"]
        _, rows, columns = encoder.grid
        count = rows * columns
        noise = rand_rows(len(frames), count + 1, device=frames.device)
        self.order = noise[:, :count].argsort(dim=1)
        last = len(encoder.sensor_table) - 1
        sensor = encoder.rows(batch["sensor"])
        self.sensor = torch.where(noise[:, count] < universal, last, sensor)

    @cached_property
    def patches(self) -> Tensor:
        """Float (B, slots, N, P): the normalised frames, in patches."""
        pixels = self.encoder.preprocess(self.batch["frames"], self.batch["background"])
        return self.encoder.patchify(pixels)

    @cached_property
    def full(self) -> Features:
        """Every patch is seen."""
        encoder = self.encoder
        tokens = encoder.encode(self.patches, self.sensor)
        cls = encoder.project(encoder.norm_out(tokens[:, 0]))
        return Features(tokens, cls, encoder.prefix, encoder.grid)

    @cached_property
    def masked(self) -> MaskedFeatures:
        """``mask_ratio`` of the spatial positions are hidden, the same in every slot."""
        encoder = self.encoder
        count = self.order.shape[1]
        keep = max(1, round(count * (1 - encoder.mask_ratio)))
        kept = self.order[:, :keep].sort(dim=1).values
        masked = self.order[:, keep:].sort(dim=1).values
        tokens = encoder.project(encoder.encode(self.patches, self.sensor, kept))
        return MaskedFeatures(tokens, kept, masked, encoder.prefix, encoder.grid)
