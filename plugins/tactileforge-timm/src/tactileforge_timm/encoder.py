"""Any network of timm as a touch encoder: ``encoder=timm encoder.model=NAME``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any, ClassVar, Literal

import torch
from torch import Tensor, nn

from tactileforge.encoders import PUBLISHED_SENSORS, Backbone, init_weights, patches_at
from tactileforge.errors import ConfigError, unknown
from tactileforge_timm.adapters import add_lora
from tactileforge_timm.features import Layout, PlaceHeads, own_pixels, own_size
from tactileforge_timm.networks import create_network, fix_norms, takes_tokens
from tactileforge_timm.token_choice import choose_tokens

#: Preprocessing of the network itself: its mean, deviation and interpolation; no background.
OWN: dict[str, Any] = {"offset": None, "fit": "squash", "filter": None, "mean": None, "std": None}
JOINS = ("tokens", "mean", "concat")


class TimmEncoder(Backbone):
    """Encodes each frame of a clip by a network of timm, and joins the frames.

    Tokens are the places of the network's last features (``forward_features``): patches of a
    transformer after its class and register tokens, or places of a map. The vector of a clip is the
    network's own (``forward_head`` before the classifier). For one frame both are those of timm.

    A transformer of one width (ViT, DeiT, DINOv2, DINOv3, CLIP, SigLIP, EVA) does not embed hidden
    patches, and takes tokens of the sensor. To any other network hidden patches have the mean
    colour of its normalisation, and their places are left out of its map.

    Args:
        model: Name of a model of timm, with or without a tag: ``vit_small_patch14_dinov2``,
            ``convnext_tiny.fb_in22k``.
        pretrained: Whether a new run starts from the weights that timm has for it.
        path: File of weights to start from, ``.safetensors``, ``.pth`` or ``.bin``; None for none.
        frames: Frames of a clip.
        image_size: Height and width of resized frames, pixels, or one number; None for its own.
        join: ``tokens`` keeps the tokens of every frame, one slot each, and averages tokens before
            the patches; ``mean`` averages all over time; ``concat`` puts their channels side by
            side, oldest frame first.
        projected: Width of a last linear layer; None for no such layer.
        sensor_tokens: Number of learned tokens per sensor; 0 accepts any sensor.
        sensor_rows: Number of rows of the sensor table, the universal one included.
        sensors: Row of each sensor; None takes the published table.
        unknown_sensor: Treatment of a sensor without a row: ``error``, or the ``universal`` row.
        mask_ratio: Share of spatial positions hidden in the masked view, the same in every slot.
        spacing: Seconds between the frames of a clip in training; 0 for one frame.
        fixed_norms: Whether batch norms keep the statistics of their weights in training.
        lora: Rank of LoRA's matrices; the network is frozen beside them. 0 trains the network.
        lora_layers: Ends of the names of layers with LoRA; none for all linear ones.
        preprocess: Options of preprocessing, see `Preprocess`; None in it is the network's own.
            ``offset: 130`` subtracts the frame without contact. Not named ``pixels``, which recipes
            set for encoders of ours.

    Raises:
        PluginError: timm or peft is not installed, or timm cannot be imported.
        ConfigError: There is no such model, or it does not take the size or the tokens.
        DataError: The file does not hold its weights; `DataNotFoundError` for one that is absent,
            or for weights that cannot be fetched.
    """

    #: Options that matter for the first weights alone; see `registry.without_start`.
    starting_options: ClassVar[tuple[str, ...]] = ("pretrained", "path")
    #: Option that is meant where a user types a name: ``encoder.name=resnet18``, ``timm:resnet18``.
    named_by: ClassVar[str] = "model"

    def __init__(
        self,
        model: str = "vit_tiny_patch16_224",
        pretrained: bool = False,
        path: str | None = None,
        frames: int = 2,
        image_size: int | Sequence[int] | None = None,
        join: Literal["tokens", "mean", "concat"] = "tokens",
        projected: int | None = None,
        sensor_tokens: int = 0,
        sensor_rows: int = 20,
        sensors: dict[str, int] | None = None,
        unknown_sensor: Literal["error", "universal"] = "error",
        mask_ratio: float = 0.75,
        spacing: float = 1 / 15,
        fixed_norms: bool = True,
        lora: int = 0,
        lora_layers: Sequence[str] = (),
        preprocess: Mapping[str, Any] = OWN,
    ) -> None:
        if join not in JOINS:
            raise ConfigError(unknown("encoder.join", join, JOINS))
        if frames < 1:
            raise ConfigError(f"encoder.frames={frames}: give 1 or more")
        network = create_network(model, pair_of(image_size), pretrained, path)
        size = pair_of(image_size) or own_size(network, model)
        layout = Layout(network, model, size)
        pixels = own_pixels(network) | {key: x for key, x in preprocess.items() if x is not None}
        beside = frames if join == "concat" else 1
        super().__init__(
            layout.width * beside,
            None,
            frames,
            spacing,
            size,
            layout.stride,
            1 if join == "tokens" else frames,
            mask_ratio,
            pixels,
        )
        self.join, self.layout, self.beside, self.fixed_norms = join, layout, beside, fixed_norms
        self.network: Any = network
        self.takes_tokens = takes_tokens(network)
        if self.takes_tokens:
            choose_tokens(network, layout.prefix, sensor_tokens)
        if lora:
            add_lora(network, lora, lora_layers)
        self._add_sensors(model, sensor_tokens, sensor_rows, sensors)
        self.unknown_sensor = unknown_sensor
        self._add_projection(model, projected)
        #: Options to build it again from its own weights, whatever timm says of the model then.
        self.settled = {"image_size": list(size), "preprocess": pixels}
        # from the start: norms keep the statistics of their weights
        self.train(self.training)

    def _add_sensors(
        self, model: str, count: int, rows: int, sensors: Mapping[str, int] | None
    ) -> None:
        """The table of sensor tokens."""
        self.sensors = dict(PUBLISHED_SENSORS if sensors is None else sensors)
        self.prefix = self.layout.prefix + count
        self.sensor_table = None
        if not count:
            return
        if not self.takes_tokens:
            raise ConfigError(
                f"encoder.sensor_tokens={count}: {model} takes no tokens; give 0, or a transformer "
                "of one width, such as vit_small_patch16_224"
            )
        self.universal = rows - 1
        for name, row in self.sensors.items():
            if not 0 <= row < self.universal:
                raise ConfigError(
                    f"encoder: sensor {name!r} has row {row} of {rows}, of which the last is "
                    "universal; raise sensor_rows"
                )
        table = torch.empty(rows, count, self.layout.width)
        self.sensor_table = nn.Parameter(nn.init.normal_(table, std=0.02))

    def _add_projection(self, model: str, projected: int | None) -> None:
        """The last linear layer, and the network's head where it changes the width."""
        each = self.layout.head_width * self.beside
        same = self.layout.head_width == self.layout.width
        if not same and self.beside > 1:
            raise ConfigError(
                f"encoder.join=concat: the vector of {model} has another size than its map; give "
                "join=tokens or join=mean"
            )
        self.projected = projected or each
        self.linear: nn.Module = nn.Identity()
        if projected:
            self.linear = nn.Linear(each, projected)
            init_weights(self.linear)
        places = nn.Identity() if same else PlaceHeads(self.network, self.layout)
        self.project = nn.Sequential(places, self.linear)

    def train(self, mode: bool = True) -> TimmEncoder:
        """Sets the mode; with ``fixed_norms``, batch norms stay in evaluation mode."""
        super().train(mode)
        if self.fixed_norms:
            fix_norms(self.network)
        return self

    def sensor_ids(self, sensor: Sequence[str]) -> Tensor:
        """Rows of the sensor table, int64 (B,); without a table they are not used.

        Raises:
            ConfigError: A sensor has no row and ``unknown_sensor`` is ``error``.
        """
        if self.sensor_table is None:
            rows = [0] * len(sensor)
        else:
            assert self.universal is not None
            if self.unknown_sensor == "error":
                for name in sensor:
                    if name not in self.sensors:
                        fix = "Add it to encoder.sensors, or set encoder.unknown_sensor=universal."
                        raise ConfigError(unknown("sensor of the encoder", name, self.sensors, fix))
            rows = [self.sensors.get(name, self.universal) for name in sensor]
        return torch.tensor(rows).to(next(self.parameters()).device, non_blocking=True)

    def encode(
        self,
        patches: Tensor,
        sensor: Tensor,
        kept: Tensor | None = None,
        class_only: bool = False,
    ) -> Tensor:
        """Tokens of all frames, joined; see `Backbone.encode`."""
        pictures = self._pictures(patches, None if self.takes_tokens else kept)
        each = None if kept is None else kept.repeat_interleave(self.frames, 0)
        if self.takes_tokens:
            tokens = self._of_tokens(pictures, sensor, each)
        else:
            tokens = self.layout.tokens(self.network.forward_features(pictures))
            if each is not None:
                head, places = tokens[:, : self.prefix], tokens[:, self.prefix :]
                tokens = torch.cat([head, patches_at(places[:, None], each)[:, 0]], 1)
        return self._joined(tokens.view(len(patches), self.frames, *tokens.shape[1:]))

    def _of_tokens(self, pictures: Tensor, sensor: Tensor, kept: Tensor | None) -> Tensor:
        """Tokens of a transformer: hidden patches are left out, those of the sensor added."""
        extra = None
        if self.sensor_table is not None:
            extra = self.sensor_table[sensor].repeat_interleave(self.frames, 0)
        with self.network.patch_drop.choosing(kept, extra):
            found = self.network.forward_features(pictures)
        return self.layout.tokens(found, hidden=kept is not None or extra is not None)

    def _pictures(self, patches: Tensor, kept: Tensor | None) -> Tensor:
        """Frames (B * T, 3, height, width) of patches (B, slots, N, P), hidden ones at the mean."""
        slots, rows, columns = self.grid
        if kept is not None:
            shown = patches.new_zeros(len(patches), rows * columns).scatter(1, kept, 1.0)
            patches = patches * shown[:, None, :, None]
        cells = (len(patches), slots, rows, columns, 3, self.tube, self.patch, self.patch)
        x = patches.reshape(cells).permute(0, 1, 5, 4, 2, 6, 3, 7)
        return x.reshape(-1, 3, *self.image_size).to(next(self.network.parameters()).dtype)

    def _joined(self, tokens: Tensor) -> Tensor:
        """Joins the tokens of frames, (B, T, L, C), to (B, prefix + slots * places, width)."""
        if self.join == "mean":
            return tokens.mean(1)
        if self.join == "concat":
            return tokens.permute(0, 2, 1, 3).flatten(2)
        return torch.cat(
            [tokens[:, :, : self.prefix].mean(1), tokens[:, :, self.prefix :].flatten(1, 2)], 1
        )

    def pool_tokens(self, tokens: Tensor) -> Tensor:
        """The network's vector of all tokens but those of the sensor, projected: (B, projected)."""
        own = torch.cat([tokens[:, : self.layout.prefix], tokens[:, self.prefix :]], 1)
        frames = own.reshape(*own.shape[:2], self.beside, -1).transpose(1, 2).flatten(0, 1)
        vector = self.layout.vector(self.network, frames)
        out: Tensor = self.linear(vector.reshape(len(tokens), -1))
        return out

    def state_for(self, after: TimmEncoder) -> dict[str, Tensor]:
        """The state of this encoder for one of other frames or another size.

        Args:
            after: The same encoder with another ``frames`` or ``image_size``.

        Raises:
            ConfigError: The network is made for one size, or the joined frames for one number.
        """
        network = self.network
        if self.image_size != after.image_size and hasattr(network, "set_input_size"):
            network = deepcopy(network)
            network.set_input_size(img_size=after.image_size)
        state: dict[str, Tensor] = self.state_dict()
        state |= {f"network.{key}": value for key, value in network.state_dict().items()}
        for key, value in after.state_dict().items():
            if key not in state or state[key].shape != value.shape:
                raise ConfigError(f"{key}: cannot be interpolated; leave frames and image_size out")
        return state


def pair_of(size: int | Sequence[int] | None) -> tuple[int, int] | None:
    """Height and width, of both or of one number for both; None for None.

    Raises:
        ConfigError: There are not two, or they are below 1.
    """
    if size is None:
        return None
    sides = (size, size) if isinstance(size, int) else tuple(size)
    if len(sides) != 2 or min(sides) < 1:
        raise ConfigError(f"encoder.image_size={size}: give height and width, or one number")
    return sides[0], sides[1]
