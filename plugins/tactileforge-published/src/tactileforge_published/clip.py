"""CLIP's image tower, the baseline without touch: Hugging Face's layout and OpenCLIP's."""

from __future__ import annotations

from typing import Any

from tactileforge.encoders import CLIP_MEAN, CLIP_STD
from tactileforge_published.layout import (
    ConversionPlan,
    Keys,
    State,
    WeightLayout,
    blocks,
    depth_of,
    norms,
    size_of_width,
    square,
)

#: Our names of modules in a block -> names in the CLIP of ``transformers``.
HF_BLOCK: dict[str, str | tuple[str, ...]] = {
    "norm1": "layer_norm1",
    "attention.qkv": ("self_attn.q_proj", "self_attn.k_proj", "self_attn.v_proj"),
    "attention.out": "self_attn.out_proj",
    "norm2": "layer_norm2",
    "mlp.0": "mlp.fc1",
    "mlp.2": "mlp.fc2",
}
_OPEN_BLOCK: dict[str, str | tuple[str, ...]] = {
    "norm1": "ln_1",
    # torch's own attention: in_proj_weight, with no dot
    "attention.qkv": "attn.in_proj_{}",
    "attention.out": "attn.out_proj",
    "norm2": "ln_2",
    "mlp.0": "mlp.c_fc",
    "mlp.2": "mlp.c_proj",
}
#: Preprocessing of CLIP's images.
PIXELS: dict[str, Any] = {
    "offset": None,
    "fit": "cover",
    "filter": "bicubic",
    "mean": CLIP_MEAN,
    "std": CLIP_STD,
}


def single_frame(width: int, depth: int, positions: int, patch: int, what: str) -> dict[str, Any]:
    """Options of a `TactileViT` for one frame, without sensor tokens."""
    return {
        "size": size_of_width(width, what),
        "depth": depth,
        "frames": 1,
        "spacing": 0.0,
        "image_size": square(positions - 1, what) * patch,
        "patch": patch,
        "tube": 1,
        "sensor_tokens": 0,
        "pixels": dict(PIXELS),
    }


def _hf(state: State) -> ConversionPlan:
    tower = "vision_model"
    depth = depth_of(state, f"{tower}.encoder.layers")
    position = f"{tower}.embeddings.position_embedding.weight"
    embed = f"{tower}.embeddings.patch_embedding.weight"
    count, width = state[position].shape
    options = single_frame(width, depth, count, state[embed].shape[-1], "CLIP")
    options["projected"] = len(state["visual_projection.weight"])
    keys: Keys = {
        "class_token": f"{tower}.embeddings.class_embedding",
        "position": position,
        "embed.weight": embed,
        "project.weight": "visual_projection.weight",
    }
    keys |= norms({"norm_in": f"{tower}.pre_layrnorm", "norm_out": f"{tower}.post_layernorm"})
    keys |= blocks("transformer.blocks", f"{tower}.encoder.layers", depth, HF_BLOCK)
    return ConversionPlan("tactile_vit", options, keys, {"embed.weight": lambda x: x.flatten(1)})


def _open(state: State) -> ConversionPlan:
    depth = depth_of(state, "transformer.resblocks")
    count, width = state["positional_embedding"].shape
    options = single_frame(width, depth, count, state["conv1.weight"].shape[-1], "CLIP")
    options["projected"] = state["proj"].shape[1]
    keys: Keys = {
        "class_token": "class_embedding",
        "position": "positional_embedding",
        "embed.weight": "conv1.weight",
        "project.weight": "proj",
    }
    keys |= norms({"norm_in": "ln_pre", "norm_out": "ln_post"})
    keys |= blocks("transformer.blocks", "transformer.resblocks", depth, _OPEN_BLOCK)
    change = {"embed.weight": lambda x: x.flatten(1), "project.weight": lambda x: x.T}
    return ConversionPlan("tactile_vit", options, keys, change)


LAYOUTS = (
    WeightLayout(
        name="clip",
        title="CLIP (Hugging Face)",
        marks={
            "vision_model.embeddings.patch_embedding.weight": (None, 3, None, None),
            "vision_model.embeddings.position_embedding.weight": (None, None),
            "vision_model.pre_layrnorm.weight": (None,),
            "visual_projection.weight": (None, None),
        },
        plan=_hf,
        unused={
            "text_*": "text tower",
            "logit_*": "temperature of training",
            "*position_ids": "0, 1, 2, ...",
        },
    ),
    WeightLayout(
        name="clip",
        title="CLIP (OpenCLIP)",
        marks={
            "conv1.weight": (None, 3, None, None),
            "positional_embedding": (None, None),
            "class_embedding": (None,),
            "ln_pre.weight": (None,),
            "proj": (None, None),
        },
        plan=_open,
        prefixes=("visual.",),
        outside="text tower and temperature",
    ),
)
