"""The touch encoder of AnyTouch 2 and of other models like CLIP: a ViT on tubes of frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.encoders.backbone import Backbone, patches_at, rescale_norm, visible_patches
from tactileforge.encoders.photo_stream import PhotoStream
from tactileforge.encoders.positions import sincos_grid
from tactileforge.encoders.preprocess import ANYTOUCH2, CLIP_MEAN, CLIP_STD
from tactileforge.encoders.transformer import Transformer, init_weights
from tactileforge.errors import ConfigError, unknown

__all__ = ["CLIP_MEAN", "CLIP_STD", "PUBLISHED_SENSORS", "TactileViT"]

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


class TactileViT(Backbone):
    """Encodes touch clips to tokens, preprocessing of uint8 frames included.

    The sequence is one class token, ``sensor_tokens`` tokens of the sensor, and the patches of
    every temporal slot in (slot, row, column) order. Patches are tubes of ``tube`` frames, embedded
    linearly, with one learned position each. Blocks are pre-norm with a norm before the first
    (CLIP's). Returned tokens are those before the last norm, class tokens those after it,
    projected.
    Source: AnyTouch 2, sections Method and Implementation Details, and its published weights.

    Args:
        size: Size of the model: ``tiny`` (192 wide, 6 deep, 3 heads), ``small`` (384/12/6),
            ``base`` (768/12/12) or ``large`` (1024/24/16).
        frames: Frames of a clip; a multiple of ``tube``.
        image_size: Height and width of resized frames, pixels, or one number for both.
        patch: Rows and columns of a patch.
        tube: Frames of a patch.
        projected: Width of projected tokens, for decoding and alignment.
        mask_ratio: Share of spatial positions hidden in the masked view, the same in every slot.
        sensor_tokens: Number of tokens per sensor; with 0, any sensor is accepted.
        sensor_rows: Number of rows of the sensor table, the universal one included.
        sensors: Row of each sensor; None takes the published table.
        unknown_sensor: Treatment of a sensor without a row: ``error``, or the ``universal`` row.
        depth: Number of blocks; None takes the size's.
        spacing: Seconds between the frames of a clip in training; 0 for one frame.
        activation: Activation of the MLPs: ``gelu``, or ``quick_gelu`` for OpenAI's CLIP weights.
        norm_in: Whether there is a norm before the first block.
        eps: Epsilon of the norms.
        bias_kv: Whether attention has a learned key and value besides the tokens (ImageBind).
        length: Length to which projected class tokens are scaled; None for no scaling.
        pixels: Options of preprocessing, see `preprocess.Preprocess`.
        photo_stream: Whether to concatenate the tokens of a network for photographs to those of the
            transformer, which doubles their width, see `photo_stream.PhotoStream`. The class token
            gets the mean of its patches, and tokens of the sensor get zeros. ``init=imagenet``
            gives it ImageNet weights.

    Attributes:
        width: Size of a token.
        prefix: Number of tokens before the patches.
        grid: Numbers of temporal slots, rows and columns.

    Raises:
        ConfigError: Tubes do not divide the sizes, or a row is outside of the sensor table.

    Example:
        >>> import torch
        >>> encoder = TactileViT("tiny", frames=4, image_size=32).eval()
        >>> frames = torch.zeros(2, 4, 3, 240, 320, dtype=torch.uint8)
        >>> tokens, cls = encoder(frames, frames[:, 0], encoder.sensor_ids(["digit", "gelsight"]))
        >>> tokens.shape, cls.shape
        (torch.Size([2, 14, 192]), torch.Size([2, 512]))
    """

    pools_class_token = True

    def __init__(
        self,
        size: Literal["tiny", "small", "base", "large"] = "base",
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
        depth: int | None = None,
        spacing: float = 1 / 15,
        activation: Literal["gelu", "quick_gelu"] = "gelu",
        norm_in: bool = True,
        eps: float = 1e-5,
        bias_kv: bool = False,
        length: float | None = None,
        pixels: Mapping[str, Any] = ANYTOUCH2,
        photo_stream: bool = False,
    ) -> None:
        super().__init__(size, depth, frames, spacing, image_size, patch, tube, mask_ratio, pixels)
        self.sensors = dict(PUBLISHED_SENSORS if sensors is None else sensors)
        self.universal = sensor_rows - 1
        for name, row in self.sensors.items():
            if sensor_tokens and not 0 <= row < self.universal:
                raise ConfigError(
                    f"encoder: sensor {name!r} has row {row} of {sensor_rows}, of which the last "
                    "is universal; raise sensor_rows"
                )
        self.projected = projected
        self.unknown_sensor = unknown_sensor
        self.prefix = 1 + sensor_tokens
        self.length = length
        slots, rows, columns = self.grid

        self.class_token = nn.Parameter(torch.empty(self.width))
        self.sensor_table = None
        if sensor_tokens:
            self.sensor_table = nn.Parameter(torch.empty(sensor_rows, sensor_tokens, self.width))
        self.position = nn.Parameter(torch.empty(1 + slots * rows * columns, self.width))
        self.embed = nn.Linear(3 * tube * patch * patch, self.width, bias=False)
        self.norm_in = nn.LayerNorm(self.width, eps) if norm_in else nn.Identity()
        self.transformer = Transformer(self.width, self.depth, self.heads, eps, activation, bias_kv)
        out = self.width * (1 + photo_stream)
        self.norm_out = nn.LayerNorm(out, eps)
        self.project = nn.Linear(out, projected, bias=False)
        self.apply(init_weights)
        for parameter in (self.class_token, self.sensor_table, self.position):
            if parameter is not None:
                nn.init.normal_(parameter, std=0.02)  # as in BERT and ViT
        # tactile patches differ little: with small random positions, tokens start almost equal
        with torch.no_grad():
            self.position[1:] = 0.5 * sincos_grid(self.grid, self.width).flatten(0, 2)
        self.photo_stream = None
        if photo_stream:
            # after apply(): init_weights would overwrite its weights; before the new width, as it
            # is as wide as the transformer
            self.photo_stream = PhotoStream(self.grid, tube, patch, self.width, self.pixels)
            self.width = out

    def sensor_ids(self, sensor: Sequence[str]) -> Tensor:
        """Rows of the sensor table, int64 (B,).

        Raises:
            ConfigError: A sensor has no row and ``unknown_sensor`` is ``error``.
        """
        if self.unknown_sensor == "error" and self.sensor_table is not None:
            for name in sensor:
                if name not in self.sensors:
                    fix = "Add it to encoder.sensors, or set encoder.unknown_sensor=universal."
                    raise ConfigError(unknown("sensor of the encoder", name, self.sensors, fix))
        # without a table the rows are not used
        rows = torch.tensor([self.sensors.get(name, self.universal) for name in sensor])
        return rows.to(self.class_token.device, non_blocking=True)

    def encode(
        self,
        patches: Tensor,
        sensor: Tensor,
        kept: Tensor | None = None,
        class_only: bool = False,
    ) -> Tensor:
        """Last hidden state, before the last norm; see `Backbone.encode`."""
        first, position = torch.split(self.position, [1, len(self.position) - 1])
        shown, position = visible_patches(patches, position, kept)
        x = (self.embed(shown.to(position.dtype)) + position).flatten(1, 2)
        x = self.norm_in(torch.cat([*self._head(first, sensor), x], dim=1))
        hidden = self.transformer(x, only=slice(0, 1) if class_only else None)
        return self._with_photo_stream(hidden, patches, kept, class_only)

    def encode_both(self, patches: Tensor, sensor: Tensor, kept: Tensor) -> tuple[Tensor, Tensor]:
        """Both in one pass: only attention is separate; see `Backbone.encode_both`."""
        first, position = torch.split(self.position, [1, len(self.position) - 1])
        every = self.embed(patches.to(position.dtype)) + position.view(*patches.shape[1:3], -1)
        head = self._head(first, sensor)
        seen = [x.flatten(1, 2) for x in (every, patches_at(every, kept))]
        x = self.norm_in(torch.cat([*head, seen[0], *head, seen[1]], dim=1))
        lengths = (self.prefix + seen[0].shape[1], self.prefix + seen[1].shape[1])
        full, masked = self.transformer(x, lengths=lengths).split(lengths, dim=1)
        return (
            self._with_photo_stream(full, patches, None),
            self._with_photo_stream(masked, patches, kept),
        )

    def _head(self, first: Tensor, sensor: Tensor) -> list[Tensor]:
        """Tokens before the patches, (B, 1, width) and (B, sensor tokens, width)."""
        head = [(self.class_token + first).expand(len(sensor), 1, -1)]
        if self.sensor_table is not None:
            head.append(self.sensor_table[sensor])
        return head

    def _with_photo_stream(
        self, hidden: Tensor, patches: Tensor, kept: Tensor | None, class_only: bool = False
    ) -> Tensor:
        """Adds the channels of the network for photographs, if there is one."""
        if self.photo_stream is None:
            return hidden
        seen = self.photo_stream(patches, kept)
        beside = seen.mean(1, keepdim=True)
        if not class_only:
            # sensor tokens are of no place of the picture: zeros beside them
            beside = torch.cat([F.pad(beside, (0, 0, 0, self.prefix - 1)), seen], dim=1)
        return torch.cat([hidden, beside], dim=2)

    def pool_tokens(self, tokens: Tensor) -> Tensor:
        """The class token, normed and projected: (B, L, width) to (B, projected)."""
        return rescale_norm(self.project(self.norm_out(tokens[:, 0])), self.length)
