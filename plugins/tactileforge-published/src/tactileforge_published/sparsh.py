"""Sparsh: MAE, DINO, DINOv2 and I-JEPA on two frames, V-JEPA on four."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from tactileforge.encoders import SPARSH
from tactileforge.errors import ConfigError
from tactileforge_published.layout import (
    ConversionPlan,
    Keys,
    Shape,
    State,
    WeightLayout,
    blocks,
    depth_of,
    norms,
    size_of_width,
)

_EMBED = "patch_embed.proj.weight"
_BANDS = "pos_embed.frequency_bands"
#: Names of the modules of a block in timm and DINOv2, by our name.
TIMM_BLOCK: dict[str, str | tuple[str, ...]] = {
    "norm1": "norm1",
    "attention.qkv": "attn.qkv",
    "attention.out": "attn.proj",
    "norm2": "norm2",
    "mlp.0": "mlp.fc1",
    "mlp.2": "mlp.fc2",
}
#: Height and width of a frame, by its number of patches.
_SIZES = {20 * 15: [320, 240], 14 * 14: [224, 224]}


def _plan(state: State) -> ConversionPlan:
    """Plans the conversion.

    Sparsh's frames come newest first and ours oldest first, so weights of frames and slots are
    reversed.
    """
    video = state[_EMBED].ndim == 5
    depth = depth_of(state, "blocks")
    width = len(state["norm.weight"])
    slots = 2 if video else 1
    learned = "pos_embed" in state
    options: dict[str, Any] = {
        "size": size_of_width(width, "Sparsh"),
        "depth": depth,
        "frames": 2 * slots,
        # Every fifth frame (V-JEPA: every second), of sensors at 60 Hz.
        "spacing": 2 / 60 if video else 5 / 60,
        "image_size": _image_size(state, slots) if learned else _SIZES[300],
        "patch": state[_EMBED].shape[-1],
        "positions": "learned" if learned else "sincos",
        "pixels": dict(SPARSH),
    }
    keys: Keys = {"stems.0.embed.weight": _EMBED, "stems.0.embed.bias": "patch_embed.proj.bias"}
    keys |= norms({"norm_out": "norm"}) | blocks("transformer.blocks", "blocks", depth, TIMM_BLOCK)
    for i in range(depth):
        keys |= layer_scales(f"transformer.blocks.{i}", f"blocks.{i}")
    change: dict[str, Callable[[Tensor], Tensor]] = {
        # of videos (width, colours, frames, rows, columns)
        "stems.0.embed.weight": (lambda x: x.flip(2).flatten(1)) if video else image_patches,
        "registers": lambda x: x[0],
        "stems.0.position": lambda x: x[0].view(slots, -1, width).flip(0).flatten(0, 1),
    }
    if learned:
        keys["stems.0.position"] = "pos_embed"
    else:
        check_bands(state.get(_BANDS), _BANDS, width, 3 if video else 2)
    # some files have an empty tensor of them
    if (registers := state.get("register_tokens")) is not None and registers.numel():
        keys["registers"] = "register_tokens"
        options["registers"] = registers.shape[1]
    return ConversionPlan("plain_vit", options, keys, change)


def layer_scales(ours: str, theirs: str) -> Keys:
    """Key map of the two LayerScales of a block."""
    return {f"{ours}.scale{j}": f"{theirs}.ls{j}.gamma" for j in (1, 2)}


def image_patches(x: Tensor) -> Tensor:
    """Reverses frames: (width, frames * colours, rows, columns), newest first, to a matrix."""
    return x.view(len(x), -1, 3, *x.shape[2:]).flip(1).transpose(1, 2).flatten(1)


def _image_size(state: State, slots: int) -> list[int]:
    count = state["pos_embed"].shape[1]
    if count % slots or count // slots not in _SIZES:
        known = " or ".join(str(slots * size) for size in _SIZES)
        raise ConfigError(f"Sparsh: pos_embed has {count} positions; expected {known}")
    return _SIZES[count // slots]


def check_bands(bands: Tensor | None, name: str, width: int, axes: int) -> None:
    """Compares a file's fixed positions with those computed by our encoder.

    Args:
        bands: Frequencies of the file, (axes, count); None where it has none.
        name: Name of this tensor.
        width: Size of a token.
        axes: Number of axes of the positions.

    Raises:
        ConfigError: There are none, or others.
    """
    if bands is None:
        raise ConfigError(f"not a whole Sparsh file; missing: {name}, or learned positions")
    count = -(-width // (2 * axes))
    expected = (10000 ** -(torch.arange(count) / count)).expand(axes, -1)
    if bands.shape != (axes, count) or not torch.allclose(
        bands.float(), expected, rtol=_precision(bands), atol=1e-7
    ):
        raise ConfigError(
            f"Sparsh: {name} {tuple(bands.shape)} is not 10000 ** (-k / {count}) on {axes} axes: "
            "its positions are made in another way than the published ones"
        )


def _precision(values: Tensor) -> float:
    """Relative precision of numbers, lower if they were stored in a 16-bit type."""
    for dtype in (torch.bfloat16, torch.float16):
        if torch.equal(values.to(dtype).to(values.dtype), values):
            return torch.finfo(dtype).eps
    return 1e-5


def _layout(
    name: str, title: str, patches: Shape, *prefixes: str, beside: str = ""
) -> WeightLayout:
    # Without this mark, a DINO file with its register missing would pass for one without registers.
    registers: dict[str, Shape] = {"register_tokens": (1, None, None)}
    return WeightLayout(
        name=name,
        title=title,
        marks={
            _EMBED: patches,
            "blocks.0.attn.qkv.weight": (None, None),
            "blocks.0.ls1.gamma": (None,),
            "norm.weight": (None,),
            **(registers if TEACHER in prefixes else {}),
        },
        plan=_plan,
        prefixes=prefixes,
        beside=beside,
        unused={
            _BANDS: "fixed positions, made anew",
            "register_tokens": "there are none",
            "mask_token": "pre-training",
        },
        outside="other networks of pre-training (student, predictor, decoder, heads)",
    )


_IMAGE: Shape = (None, 6, None, None)
_VIDEO: Shape = (None, 3, 2, None, None)
TEACHER = "teacher_encoder.backbone."
_TARGET = ("target_encoder.backbone.", "target_encoder.")
_TASK = ("model_encoder.backbone.", "model_encoder.", "")
LAYOUTS = (
    _layout("sparsh_ijepa", "Sparsh I-JEPA", _IMAGE, *_TARGET),
    _layout("sparsh_vjepa", "Sparsh V-JEPA", _VIDEO, *_TARGET, *_TASK),
    _layout("sparsh_dinov2", "Sparsh DINOv2", _IMAGE, TEACHER, beside="ibot_patch_loss.center"),
    _layout("sparsh_dino", "Sparsh DINO", _IMAGE, TEACHER),
    _layout("sparsh_mae", "Sparsh MAE", _IMAGE, "encoder.backbone.", "encoder."),
    _layout("sparsh", "Sparsh (encoder alone)", _IMAGE, *_TASK),
)
