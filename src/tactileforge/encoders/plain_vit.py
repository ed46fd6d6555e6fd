"""A vision transformer like timm's and DINOv2's; Sparsh, T3 and TVL are settings of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import torch
from torch import Tensor, nn

from tactileforge.encoders.backbone import Backbone, rescale_norm, visible_patches
from tactileforge.encoders.positions import sincos_position_embedding
from tactileforge.encoders.preprocess import SPARSH
from tactileforge.encoders.tactile_vit import PUBLISHED_SENSORS
from tactileforge.encoders.transformer import Transformer, init_weights
from tactileforge.errors import ConfigError, unknown

#: Epsilon of timm's norms; T3's stems use it too, although its trunk uses torch's default.
_STEM_EPS = 1e-6


class Stem(nn.Module):
    """Patches to tokens: a linear embedding, positions, a class token, and the first blocks.

    Args:
        patch: Number of values of a patch.
        width: Size of a token.
        depth: Number of blocks.
        heads: Number of attention heads.
        grid: Numbers of temporal slots, rows and columns.
        positions: Kind of position embedding: ``sincos`` (fixed) or ``learned``.
        class_token: Whether there is a class token; learned positions include one for it.
    """

    position: Tensor

    def __init__(
        self,
        patch: int,
        width: int,
        depth: int,
        heads: int,
        grid: tuple[int, int, int],
        positions: str,
        class_token: bool,
    ) -> None:
        super().__init__()
        slots, rows, columns = grid
        self.embed = nn.Linear(patch, width)
        self.class_token = nn.Parameter(torch.empty(width)) if class_token else None
        if positions == "sincos":
            fixed = torch.cat(
                [torch.zeros(int(class_token), width), sincos_position_embedding(grid, width)]
            )
            self.register_buffer("position", fixed, persistent=False)
        else:
            count = int(class_token) + slots * rows * columns
            self.position = nn.Parameter(torch.empty(count, width))
        self.transformer = Transformer(width, depth, heads, _STEM_EPS)

    def forward(self, patches: Tensor, kept: Tensor | None) -> Tensor:
        """Embeds patches (B, slots, N, P) to (B, class token + slots * (K or N), width)."""
        head = int(self.class_token is not None)
        patches, position = visible_patches(patches, self.position[head:], kept)
        x = (self.embed(patches.to(position.dtype)) + position).flatten(1, 2)
        if self.class_token is not None:
            first = (self.class_token + self.position[0]).expand(len(x), 1, -1)
            x = torch.cat([first, x], dim=1)
        out: Tensor = self.transformer(x)
        return out


class PlainViT(Backbone):
    """Encodes touch clips to tokens by a plain vision transformer, from uint8 frames.

    Patches are tubes of ``tube`` frames, embedded linearly with a bias, followed by pre-norm blocks
    with optional LayerScale, and a norm. Register tokens have no position and are dropped at the
    end. With ``stems`` above 1, each type of sensor has an embedding, positions and first blocks of
    its own, and all share the other blocks (T3).
    The defaults are those of Sparsh (MAE, I-JEPA): two frames in one tube, sine positions, no class
    token. Fixed positions count slots from the newest, as Sparsh sees the newest frame first.
    Sources: the papers of Sparsh, T3 and TVL, and the layouts of their weights.

    Args:
        size: Size of the model: ``tiny``, ``small``, ``base`` or ``large``; see `TactileViT`.
        frames: Frames of a clip; a multiple of ``tube``.
        image_size: Height and width of resized frames, pixels, or one number for both.
        patch: Rows and columns of a patch.
        tube: Frames of a patch.
        depth: Number of blocks, those of a stem included; None takes the size's.
        positions: Kind of position embedding: ``sincos`` (fixed) or ``learned``.
        class_token: Whether there is a class token.
        registers: Number of register tokens.
        layer_scale: Initial value of LayerScale; None for no LayerScale.
        stems: Number of stems, one for each type of sensor; a single stem takes any sensor.
        stem_depth: Number of blocks of a stem.
        sensors: Row (stem) of each sensor; needed with several stems.
        eps: Epsilon of the norms outside the stems.
        pool: Pooling of the tokens: their ``mean``, or the ``class`` token.
        norm: Input of the last norm: all ``tokens``, or the ``pooled`` vector.
        projected: Width of a last linear layer; None for no such layer.
        length: Length to which projected class tokens are scaled; None for no scaling.
        mask_ratio: Share of spatial positions hidden in the masked view, the same in every slot.
        spacing: Seconds between the frames of a clip in training; 0 for one frame.
        pixels: Options of preprocessing, see `preprocess.Preprocess`.

    Attributes:
        width: Size of a token.
        prefix: Number of tokens before the patches: 1 with a class token, else 0.
        grid: Numbers of temporal slots, rows and columns.

    Raises:
        ConfigError: Tubes do not divide the sizes, or options exclude each other.

    Example:
        >>> import torch
        >>> encoder = PlainViT("tiny", image_size=(64, 48)).eval()
        >>> frames = torch.zeros(1, 2, 3, 320, 240, dtype=torch.uint8)
        >>> tokens, cls = encoder(frames, frames[:, 0], encoder.sensor_ids(["digit"]))
        >>> tokens.shape, cls.shape
        (torch.Size([1, 12, 192]), torch.Size([1, 192]))
    """

    def __init__(
        self,
        size: Literal["tiny", "small", "base", "large"] = "base",
        frames: int = 2,
        image_size: int | Sequence[int] = (320, 240),
        patch: int = 16,
        tube: int = 2,
        depth: int | None = None,
        positions: Literal["sincos", "learned"] = "sincos",
        class_token: bool = False,
        registers: int = 0,
        layer_scale: float | None = 1.0,
        stems: int = 1,
        stem_depth: int = 0,
        sensors: dict[str, int] | None = None,
        eps: float = 1e-6,
        pool: Literal["mean", "class"] = "mean",
        norm: Literal["tokens", "pooled"] = "tokens",
        projected: int | None = None,
        length: float | None = None,
        mask_ratio: float = 0.75,
        spacing: float = 5 / 60,
        pixels: Mapping[str, Any] = SPARSH,
    ) -> None:
        super().__init__(size, depth, frames, spacing, image_size, patch, tube, mask_ratio, pixels)
        if pool == "class" and not class_token:
            raise ConfigError("encoder: pool=class needs class_token=true")
        known = dict.fromkeys(PUBLISHED_SENSORS, 0) if stems == 1 else {}
        self.sensors = dict(known if sensors is None else sensors)
        if stems > 1 and not (self.sensors and set(self.sensors.values()) <= set(range(stems))):
            raise ConfigError(
                f"encoder: {stems} stems need encoder.sensors, a stem (0 to {stems - 1}) for each "
                f"sensor; it is {self.sensors}"
            )
        self.static_graph = stems == 1  # a batch may lack a type of sensor
        self.pool = pool
        self.pools_class_token = pool == "class"
        self.norm_tokens = norm == "tokens"
        self.length = length
        self.prefix = int(class_token)
        self.projected = projected or self.width

        cells = 3 * tube * patch * patch
        self.stems = nn.ModuleList(
            Stem(cells, self.width, stem_depth, self.heads, self.grid, positions, class_token)
            for _ in range(stems)
        )
        self.registers = nn.Parameter(torch.empty(registers, self.width)) if registers else None
        rest = self.depth - stem_depth
        self.transformer = Transformer(self.width, rest, self.heads, eps, layer_scale=layer_scale)
        self.norm_out = nn.LayerNorm(self.width, eps)
        self.project = nn.Linear(self.width, projected) if projected else nn.Identity()
        self.apply(init_weights)
        for name, parameter in self.named_parameters():
            if name.rpartition(".")[2] in ("class_token", "position", "registers"):
                nn.init.normal_(parameter, std=0.02)

    def sensor_ids(self, sensor: Sequence[str]) -> Tensor:
        """Stem of each sensor, int64 (B,).

        Raises:
            ConfigError: There are several stems, but none for this sensor.
        """
        rows = [0] * len(sensor)
        if len(self.stems) > 1:
            for name in sensor:
                if name not in self.sensors:
                    fix = "It has no stem: give the name of one, or add it to encoder.sensors."
                    raise ConfigError(unknown("sensor of the encoder", name, self.sensors, fix))
            rows = [self.sensors[name] for name in sensor]
        return torch.tensor(rows).to(self.norm_out.weight.device, non_blocking=True)

    def encode(
        self,
        patches: Tensor,
        sensor: Tensor,
        kept: Tensor | None = None,
        class_only: bool = False,
    ) -> Tensor:
        """Last hidden state, normed unless the norm follows pooling; see `Backbone.encode`."""
        x = self._tokens(patches, sensor, kept)
        count = self._registers
        # the class token, which comes after the registers
        only = slice(count, count + 1)
        x = self.transformer(x, only=only) if class_only else self.transformer(x)[:, count:]
        out: Tensor = self.norm_out(x) if self.norm_tokens else x
        return out

    def encode_both(self, patches: Tensor, sensor: Tensor, kept: Tensor) -> tuple[Tensor, Tensor]:
        """Both in one pass after the stems; see `Backbone.encode_both`."""
        parts = [self._tokens(patches, sensor, seen) for seen in (None, kept)]
        lengths = (parts[0].shape[1], parts[1].shape[1])
        x = self.transformer(torch.cat(parts, dim=1), lengths=lengths)
        x = self.norm_out(x) if self.norm_tokens else x
        full, masked = (part[:, self._registers :] for part in x.split(lengths, dim=1))
        return full, masked

    @property
    def _registers(self) -> int:
        return 0 if self.registers is None else len(self.registers)

    def _tokens(self, patches: Tensor, sensor: Tensor, kept: Tensor | None) -> Tensor:
        """Registers, if there are any, and the tokens of the stems."""
        x = self._stems(patches, sensor, kept)
        if self.registers is None:
            return x
        return torch.cat([self.registers.expand(len(x), -1, -1), x], dim=1)

    def _stems(self, patches: Tensor, sensor: Tensor, kept: Tensor | None) -> Tensor:
        """Runs each sample through the stem of its sensor."""
        if len(self.stems) == 1:
            out: Tensor = self.stems[0](patches, kept)
            return out
        if torch.compiler.is_compiling() or patches.device.type != "cpu":
            # every stem runs on every sample: shapes that depend on data would break the compiled
            # graph, and the CPU would have to wait for the device to know them
            every = torch.stack([stem(patches, kept) for stem in self.stems])
            return every[sensor, torch.arange(len(sensor), device=sensor.device)]
        parts, order = [], []
        for row, stem in enumerate(self.stems):  # with no samples too, for a gradient of zeros
            index = (sensor == row).nonzero()[:, 0]
            parts.append(stem(patches[index], None if kept is None else kept[index]))
            order.append(index)
        return torch.cat(parts)[torch.cat(order).argsort()]

    def pool_tokens(self, tokens: Tensor) -> Tensor:
        """The class token, or the mean of the patches, projected: (B, projected)."""
        x = tokens[:, 0] if self.pool == "class" else tokens[:, self.prefix :].mean(dim=1)
        x = x if self.norm_tokens else self.norm_out(x)
        return rescale_norm(self.project(x), self.length)
