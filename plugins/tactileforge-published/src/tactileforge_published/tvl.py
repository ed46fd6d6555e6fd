"""TVL: timm's vision transformer with a linear layer to CLIP's space."""

from __future__ import annotations

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
from tactileforge_published.sparsh import TIMM_BLOCK


def _plan(state: State) -> ConversionPlan:
    depth = depth_of(state, "blocks")
    projected, width = state["head.weight"].shape
    patch = state["patch_embed.proj.weight"].shape[-1]
    options = {
        "size": size_of_width(width, "TVL"),
        "depth": depth,
        "frames": 1,
        "spacing": 0.0,
        "image_size": square(state["pos_embed"].shape[1] - 1, "TVL") * patch,
        "patch": patch,
        "tube": 1,
        "positions": "learned",
        "class_token": True,
        "layer_scale": None,
        "norm": "pooled",
        "projected": projected,
        # unit vectors, as in the alignment with CLIP
        "length": 1.0,
        "pixels": {
            "offset": None,
            "fit": "pad",
            "filter": "bilinear",
            "mean": (0.29174602, 0.29713256, 0.29104045),
            "std": (0.18764469, 0.19467652, 0.21871583),
        },
    }
    keys: Keys = {"stems.0.class_token": "cls_token", "stems.0.position": "pos_embed"}
    keys |= norms({"stems.0.embed": "patch_embed.proj", "norm_out": "fc_norm", "project": "head"})
    keys |= blocks("transformer.blocks", "blocks", depth, TIMM_BLOCK)
    change = {
        "stems.0.class_token": lambda x: x.flatten(),
        "stems.0.position": lambda x: x[0],
        "stems.0.embed.weight": lambda x: x.flatten(1),
    }
    return ConversionPlan("plain_vit", options, keys, change)


LAYOUT = WeightLayout(
    name="tvl",
    title="TVL",
    marks={
        "patch_embed.proj.weight": (None, 3, None, None),
        "cls_token": (1, 1, None),
        "pos_embed": (1, None, None),
        "fc_norm.weight": (None,),
        "head.weight": (None, None),
    },
    plan=_plan,
    prefixes=("tactile_encoder.",),
    outside="temperature of training",
)
