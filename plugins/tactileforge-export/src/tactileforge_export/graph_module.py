"""The module to trace: an encoder, the vectors of its model, and its force head with a scale."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.encoders import ComputedViews, join_summary, joint_vector, summarised_parts
from tactileforge.errors import ConfigError
from tactileforge_export.squash import Squash

#: Row of an unknown sensor, outside of every table, so that the graph raises an error.
_NOWHERE = -(2**31)


class GraphModule(nn.Module):
    """An encoder with the outputs of a file: tokens, cls, force, vector and probability.

    ``force`` is there with a head, ``vector`` for models trained here, and ``probability`` with a
    head of classes.

    The graph raises an error for a sensor unknown to the encoder, and gives NaN forces for a sensor
    without a force scale.

    Args:
        encoder: Touch encoder in eval mode, a copy: hooks are left in it.
        head: Force head; None for no forces.
        scale: Factor of the head's output along x, y and z, for each sensor: its newtons, or 1.
        squashed: Height and width of frames resized in training, pixels; None for imported weights.
        classes: Weight (classes, projected) and bias (classes,) of a head of classes; None without.

    Attributes:
        outputs: Names of the outputs.
        sensors: Number of each sensor: its row of the encoder's table, or an index if sensors share
            a row and forces are scaled.
    """

    def __init__(
        self,
        encoder: Any,
        head: nn.Module | None = None,
        scale: Mapping[str, Sequence[float]] | None = None,
        squashed: tuple[int, int] | None = None,
        classes: tuple[Tensor, Tensor] | None = None,
    ) -> None:
        super().__init__()
        self.squash = None if squashed is None else Squash(squashed)
        self.encoder, self.head = encoder, head
        vector, force = ("vector",) * (self.squash is not None), ("force",) * (head is not None)
        self.classes = None if classes is None else _linear(*classes)
        probability = ("probability",) * (classes is not None)
        self.outputs = ("tokens", "cls", *force, *vector, *probability)
        self.frames, self.image_size = encoder.frames, encoder.image_size
        self._states: list[Tensor] = []
        if vector:  # hooks set in `forward` could not be traced
            for part in summarised_parts(encoder):
                part.register_forward_hook(lambda _part, _given, state: self._states.append(state))
        rows, scale = sensor_rows(encoder), scale or {}
        # Sensors with a common row have different force scales, so each needs its own number.
        numbered = bool(scale) and len(set(rows.values())) < len(rows)
        self.sensors = {name: i for i, name in enumerate(rows)} if numbered else rows
        known = torch.full((max(self.sensors.values(), default=0) + 1,), _NOWHERE)
        factor = torch.full((len(known), 3), torch.nan)
        for name, number in self.sensors.items():
            known[number] = rows[name]
            if name in scale:
                factor[number] = torch.tensor(scale[name])
        self.register_buffer("known", known)
        self.register_buffer("factor", factor)
        self.known: Tensor
        self.factor: Tensor
        # without a table, and with one stem, an encoder takes any sensor
        has_table = getattr(encoder, "sensor_table", None) is not None
        reads = has_table or len(getattr(encoder, "stems", ())) > 1
        self._checks = numbered or (bool(encoder.sensors) and reads)

    def forward(self, frames: Tensor, background: Tensor, sensor: Tensor) -> tuple[Tensor, ...]:
        """Computes the outputs of `outputs`; see `facts.OUTPUTS` for their shapes.

        Args:
            frames: uint8 (B, T, 3, H, W), RGB, oldest first.
            background: uint8 (B, 3, H, W).
            sensor: int64 (B,), numbers of sensors, see `sensors`.
        """
        row = self.known[sensor] if self._checks else sensor
        if self.squash is not None:
            frames, background = self.squash(frames), self.squash(background)
        tokens, cls = self.encoder(frames, background, row)
        vector: tuple[Tensor, ...] = ()
        if self.squash is not None:
            summary = join_summary(self._states or [tokens], self.encoder.grid)
            vector = (joint_vector({"summary": summary}),)
            self._states.clear()
        if self.classes is not None:
            vector = (*vector, self.classes(cls).softmax(-1))
        if self.head is None:
            return tokens, cls, *vector
        force = self.head(ComputedViews.of(self.encoder, tokens, cls), {}).force
        return tokens, cls, force * self.factor[sensor][:, None], *vector


def _linear(weight: Tensor, bias: Tensor) -> nn.Linear:
    layer = nn.Linear(weight.shape[1], weight.shape[0])
    layer.weight, layer.bias = nn.Parameter(weight), nn.Parameter(bias)
    return layer


def sensor_rows(encoder: Any) -> dict[str, int]:
    """Rows of an encoder's table by sensor, the universal one included."""
    universal = getattr(encoder, "universal", None)
    return dict(encoder.sensors) | ({} if universal is None else {"universal": universal})


def check_float32(encoder: nn.Module) -> None:
    """Raises a ConfigError for rounded weights, since a file needs the original ones."""
    dtypes = {x.dtype for x in encoder.state_dict().values() if x.dtype != torch.int64}
    if dtypes - {torch.float32}:
        raise ConfigError(
            "export takes float32 weights: load the model without dtype=; int8=true makes int8"
        )
