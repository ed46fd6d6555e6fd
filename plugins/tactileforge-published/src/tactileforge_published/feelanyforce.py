"""FeelAnyForce: DINOv2 with a head for the three forces on a GelSight Mini."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.errors import ConfigError
from tactileforge_published.layout import (
    ConversionPlan,
    State,
    WeightLayout,
    blocks,
    depth_of,
    first_names,
    norms,
    size_of_width,
    square,
)
from tactileforge_published.sparsh import TIMM_BLOCK, layer_scales

_IMAGE = 224  # pixels; the files do not hold it
_EMBED = "patch_embed.proj.weight"
#: Added by DINOv2 to the sides of the grid to which it resizes its positions.
_MARGIN = 0.1
#: Preprocessing in training: difference to the background about grey, black bars above and below.
_PIXELS: dict[str, Any] = {
    "offset": 127,
    "fit": "letterbox",
    "filter": "bilinear",
    "mean": (0.36541665, 0.37162220, 0.36927229),
    "std": (0.21197720, 0.21512392, 0.21367691),
}
_HEAD = "regressor.regressor"
#: Places of linear layers in the force head; all but the last are followed by a norm.
_LINEAR = (0, 3, 6, 9, 12)


def _plan(state: State) -> ConversionPlan:
    depth = depth_of(state, "blocks")
    count, width = state["pos_embed"].shape[1:]
    side = square(count - 1, "FeelAnyForce")
    patch = state[_EMBED].shape[-1]
    options = {
        "size": size_of_width(width, "FeelAnyForce"),
        "depth": depth,
        "frames": 1,
        "spacing": 0.0,
        "image_size": _IMAGE,
        "patch": patch,
        "tube": 1,
        "positions": "learned",
        "class_token": True,
        "pool": "class",
        "pixels": dict(_PIXELS),
    }
    keys = norms({"stems.0.embed": "patch_embed.proj", "norm_out": "norm"})
    keys |= {"stems.0.class_token": "cls_token", "stems.0.position": "pos_embed"}
    keys |= blocks("transformer.blocks", "blocks", depth, TIMM_BLOCK)
    for i in range(depth):
        keys |= layer_scales(f"transformer.blocks.{i}", f"blocks.{i}")
    change = {
        "stems.0.embed.weight": lambda x: x.flatten(1),
        "stems.0.class_token": lambda x: x.flatten(),
        "stems.0.position": lambda x: _resized(x[0], side, _IMAGE // patch),
    }
    return ConversionPlan("plain_vit", options, keys, change)


def _resized(positions: Tensor, side: int, wanted: int) -> Tensor:
    """Resizes positions (1 + side * side, width) as DINOv2 does, to (1 + wanted * wanted, width).

    Cubic; the scale is that of a side of ``wanted + 0.1``, as in its networks without registers.
    """
    if side == wanted:
        return positions
    grid = positions[1:].view(1, side, side, -1).permute(0, 3, 1, 2)
    scale = (wanted + _MARGIN) / side
    # by factor and not by size: torch then samples at the scale with the margin
    grid = F.interpolate(grid, scale_factor=(scale, scale), mode="bicubic")
    return torch.cat([positions[:1], grid[0].flatten(1).T])


def force_head(state: State) -> dict[str, Tensor]:
    """Force head of a file, as a state dict of `heads.published.regressor_decoder`.

    The weights of the file are lengths and directions of rows; ours are their products.

    Args:
        state: Tensors of the file; those below ``regressor.regressor.`` are read.

    Raises:
        ConfigError: Tensors of the head are missing, left over, or do not fit together; the message
            lists them.
    """
    layer = ("weight_g", "weight_v", "bias")
    kinds: dict[int, tuple[str, ...]] = dict.fromkeys(_LINEAR, layer)
    kinds |= {place + 1: ("weight", "bias") for place in _LINEAR[:-1]}
    wanted = {f"{_HEAD}.{place}.{kind}" for place, names in kinds.items() for kind in names}
    found = {key for key in state if key.startswith(f"{_HEAD}.")}
    if wanted != found:
        raise ConfigError(
            "not the force head of FeelAnyForce; missing: "
            f"{first_names(sorted(wanted - found)) or 'nothing'}; unexpected: "
            f"{first_names(sorted(found - wanted)) or 'nothing'}"
        )
    made = {
        key.removeprefix(f"{_HEAD}."): state[key].float().clone()
        for key in sorted(wanted)
        if not key.endswith(("_g", "_v"))
    }
    for place in _LINEAR:
        length, direction = (state[f"{_HEAD}.{place}.weight_{x}"].float() for x in "gv")
        if direction.ndim != 2 or length.shape != (len(direction), 1):
            raise ConfigError(
                f"shapes that do not fit: {_HEAD}.{place}.weight_g {tuple(length.shape)}, "
                f"weight_v {tuple(direction.shape)}"
            )
        # torch's weight_norm: w = g v / |v|, row by row
        made[f"{place}.weight"] = length * F.normalize(direction, dim=1)
    if strange := [key for key, x in made.items() if not torch.isfinite(x).all()]:
        raise ConfigError(f"force head of FeelAnyForce: not finite: {first_names(strange)}")
    return made


LAYOUT = WeightLayout(
    name="feelanyforce",
    title="FeelAnyForce",
    marks={
        _EMBED: (None, 3, 14, 14),
        "cls_token": (1, 1, None),
        "pos_embed": (1, None, None),
        "blocks.0.ls1.gamma": (None,),
        "norm.weight": (None,),
    },
    plan=_plan,
    prefixes=("tactile_backbone.",),
    beside=f"{_HEAD}.12.weight_v",
    unused={"mask_token": "pre-training"},
    outside="force head (read beside the encoder, each layer by two names) and decoder of depth",
    head=force_head,
)
