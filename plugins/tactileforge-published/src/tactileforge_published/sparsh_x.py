"""Sparsh-X of images alone: the image stream of a Digit 360, without its other senses."""

from __future__ import annotations

from torch import Tensor

from tactileforge.encoders import AS_THEY_ARE
from tactileforge_published.layout import (
    ConversionPlan,
    Keys,
    State,
    WeightLayout,
    depth_of,
    norms,
    size_of_width,
)
from tactileforge_published.sparsh import (
    TEACHER,
    TIMM_BLOCK,
    check_bands,
    image_patches,
    layer_scales,
)

_IMAGE = 224  # pixels; the files do not hold it
_EMBED = "patch_embed.img.proj"
_BANDS = "pos_embeds.img.frequency_bands"
#: Its cut from the fisheye picture is not published: the central square is taken.
_PIXELS = AS_THEY_ARE | {"fit": "cover"}


def _plan(state: State) -> ConversionPlan:
    """Plans the conversion: blocks of the image, then those shared by all senses."""
    own, shared = depth_of(state, "blocks"), depth_of(state, "fusion_blocks")
    width = len(state["norm.weight"])
    check_bands(state.get(_BANDS), _BANDS, width, 2)
    options = {
        "size": size_of_width(width, "Sparsh-X"),
        "depth": own + shared,
        "frames": 2,
        "spacing": 5 / 30,  # every fifth frame at 30 Hz
        "image_size": _IMAGE,
        "patch": state[f"{_EMBED}.weight"].shape[-1],
        "registers": state["register_tokens"].shape[1],
        "pixels": dict(_PIXELS),
    }
    keys: Keys = {"registers": "register_tokens"}
    keys |= norms({"stems.0.embed": _EMBED, "norm_out": "norm"})
    for i in range(own + shared):
        theirs = f"blocks.{i}.img" if i < own else f"fusion_blocks.{i - own}"
        ours = f"transformer.blocks.{i}"
        keys |= norms({f"{ours}.{mine}": f"{theirs}.{name}" for mine, name in TIMM_BLOCK.items()})
        keys |= layer_scales(ours, theirs)
    # (x - mean) / deviation of the six channels goes into weights and bias of the patches
    mean, deviation = (state[name].float() for name in ("img_avg", "img_div"))
    weight = state[f"{_EMBED}.weight"].float()

    def shifted(bias: Tensor) -> Tensor:
        return bias - (weight * (mean / deviation)).sum((1, 2, 3))

    change = {
        "stems.0.embed.weight": lambda x: image_patches(x / deviation),
        "stems.0.embed.bias": shifted,
        "registers": lambda x: x[0],
    }
    return ConversionPlan("plain_vit", options, keys, change)


LAYOUT = WeightLayout(
    name="sparsh_x",
    title="Sparsh-X (images)",
    marks={
        f"{_EMBED}.weight": (None, 6, None, None),
        "blocks.0.img.attn.qkv.weight": (None, None),
        "fusion_blocks.0.attn.qkv.weight": (None, None),
        "register_tokens": (1, None, None),
        "norm.weight": (None,),
        "img_avg": (6, 1, 1),
        "img_div": (6, 1, 1),
    },
    plan=_plan,
    prefixes=(TEACHER, ""),
    unused={
        _BANDS: "fixed positions, made anew",
        "img_*": "normalisation, contained in the weights of the patches",
    },
    outside="other networks of pre-training (student, heads)",
)
