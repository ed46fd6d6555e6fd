"""Encoders for other clips or images than they were trained on: learned positions interpolated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.errors import ConfigError
from tactileforge.plugins import registry


def changed_options(
    encoder: Any, frames: int | None, image_size: int | tuple[int, int] | None
) -> dict[str, Any]:
    """Requested options of an encoder, as far as they differ from its own.

    Args:
        encoder: The trained encoder.
        frames: Frames of a clip; None keeps their number.
        image_size: Rows and columns, or one number for both; None keeps the size.
    """
    options: dict[str, Any] = {}
    if frames is not None and frames != encoder.frames:
        options["frames"] = frames
    if image_size is not None:
        size = (image_size, image_size) if isinstance(image_size, int) else tuple(image_size)
        if size != tuple(encoder.image_size):
            options["image_size"] = list(size)
    return options


def rebuild_encoder(node: Mapping[str, Any], encoder: Any, options: Mapping[str, Any]) -> Any:
    """An encoder with some options changed and the weights of another.

    Args:
        node: Plugin and arguments of the encoder that was trained.
        encoder: The trained encoder, with its weights.
        options: Options to change, by name; see `changed_options`.

    Raises:
        ConfigError: The encoder does not take an option, or its positions cannot be interpolated.
    """
    known = registry.parameters(registry.get("encoders", node["name"]))
    for key, value in options.items():
        if key not in known:
            raise ConfigError(
                f"{key}={value}: the encoder {node['name']!r} takes {getattr(encoder, key)} and "
                f"nothing else; leave {key} out"
            )
    with torch.random.fork_rng(devices=[]):  # the numbers drawn here are replaced
        after = registry.build("encoders", {**node, **options})
    state = interpolate_positions(encoder, after)
    after.load_state_dict(state)
    return after


def interpolate_positions(before: Any, after: Any) -> dict[str, Tensor]:
    """The state of an encoder, its positions interpolated for another grid of patches.

    Linear over time, bicubic over the image, as timm and transformers do it; positions of tokens
    that are not patches stay.

    Args:
        before: The encoder with its weights.
        after: One of another grid.

    Raises:
        ConfigError: There are no learned positions over time, or something else differs.
    """
    wanted: Mapping[str, Tensor] = after.state_dict()
    if hasattr(before, "state_for"):  # it knows its own positions
        known: dict[str, Tensor] = before.state_for(after)
        return known
    state: dict[str, Tensor] = before.state_dict()
    changed = {
        key: _resample(key, value, before.grid, after.grid, len(wanted[key]))
        for key, value in state.items()
        if key in wanted and wanted[key].shape != value.shape
    }
    if not changed and before.grid[0] != after.grid[0]:
        raise ConfigError("the encoder has no learned positions over time; leave frames out")
    return state | changed


def _resample(
    key: str, value: Tensor, old: tuple[int, int, int], new: tuple[int, int, int], length: int
) -> Tensor:
    count = old[0] * old[1] * old[2]
    # positions of the class token and the like come first
    head = len(value) - count
    if value.ndim != 2 or head < 0 or length != head + new[0] * new[1] * new[2]:
        raise ConfigError(f"{key}: cannot be interpolated; leave frames and image_size out")
    table = value[head:].view(*old, -1)
    if old[0] != new[0]:
        flat = table.flatten(1, 2).permute(1, 2, 0)
        flat = F.interpolate(flat, new[0], mode="linear")
        table = flat.permute(2, 0, 1).reshape(new[0], *old[1:], -1)
    if old[1:] != new[1:]:
        image = F.interpolate(table.permute(0, 3, 1, 2), new[1:], mode="bicubic")
        table = image.permute(0, 2, 3, 1)
    return torch.cat([value[:head], table.flatten(0, 2)])
